"""Noise of the channels of a machine: what they show, and no less than digits and the rig say."""

import numpy as np
import pytest

from tests.tendon.test_machine import rig
from tssgeom.identify.machine_run import machine_run
from tssgeom.rig import with_values
from tssgeom.route.pieces import Arcs

ROUTE = [Arcs.exact(np.array([0.5]), np.array([3.0]))]
TIME = np.linspace(0.0, 6.0, 400)
STEP = np.radians(0.1)


def noise(joint, **sensor):
    motor = 0.5 * np.sin(TIME)
    columns = {"time_s": TIME, "motor_angle_rad": motor, "joint_angle_rad": joint}
    stated = with_values(rig(), {f"sensors.joint_angle_rad.{key}": value for key, value in sensor.items()})
    return machine_run("run", columns, ROUTE, stated).noise["joint_angle_rad"]


def test_noise_of_a_channel_is_no_less_than_that_of_its_digits():
    triangle = np.abs((np.arange(len(TIME)) + 100) % 200 - 100)
    for each in (1.0, 0.5, 0.1):  # steps from one reading to the next
        assert noise(STEP * np.round(each * triangle)) >= 0.999 * STEP / np.sqrt(12.0)


def test_noise_of_a_channel_is_no_less_than_the_rig_states():
    smooth = 0.2 * np.sin(TIME)
    assert noise(smooth) < 1e-6
    assert noise(smooth, noise=2e-3) == pytest.approx(2e-3)
    assert noise(smooth, resolution=1e-3) == pytest.approx(1e-3 / np.sqrt(12.0))
    read = smooth + 5e-3 * np.random.default_rng(0).standard_normal(len(TIME))
    assert noise(read, noise=2e-3) == pytest.approx(5e-3, rel=0.2)


@pytest.mark.parametrize(("constant", "named"), [(0.0, True), (0.03, False)])
def test_a_current_of_a_motor_whose_torque_constant_is_not_known_is_named(constant, named):
    columns = {"time_s": TIME, "motor_angle_rad": 0.5 * np.sin(TIME), "joint_angle_rad": 0.4 * np.sin(TIME)}
    known = with_values(rig(), {"drive.torque_constant_Nm_per_A": constant})
    run = machine_run("run", {**columns, "motor_current_A": np.cos(TIME)}, ROUTE, known)
    assert any("drive.torque_constant_Nm_per_A" in note for note in run.notes) == named
    assert ("motor_torque_Nm" in run.measured) != named


def test_a_run_that_breaks_off_and_goes_on_is_named():
    there = (TIME < 2.0) | (TIME > 3.5)
    columns = {"time_s": TIME, "motor_angle_rad": 0.5 * np.sin(TIME), "joint_angle_rad": 0.4 * np.sin(TIME)}
    broken = {name: values[there] for name, values in columns.items()}
    assert any("time_s jumps by 1.5" in note for note in machine_run("run", broken, ROUTE, rig()).notes)
    assert not machine_run("run", columns, ROUTE, rig()).notes
    sparse = columns | {
        "motor_angle_rad": np.where(
            np.arange(len(columns["time_s"])) % 10, columns["motor_angle_rad"], np.nan
        )
    }
    assert any(
        "motor_angle_rad of run is missing in" in note
        for note in machine_run("run", sparse, ROUTE, rig()).notes
    )

"""Sensors of machines that drift, and which channels speak against a part."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.identify.test_machine_discovery import (
    NOISE,
    UNKNOWN,
    columns,
    finding_of,
    held,
    lumped_run,
    rig,
    work_of_play,
)
from tssgeom.channel_names import unit_of_key
from tssgeom.identify.machine_discovery import machine_work
from tssgeom.identify.machine_evidence import contradicted, touched
from tssgeom.identify.machine_finding import MachineCampaign
from tssgeom.identify.machine_parts import _drift
from tssgeom.identify.machine_run import machine_run
from tssgeom.identify.machine_score import as_noise
from tssgeom.rig import Sensor, with_values
from tssgeom.tendon.machine import machine_of, route_of_rig
from tssgeom.tendon.machine_history import drift
from tssgeom.tendon.machine_simulation import simulated
from tssgeom.uncertain import UNKNOWNS, Uncertain, assumed

RATE, ENDS = 8e-4, 12.0


def drifted(elapsed):
    return RATE * ENDS * (1.0 - np.exp(-elapsed / ENDS))


def test_a_drift_goes_on_or_ends():
    elapsed = np.linspace(0.0, 50.0, 11)
    np.testing.assert_array_equal(drift(Sensor(drift_per_s=RATE), elapsed), RATE * elapsed)
    ending = drift(Sensor(drift_per_s=RATE, drift_time_s=ENDS), elapsed)
    np.testing.assert_allclose(ending, drifted(elapsed), rtol=1e-12)
    assert not drift(Sensor(drift_time_s=ENDS), elapsed).any()


def test_a_drift_is_expected_by_the_widest_range_and_the_longest_run():
    def run_of(span, duration):
        at = np.linspace(0.0, 1.0, 9)
        return SimpleNamespace(measured={"joint_angle_rad": span * at}, given={"time_s": duration * at})

    runs = [run_of(0.2, 10.0), run_of(1.0, 20.0), run_of(0.5, 30.0)]
    assert _drift("joint_angle_rad", runs).numbers == _drift("joint_angle_rad", [run_of(1.0, 30.0)]).numbers


def test_a_drift_has_the_unit_of_its_channel_by_second_and_a_time_that_stays_above_zero():
    assert unit_of_key("sensors.joint_angle_rad.drift_per_s") == "rad/s"
    assert unit_of_key("sensors.tension_in_1_N.drift_per_s") == "N/s"
    assert unit_of_key("sensors.tension_in_1_N.drift_time_s") == "s"
    assert assumed("sensors.joint_angle_rad.drift_time_s", 5.0, 4.0).log
    assert not assumed("sensors.joint_angle_rad.drift_per_s", 0.001, 0.002).log


def test_a_drift_counts_from_where_a_run_began_whatever_its_clock_and_its_frames():
    hardware = rig(2)
    machine = machine_of(hardware, [route_of_rig(hardware)])
    time = np.linspace(0.0, 10.0, 101)
    motor = 0.5 * np.sin(time)
    plain = simulated(machine, {"time_s": time, "motor_angle_rad": motor}).channels["joint_angle_rad"]
    off = with_values(hardware, {"sensors.joint_angle_rad.drift_per_s": RATE})
    machine = machine_of(off, [route_of_rig(off)])
    for epoch in (0.0, 1.7e9):
        history, read = None, []
        for part in np.array_split(np.arange(len(time)), 4):
            given = {"time_s": epoch + time[part], "motor_angle_rad": motor[part]}
            made = simulated(machine, given, before=history)
            read, history = [*read, made.channels["joint_angle_rad"]], made.history
        np.testing.assert_allclose(np.concatenate(read) - plain, RATE * time, atol=1e-9)


def test_a_sensor_that_drifts_is_named_and_its_misfit_goes():
    given = columns(2)
    given["joint_angle_rad"] = given["joint_angle_rad"] + drifted(given["time_s"])
    finding = finding_of(2, given)
    (effect,) = finding.effects
    assert effect.names == ("channel_drift",)
    assert finding.rig.sensors["joint_angle_rad"].drift_per_s == pytest.approx(RATE, rel=0.1)
    assert finding.rig.sensors["joint_angle_rad"].drift_time_s == pytest.approx(ENDS, rel=0.2)
    before, after = held(finding, "joint_angle_rad")
    assert after < 1.2 * NOISE["joint_angle_rad"] < 0.4 * before


def test_a_play_between_joint_and_encoder_touches_no_torque():
    hardware = rig(2)
    run = machine_run("run", columns(2, end_play=0.01), [route_of_rig(hardware)], hardware)
    uncertain = tuple(Uncertain(key, UNKNOWNS[key], stated=False) for key in UNKNOWN)
    model = machine_work(MachineCampaign("bench", hardware, uncertain, (run,)))[0].chosen.model
    assert [part.name for part in model.parts] == ["end_play"]
    assert touched(model, model.parts) == {"joint_angle_rad"}
    assert touched(model, ()) == set()


def test_a_channel_that_a_part_does_not_touch_does_not_contradict_it():
    rises = {"joint_angle_rad": -50.0, "motor_torque_Nm": 18.0}
    assert contradicted(rises) == "motor_torque_Nm"
    assert contradicted(rises, {"joint_angle_rad"}) == ""


def test_readings_that_leave_noise_alone_have_its_weight():
    base = work_of_play().chosen.base
    (weight,) = as_noise(base).state.weight
    assert 1.0 / weight[0] == pytest.approx(NOISE["joint_angle_rad"], rel=0.2)
    assert max(base.state.weight[0]) < 0.5 * weight[0]  # which leaves the play as well
    assert len(lumped_run(2, 0.0)[0]) == len(weight) + base.problem.runs[0].held_out.sum()

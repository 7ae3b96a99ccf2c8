"""Sensors of a machine that are no straight line."""

import msgspec
import numpy as np
import pytest

from tests.identify.test_machine_discovery import NOISE, finding_of, held, rig
from tests.identify.test_machine_joint_load import columns
from tssgeom.effects import SensorLaw
from tssgeom.errors import SettingsError
from tssgeom.tendon.machine import machine_of, route_of_rig
from tssgeom.tendon.machine_simulation import simulate_machine

CUBIC = 0.25  # of the greatest torque


def test_a_cell_that_is_bent_gets_its_curve_and_nothing_else_a_name():
    read = columns(16, torque=True)
    torque, most = read["motor_torque_Nm"], np.abs(read["motor_torque_Nm"]).max()
    read["motor_torque_Nm"] = torque + CUBIC * torque**3 / most**2
    finding = finding_of(2, read)
    assert finding.verdict == "law"
    (effect,) = finding.effects
    assert effect.names == ("sensor_curve",)
    (law,) = finding.rig.effects
    assert (law.channel, law.over, effect.law.unit) == ("motor_torque_Nm", "reading", "N·m")
    read_there = effect.law.x + effect.law.value
    true = np.array([k * effect.law.x for k in np.linspace(0.5, 1.5, 1001)])  # nothing states how stiff it is
    off = np.abs(true + CUBIC * true**3 / most**2 - read_there).max(axis=1)
    assert off.min() < 0.02 * most
    before, after = held(finding, "motor_torque_Nm")
    assert after < min(1.6 * NOISE["motor_torque_Nm"], 0.25 * before)


def test_a_cell_that_swings_in_time_gets_its_drift_as_a_law():
    runs = [columns(seed, torque=True) for seed in (17, 18, 19)]
    most = max(np.abs(read["motor_torque_Nm"]).max() for read in runs)
    for read in runs:
        read["motor_torque_Nm"] = read["motor_torque_Nm"] + swing(read["time_s"], most)
    finding = finding_of(2, *runs)
    assert finding.verdict == "law"
    effect, *others = finding.effects
    assert (effect.names, effect.law.over) == (("sensor_drift",), "time_s")
    assert all(one.names == ("channel_zero",) for one in others)  # the mean of the swing
    (law,) = finding.rig.effects
    assert (law.channel, law.over) == ("motor_torque_Nm", "time")
    off = effect.law.value - swing(effect.law.x, most)
    assert np.std(off) < 0.015 * most  # each run has a zero of its own
    before, after = held(finding, "motor_torque_Nm")
    assert after < min(1.6 * NOISE["motor_torque_Nm"], 0.25 * before)


def swing(time, most):
    return 0.1 * most * np.sin(2.0 * np.pi * time / 30.0 + 1.0)


@pytest.mark.parametrize("over", ["reading", "time"])
def test_a_channel_reads_beside_the_truth_and_what_is_given_may_not(over):
    time = np.linspace(0.0, 10.0, 101)
    run = {"time_s": time, "motor_angle_rad": 0.5 * np.sin(time)}
    plain = rig(2)

    def read(*laws):
        with_laws = msgspec.structs.replace(plain, effects=laws)
        return simulate_machine(machine_of(with_laws, [route_of_rig(with_laws)]), run)

    x = (-1.0, 1.0) if over == "reading" else (0.0, 10.0)
    law = SensorLaw(channel="joint_angle_rad", over=over, x=x, error=(-0.1, 0.1))
    true = read()["joint_angle_rad"]
    wanted = 0.1 * true if over == "reading" else 0.02 * (time - time[0]) - 0.1
    np.testing.assert_allclose(read(law)["joint_angle_rad"] - true, wanted, atol=1e-9)
    with pytest.raises(SettingsError, match="motor_angle_rad is given and not an answer"):
        read(msgspec.structs.replace(law, channel="motor_angle_rad"))

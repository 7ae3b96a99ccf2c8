"""What a joint carries: loads that harden with its angle, weights, and springs, each by its own name."""

import numpy as np
import pytest

from tests import lumped
from tests.identify.test_machine_discovery import (
    ANGLE,
    ARM,
    LENGTH,
    MU,
    NOISE,
    PRETENSION,
    RHO,
    STIFF,
    finding_of,
    held,
)
from tssgeom.effects import LoadLaw

HARDENING = 0.2  # N·m/rad³: of 0.25 N·m/rad at 0.6 rad a quarter


def columns(seed, *, torque, **load):
    """What a laboratory would read of a pair whose joint has such a load."""
    time = np.linspace(0.0, 48.0, 481)
    rate = np.where((time // 12.0) % 2 == 0, 1.0, 3.0)
    phase = np.cumsum(rate * np.gradient(time)) * 2.0 * np.pi / 12.0
    motor = 0.9 * np.sin(phase) * (0.7 + 0.3 * np.cos(phase / 5.0))
    path = lumped.from_pieces([LENGTH], [ANGLE], cells=60)
    physics = lumped.Physics(pretension_N=PRETENSION, friction=MU, compliance_per_N=RHO)
    drive = lumped.Motor("angle", time, motor, ARM)
    run = lumped.simulate_machine([(path, physics)] * 2, drive, lumped.Joint(ARM, STIFF, **load), time, 0.1)
    assert run.joint_angle is not None
    assert run.motor_torque is not None
    rng = np.random.default_rng(seed)
    read = {"joint_angle_rad": run.joint_angle} | ({"motor_torque_Nm": run.motor_torque} if torque else {})
    noisy = {name: values + rng.normal(0.0, NOISE[name], len(time)) for name, values in read.items()}
    return {"time_s": time, "motor_angle_rad": motor, **noisy}


@pytest.mark.parametrize("torque", [True, False], ids=["torque", "displacement only"])
def test_a_load_that_hardens_is_named_and_its_misfit_goes(torque):
    finding = finding_of(2, columns(11, torque=torque, hardening_Nm_per_rad3=HARDENING))
    assert finding.verdict == "effect"
    (effect,) = finding.effects
    assert effect.names == ("joint_hardening",)
    number = effect.parameters[0]["hardening_Nm_per_rad3"]
    assert number.low < HARDENING < number.high
    assert number.unit == "N·m/rad³"
    assert finding.rig.end.hardening_Nm_per_rad3 == number.value
    before, after = held(finding, "joint_angle_rad")
    assert before > 4.0 * NOISE["joint_angle_rad"]
    assert after < 1.2 * NOISE["joint_angle_rad"]


def square(at):
    return 0.15 * at * np.abs(at), 0.3 * np.abs(at)


def test_a_load_without_a_formula_is_learnt_with_its_band():
    finding = finding_of(2, columns(14, torque=True, spring=square))
    assert finding.verdict == "law"
    (effect,) = finding.effects
    assert effect.names == ("load_over_position",)
    law = effect.law
    assert (law.over, law.unit) == ("joint_angle_rad", "N·m")
    whole = finding.rig.end.stiffness_Nm_per_rad * law.x
    true = STIFF * law.x + square(law.x)[0]
    np.testing.assert_allclose(whole + law.value, true, atol=2e-3)  # of 0.22 N·m
    assert np.mean((whole + law.low <= true) & (true <= whole + law.high)) > 0.8
    before, after = held(finding, "joint_angle_rad")
    assert after < min(1.5 * NOISE["joint_angle_rad"], 0.1 * before)
    (kept,) = finding.rig.effects
    assert isinstance(kept, LoadLaw)
    assert kept.torque[5] == kept.x[5] == 0.0  # at rest


def test_a_spring_alone_has_no_name():
    assert finding_of(2, columns(12, torque=True)).verdict == "none"


def test_a_weight_is_no_load_that_hardens():
    finding = finding_of(2, columns(13, torque=True, gravity_Nm=0.05))
    assert [effect.names for effect in finding.effects] == [("joint_weight",)]


def test_a_part_that_helps_where_something_remains_is_no_whole_answer():
    read = columns(15, torque=True)
    wave = 3e-3 * np.sin(2.0 * np.pi * read["time_s"] / 1.7)  # of nothing that a machine has
    read["joint_angle_rad"] = 1.03 * read["joint_angle_rad"] + wave
    finding = finding_of(2, read)
    assert finding.verdict == "partial"
    assert [effect.names for effect in finding.effects] == [("channel_gain",)]
    assert "Something remains that has no name here" in finding.sentence
    before, after = held(finding, "joint_angle_rad")
    assert 3.0 * NOISE["joint_angle_rad"] < after < 0.5 * before

"""The angle of a motor that turns a joint as wanted: run forward, the joint goes there."""

import numpy as np
import pytest
from msgspec.structs import replace as changed

from tests.tendon.test_machine import HALF_CIRCLE, rig
from tssgeom import compensate
from tssgeom.errors import SettingsError
from tssgeom.mechanism import Drive, End
from tssgeom.rig import Rig, Tendon
from tssgeom.tendon.machine import machine_of
from tssgeom.tendon.machine_command import command_machine
from tssgeom.tendon.machine_simulation import simulate_machine

TIME = np.linspace(0.0, 10.0, 121)


@pytest.mark.parametrize(("width", "of_end"), [(0.0, 0.0), (0.03, 0.0), (0.0, 0.02), (0.03, 0.02)])
def test_the_joint_goes_where_it_is_wanted(width, of_end):
    drive = Drive(kind="pair", radius_m=0.01, play_rad=width)
    hardware = changed(rig(), drive=drive, end=changed(rig().end, play_rad=of_end))
    machine, target = machine_of(hardware, [HALF_CIRCLE]), 0.4 * np.sin(TIME) * np.cos(TIME / 3)
    load = 0.01 * np.sin(TIME / 2)
    commands = command_machine(machine, TIME, {"joint_angle_rad": target}, load)
    assert commands.reached.all()
    run = {"time_s": TIME, "motor_angle_rad": commands.inputs[:, 0], "joint_torque_Nm": load}
    done = simulate_machine(machine, run)
    np.testing.assert_allclose(done["joint_angle_rad"], target, atol=1e-6)
    np.testing.assert_allclose(done["joint_angle_rad"], commands.outputs[:, 0], atol=1e-6)


def test_the_motor_crosses_the_dead_zone_where_the_joint_turns_back():
    machine = machine_of(rig(), [HALF_CIRCLE])
    target = np.concatenate([np.linspace(0.0, 0.3, 31), np.linspace(0.29, 0.2, 10)])
    angle = command_machine(machine, np.arange(41.0), {"joint_angle_rad": target}).inputs[:, 0]
    steps = np.diff(angle)
    assert abs(steps[30]) > 3.0 * np.max(np.abs(steps[2:30]))


def test_a_target_out_of_reach_is_marked_and_the_others_are_followed():
    """Tendons that can be slack leave a joint with its load, however far the motor goes the other way."""
    one = changed(rig(1.0, 0.0), drive=Drive(kind="tendon", radius_m=0.01))
    machine = machine_of(one, [HALF_CIRCLE])
    commands = command_machine(machine, np.arange(4.0), {"joint_angle_rad": np.array([0.05, 0.1, -0.5, 0.1])})
    np.testing.assert_array_equal(commands.reached, [True, True, False, True])
    assert commands.outputs[:, 0][2] == pytest.approx(-0.01 * 1.0 / 0.2, rel=1e-6)  # the spring of the joint


def test_what_has_no_motor_or_no_end_that_follows_is_refused():
    machine = machine_of(changed(rig(), drive=Drive(kind="pair")), [HALF_CIRCLE])
    with pytest.raises(SettingsError, match=r"drive\.radius_m > 0"):
        command_machine(machine, np.arange(2.0), {"joint_angle_rad": np.zeros(2)})
    with pytest.raises(SettingsError, match="no target: give joint_angle_rad"):
        command_machine(machine_of(rig(), [HALF_CIRCLE]), np.arange(2.0), {"bending_x_rad": np.zeros(2)})


@pytest.mark.parametrize(
    ("kind", "channel", "target", "miss"),
    [
        ("weight", "displacement_out_m", 2e-3 * np.sin(TIME) + 1e-3 * (1.0 - np.cos(TIME / 2)), 1e-6),
        ("blocked", "tension_out_N", 6.0 + 2.0 * np.sin(TIME), 1e-6),
    ],
)
def test_one_tendon_with_a_weight_or_blocked_goes_where_it_is_wanted(kind, channel, target, miss):
    hardware = Rig(tendon=Tendon(pretension_N=5.0), end=End(kind=kind))
    commands = compensate(HALF_CIRCLE, {"time_s": TIME, channel: target}, hardware)
    moved = commands.to_pandas()["displacement_in_m"].to_numpy()
    done = simulate_machine(machine_of(hardware, [HALF_CIRCLE]), {"time_s": TIME, "displacement_in_m": moved})
    np.testing.assert_allclose(done[channel], target, atol=miss)

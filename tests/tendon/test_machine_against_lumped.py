"""Machines beside the independent lumped chains: pairs, joints, motors, segments."""

import numpy as np
import pytest

from tests import lumped
from tssgeom.effects import FrictionLaw, LoadLaw
from tssgeom.errors import SettingsError
from tssgeom.mechanism import Drive, End
from tssgeom.rig import Friction, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import machine_of
from tssgeom.tendon.machine_simulation import simulate_machine

LENGTHS, ANGLES = [0.1, 0.3, 0.1], [0.5, 3.0, 0.2]
PRETENSION, MU, RHO, R = 6.0, 0.12, 2.5e-4, 0.01
TIMES = np.linspace(0.0, 20.0, 401)
PHYSICS = {"pretension_N": PRETENSION, "friction": MU, "compliance_per_N": RHO}
CLOSE = {"rad": 2e-3, "Nm": 2e-3, "N": 0.25}  # rad, N·m, N: of 1 rad, 0.3 N·m and 30 N


def route():
    return Arcs.exact(np.array(LENGTHS), np.array(ANGLES))


def tendons(count):
    path = lumped.from_pieces(LENGTHS, ANGLES, cells=100)
    return [(path, lumped.Physics(**PHYSICS))] * count


def rig(**parts):
    own = {
        "tendon": Tendon(pretension_N=PRETENSION, compliance_per_N=RHO),
        "friction": Friction(coefficient=MU),
    }
    return Rig(**own | parts)


def compared(expected, columns, hardware, *, bars=24, end_given=False):
    out = simulate_machine(machine_of(hardware, [route()], bars), columns, end_given=end_given)
    for name, values in expected.items():
        close = CLOSE[name.rpartition("_")[2]]
        off = np.abs(out[name] - values)
        assert np.sqrt(np.mean(off**2)) < 0.3 * close, name
        assert np.max(off) < close, name


@pytest.mark.parametrize(("gravity", "hardening"), [(0.0, 0.0), (0.1, 0.0), (0.05, 0.3)])
def test_a_pair_on_a_motor_turns_a_joint_as_the_lumped_chains_do(gravity, hardening):
    angle, load = 0.9 * np.sin(TIMES / 2) * np.cos(TIMES / 7), 0.03 * np.sin(TIMES / 3)
    joint = lumped.Joint(R, 0.25, gravity, 0.4, hardening, load=(TIMES, load))
    run = lumped.simulate_machine(
        tendons(2), lumped.Motor("angle", TIMES, angle, R, play_rad=0.02), joint, TIMES
    )
    end = End(
        kind="joint",
        radius_m=R,
        stiffness_Nm_per_rad=0.25,
        gravity_Nm=gravity,
        gravity_at_rad=0.4,
        hardening_Nm_per_rad3=hardening,
    )
    hardware = rig(drive=Drive(kind="pair", radius_m=R, play_rad=0.02), end=end)
    expected = {
        "joint_angle_rad": run.joint_angle,
        "motor_torque_Nm": run.motor_torque,
        "tension_in_1_N": run.tendons[0].tension_in,
        "tension_out_2_N": run.tendons[1].tension_out,
    }
    given = {"time_s": TIMES, "motor_angle_rad": angle, "joint_torque_Nm": load}
    compared(expected, given, hardware)


STOP = LoadLaw(x=(-1.4, -0.32, -0.3, 0.3, 0.32, 1.4), torque=(-0.22, -0.004, 0.0, 0.0, 0.004, 0.22))
"""A torque of 0.2 N·m/rad beyond 0.3 rad, nearly."""


def stop(at):
    beyond = np.sign(at) * np.maximum(np.abs(at) - 0.3, 0.0)
    return 0.2 * beyond, 0.2 * (beyond != 0.0)


@pytest.mark.parametrize("given", ["torque", "angle"])
def test_a_law_of_the_torque_of_a_joint_is_that_of_the_lumped_chains(given):
    angle, held = 0.9 * np.sin(TIMES / 2), 0.6 * np.sin(TIMES / 2)
    of_joint = {"spring": stop} | ({"angle": (TIMES, held)} if given == "angle" else {})
    joint = lumped.Joint(R, 0.25, **of_joint)
    run = lumped.simulate_machine(tendons(2), lumped.Motor("angle", TIMES, angle, R), joint, TIMES)
    end = End(kind="joint", radius_m=R, stiffness_Nm_per_rad=0.25, given=given)
    hardware = rig(drive=Drive(kind="pair", radius_m=R), end=end, effects=(STOP,))
    expected = {"joint_angle_rad": run.joint_angle, "tension_out_2_N": run.tendons[1].tension_out}
    columns = {"time_s": TIMES, "motor_angle_rad": angle}
    if given == "angle":
        expected, columns = {"joint_torque_Nm": run.load_torque}, columns | {"joint_angle_rad": held}
    compared(expected, columns, hardware, end_given=given == "angle")


def test_a_law_of_a_joint_is_refused_of_another_end():
    with pytest.raises(SettingsError, match="load_law acts on a joint"):
        rig(effects=(STOP,))


def test_the_torque_that_holds_a_joint_is_that_of_the_lumped_chains():
    angle, held = 0.9 * np.sin(TIMES / 2), 0.6 * np.sin(TIMES / 2 - 0.2)
    held = held - held[0]
    joint = lumped.Joint(R, 0.25, hardening_Nm_per_rad3=0.3, angle=(TIMES, held))
    run = lumped.simulate_machine(tendons(2), lumped.Motor("angle", TIMES, angle, R), joint, TIMES)
    end = End(kind="joint", radius_m=R, stiffness_Nm_per_rad=0.25, hardening_Nm_per_rad3=0.3, given="angle")
    hardware = rig(drive=Drive(kind="pair", radius_m=R), end=end)
    given = {"time_s": TIMES, "motor_angle_rad": angle, "joint_angle_rad": held}
    expected = {"motor_torque_Nm": run.motor_torque, "joint_torque_Nm": run.load_torque}
    compared(expected, given, hardware, end_given=True)


def test_a_segment_bends_as_the_lumped_chains_do():
    around = (0.0, 120.0, 240.0)
    pulls = [1.5e-3 * np.sin(TIMES / 2 + phase) * TIMES / 20.0 for phase in (0.0, 2.1, 4.2)]
    drives = [lumped.Drive("displacement", TIMES, pull) for pull in pulls]
    segment = lumped.Segment(0.0045, tuple(np.radians(around)), 0.05, 0.06, 0.008)
    run = lumped.simulate_machine(tendons(3), drives, segment, TIMES)
    end = End(
        kind="segment",
        radius_m=0.0045,
        stiffness_Nm_per_rad=0.05,
        tendon_angles_deg=around,
        length_m=0.06,
        marker_m=0.008,
    )
    hardware = rig(drive=Drive(kind="tendons"), end=end)
    given = {"time_s": TIMES} | {f"displacement_in_{i + 1}_m": pull for i, pull in enumerate(pulls)}
    expected = {
        "bending_x_rad": run.bending[:, 0],
        "bending_y_rad": run.bending[:, 1],
        "tension_out_3_N": run.tendons[2].tension_out,
    }
    compared(expected, given, hardware)


@pytest.mark.parametrize(("lag_s", "close_rad"), [(0.4, 2e-4), (0.1, 1e-4)])
def test_friction_that_follows_a_falling_speed_late_does_so_within_a_reading(lag_s, close_rad):
    peak, decay, arm = 0.4, 2e-3, 0.008
    time = np.linspace(0.0, 48.0, 481)
    phase = np.cumsum(np.where((time // 12.0) % 2 == 0, 1.0, 3.0)) * 2.0 * np.pi * 0.1 / 12.0
    motor = 0.9 * np.sin(phase)
    path = lumped.from_pieces([0.8], [5.0], cells=60)
    falling = {"stribeck_gain": peak, "stribeck_speed_m_per_s": decay, "speed_lag_s": lag_s}
    ends = [(path, lumped.Physics(**PHYSICS, **falling))] * 2
    drive, joint = lumped.Motor("angle", time, motor, arm), lumped.Joint(arm, 0.4)
    run = lumped.simulate_machine(ends, drive, joint, time, 0.1)
    speeds = 0.014 * np.append(0.0, np.geomspace(0.02, 1.0, 11))
    factors = 1.0 + peak * np.exp(-speeds / decay)
    law = FrictionLaw(over="speed", x=tuple(speeds), factor=tuple(factors), memory_s=lag_s)
    end = End(kind="joint", radius_m=arm, stiffness_Nm_per_rad=0.4)
    hardware = rig(drive=Drive(kind="pair", radius_m=arm), end=end, effects=(law,))
    machine = machine_of(hardware, [Arcs.exact(np.array([0.8]), np.array([5.0]))], 12)
    out = simulate_machine(machine, {"time_s": time, "motor_angle_rad": motor})
    assert run.joint_angle is not None
    off = out["joint_angle_rad"] - run.joint_angle
    assert np.sqrt(np.mean(off**2)) < close_rad  # with the speed before each reading 1.3e-3 and 3.2e-3

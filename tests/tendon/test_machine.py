"""Machines against closed forms: pairs, joints, motors by torque, segments, plays and sensors."""

import math

import numpy as np
import pytest
from msgspec.structs import replace as changed

from tssgeom.effects import HiddenBend, SheathClearance
from tssgeom.errors import FitError, SettingsError
from tssgeom.mechanism import Drive, End, GivenRoute, tip
from tssgeom.rig import Friction, Rig, Sensor, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.sensors import play
from tssgeom.tendon.machine import BARS, Start, at_rest, held_tensions, machine_of, routed
from tssgeom.tendon.machine_simulation import simulate_machine as simulate
from tssgeom.tendon.state import HALVINGS

PI, MU, RHO = math.pi, 0.145, 3.16e-4
R, K = 0.01, 0.2
HALF_CIRCLE, BENT = (
    Arcs.exact(np.array([0.5]), np.array([PI])),
    Arcs.exact(np.full(2, 0.3), np.array([1.0, 0.5])),
)
SOFT = 1.0 / (RHO * 0.5)  # stiffness of 0.5 m of tendon [N/m]
SOLVED = 1e-7
END_BAR = MU * PI / BARS / 2**HALVINGS  # what the friction of an outermost bar may hold, as a share


def rig(pretension=5.0, friction=MU, **others):
    drive = Drive(kind="pair", radius_m=R)
    end = End(kind="joint", radius_m=R, stiffness_Nm_per_rad=K)
    return changed(
        Rig(
            tendon=Tendon(pretension_N=pretension),
            friction=Friction(coefficient=friction),
            drive=drive,
            end=end,
        ),
        **others,
    )


def run(hardware, routes, start=None, end_given=False, **columns):
    """Take a machine through columns, with samples of one second."""
    columns = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    count = len(next(iter(columns.values())))
    given = {"time_s": np.arange(count, dtype=float), **columns}
    return simulate(machine_of(hardware, routes), given, start=start, end_given=end_given)


@pytest.mark.parametrize("torque", [0.0, 0.02, -0.03])
def test_without_friction_the_joint_turns_as_two_springs_say(torque):
    drive = 0.2
    out = run(rig(friction=0.0), [HALF_CIRCLE], motor_angle_rad=[drive], joint_torque_Nm=[torque])
    expected = (2 * R * R * SOFT * drive - torque) / (K + 2 * R * R * SOFT)
    assert out["joint_angle_rad"][0] == pytest.approx(expected, rel=SOLVED)
    assert out["tension_out_1_N"][0] == pytest.approx(5.0 + SOFT * R * (drive - expected), rel=SOLVED)
    pulled = R * (out["tension_in_1_N"][0] - out["tension_in_2_N"][0])
    assert out["motor_torque_Nm"][0] == pytest.approx(pulled, rel=SOLVED)


def test_a_tendon_that_goes_slack_leaves_the_joint_to_the_other():
    out = run(rig(0.5, 0.0), [HALF_CIRCLE], motor_angle_rad=[0.3, 0.0])
    expected = R * (0.5 + SOFT * R * 0.3) / (K + R * R * SOFT)
    assert out["joint_angle_rad"][0] == pytest.approx(expected, rel=SOLVED)
    assert out["tension_out_2_N"][0] == 0.0
    assert out["joint_angle_rad"][1] == pytest.approx(0.0, abs=1e-8)


def test_a_second_tendon_with_slack_pulls_once_that_is_taken_up():
    slack = changed(rig(2.0, 0.0), drive=Drive(kind="pair", radius_m=R, slack_m=2e-3))
    out = run(slack, [HALF_CIRCLE], motor_angle_rad=[0.0, -0.1, -0.6])
    np.testing.assert_array_equal(out["tension_out_2_N"][:2], 0.0)
    assert out["tension_out_2_N"][2] > 0.0
    joint = K * out["joint_angle_rad"] + R * 2.0 - R * (out["tension_out_1_N"] - out["tension_out_2_N"])
    np.testing.assert_allclose(joint, 0.0, atol=1e-8)


def test_with_friction_the_pulled_tendon_loses_and_the_other_one_gains_tension():
    out = run(rig(), [HALF_CIRCLE, BENT], tension_in_1_N=[30.0], tension_in_2_N=[5.0])
    pulled, let_out = 30.0 * math.exp(-MU * PI), 5.0 * math.exp(MU * 1.5)
    assert out["tension_out_1_N"][0] == pytest.approx(pulled, rel=SOLVED)
    assert out["tension_out_2_N"][0] == pytest.approx(let_out, rel=SOLVED)
    assert out["joint_angle_rad"][0] == pytest.approx(R * (pulled - let_out) / K, rel=SOLVED)


def test_a_small_reversal_is_lost_in_both_sheaths():
    out = run(rig(), [HALF_CIRCLE, BENT], tension_in_1_N=[30.0, 26.0, 5.0], tension_in_2_N=[5.0, 5.5, 30.0])
    assert out["joint_angle_rad"][1] == pytest.approx(out["joint_angle_rad"][0], rel=1e-6)
    assert out["joint_angle_rad"][2] < 0.0


def test_pulling_both_alike_on_like_routes_does_not_turn_the_joint():
    out = run(rig(), [HALF_CIRCLE], tension_in_1_N=[20.0], tension_in_2_N=[20.0])
    assert out["joint_angle_rad"][0] == pytest.approx(0.0, abs=1e-12)
    assert out["tension_out_1_N"][0] == pytest.approx(20.0 * math.exp(-MU * PI), rel=END_BAR)


def test_the_torque_of_a_motor_turns_it_as_its_angle_did():
    angle = 0.8 * np.sin(np.linspace(0.0, 9.0, 60))
    by_angle = run(rig(), [HALF_CIRCLE], motor_angle_rad=angle)
    torque = by_angle["motor_torque_Nm"]
    by_torque = run(rig(), [HALF_CIRCLE], motor_torque_Nm=torque)
    np.testing.assert_allclose(by_torque["motor_angle_rad"], angle, atol=2e-4)
    np.testing.assert_allclose(by_torque["joint_angle_rad"], by_angle["joint_angle_rad"], atol=2e-4)
    by_current = run(
        changed(rig(), drive=changed(rig().drive, torque_constant_Nm_per_A=0.05)),
        [HALF_CIRCLE],
        motor_current_A=torque / 0.05,
    )
    np.testing.assert_allclose(by_current["motor_angle_rad"], by_torque["motor_angle_rad"], atol=1e-9)


def test_a_joint_that_is_held_where_it_went_feels_the_torque_that_acted():
    motor, load = 0.8 * np.sin(np.linspace(0.0, 9.0, 60)), 0.02 * np.sin(np.linspace(0.0, 5.0, 60))
    heavy = changed(rig(), end=changed(rig().end, gravity_Nm=0.05, gravity_at_rad=0.4))
    free = run(heavy, [HALF_CIRCLE], motor_angle_rad=motor, joint_torque_Nm=load)
    held = run(
        heavy, [HALF_CIRCLE], end_given=True, motor_angle_rad=motor, joint_angle_rad=free["joint_angle_rad"]
    )
    np.testing.assert_allclose(held["joint_torque_Nm"], load, atol=1e-6)


def test_gravity_alone_turns_a_joint_to_where_its_moment_balances_the_spring():
    """Without tension the tendons do nothing: K θ + G (sin(θ + θ_g) − sin θ_g) = −τ."""
    loose = changed(rig(0.0, 0.0), end=changed(rig().end, gravity_Nm=0.3, gravity_at_rad=0.5))
    out = run(loose, [HALF_CIRCLE], tension_in_1_N=[0.0], tension_in_2_N=[0.0], joint_torque_Nm=[-0.1])
    angle = out["joint_angle_rad"][0]
    assert K * angle + 0.3 * (math.sin(angle + 0.5) - math.sin(0.5)) == pytest.approx(0.1, rel=1e-6)


def test_three_tendons_without_friction_bend_a_segment_as_springs_do():
    """Σ d cos α_i k (x_i − d b·α_i) = K b, and Σ α_i α_iᵀ is 3/2 of the identity."""
    d, stiffness = 0.0045, 0.05
    end = End(kind="segment", radius_m=d, stiffness_Nm_per_rad=stiffness, tendon_angles_deg=(0, 120, 240))
    hardware = changed(rig(20.0, 0.0), drive=Drive(kind="tendons"), end=end)
    pulled = np.array([1e-3, -0.4e-3, -0.3e-3])
    out = run(hardware, [HALF_CIRCLE], **{f"displacement_in_{i + 1}_m": [x] for i, x in enumerate(pulled)})
    around = np.radians([0.0, 120.0, 240.0])
    across = np.column_stack([np.cos(around), np.sin(around)])
    expected = d * SOFT * across.T @ pulled / (stiffness + 1.5 * d * d * SOFT)
    bending = np.array([out["bending_x_rad"][0], out["bending_y_rad"][0]])
    np.testing.assert_allclose(bending, expected, rtol=1e-6)


def test_the_tip_of_a_segment_is_on_its_arc():
    end = End(
        kind="segment",
        radius_m=0.004,
        tendon_angles_deg=(0.0, 120.0, 240.0),
        length_m=0.06,
        marker_m=0.008,
    )
    angle = 0.7
    x, y, z = tip(np.array([[0.0, angle]]), end)[0]
    assert x == pytest.approx(0.0, abs=1e-15)
    assert y == pytest.approx(0.06 / angle * (1 - math.cos(angle)) + 0.008 * math.sin(angle))
    assert z == pytest.approx(0.06 / angle * math.sin(angle) + 0.008 * math.cos(angle))
    np.testing.assert_allclose(tip(np.zeros((1, 2)), end)[0], [0.0, 0.0, 0.068], rtol=1e-12)


def test_effects_act_in_every_tendon():
    bent = changed(rig(), effects=(HiddenBend(at_m=0.2, angle_rad=0.5),))
    plain, more = (
        run(each, [HALF_CIRCLE], tension_in_1_N=[30.0], tension_in_2_N=[5.0]) for each in (rig(), bent)
    )
    ratio = more["tension_out_1_N"][0] / plain["tension_out_1_N"][0]
    assert ratio == pytest.approx(math.exp(-MU * 0.5), rel=1e-6)
    assert more["tension_out_2_N"][0] / plain["tension_out_2_N"][0] == pytest.approx(1 / ratio, rel=1e-6)


def test_what_friction_holds_at_the_start_is_felt_in_the_first_motion():
    """A tendon that was pulled before slides at once, one that was let out has to be turned first."""
    machine = machine_of(rig(), [HALF_CIRCLE])
    after_pull = held_tensions(machine, Start(np.array([1.0, -1.0])))
    np.testing.assert_allclose(after_pull[0, 0] / after_pull[0, -1], math.exp(MU * PI), rtol=1e-9)
    np.testing.assert_allclose(held_tensions(machine, at_rest(2)), 5.0)
    angle = np.linspace(0.0, 0.05, 6)
    ready, turned = (
        run(rig(), [HALF_CIRCLE], start=Start(np.array([way, -way])), motor_angle_rad=angle)[
            "joint_angle_rad"
        ]
        for way in (1.0, -1.0)
    )
    assert ready[-1] > 2.0 * turned[-1] > 0.0


def test_play_zero_gain_and_lag_of_channels():
    angle = np.array([0.0, 0.2, 0.1, 0.05, -0.2])
    np.testing.assert_allclose(play(angle, 0.15), [0.0, 0.2, 0.2, 0.2, -0.05])
    sensor = Sensor(zero=0.1, gain=2.0)
    plain = run(rig(), [HALF_CIRCLE], motor_angle_rad=angle)
    read = run(rig(sensors={"joint_angle_rad": sensor}), [HALF_CIRCLE], motor_angle_rad=angle)
    np.testing.assert_allclose(read["joint_angle_rad"], 0.1 + 2.0 * plain["joint_angle_rad"])
    off = run(rig(sensors={"motor_angle_rad": sensor}), [HALF_CIRCLE], motor_angle_rad=0.1 + 2.0 * angle)
    np.testing.assert_allclose(off["joint_angle_rad"], plain["joint_angle_rad"], atol=1e-12)
    late = run(rig(sensors={"joint_angle_rad": Sensor(lag_s=1.0)}), [HALF_CIRCLE], motor_angle_rad=angle)
    assert 0.0 < late["joint_angle_rad"][1] < plain["joint_angle_rad"][1]


def test_what_does_not_go_together_is_refused():
    with pytest.raises(SettingsError, match=r"end\.radius_m is 0"):
        End(kind="joint")
    with pytest.raises(SettingsError, match=r"give end\.kind"):
        machine_of(changed(rig(), end=End()), [HALF_CIRCLE])
    with pytest.raises(SettingsError, match="3 routes for 2 tendons"):
        machine_of(rig(), [HALF_CIRCLE] * 3)
    with pytest.raises(SettingsError, match="no drive: give one of motor_angle_rad, displacement_in_1_m"):
        run(rig(), [HALF_CIRCLE], joint_torque_Nm=[0.0])
    with pytest.raises(SettingsError, match=r"drive\.radius_m is 0"):
        run(changed(rig(), drive=Drive(kind="pair")), [HALF_CIRCLE], motor_angle_rad=[0.1])
    with pytest.raises(SettingsError, match=r"two angles"):
        End(kind="segment", radius_m=0.01, tendon_angles_deg=(0.0,))


def test_friction_of_a_joint_makes_a_play_whose_width_follows_from_springs_alone():
    """Two straight tendons without friction are two springs: the joint follows the motor with a play."""
    soft, length, pulley, arm, spring, friction = 2e-4, 0.5, 0.01, 0.008, 0.3, 0.02
    hardware = Rig(
        tendon=Tendon(pretension_N=30.0, compliance_per_N=soft),
        friction=Friction(coefficient=0.0),
        drive=Drive(kind="pair", radius_m=pulley),
        end=End(kind="joint", radius_m=arm, stiffness_Nm_per_rad=spring, friction_Nm=friction),
    )
    time = np.linspace(0.0, 20.0, 400)
    motor = 0.3 * np.sin(time) * (1.0 - 0.03 * time)
    machine = machine_of(hardware, [Arcs.exact(np.array([length]), np.array([0.0]))])
    out = simulate(machine, {"time_s": time, "motor_angle_rad": motor})
    stiff = 2.0 / (soft * length)  # N/m of both tendons
    half = friction / (stiff * arm * pulley)
    followed, at = [], 0.0
    for value in motor:
        at = min(max(at, value - half), value + half)
        followed.append(at)
    gain = stiff * arm * pulley / (stiff * arm**2 + spring)
    np.testing.assert_allclose(out["joint_angle_rad"], gain * np.array(followed), atol=1e-6)
    assert np.ptp(motor) > 20.0 * half
    assert half > 1e-3


@pytest.mark.parametrize("friction", [0.3, 0.5, 0.55])
def test_a_band_that_keeps_a_millionth_of_its_tension_has_an_equilibrium(friction):
    band = changed(
        rig(160.0, friction),
        tendon=Tendon(pretension_N=160.0, compliance_per_N=2e-5),
        drive=Drive(radius_m=1.0),
        end=End(kind="carried"),
        effects=(SheathClearance(clearance_m_per_rad=4e-4, scale_N=0.4),),
    )
    wrapped = Arcs.exact(np.array([1.0]), np.array([30.0]))
    angle = 0.04 * np.sin(np.linspace(0.0, 4.0 * PI, 200))
    out = run(band, [wrapped], motor_angle_rad=angle)
    slides = np.log(out["tension_in_N"] / out["tension_out_N"])
    assert slides.max() == pytest.approx(friction * 30.0, rel=1e-6)
    assert slides.min() == pytest.approx(-friction * 30.0, rel=1e-6)


def test_friction_of_a_joint_that_is_moved_is_a_torque_against_its_motion():
    """Source: Coulomb friction."""
    angle = 0.1 * np.sin(0.3 * np.arange(1.0, 40.0))
    motion = {"time_s": np.arange(39.0), "motor_angle_rad": np.zeros(39), "joint_angle_rad": angle}
    torque = list[np.ndarray]()
    for friction in (0.0, 0.02):
        end = End(kind="joint", radius_m=0.008, stiffness_Nm_per_rad=0.3, friction_Nm=friction)
        one = changed(rig(30.0, 0.0), end=end)
        machine = machine_of(one, [Arcs.exact(np.array([0.5]), np.array([0.0]))])
        torque.append(simulate(machine, motion, end_given=True)["joint_torque_Nm"])
    against = 0.02 * np.sign(np.diff(angle))
    np.testing.assert_allclose((torque[0] - torque[1])[1:], against, atol=1e-9)


def test_a_tension_that_does_not_hold_a_weight_is_named():
    hardware = Rig(tendon=Tendon(pretension_N=5.0), end=End(kind="weight"))
    with pytest.raises(FitError, match=r"hold the weight of 5 N"):
        run(hardware, [HALF_CIRCLE], tension_in_N=[15.0])


def hanging(pretension, stiffness, gravity, at_rest, motor):
    """Angles of a joint with a weight where its only tendon is slack, and the torque that is left there."""
    end = End(
        kind="joint",
        radius_m=0.007,
        stiffness_Nm_per_rad=stiffness,
        gravity_Nm=gravity,
        gravity_at_rad=at_rest,
    )
    hardware = Rig(tendon=Tendon(pretension_N=pretension), drive=Drive(radius_m=R), end=end)
    out = run(hardware, [HALF_CIRCLE], motor_angle_rad=motor)
    angle = out["joint_angle_rad"][out["tension_out_N"] == 0.0]
    weight = gravity * (np.sin(angle + at_rest) - np.sin(at_rest))
    return angle, stiffness * angle + weight + 0.007 * pretension


@pytest.mark.parametrize("pretension", np.linspace(2.0, 8.0, 25))
def test_a_joint_whose_only_tendon_is_slack_hangs_from_its_spring_and_its_weight(pretension):
    angle, left = hanging(pretension, 0.06, 0.03, 0.8, np.linspace(0.0, -1.5, 40))
    assert len(angle) > 5
    np.testing.assert_allclose(left, 0.0, atol=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_a_weight_that_its_spring_does_not_hold_turns_over(seed):
    """Between both rests the force grows with the angle: no step by its slope gets there."""
    rng = np.random.default_rng(seed)
    pretension, at_rest = rng.uniform((0.5, -1.0), (4.0, 1.0))
    motor = -rng.uniform(4.0, 5.0) * np.sin(0.1 * np.arange(30))
    angle, left = hanging(pretension, 0.006, 0.03, at_rest, motor)
    assert len(angle) > 5
    np.testing.assert_allclose(left, 0.0, atol=1e-9)


def test_a_stated_length_and_angle_scale_a_sensed_route_whose_bends_stay_where_they_are():
    stated = routed(BENT, rig(route=GivenRoute(length_m=1.2, angle_rad=3.0)))
    np.testing.assert_allclose(stated.length, 2.0 * BENT.length)
    np.testing.assert_allclose(stated.angle, 2.0 * BENT.angle)


def test_a_straight_route_bends_evenly_where_the_rig_states_an_angle_and_not_by_its_length():
    straight = Arcs.exact(np.array([0.2, 0.4]), np.zeros(2))
    bent = routed(straight, rig(route=GivenRoute(angle_rad=3.0)))
    np.testing.assert_allclose(bent.angle, [1.0, 2.0])
    assert routed(straight, rig(route=GivenRoute(length_m=1.2))).total_angle == 0.0

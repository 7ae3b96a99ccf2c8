"""Several tendons on one mechanism, against closed forms and against one tendon alone."""

import math

import numpy as np
import pytest

from tests.lumped import (
    Distal,
    Drive,
    Joint,
    Motor,
    NoBalanceError,
    Path,
    Physics,
    Segment,
    from_pieces,
    simulate,
    simulate_machine,
)

PI, MU, RHO, R = math.pi, 0.145, 3.16e-4, 0.01
HALF, BENT = from_pieces([0.5], [PI], 60), from_pieces([0.3, 0.2], [1.0, 0.5], 60)
SOFT = 1.0 / (RHO * 0.5)  # stiffness of 0.5 m of tendon [N/m]
JOINT = Joint(R, 0.2)
SMOOTH, ROUGH = Physics(pretension_N=5.0, friction=0.0), Physics(pretension_N=5.0)
# Bars outside the sheath have 1e-5 of the compliance of one bar, balance is closed to 1e-8 N.
SOLVED = 1e-6
NEWTON = 0.01  # what the chain promises


def over(*values, kind="displacement", span=10.0):
    return Drive(kind, np.linspace(0.0, span, len(values)), np.array(values, dtype=float))


def motor(kind, *values, span=10.0, **others):
    return Motor(kind, np.linspace(0.0, span, len(values)), np.array(values, dtype=float), R, **others)


def course(*values, span=10.0):
    return np.linspace(0.0, span, len(values)), np.array(values, dtype=float)


def machine(physics, drive, end=JOINT, paths=(HALF, HALF), samples=21, max_step=0.5):
    physics = physics if isinstance(physics, tuple) else (physics,) * len(paths)
    tendons = list(zip(paths, physics, strict=True))
    return simulate_machine(tendons, drive, end, np.linspace(0.0, 10.0, samples), max_step)


def changes(run, side="tension_out", rest=5.0):
    """[n, F] Change of tension of each tendon from its rest [N]."""
    return np.array([getattr(tendon, side) for tendon in run.tendons]) - rest


def wave(amplitude, count=41):
    at = np.linspace(0.0, 10.0, count)
    return amplitude * np.sin(1.1 * at) * (1.0 - 0.04 * at)


# without friction


@pytest.mark.parametrize("torque", [0.0, 0.02, -0.03])
def test_a_pair_without_friction_is_two_springs(torque):
    """2 r k (R p − r θ) = K θ + τ with k the stiffness of each tendon."""
    turn = 0.2
    joint = Joint(R, 0.2, load=course(0.0, torque))
    run = machine(SMOOTH, motor("angle", 0.0, turn), joint)
    theta = (2 * R * SOFT * R * turn - torque) / (0.2 + 2 * R * R * SOFT)
    assert run.joint_angle[-1] == pytest.approx(theta, rel=SOLVED)
    pull = SOFT * (R * turn - R * theta)
    assert changes(run)[:, -1] == pytest.approx([pull, -pull], rel=SOLVED)
    assert run.motor_torque[-1] == pytest.approx(2 * R * pull, rel=SOLVED)
    assert run.joint_torque[-1] == pytest.approx(2 * R * pull, rel=SOLVED)
    assert run.load_torque[-1] == torque
    assert run.joint_angle == pytest.approx(np.linspace(0.0, theta, 21), rel=SOLVED, abs=1e-12)


def test_a_motor_of_given_torque_finds_the_angle_of_two_springs():
    torque, coupling = 0.05, 0.8
    run = machine(SMOOTH, motor("torque", 0.0, torque, coupling=coupling))
    # k (1 + c²) R² p − k (1 + c) R r θ = τ and k (1 + c) r R p − 2 k r² θ = K θ
    k = SOFT * R * R
    matrix = [[k * (1 + coupling**2), -k * (1 + coupling)], [k * (1 + coupling), -2 * k - 0.2]]
    turn, theta = np.linalg.solve(matrix, [torque, 0.0])
    assert run.motor_angle[-1] == pytest.approx(turn, rel=SOLVED)
    assert run.joint_angle[-1] == pytest.approx(theta, rel=SOLVED)
    assert run.tendons[1].displacement_in[-1] == pytest.approx(-coupling * R * turn, rel=SOLVED)
    assert run.motor_torque == pytest.approx(np.linspace(0.0, torque, 21), abs=1e-9)


def test_a_tendon_that_goes_slack_leaves_the_joint_to_the_other():
    physics, drive = Physics(pretension_N=0.5, friction=0.0), 3e-3
    run = machine(physics, [over(0.0, drive, 0.0), over(0.0, -drive, 0.0)])
    theta = R * (0.5 + SOFT * drive) / (0.2 + R * R * SOFT)
    assert run.tendons[1].tension_out[10] == 0.0
    assert run.joint_angle[10] == pytest.approx(theta, rel=SOLVED)
    assert run.joint_angle[-1] == pytest.approx(0.0, abs=1e-9)
    assert changes(run, rest=0.5)[:, -1] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_a_tendon_with_slack_pulls_once_it_is_taken_up():
    slack = 1.5e-3
    loose = Physics(pretension_N=0.0, friction=0.0, slack_m=slack)
    run = machine((loose, loose), motor("angle", 0.0, -0.4), samples=401)
    moved = run.tendons[1].displacement_in
    assert np.all(run.joint_angle[moved < slack] == 0.0)
    pulling = moved > slack
    theta = -R * SOFT * (moved - slack) / (0.2 + R * R * SOFT)
    assert run.joint_angle[pulling] == pytest.approx(theta[pulling], rel=SOLVED, abs=1e-9)
    assert np.all(run.tendons[0].tension_out == 0.0)


def test_a_motor_of_given_torque_runs_through_the_slack_to_the_tendon_that_pulls():
    slack, torque = 2e-3, -0.05
    tight, loose = Physics(pretension_N=1.0, friction=0.0), Physics(friction=0.0, slack_m=slack)
    run = machine((tight, loose), motor("torque", 0.0, torque))
    pull = -torque / R - 1.0  # tendon 1 gives its 1 N, tendon 2 the rest
    assert changes(run, rest=0.0)[:, -1] == pytest.approx([0.0, pull], abs=1e-6)
    theta = R * (-1.0 - pull) / 0.2
    assert run.joint_angle[-1] == pytest.approx(theta, rel=SOLVED)
    assert run.motor_angle[-1] == pytest.approx(-(slack + pull / SOFT - R * theta) / R, rel=SOLVED)


def test_a_given_joint_angle_stretches_the_tendons_and_its_torque_comes_out():
    joint = Joint(R, 0.2, gravity_Nm=0.1, gravity_angle_rad=0.4, angle=course(0.0, 0.05))
    run = machine(SMOOTH, motor("angle", 0.0, 0.02), joint)
    pull = SOFT * R * (0.02 - 0.05)
    assert changes(run)[:, -1] == pytest.approx([pull, -pull], rel=SOLVED)
    holds = 0.2 * 0.05 + 0.1 * (math.sin(0.45) - math.sin(0.4))
    assert run.load_torque[-1] == pytest.approx(2 * R * pull - holds, rel=SOLVED)
    assert np.array_equal(run.joint_angle, np.linspace(0.0, 0.05, 21))


@pytest.mark.parametrize("tilt", [0.0, 0.6, -1.2])
def test_gravity_alone_turns_the_joint_to_where_its_arm_balances_the_tendons(tilt):
    joint = Joint(R, 0.0, gravity_Nm=0.2, gravity_angle_rad=tilt)
    run = machine(SMOOTH, [over(5.0, 9.0, kind="force"), over(5.0, 4.0, kind="force")], joint)
    theta = math.asin(math.sin(tilt) + R * (4.0 + 1.0) / 0.2) - tilt
    assert run.joint_angle[-1] == pytest.approx(theta, abs=1e-6)


def test_tensions_that_nothing_holds_have_no_balance():
    with pytest.raises(NoBalanceError, match="no balance of the machine at"):
        machine(
            SMOOTH, [over(5.0, 30.0, kind="force"), over(5.0, 4.0, kind="force")], Joint(R, gravity_Nm=0.2)
        )


THREE = (0.0, 2 * PI / 3, -2 * PI / 3)


def test_a_segment_without_friction_bends_as_springs_round_its_backbone_say():
    """Σ d (cos α, sin α) k (x_in − x_out) = K b, with x_out = d (b_x cos α + b_y sin α)."""
    angles, arm, stiff, moved = (0.2, 1.9, 4.0), 0.004, 0.05, np.array([1.0e-3, -0.2e-3, -0.4e-3])
    segment = Segment(arm, angles, stiff, length_m=0.08, marker_m=0.01)
    run = machine(SMOOTH, [over(0.0, each) for each in moved], segment, (HALF,) * 3)
    round_ = arm * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    bending = np.linalg.solve(stiff * np.eye(2) + SOFT * round_.T @ round_, SOFT * round_.T @ moved)
    assert run.bending[-1] == pytest.approx(bending, rel=SOLVED)
    assert round_.T @ changes(run)[:, -1] == pytest.approx(stiff * bending, rel=SOLVED)
    for i, tendon in enumerate(run.tendons):
        assert tendon.displacement_out[-1] == pytest.approx(round_[i] @ bending, rel=SOLVED)


def test_a_segment_bends_towards_the_pulled_tendon_and_its_tip_lies_on_an_arc():
    segment = Segment(0.004, THREE, 0.05, length_m=0.08, marker_m=0.01)
    for pulled, angle in enumerate(THREE):
        drives = [over(5.0, 15.0 if i == pulled else 5.0, kind="force") for i in range(3)]
        run = machine(ROUGH, drives, segment, (HALF,) * 3)
        total = np.linalg.norm(run.bending[-1])
        assert run.bending[-1] == pytest.approx(total * np.array([math.cos(angle), math.sin(angle)]))
        radius = 0.08 / total
        across = radius * (1 - math.cos(total)) + 0.01 * math.sin(total)
        along = radius * math.sin(total) + 0.01 * math.cos(total)
        tip = [across * math.cos(angle), across * math.sin(angle), along]
        assert run.tip[-1] == pytest.approx(tip, abs=1e-12)
        assert run.tip[0] == pytest.approx([0.0, 0.0, 0.09], abs=1e-12)


def test_tendons_that_pull_alike_round_a_segment_leave_it_straight():
    segment = Segment(0.004, THREE, 0.05)
    run = machine(ROUGH, [over(5.0, 15.0, kind="force")] * 3, segment, (HALF,) * 3)
    assert np.abs(run.bending).max() < 1e-9
    assert changes(run)[:, -1] == pytest.approx(15.0 * math.exp(-MU * PI) - 5.0, abs=NEWTON)


# with friction


def test_the_pulled_tendon_loses_by_its_sheath_and_the_other_one_gains():
    given = [over(5.0, 30.0, kind="force"), over(5.0, 5.0, kind="force")]
    run = machine(ROUGH, given, paths=(HALF, BENT))
    pulled, let_out = 30.0 * math.exp(-MU * PI), 5.0 * math.exp(MU * 1.5)
    assert changes(run, rest=0.0)[:, -1] == pytest.approx([pulled, let_out], abs=NEWTON)
    assert run.joint_angle[-1] == pytest.approx(R * (pulled - let_out) / 0.2, abs=R * NEWTON / 0.2)


def test_a_small_reversal_is_lost_in_both_sheaths():
    given = [over(5.0, 30.0, 26.0, 5.0, kind="force"), over(5.0, 5.0, 5.5, 30.0, kind="force")]
    run = machine(ROUGH, given, paths=(HALF, BENT), samples=31)
    assert run.joint_angle[20] == pytest.approx(run.joint_angle[10], abs=1e-9)
    assert run.joint_angle[30] < 0.0
    tight = Physics(pretension_N=15.0)  # a slack sheath loses nothing
    again = machine(tight, motor("angle", 0.0, 0.2, 0.195), samples=21)
    assert np.ptp(again.joint_angle[10:]) < 1e-9
    assert np.ptp(again.motor_torque[10:]) > 0.01


def test_a_loop_through_a_free_joint_is_one_long_tendon():
    """Without a spring both far ends have one tension, so that tendon 2 goes on where tendon 1 ends."""
    run = machine(ROUGH, motor("angle", *wave(0.3), coupling=0.0), Joint(R, 1e-9), (HALF, BENT), 81, 0.02)
    bars = np.concatenate([HALF.bars[0][:-1], [HALF.bars[0][-1] + BENT.bars[0][-1]], BENT.bars[0][-2::-1]])
    turns = np.concatenate([HALF.turns[0], BENT.turns[0][::-1]])
    whole = simulate(
        Path(np.zeros(1), bars[None], turns[None]),
        ROUGH,
        over(*R * wave(0.3)),
        Distal("blocked"),
        run.times,
        0.02,
    )
    n = HALF.turns.shape[1]
    assert np.ptp(run.joint_angle) > 0.05
    assert run.tendons[0].tension_in == pytest.approx(whole.tension_in, abs=1e-4)
    assert run.tendons[1].tension_in == pytest.approx(whole.tension_out, abs=1e-4)
    assert run.tendons[0].tension_out == pytest.approx(whole.tension[:, n], abs=1e-4)
    assert run.tendons[1].tension_out == pytest.approx(whole.tension[:, n], abs=1e-4)


def test_one_tendon_on_a_joint_pulls_a_spring():
    run = machine(ROUGH, motor("angle", *wave(0.3)), paths=(HALF,), samples=81, max_step=0.02)
    spring = simulate(HALF, ROUGH, over(*R * wave(0.3)), Distal("spring", 0.2 / R**2), run.times, 0.02)
    assert run.tendons[0].tension_in == pytest.approx(spring.tension_in, abs=1e-4)
    assert run.tendons[0].tension_out == pytest.approx(spring.tension_out, abs=1e-4)
    assert R * run.joint_angle == pytest.approx(spring.displacement_out, abs=1e-8)


def test_four_tendons_in_a_plane_are_two_pairs():
    """Each across has a pair of its own: the joint's torque and the backbone's have one form."""
    arm, moved = 0.01, (wave(2e-3), -wave(2e-3), wave(1e-3)[::-1] - wave(1e-3)[-1])
    given = [over(*each) for each in (*moved, -moved[2])]
    run = machine(ROUGH, given, Segment(arm, (0.0, PI, PI / 2, -PI / 2), 0.2), (HALF, BENT) * 2, 41, 0.05)
    for axis, pair in enumerate((given[:2], given[2:])):
        alone = machine(ROUGH, pair, JOINT, (HALF, BENT), 41, 0.05)
        assert run.bending[:, axis] == pytest.approx(alone.joint_angle, abs=1e-8)


def test_a_motor_of_given_torque_undoes_one_of_given_angle():
    joint = Joint(R, 0.2, gravity_Nm=0.05, gravity_angle_rad=0.3, load=course(0.0, 0.03, -0.02))
    first = machine(ROUGH, motor("angle", *wave(0.3)), joint, (HALF, BENT), 201, 0.05)
    back = machine(ROUGH, motor("torque", *first.motor_torque), joint, (HALF, BENT), 201, 0.05)
    assert np.ptp(first.joint_angle) > 0.2
    assert back.motor_angle == pytest.approx(first.motor_angle, abs=1e-6)
    assert back.joint_angle == pytest.approx(first.joint_angle, abs=1e-6)


def test_a_given_joint_angle_takes_the_load_that_led_to_it():
    joint = Joint(R, 0.2, gravity_Nm=0.05, load=course(*wave(0.05)))
    first = machine(ROUGH, motor("angle", *wave(0.1)[::-1] - wave(0.1)[-1]), joint, (HALF, BENT), 201, 0.05)
    held = Joint(R, 0.2, gravity_Nm=0.05, angle=(first.times, first.joint_angle))
    back = machine(ROUGH, motor("angle", *wave(0.1)[::-1] - wave(0.1)[-1]), held, (HALF, BENT), 201, 0.05)
    assert back.load_torque == pytest.approx(first.load_torque, abs=1e-6)
    assert back.motor_torque == pytest.approx(first.motor_torque, abs=1e-6)


def test_play_delays_the_pulley_when_the_motor_turns_back():
    played = machine(ROUGH, motor("angle", 0.0, 0.3, 0.1, play_rad=0.05), samples=41)
    direct = machine(ROUGH, motor("angle", 0.0, 0.3, 0.3, 0.25, 0.2, 0.15), samples=41)
    assert played.joint_angle[20] == pytest.approx(direct.joint_angle[16], abs=1e-9)
    assert np.ptp(played.joint_angle[20:25]) < 1e-12
    assert played.joint_angle[-1] == pytest.approx(direct.joint_angle[-1], abs=1e-9)
    torque = machine(ROUGH, motor("torque", *played.motor_torque, play_rad=0.05), samples=41)
    assert torque.motor_angle[-1] == pytest.approx(0.1, abs=1e-6)


def test_work_of_the_motor_is_elastic_energy_heat_and_what_the_joint_took():
    joint = Joint(R, 0.2, gravity_Nm=0.05, gravity_angle_rad=0.3)
    run = machine(ROUGH, motor("angle", *wave(0.3, 401)), joint, (HALF, BENT), 4001, 0.01)
    work = np.trapezoid(run.motor_torque, run.motor_angle)
    work += 5.0 * (sum(t.displacement_in[-1] for t in run.tendons))  # torque counts from rest
    out = 5.0 * (sum(t.displacement_out[-1] for t in run.tendons))
    angle = run.joint_angle[-1]
    joint_took = 0.1 * angle**2 + 0.05 * (math.cos(0.3) - math.cos(angle + 0.3) - angle * math.sin(0.3))
    stored = sum(
        0.5 * RHO * path.bars[0] @ (tendon.tension[-1] ** 2 - 25.0)
        for path, tendon in zip((HALF, BENT), run.tendons, strict=True)
    )
    heat = sum(tendon.heat[-1] for tendon in run.tendons)
    assert heat > 5e-3
    assert work == pytest.approx(out + stored + joint_took + heat, abs=1e-6 * heat)


@pytest.mark.parametrize(
    "effects", [{}, {"toe_strain": 1e-3, "load_exponent": -0.2, "straight_friction_N_per_m": 0.5}]
)
def test_every_instant_is_in_balance(effects):
    physics = Physics(pretension_N=3.0, slack_m=0.0, **effects), Physics(pretension_N=6.0, **effects)
    joint = Joint(R, 0.15, gravity_Nm=-0.05, gravity_angle_rad=0.4, load=course(*wave(0.02)))
    run = machine(physics, motor("angle", *wave(0.4)), joint, (HALF, BENT), 201, 0.05)
    pull = R * (run.tendons[0].tension_out - 3.0 - run.tendons[1].tension_out + 6.0)
    held = 0.15 * run.joint_angle - 0.05 * (np.sin(run.joint_angle + 0.4) - math.sin(0.4))
    assert pull == pytest.approx(held + run.load_torque, abs=1e-9)
    assert run.tendons[0].displacement_out == pytest.approx(R * run.joint_angle, abs=1e-15)
    assert run.tendons[1].displacement_out == pytest.approx(-R * run.joint_angle, abs=1e-15)
    assert run.left_open < 1e-9


def test_routes_may_move_while_the_motor_stands():
    times = np.linspace(0.0, 10.0, 21)
    straightens = from_pieces([0.5], np.linspace(PI, 1.0, 21)[:, None], 60, times)
    run = machine(ROUGH, motor("angle", 0.3, 0.3), paths=(straightens, HALF), samples=41, max_step=0.02)
    # less friction lets more of the pull through
    assert run.tendons[0].tension_out[-1] > run.tendons[0].tension_out[0] + 0.5
    assert run.joint_angle[-1] > run.joint_angle[0] + 0.005
    assert run.joint_torque == pytest.approx(0.2 * run.joint_angle, abs=1e-9)


@pytest.mark.parametrize("end", [JOINT, Segment(R, (0.0, 2.0, 4.0), 0.2)])
def test_error_falls_with_the_square_of_the_cell(end):
    def run(cells):
        paths = tuple(from_pieces([0.3, 0.2], [2.0 + i, 0.5], cells) for i in range(2 + (end is not JOINT)))
        given = [over(*wave(2e-3)), over(*-wave(2e-3)), over(*wave(1e-3))][: len(paths)]
        return machine(ROUGH, given, end, paths, 201, 0.05)

    def rows(run):
        moved = run.joint_angle[None] if end is JOINT else run.bending.T
        return np.concatenate([moved, changes(run)]), changes(run, "tension_in")

    best, *others = [rows(run(cells)) for cells in (480, 30, 60, 120)]
    out, drive = ([np.sqrt(np.mean((each[i] - best[i]) ** 2, axis=1)) for each in others] for i in (0, 1))
    assert np.all(out[0] / out[2] > 10.0)  # 16 for second order
    assert np.all(drive[0] / drive[2] > 6.0)  # less where a drive turns back, as with one tendon
    moves = 1 if end is JOINT else 2
    assert np.all(out[2][:moves] < 1e-5)  # rad
    assert np.all(out[2][moves:] < 1e-3)  # N
    assert np.all(drive[2] < 5e-3)


def test_what_does_not_fit_together_is_refused():
    with pytest.raises(ValueError, match="give one or two"):
        machine(ROUGH, motor("angle", 0.0, 1.0), JOINT, (HALF,) * 3)
    with pytest.raises(ValueError, match="3 tendons, 2 angles"):
        machine(ROUGH, [over(0.0, 1.0)] * 3, Segment(R, (0.0, 1.0), 0.2), (HALF,) * 3)
    with pytest.raises(ValueError, match="give as many"):
        machine(ROUGH, [over(0.0, 1.0)])
    with pytest.raises(ValueError, match="give the motor a play"):
        machine(Physics(backlash_m=1e-3), motor("angle", 0.0, 1.0))
    with pytest.raises(ValueError, match="a slack tendon has none"):
        Physics(pretension_N=1.0, slack_m=1e-3)

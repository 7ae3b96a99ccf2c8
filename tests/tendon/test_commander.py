"""Commands know how far the distal end may be from its target, by the route, the rig and the state."""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from pipelines.live.warm_up import warm_up
from tssgeom.engine import process
from tssgeom.errors import SettingsError
from tssgeom.frame import Frame
from tssgeom.mechanism import Drive, DriveLimits
from tssgeom.rig import Friction, Load, Rig, ShapeSensor, Tendon, with_values
from tssgeom.route.pieces import Arcs
from tssgeom.stream import FrameResult
from tssgeom.tendon.command import compensate
from tssgeom.tendon.command_error import Step, Variant, bound, outside, spread
from tssgeom.tendon.commander import Target, commander_of
from tssgeom.tendon.state import pretensioned, step, transmit
from tssgeom.uncertain import Uncertain, Unexplained, assumed

MU, ANGLE = 0.145, math.pi
ROUTE = Arcs.exact([0.5], [ANGLE])
RIG = Rig(tendon=Tendon(pretension_N=3.0))
FRICTION = Uncertain("friction.coefficient", assumed("", MU, 0.01), stated=True)


def commanded(rig, targets, uncertain=(), arcs=ROUTE, **options):
    """Return the commands of targets of the load [m], one a second on one route."""
    state, commander, commands = pretensioned(rig), commander_of(rig, uncertain, **options), []
    for time, target in enumerate(targets):
        at = Step(arcs, float(time))
        command, commander = commander.command(state, at, Target(target, None), elapsed=1.0)
        state = command.state
        commands.append(command)
    return commands


def test_on_exact_numbers_a_command_has_no_error():
    (command,) = commanded(RIG, [2e-3])
    assert command.displacement_out_se == 0.0
    assert command.tension_out_se == 0.0
    assert command.out_of_tolerance is None


@pytest.mark.parametrize("targets", [[2e-3], [4e-3, 2e-3]])
def test_the_error_of_the_route_is_that_of_sampled_routes(targets):
    sd = np.array([2e-3, 0.05])  # of length [m] and angle [rad]
    arcs = replace(ROUTE, covariance=np.diag(sd**2))
    ends = {"position": [], "tension": []}
    nominal = commanded(RIG, targets, arcs=arcs)
    rng = np.random.default_rng(1)
    for length, angle in rng.standard_normal((400, 2)) * sd:
        true = Arcs.exact([0.5 + length], [ANGLE + angle])
        by_position = by_tension = pretensioned(RIG)
        for command in nominal:
            by_position = step(by_position, true, RIG, displacement_in=command.displacement_in)
            by_tension = step(by_tension, true, RIG, tension_in=command.tension_in)
        ends["position"].append(transmit(by_position, RIG).displacement_out)
        ends["tension"].append(transmit(by_tension, RIG).displacement_out)
    # 400 draws give a standard deviation to 3.5 %; a fifth is six of these
    error = nominal[-1].errors
    assert error.displacement_out == pytest.approx(np.std(ends["position"]), rel=0.2)
    assert error.displacement_out_by_tension == pytest.approx(np.std(ends["tension"]), rel=0.2)


def test_an_uncertain_friction_counts_as_its_derivative_says():
    (command,) = commanded(RIG, [2e-3], [FRICTION])
    # T_out = T_in exp(−μΦ), the drive at T_in: 5 N · Φ · 0.01
    assert command.errors.tension_out_by_tension == pytest.approx(5.0 * ANGLE * 0.01, rel=0.01)
    assert command.errors.displacement_out_by_tension == pytest.approx(5e-3 * ANGLE * 0.01, rel=0.01)
    assert command.displacement_out_se < 0.5 * command.errors.displacement_out_by_tension


def test_errors_that_cancel_count_less_than_each_alone():
    """A drive that holds a position: friction and stretch both keep the end back."""
    rig = Rig(tendon=Tendon(pretension_N=3.0))
    rho = Uncertain("tendon.compliance_per_N", assumed("", 3.16e-4, 2e-5), stated=True)
    apart = commanded(rig, [2e-3], [FRICTION, rho])[0].errors
    ends = {}
    for together in (-0.99, 0.99):
        one = replace(FRICTION, correlation={rho.key: together})
        other = replace(rho, correlation={FRICTION.key: together})
        ends[together] = commanded(rig, [2e-3], [one, other])[0].errors
    draws = np.random.default_rng(3).multivariate_normal([0.0, 0.0], [[1.0, 0.99], [0.99, 1.0]], 400)
    at = commanded(rig, [2e-3])[0].displacement_in
    ways = [
        transmit(step(pretensioned(one), ROUTE, one, displacement_in=at), one).displacement_out
        for u, v in draws
        for one in [with_values(rig, {FRICTION.key: FRICTION.prior.value(u), rho.key: rho.prior.value(v)})]
    ]
    assert ends[0.99].displacement_out == pytest.approx(np.std(ways), rel=0.2)  # 400 draws: as above
    both = 0.5 * (ends[0.99].displacement_out ** 2 + ends[-0.99].displacement_out ** 2)
    assert both == pytest.approx(apart.displacement_out**2, rel=0.01)
    assert ends[-0.99].displacement_out < 0.7 * ends[0.99].displacement_out


def test_tension_and_elongation_of_a_frame_have_the_errors_of_the_rig():
    points = (
        0.5
        / ANGLE
        * np.column_stack([f(np.linspace(0.0, ANGLE, 60)) for f in (np.sin, np.cos, np.zeros_like)])
    )
    frames = [Frame(points, time=0.1 * k, tension_in=pull) for k, pull in enumerate((5.0, 10.0))]
    plain = list(process(frames, RIG, tension_in=0.0))
    known = list(process(frames, RIG, tension_in=0.0, commander=commander_of(RIG, [FRICTION])))
    for one, other in zip(plain, known, strict=True):
        a, b = one.transmission, other.transmission
        assert b.tension_out == a.tension_out
        assert math.hypot(a.tension_out_se, b.tension_out * ANGLE * 0.01) == pytest.approx(
            b.tension_out_se, rel=0.01
        )
        assert b.elongation_se > 1.05 * a.elongation_se
    left = msgspec.structs.replace(RIG, unexplained=Unexplained(tension_out_N=0.1, elongation_m=3e-5))
    for one, other in zip(plain, process(frames, left, tension_in=0.0), strict=True):
        a, b = one.transmission, other.transmission
        assert b.tension_out_se == pytest.approx(math.hypot(a.tension_out_se, 0.1), rel=1e-9)
        assert b.elongation_se == pytest.approx(math.hypot(a.elongation_se, 3e-5), rel=1e-9)


def test_what_the_model_leaves_unexplained_joins_every_error():
    """0.05 N that nobody knows are 0.05 N of T_out; 20 µm take what 20 µm of the drive give."""
    tension_left, stretch_left, drive_left = 0.05, 2e-5, 0.2
    left = Unexplained(tension_in_N=drive_left, tension_out_N=tension_left, elongation_m=stretch_left)
    rig = msgspec.structs.replace(RIG, unexplained=left)
    per_N = 1.0 / rig.load.stiffness_N_per_m
    (plain,), (command,) = commanded(RIG, [1e-3]), commanded(rig, [1e-3])
    assert command.displacement_in == plain.displacement_in
    before, after = (np.array(each.errors) for each in (plain, command))
    added = np.sqrt(after**2 - before**2)
    further = transmit(step(command.state, ROUTE, rig, displacement_in=command.displacement_in + 1e-5), rig)
    fed = (further.tension_out - command.tension_reached) / 1e-5 * stretch_left
    assert added[:2] == pytest.approx(np.hypot(tension_left, fed) * np.array([1.0, per_N]), rel=1e-3)
    passed = drive_left * command.tension_reached / command.tension_in
    assert added[2:] == pytest.approx(np.hypot(tension_left, passed) * np.array([1.0, per_N]), rel=1e-6)


def test_the_scale_of_the_angles_counts_as_much_as_friction():
    rig = Rig(tendon=Tendon(pretension_N=3.0), shape=ShapeSensor(angle_gain_sd=0.01 / MU))
    (by_scale,), (by_friction,) = commanded(rig, [2e-3]), commanded(RIG, [2e-3], [FRICTION])
    assert by_scale.errors == pytest.approx(by_friction.errors, rel=0.02)


def test_numbers_of_a_rig_that_one_tendon_lacks_change_nothing():
    joint = Uncertain("end.radius_m", assumed("", 0.006, 0.001), stated=True)
    unknown = Uncertain("friction.coefficient", assumed("", MU, 0.01), stated=False)
    assert commander_of(RIG, [joint, unknown]).variants == ()


def test_each_variant_keeps_its_own_history():
    """The error of a friction acts on a release as well: the spread is that of a fresh run of each."""
    commands = commanded(RIG, [4e-3, 3e-3, 3.5e-3], [FRICTION])
    ends = []
    for u in (-1.0, 1.0):
        rig = Rig(tendon=Tendon(pretension_N=3.0), friction=Friction(coefficient=FRICTION.prior.value(u)))
        state = pretensioned(rig)
        for command in commands:
            state = step(state, ROUTE, rig, displacement_in=command.displacement_in)
        ends.append(transmit(state, rig).displacement_out)
    assert commands[-1].displacement_out_se == pytest.approx(abs(ends[1] - ends[0]) / 2, rel=1e-9)


def test_weights_of_a_filter_give_its_standard_deviation():
    rng = np.random.default_rng(2)
    values = MU + 0.01 * rng.standard_normal(100)
    begun = pretensioned(RIG)
    variants = tuple(
        Variant(Rig(tendon=RIG.tendon, friction=Friction(coefficient=value)), 0.01, begun, begun)
        for value in values
    )
    command = compensate(begun, ROUTE, RIG, displacement_out=2e-3)
    moved = [each.driven(Step(ROUTE), command.displacement_in, command.tension_in) for each in variants]
    expected = np.std([transmit(each.pulled, each.rig).tension_out for each in moved])
    assert spread(moved).tension_out_by_tension == pytest.approx(expected, rel=1e-9)
    assert spread([]) == (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("miss", "error", "tolerance", "expected"),
    [
        (0.0, 1.0, 1.959964, 0.05),
        (0.0, 0.0, 1.0, 0.0),
        (2.0, 0.0, 1.0, 1.0),
        (1.0, 1e-6, 1.0, 0.5),
        (-1.0, 1.0, 1.0, 0.5228),
    ],
)
def test_the_probability_of_a_miss_is_that_of_a_normal_error(miss, error, tolerance, expected):
    assert outside(miss, error, tolerance) == pytest.approx(expected, abs=1e-4)


def test_a_target_that_a_limit_keeps_out_of_reach_is_out_of_tolerance():
    rig = Rig(drive=Drive(limits=DriveLimits(displacement_m=(0.0, 2e-3))))
    near, far = commanded(rig, [1e-3, 4e-3], [FRICTION], tolerance=0.5e-3)
    assert near.out_of_tolerance < 0.05
    assert far.out_of_tolerance > 0.99
    assert far.limited == "displacement_m"


def test_a_tolerance_in_mm_means_nothing_without_a_stiffness():
    rig = Rig(load=Load(stiffness_N_per_m=0.0))
    commander = commander_of(rig, tolerance=1e-3)
    with pytest.raises(SettingsError, match=r"load\.stiffness_N_per_m is 0"):
        commander.command(pretensioned(rig), Step(ROUTE), Target(None, 5.0))
    with pytest.raises(SettingsError, match="--tolerance-mm is 0 mm"):
        commander_of(rig, tolerance=0.0)


# waiting in the dead zone


def test_cross_jumps_the_dead_zone_for_the_noise_of_a_target_and_wait_holds_the_drive():
    targets = [2e-3, 2e-3 - 1e-6, 2e-3 + 1e-6, 2e-3 - 1e-6]
    crossing = [one.tension_in for one in commanded(RIG, targets, [FRICTION])]
    waiting = commanded(RIG, targets, [FRICTION], policy="wait")
    width = 5.0 * (math.exp(MU * ANGLE) - math.exp(-MU * ANGLE))
    assert np.abs(np.diff(crossing)) == pytest.approx(width, rel=0.01)
    assert [one.waits for one in waiting] == [False, True, False, True]
    # 2 µm further in the direction of the last slide crosses nothing: it is carried out
    assert np.abs(np.diff([one.tension_in for one in waiting])).max() < 0.01
    assert waiting[1].displacement_reached == pytest.approx(2e-3, rel=1e-9)


def test_wait_crosses_where_the_target_is_farther_than_the_error():
    (pulled, released) = commanded(RIG, [2e-3, 1.5e-3], [FRICTION], policy="wait")
    assert not released.waits
    assert released.tension_in < pulled.tension_in * math.exp(-MU * ANGLE)
    assert released.displacement_reached == pytest.approx(1.5e-3, rel=1e-9)


def test_with_a_tolerance_the_drive_waits_while_it_is_kept():
    near = commanded(RIG, [2e-3, 1.9e-3], policy="wait", tolerance=0.2e-3)[-1]
    assert near.waits
    assert near.out_of_tolerance < 0.05
    assert not commanded(RIG, [2e-3, 1.7e-3], policy="wait", tolerance=0.2e-3)[-1].waits
    assert not commanded(RIG, [2e-3, 1.9e-3], policy="wait")[-1].waits  # nothing is uncertain


# in the stream


def frames(targets, drive=None):
    angle = np.linspace(0.0, np.pi, 60)
    points = 0.5 / np.pi * np.column_stack((np.sin(angle), 1 - np.cos(angle), 0 * angle))
    rng = np.random.default_rng(3)
    for time, target in enumerate(targets):
        noise = 2e-4 * rng.standard_normal(points.shape)
        measured = {} if drive is None else {"displacement_in": drive[time]}
        yield Frame(points + noise, float(time), displacement_target=target, **measured)


def results(rig, targets, drive=None, **options):
    commander = commander_of(rig, options.pop("uncertain", ()), **options)
    every = list(process(frames(targets, drive), rig, tension_in=0.0, commander=commander))
    assert all(isinstance(one, FrameResult) for one in every), every
    return every


def test_a_stream_counts_the_route_and_the_rig():
    alone = results(RIG, [2e-3, 4e-3])[-1].command
    both = results(RIG, [2e-3, 4e-3], uncertain=[FRICTION])[-1].command
    assert alone.displacement_out_se > 0.0
    assert both.displacement_out_se > 2.0 * alone.displacement_out_se


def test_the_history_of_a_measured_drive_is_that_of_every_variant():
    drive = [1e-3, 4e-3, 3.5e-3]
    last = results(RIG, [None, None, 2e-3], drive, uncertain=[FRICTION])[-1]
    ends = []
    for each in last.commander.variants:
        assert each.located is each.pulled
        assert transmit(each.located, each.rig).displacement_in == pytest.approx(3.5e-3, abs=1e-9)
        ends.append(transmit(each.located, each.rig).displacement_out)
    assert ends[0] != pytest.approx(ends[1], rel=1e-3)
    assert last.strip().commander is None


def test_the_first_command_of_a_stream_with_a_limit_of_speed_holds_the_drive():
    rig = Rig(drive=Drive(limits=DriveLimits(speed_m_per_s=1e-3)))
    first, second = (one.command for one in results(rig, [3e-3, 3e-3]))
    assert (first.displacement_in, first.limited) == (pytest.approx(0.0, abs=1e-9), "speed_m_per_s")
    assert (second.displacement_in, second.limited) == (pytest.approx(1e-3, abs=1e-9), "speed_m_per_s")


@pytest.mark.parametrize("stiffness", [1e-300, 1e-12])
def test_a_load_so_soft_that_no_drive_reaches_it_gives_a_result_or_a_reason(stiffness):
    rig = Rig(load=Load(stiffness_N_per_m=stiffness))
    turn = np.linspace(0.0, 2.0, 30)
    points = 0.25 * np.column_stack((np.sin(turn), 1 - np.cos(turn), 0 * turn))
    frames = [
        Frame(points, 0.1 * k, tension_in=10.0 + k % 3, displacement_target=target)
        for k, target in enumerate((1e-3, -1e-3, 2e-3, 0.0, 1e-3) * 4)
    ]
    outcomes = list(process(frames, rig, tension_in=10.0, commander=commander_of(rig, [])))
    assert len(outcomes) == len(frames)


def test_a_stream_is_warm_on_a_load_so_soft_that_no_drive_reaches_the_target():
    rig = Rig(load=Load(stiffness_N_per_m=1e-300))
    warm_up(rig, commander_of(rig, []))


def test_the_bound_of_a_command_leaves_one_in_twenty_outside():
    assert outside(0.0, 2e-3, bound(2e-3)) == pytest.approx(0.05)

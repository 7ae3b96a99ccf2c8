"""A moving route is tracked: each fit starts from the last one, and ends where a fit from nothing does."""

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.known_routes import arc_positions, truth
from tests.live_process import ROUTES, points_mm
from tssgeom import core
from tssgeom.core.constants_arcs import CHAIN_MOVES
from tssgeom.route.arcs.chain import work_of_evaluation
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean
from tssgeom.route.synthetic import Course, chain
from tssgeom.route.tracking import NotWarmError, TrackedFit, follow, model_checked

NOISE = 5e-4
LENGTH = np.array([0.07, 0.09, 0.05, 0.08, 0.06, 0.10, 0.05])
KAPPA = np.array([5.0, 25.0, 0.0, 15.0, 40.0, 10.0, 0.0])
PLANE = np.array([0.0, 1.2, 0.0, -0.8, 2.0, 0.5, 0.0])
FRAMES = 48


def _swaying(part: float) -> Course:
    """Seven pieces whose bends sway by a tenth and whose joints wander."""
    sway = np.sin(2 * np.pi * part)
    length = LENGTH * (1.0 + 0.1 * sway * np.array([1, -1, 1, -1, 1, -1, 1]))
    return chain(length, KAPPA * (1.0 + 0.1 * sway), PLANE)


def _arriving(part: float) -> Course:
    """A straight middle piece that bends until it is a bend like the others, and back."""
    return chain(
        LENGTH[:5], np.where(np.arange(5) == 2, 15.0 * np.sin(np.pi * part) ** 2, KAPPA[:5]), PLANE[:5]
    )


def _points(course: Course, n: int, rng: np.random.Generator) -> np.ndarray:
    s = np.linspace(0.0, course.total_length, n)
    return arc_positions(course)(s) + NOISE * rng.standard_normal((n, 3))


@pytest.mark.parametrize("known", [True, False], ids=["known noise", "unknown noise"])
def test_a_tracked_route_is_that_of_a_fit_from_nothing(known):
    rng, last, apart = np.random.default_rng(3), None, []
    noise = NOISE if known else None
    for i in range(24):
        shape = clean(_points(_swaying(i / 24), 120, rng))
        last = follow(shape, noise, last)
        fresh = measure(shape, noise).profile
        assert last.fit.arcs.method == "arcs"
        apart.append((last.fit.profile.total_angle - fresh.total_angle) / fresh.total_angle_se)
    # both stop where a step would save a thousandth of the noise variance: 0.03 standard errors
    assert np.median(np.abs(apart)) < 0.05
    assert np.max(np.abs(apart)) < 1.0  # where one of them has a piece more


@pytest.mark.parametrize("course", [_swaying, _arriving], ids=["joints wander", "a piece comes and goes"])
def test_the_angle_does_not_jump_where_pieces_come_and_go(course):
    """With errors that stay the same from frame to frame, a jump of the angle is the estimator's doing."""
    last, before = None, None
    for i in range(FRAMES):
        part = i / (FRAMES - 1)
        shape = clean(_points(course(part), 120, np.random.default_rng(8)))
        last = follow(shape, NOISE, last)
        result, true = last.fit.profile, course(part).total_angle
        assert abs(result.total_angle - true) < 4 * result.total_angle_se
        if before is not None:
            assert abs(result.total_angle - true - before) < result.total_angle_se
        before = result.total_angle - true


def test_the_number_of_points_may_change_from_frame_to_frame():
    rng, last = np.random.default_rng(1), None
    for i in range(30):
        course = _swaying(i / 30)
        last = follow(clean(_points(course, 80 + 7 * (i % 5), rng)), NOISE, last)
        result = last.fit.profile
        assert last.fit.arcs.method == "arcs"
        assert abs(result.total_angle - course.total_angle) < 4 * result.total_angle_se


def test_an_outlier_of_one_frame_is_left_out_and_named():
    rng, last = np.random.default_rng(4), None
    for i in range(12):
        points = _points(_swaying(0.0), 120, rng)
        if i == 7:
            points[60] += 0.004 * np.array([0.6, 0.0, 0.8])
        last = follow(clean(points), NOISE, last)
        result = last.fit
        assert bool(result.warnings) == (i == 7), (i, result.warnings)
        assert abs(result.profile.total_angle - _swaying(0.0).total_angle) < 4 * result.profile.total_angle_se
    assert "60" in str(result.warnings) or not result.warnings


@pytest.mark.parametrize("bad", [0, 20])
@pytest.mark.parametrize("directed", [False, True])
def test_a_marker_that_stays_wrong_is_left_out_without_a_fit_from_nothing(bad, directed):
    """Else each frame of a stream took 20 ms, as long as one marker of a smooth route was misplaced."""
    rng, last, warm = np.random.default_rng(4), None, 0
    for i in range(24):
        exact = points_mm(60, 0.02 * i, noise=0.0, route=ROUTES[1]) / 1e3
        points = exact + NOISE * rng.standard_normal(exact.shape)
        points[bad] += (0.007, 0.0055, 0.0) if i < 18 else 0.0
        step = np.gradient(exact, axis=0)
        directions = step / np.linalg.norm(step, axis=1, keepdims=True) if directed else None
        shape = clean(points, directions=directions, direction_noise=0.02)
        last = follow(shape, None, last)
        warm += last.age > 0
        assert last.fit.spline is not None
        left_out = np.flatnonzero(last.fit.weight < 1.0).tolist()
        assert left_out == ([bad] if i < 18 else [])
    assert warm >= 20


@pytest.mark.parametrize("is_known", [False, True], ids=["unknown noise", "known noise"])
def test_a_smooth_route_is_tracked_where_markers_are_lost_and_return(is_known):
    rng, last, anew = np.random.default_rng(5), None, 0
    noise = NOISE if is_known else None
    for i in range(40):
        points = points_mm(60, 0.02 * i, i, NOISE, ROUTES[1]) / 1e3
        points[rng.integers(1, 59, rng.integers(3))] = np.nan
        shape = clean(points)
        last = follow(shape, noise, last)
        anew += last.age == 0
        assert len(last.fit.weight) == len(shape.points)
        fresh = measure(shape, noise).arcs
        assert abs(last.fit.arcs.total_angle - fresh.total_angle) < fresh.total_angle_se
        assert 0.4 < last.fit.arcs.total_angle_se / fresh.total_angle_se < 2.5  # as where none is lost
    assert anew <= 2


def test_a_route_that_leaps_is_measured_anew():
    rng = np.random.default_rng(6)
    last = follow(clean(_points(_swaying(0.0), 120, rng)), NOISE, None)
    shape = clean(_points(chain(np.array([0.5]), np.array([4.0])), 120, rng))
    result, fresh = follow(shape, NOISE, last).fit, measure(shape, NOISE)
    assert len(result.arcs.length) == len(fresh.arcs.length) == 1
    assert result.profile.total_angle == pytest.approx(
        fresh.profile.total_angle, abs=fresh.profile.total_angle_se
    )


def test_a_smooth_route_stays_smooth_and_a_staircase_takes_over():
    """Half a clothoid's frames, then seven pieces: each is identified after the waiting time."""
    rng, last = np.random.default_rng(2), None
    clothoid = truth("clothoid", rng)
    for _ in range(20):
        points = clothoid.position(np.linspace(0.0, clothoid.length, 120)) + NOISE * rng.standard_normal(
            (120, 3)
        )
        last = follow(clean(points), NOISE, last)
        assert last.fit.arcs.method == "spline"
    for _ in range(60):
        last = follow(clean(_points(_swaying(0.0), 120, rng)), NOISE, last)
    assert last.fit.arcs.method == "arcs"


def _tracked_until_a_chain_takes_over(seed):
    """Fits of noisy frames of three pieces, from a spline on, until one after a chain took over."""
    course = chain(np.array([0.15, 0.2, 0.15]), np.array([2.0, 9.0, 3.0]), np.zeros(3))
    rng, tracked = np.random.default_rng(seed), []
    while len(tracked) < 2 or tracked[-2].fit.chain is None:
        s = np.linspace(0.0, course.total_length, 60)
        shape = clean(arc_positions(course)(s) + 1e-3 * rng.standard_normal((60, 3)))
        last = tracked[-1] if tracked else None
        tracked.append(follow(shape, 1e-3, last, "auto" if tracked else "spline"))
        assert len(tracked) < 200
    return tracked


def test_a_chain_that_takes_over_has_the_model_choice_variance_at_once():
    taken = [_tracked_until_a_chain_takes_over(seed)[-2:] for seed in range(16)]
    close = [pair for pair in taken if pair[0].by_models.angle > 5e-4]  # rad²: a close call
    assert len(close) >= 3
    shares = [first.fit.arcs.total_angle_se**2 / second.fit.arcs.total_angle_se**2 for first, second in close]
    assert np.median(shares) == pytest.approx(1.0, rel=0.1)  # the same variance; without it 0.6


@pytest.mark.parametrize("course", [_swaying, _arriving], ids=["joints wander", "a piece comes and goes"])
def test_a_model_check_between_two_frames_equals_that_of_the_next_frame(course):
    rng, checks = np.random.default_rng(9), 0
    at_once, later = None, None
    for i in range(FRAMES):
        shape = clean(_points(course(i / FRAMES), 120, rng))
        later = follow(shape, NOISE, later)
        result = follow(shape, NOISE, at_once)
        checks += result.due and result.frames == 0
        at_once = model_checked(result)
        assert not at_once.due
        np.testing.assert_array_equal(result.fit.arcs.angle, later.fit.arcs.angle)
        np.testing.assert_array_equal(result.fit.arcs.covariance, later.fit.arcs.covariance)
    assert checks >= 3  # every eighth or sixteenth frame, counted anew when the other was tried


def test_one_point_beyond_a_last_joint_is_no_bend():
    """The last point of this frame is off by some standard deviations: a bend for it alone could be any."""
    samples = Path(__file__).parents[2] / "sample_shapes" / "insertion.jsonl"
    frame = json.loads(samples.read_text().splitlines()[116])
    result = measure(clean(1e-3 * np.array(frame["points"])), None)
    assert result.arcs.method == "arcs"
    assert result.profile.total_angle_se < 0.2  # rad; with a piece of that point 24 000


def test_a_route_that_is_carried_away_takes_its_start_along():
    """Unknown stations leave the start free along the route; it must not fall behind for ever."""
    rng, last = np.random.default_rng(7), None
    here = _points(_swaying(0.0), 60, rng)
    forward = (here[1] - here[0]) / np.linalg.norm(here[1] - here[0])
    for i in range(200):
        last = follow(clean(here + 1e-3 * i * forward), None, last)
    stations = last.fit.chain.stations
    # a foot goes farther than a noisy point's own error only where the start has stayed behind
    assert abs(stations[0]) < 5 * NOISE
    assert stations[-1] - stations[0] == pytest.approx(LENGTH.sum(), rel=0.01)


def test_nodes_and_evidence_of_a_tracked_chain_are_computed_when_first_asked_for():
    rng, last = np.random.default_rng(0), None
    for i in range(3):
        last = follow(clean(_points(_swaying(0.01 * i), 120, rng)), NOISE, last)
    assert last is not None
    arcs = last.fit.arcs
    assert last.fit.chain is not None
    assert "value" not in vars(last.fit.nodes)
    assert "value" not in vars(last.fit.evidence)
    sent = pickle.loads(pickle.dumps(last.fit.strip()))
    route = last.fit.route
    assert last.fit.route is route
    np.testing.assert_array_equal(sent.route.position, route.position)
    assert last.fit.noise == route.noise == NOISE
    assert last.fit.profile.total_angle == pytest.approx(arcs.total_angle, rel=1e-12)
    assert last.fit.profile.total_angle_se == pytest.approx(arcs.total_angle_se, rel=1e-9)


def test_a_route_that_leaps_is_fitted_as_if_from_nothing():
    """Any chain after any other, in as many points or fewer, noisy or exact."""
    for seed in range(24):
        rng, last = np.random.default_rng(seed), None
        for _ in range(4):
            k = rng.integers(1, 8)
            straight = rng.random(k) > 0.7
            course = chain(
                rng.uniform(0.05, 0.12, k),
                np.where(straight, 0.0, rng.uniform(0, 30, k)),
                rng.uniform(0, 6, k),
            )
            n, noise = int(rng.choice([30, 60, 120])), rng.choice([0.0, 1e-8, 1e-4])
            s = np.linspace(0.0, course.total_length, n)
            shape = clean(arc_positions(course)(s) + noise * rng.standard_normal((n, 3)))
            for _ in range(rng.integers(1, 7)):
                last = follow(shape, None, last)
            result, fresh = last.fit.profile, measure(shape).profile
            # exact points leave rounding; where a chain has a piece more it is off by its error at most
            off = abs(result.total_angle - course.total_angle)
            assert off < max(4 * result.total_angle_se, 2 * abs(fresh.total_angle - course.total_angle), 1e-5)


@pytest.mark.parametrize("route", ROUTES)
def test_the_other_estimator_is_tried_in_small_steps(monkeypatch, route):
    """The last step tried straight pieces and dropped what no point shows, 12 ms after one frame."""
    n, work, most, last, fit_pieces = 200, [0.0], 0.0, None, core.fit_pieces

    def counted(count, *arguments):
        fitted = fit_pieces(count, *arguments)
        work[0] += fitted[1] * work_of_evaluation(n, count)
        return fitted

    monkeypatch.setattr(core, "fit_pieces", counted)
    trials = set[object]()
    for i in range(80):
        last = follow(clean(1e-3 * points_mm(n, 0.01 * i, i, route=route)), None, last)
        joints, work[0] = last.fit.chain is not None and last.age < last.interval, 0.0
        trials.add(last.age)
        last = model_checked(last)
        most = most if joints else max(most, work[0])
    assert 0.0 < most < 10.0 * CHAIN_MOVES.work_of_any  # one fit of a candidate; it was 48 times that
    assert max(trials) < 80  # it was tried, and counts anew


def _wave(turn: float, noise: float, rng: np.random.Generator) -> np.ndarray:
    """Ten points on a wave in a plane, 0.4 m long, of this turn to either side [rad]; the noise in m."""
    s = np.linspace(0.0, 0.4, 2001)
    angle = turn * np.sin(np.pi * s / 0.4) ** 2
    ds = s[1] - s[0]
    x, y = (
        np.concatenate(([0.0], np.cumsum(f(angle)[:-1] + f(angle)[1:]) * ds / 2)) for f in (np.cos, np.sin)
    )
    points = np.column_stack((x, y, 0.0 * x))[:: len(s) // 9]
    return points + noise * rng.standard_normal(points.shape)


def test_few_points_that_move_keep_the_noise_of_the_last_fit():
    # one frame of ten points says little of its noise: nearly all of these were fitted from nothing
    rng, last, new, off = np.random.default_rng(8), None, 0, []
    for i in range(40):
        turn = 1.3 + 0.2 * np.sin(i / 4)
        last = follow(clean(_wave(turn, 5e-5, rng)), None, last)
        new += last.age == 0
        arcs = last.fit.arcs
        off.append((arcs.total_angle - 2 * turn) / arcs.total_angle_se)
    assert new <= 4
    assert np.mean(np.abs(off) < 1.96) >= 0.9


def test_few_points_that_went_over_to_another_estimator_are_fitted_from_nothing():
    """What they allow between them was averaged when the route was another one, as straight as it began."""
    rng, bent = np.random.default_rng(5), chain(np.array([0.1, 0.1]), np.array([20.0, 8.0]), 0.5)
    straight = clean(_points(chain(np.array([0.2]), np.array([0.1])), 20, rng))
    begun = TrackedFit.of(measure(straight, None, "spline"), straight.index)
    shape = clean(_points(bent, 20, rng))
    anew = measure(shape).arcs
    now = follow(shape, None, replace(begun, is_stale=True)).fit.arcs
    assert (now.total_angle, now.total_angle_se) == (anew.total_angle, anew.total_angle_se)
    with pytest.raises(NotWarmError):
        follow(shape, None, replace(begun, is_stale=True, warm_only=True))

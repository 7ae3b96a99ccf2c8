"""Few points do not show what a route does between them: error bars hold what its curvature may do; (235)."""

import math
from itertools import product

import numpy as np
import pytest

from tssgeom.route.bend_priors import cells, form_of, oscillations
from tssgeom.route.curvature_priors import turned_between
from tssgeom.route.geometry import measure
from tssgeom.route.model_average import with_turned
from tssgeom.route.observations import Shape, clean
from tssgeom.route.route import STATIONS
from tssgeom.route.route_fit import RouteFit, Turned
from tssgeom.route.synthetic import Course, chain, half_circle, positions
from tssgeom.route.tracking import follow

LENGTH, CELLS, DRAWS = 0.45, 60, 20
STRAIGHTS = chain(np.array([0.09, 0.08, 0.09, 0.1, 0.09]), np.array([0.0, 9.0, 0.0, 7.0, 0.0]), 0.3)


def sensed(course: Course, n: int, noise: float, rng: np.random.Generator) -> np.ndarray:
    """Noisy points at even stations [m]."""
    s = np.linspace(0.0, course.total_length, n)
    return positions(course, s) + noise * rng.standard_normal((n, 3))


def of_curvature(bend: np.ndarray, turn: float) -> Course:
    """A route of even cells [cells, 2] that turns so much [rad]."""
    return Course(
        np.full(len(bend), LENGTH / len(bend)), bend * (turn / LENGTH / np.linalg.norm(bend, axis=1).mean())
    )


def arcs(rng: np.random.Generator) -> Course:
    """Three to seven arcs in any planes, some of them straight."""
    count = rng.integers(3, 8)
    bend = rng.uniform(0.0, 1.0, (count, 1)) * _directions(rng.uniform(0.0, 2.0 * np.pi, count))
    bend[1:] *= rng.random((count - 1, 1)) < 0.75
    edge = np.cumsum(rng.dirichlet(np.full(count, 4.0)))
    piece = np.minimum(np.searchsorted(edge, (np.arange(CELLS) + 0.5) / CELLS), count - 1)
    return of_curvature(bend[piece], rng.uniform(0.5, 4.0))


def s_bend(rng: np.random.Generator) -> Course:
    """Straight, bent, straight, bent the other way, straight."""
    edge = np.cumsum(rng.dirichlet(np.full(5, 4.0)))
    piece = np.minimum(np.searchsorted(edge, (np.arange(CELLS) + 0.5) / CELLS), 4)
    kappa = np.array([0.0, rng.uniform(0.4, 1.0), 0.0, -rng.uniform(0.4, 1.0), 0.0])
    return of_curvature(np.outer(kappa[piece], (1.0, 0.0)), rng.uniform(0.5, 4.0))


def clothoid(rng: np.random.Generator) -> Course:
    """Curvature that changes in a straight line, with or without an inflection."""
    first, last = rng.uniform(-1.0, 1.0, 2)
    return of_curvature(np.outer(np.linspace(first, last, CELLS), (0.6, 0.8)), rng.uniform(0.5, 4.0))


def wandering(rng: np.random.Generator) -> Course:
    """Curvature that is a random walk."""
    walk = np.cumsum(rng.standard_normal((CELLS, 2)), axis=0) / np.sqrt(CELLS)
    return of_curvature(walk + rng.standard_normal(2), rng.uniform(0.5, 4.0))


def _directions(angle: np.ndarray) -> np.ndarray:
    return np.column_stack((np.cos(angle), np.sin(angle)))


KINDS = (arcs, s_bend, clothoid, wandering)


@pytest.mark.parametrize("n", [6, 8])
def test_intervals_of_few_points_hold_the_turn_of_any_kind_of_route(n):
    rng, off = np.random.default_rng([n, 41]), list[float]()
    for kind, noise, _ in product(KINDS, (2e-5, 2e-4), range(DRAWS)):
        course = kind(rng)
        route = measure(clean(sensed(course, n, noise, rng))).arcs
        off.append((route.total_angle - course.total_angle) / route.total_angle_se)
    assert np.mean(np.abs(off) < 1.96) >= 0.9
    assert abs(np.mean(np.clip(off, -5.0, 5.0))) < 0.3


def directed(course: Course, n: int, noise: float, rng: np.random.Generator) -> Shape:
    """Noisy points at even stations, and directions that err by 10 mrad."""
    s = np.linspace(0.0, course.total_length, n)
    after, before = (positions(course, np.clip(s + d, 0.0, course.total_length)) for d in (1e-5, -1e-5))
    tangents = (after - before) / np.linalg.norm(after - before, axis=1, keepdims=True)
    tangents += 0.01 * rng.standard_normal((n, 3))
    return clean(sensed(course, n, noise, rng), directions=tangents, direction_noise=0.01)


@pytest.mark.parametrize("n", [5, 6])
def test_directions_say_that_a_smooth_route_does_not_wave_between_its_points(n):
    """Points alone allow waves between them; with directions the error bar is near the error; (330)."""
    rng, off, error = np.random.default_rng([n, 330]), list[float](), list[float]()
    for _ in range(DRAWS):
        course = clothoid(rng)
        route = measure(directed(course, n, 2e-4, rng), 2e-4).arcs
        off.append((route.total_angle - course.total_angle) / route.total_angle_se)
        error.append(route.total_angle_se)
    assert np.mean(np.abs(off) < 1.96) >= 0.9
    assert np.median(error) < 0.1  # rad; 0.3 to 0.6 with the points alone


def test_intervals_of_few_points_with_directions_hold_the_turn_too():
    rng, off = np.random.default_rng(43), list[float]()
    for kind, _ in product(KINDS, range(DRAWS)):
        course = kind(rng)
        route = measure(directed(course, 6, 2e-5, rng), 2e-5).arcs
        off.append((route.total_angle - course.total_angle) / route.total_angle_se)
    assert np.mean(np.abs(off) < 1.96) >= 0.9


def test_points_without_noise_on_a_straight_line_have_no_angle():
    line = np.column_stack((np.cumsum(np.random.default_rng(0).uniform(0.01, 0.05, 11)), np.zeros((11, 2))))
    assert measure(clean(line), 0.0).arcs.total_angle == pytest.approx(0.0, abs=1e-6)


def smooth_fit(points: np.ndarray, noise: float) -> RouteFit:
    """A spline through points [m]."""
    return measure(clean(points), noise, "spline")


def test_on_a_circle_the_walks_agree_with_the_fit_and_turns_at_points_have_no_evidence():
    points = sensed(half_circle(), 8, 1e-5, np.random.default_rng(0))
    fit = smooth_fit(points, 1e-5)
    at_points, walk, _, smooth = turned_between(points, fit, 1e-5)
    for one in (walk, smooth):
        assert fit.arcs.total_angle + one.angle == pytest.approx(np.pi, abs=0.03)
        assert fit.arcs.total_length + one.length == pytest.approx(0.5, abs=2e-3)
    assert at_points.log_evidence < max(walk.log_evidence, smooth.log_evidence) - 3.0


def test_bends_between_straights_turn_as_their_polygon_does():
    points = sensed(STRAIGHTS, 8, 1e-4, np.random.default_rng(1))
    fit = smooth_fit(points, 1e-4)
    at_points, walk, _, smooth = turned_between(points, fit, 1e-4)
    assert at_points.log_evidence > max(walk.log_evidence, smooth.log_evidence)
    assert fit.arcs.total_angle + at_points.angle == pytest.approx(STRAIGHTS.total_angle, abs=0.1)


def test_draws_have_the_noise_that_is_stated_and_average_one_that_is_not():
    points = sensed(STRAIGHTS, 8, 1e-3, np.random.default_rng(2))
    fit = smooth_fit(points, 1e-3)
    exact, stated, unknown = (turned_between(points, fit, noise)[-1] for noise in (1e-4, 1e-3, None))
    assert exact.log_evidence < stated.log_evidence
    assert unknown.angle_variance > 0.0


def test_what_points_allow_goes_on_in_a_stream():
    points = sensed(STRAIGHTS, 8, 1e-4, np.random.default_rng(3))
    first = follow(clean(points), 1e-4, None)
    second = follow(clean(points), 1e-4, first)
    assert second.fit.turned == first.fit.turned != ()
    assert second.fit.arcs.total_angle_se > 0.9 * first.by_models.angle**0.5
    assert not second.fit.strip().turned


def alternating(n: int, noise: float, trial: int) -> tuple[np.ndarray, Course]:
    """Four arcs in a plane that alternate [m], about three points on each."""
    rng = np.random.default_rng([n, trial])
    kappa = rng.uniform(0.5, 1.0, 4) * (-1.0) ** np.arange(4)
    course = chain(np.full(4, LENGTH / 4), kappa * rng.uniform(1.0, 5.0) / (LENGTH / 4 * np.abs(kappa).sum()))
    return sensed(course, n, noise, rng), course


def test_arcs_that_alternate_are_not_noise():
    off, waves = list[float](), list[float]()
    for trial in range(60):
        points, course = alternating(12, 2e-4, trial)
        fit = measure(clean(points))
        off.append((fit.arcs.total_angle - course.total_angle) / fit.arcs.total_angle_se)
        at_points, walk, oscillates, smooth = turned_between(points, smooth_fit(points, 2e-4), None)
        waves.append(oscillates.log_evidence - max(walk.log_evidence, smooth.log_evidence))
        assert at_points.angle_variance > 0.0
    assert np.mean(np.abs(off) < 1.96) >= 0.9
    assert np.median(waves) > 3.0


def test_bends_between_two_points_are_within_the_bars_of_few_points():
    """Longer waves of less turn explain the points as well: up to one half wave a spacing 72 % hold."""
    off = list[float]()
    for trial in range(60):
        points, course = alternating(8, 2e-4, trial)
        fit = measure(clean(points))
        off.append((fit.arcs.total_angle - course.total_angle) / fit.arcs.total_angle_se)
    assert np.mean(np.abs(off) < 1.96) >= 0.9


def test_waves_do_not_wind_between_points():
    turn = np.linspace(0.0, 9.0, 5)
    points = 0.05 * np.column_stack((np.cos(turn), np.sin(turn), 0.4 * turn))
    fit = smooth_fit(points, 1e-5)
    waves = turned_between(points, fit, 1e-5)[2]
    assert math.isfinite(waves.log_evidence)
    assert fit.arcs.total_angle + waves.angle < 4 * STATIONS.most_turn_over_chord


def test_what_points_show_of_the_form_of_a_bend_is_certain():
    wave = oscillations(40)[0]
    bend = np.zeros((48, 2, 64))
    bend[:, 0] = 6.0 * np.sin(2.0 * np.pi * cells())[:, None]
    rng = np.random.default_rng(0)
    sines, chords = np.full(64, 1.0), np.full(64, math.pi / 4.0)  # a point at each bend
    known = form_of(wave.half_waves, bend, 40, 1e-6, rng)
    assert known.turn(sines, chords) == pytest.approx(1.0)
    hidden, few = (form_of(wave.half_waves, bend, *one, rng) for one in ((40, 0.02), (5, 1e-6)))
    for form in (hidden, few):
        assert set(np.round(form.turn(sines, chords), 3)) == {0.785, 1.0, 1.234}
    assert set(np.round(hidden.turn(sines, sines), 3)) == {0.785, 1.0, 1.234}


def test_accurate_points_hide_only_what_a_bend_turns_between_them():
    wave = oscillations(5)[0]
    bend = np.zeros((48, 2, 64))
    bend[:, 0] = 6.0 * np.sin(2.0 * np.pi * cells())[:, None]
    few = form_of(wave.half_waves, bend, 5, 1e-6, np.random.default_rng(0))
    sines, chords = np.full(64, 1.0), np.full(64, 0.95)
    assert few.turn(sines, chords).min() == pytest.approx(0.95)
    assert few.turn(sines, chords).max() < 1.06
    assert few.turn(sines, sines) == pytest.approx(1.0)


def test_how_often_a_route_bends_is_not_a_matter_of_its_points():
    for points in (8, 24, 40):
        every = oscillations(points)
        assert np.exp([one.log_share for one in every]).sum() == pytest.approx(1.0)
        for one in every:
            if one.half_waves > 20.0:
                assert one.log_share < -2.0
    assert oscillations(24)[-1].log_share < -4.5


LONG = chain(
    np.array([0.10, 0.16, 0.18, 0.12, 0.30, 0.14, 0.30, 0.10, 0.10]),
    np.array([1.0, 9.0, 3.0, 11.0, 0.6, 10.0, 1.5, 12.0, 0.0]),
    np.radians([0.0, 20.0, 150.0, 230.0, 60.0, 320.0, 200.0, 90.0, 0.0]),
)
SHORT = chain(
    np.array([0.18, 0.12, 0.10, 0.14, 0.06, 0.10]),
    np.array([0.0, 6.5, 0.0, 4.0, 0.0, 9.0]),
    np.radians([0.0, 0.0, 0.0, 110.0, 0.0, 200.0]),
)


@pytest.mark.parametrize(
    ("course", "n", "noise", "greatest"), [(LONG, 24, 2.5e-4, 80.0), (SHORT, 12, 3e-4, 38.0)]
)
@pytest.mark.parametrize("stated", [False, True])
def test_few_accurate_points_on_a_long_route_give_an_error_bar_of_use(course, n, noise, greatest, stated):
    off, error = list[float](), list[float]()
    for trial in range(12):
        rng = np.random.default_rng([n, trial])
        route = measure(clean(sensed(course, n, noise, rng)), noise if stated else None).arcs
        off.append((route.total_angle - course.total_angle) / route.total_angle_se)
        error.append(route.total_angle_se)
    assert np.max(np.abs(off)) < 2.5
    assert np.degrees(np.median(error)) < greatest


def test_a_smooth_route_of_many_bends_has_evidence_where_its_noise_is_known():
    x = np.linspace(0.0, 1.0, 24)
    points = np.column_stack((x, 0.06 * np.sin(6.0 * np.pi * x), 0.06 * np.cos(3.0 * np.pi * x)))
    points += 2e-4 * np.random.default_rng(3).standard_normal(points.shape)
    at_points, walk, _, smooth = turned_between(points, smooth_fit(points, 2e-4), 2e-4)
    assert smooth.log_evidence > max(walk.log_evidence, at_points.log_evidence) - 60.0


def test_a_sine_turns_less_than_arcs_with_its_first_harmonic_and_more_than_turns_at_points():
    x = (np.arange(6000) + 0.5) / 6000 * np.pi
    sine, steps = np.sin(x), np.full(6000, np.pi / 4)
    turns = np.zeros(6000)
    turns[2999:3001] = 1.0
    for shape, share in ((steps, np.pi**2 / 8), (turns / (turns @ sine) * (sine @ sine), np.pi / 4)):
        assert shape @ sine == pytest.approx(sine @ sine, rel=1e-3)
        assert shape.sum() / sine.sum() == pytest.approx(share, rel=1e-3)


def test_a_prior_that_oscillates_has_its_odds_to_the_others_beside_the_chains():
    def known(*evidence: float) -> tuple[Turned, ...]:
        return tuple(Turned(0.0, 0.1, 0.0, 0.1, one) for one in evidence)

    none = with_turned(np.array([0.2, 0.5, 0.3]), known(0.0, 0.0, -1000.0, 0.0))
    assert none == pytest.approx([0.2 / 3, 0.5, 0.3, 0.2 / 3, 0.2 / 3, 0.0])
    much = with_turned(np.array([0.2, 0.8]), known(0.0, 0.0, 20.0, 0.0))
    assert much[-1] > 0.99
    proven = with_turned(np.array([math.exp(-50.0), 1.0]), known(0.0, 0.0, 20.0, 0.0))
    assert proven[1] == pytest.approx(1.0)

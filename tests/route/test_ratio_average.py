"""Few points do not determine how smooth their route is, and the error bar of Φ includes it."""

from contextlib import suppress

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from tssgeom.core.constants_route import POINTS
from tssgeom.errors import FitError, ShapeError
from tssgeom.route import ratio_average
from tssgeom.route.arcs.chain import along, form_of
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean, on_chords
from tssgeom.route.ratio_average import averaged
from tssgeom.route.route import arcs_over_chords
from tssgeom.route.spline.fit import fit
from tssgeom.route.synthetic import Course, half_circle, helix, positions
from tssgeom.route.tracking import follow


def random_course(rng: np.random.Generator) -> Course:
    """Half a metre of a smooth random route, or of one to six pieces."""
    if rng.random() < 0.5:
        count = rng.integers(1, 7)
        length = 0.5 * rng.dirichlet(np.full(count, 4.0))
        kappa, plane = rng.uniform(0.0, 20.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
        return Course(length, np.column_stack((kappa * np.cos(plane), kappa * np.sin(plane))))
    t = (np.arange(400) + 0.5) / 400
    wave = np.cos(np.arange(4)[:, None] * np.pi * t + rng.uniform(0.0, 6.3, (2, 4, 1)))
    return Course(np.full(400, 0.5 / 400), np.einsum("ck,ckt->tc", 7.0 * rng.standard_normal((2, 4)), wave))


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(
    ("n", "noise"), [(6, 1e-4), (8, 2e-5), (8, 1e-3), (12, 2e-4), (20, 1e-3), (40, 2e-4)]
)
def test_intervals_of_few_points_hold_the_true_angle(n, noise, known):
    off = []
    for seed in range(24):
        rng = np.random.default_rng([seed, n])
        course = random_course(rng)
        s = np.linspace(0.0, 0.5, n)
        s[1:-1] += 0.1 / (n - 1) * rng.standard_normal(n - 2)
        points = positions(course, s) + noise * rng.standard_normal((n, 3))
        with suppress(FitError):  # few points may be too few
            arcs = measure(clean(points), noise if known else None).arcs
            off.append((arcs.total_angle - course.total_angle) / arcs.total_angle_se)
    assert len(off) >= 22
    assert np.mean(np.abs(off) < 1.96) >= 0.87
    assert abs(np.median(off)) < 0.6


@pytest.mark.parametrize("known", [True, False])
def test_accurate_points_two_radians_apart_are_not_taken_for_noise(known):
    points = helix(0.03, 0.04, np.linspace(0.0, 0.42, 8))
    angle = 0.42 * 0.03 / (0.03**2 + (0.04 / (2.0 * np.pi)) ** 2)
    points += 2e-5 * np.random.default_rng(0).standard_normal((8, 3))
    fit = measure(clean(points), 2e-5 if known else None)
    assert fit.arcs.total_angle == pytest.approx(angle, rel=0.1)
    assert fit.arcs.total_length == pytest.approx(0.42, rel=0.03)


def test_one_fit_stands_for_all_with_the_variance_of_all():
    rng = np.random.default_rng(3)
    points = positions(half_circle(), np.linspace(0.0, half_circle().total_length, 12))
    shape = clean(points + 1e-3 * rng.standard_normal((12, 3)))
    every = list(ratio_average._candidates(shape, None, fit(shape)))
    probability = np.exp(-0.5 * np.array([one.criterion for one in every]))
    probability /= probability.sum()
    angle, variance = (np.array([getattr(one, name) for one in every]) for name in ("angle", "variance"))
    chosen = ratio_average._representative(shape, every, [])
    k = [one.spline.memory.ratio for one in every].index(chosen.memory.ratio)
    expected = max(float(probability @ (variance + (angle - angle[k]) ** 2)) - variance[k], 0.0)
    assert chosen.ratio_variance * angle[k] ** 2 == pytest.approx(expected)
    off = np.abs(angle - probability @ angle)
    assert off[k] <= off[probability > 0.05 * probability.max()].min()


def test_many_points_are_not_averaged():
    shape = clean(positions(half_circle(), np.linspace(0.0, half_circle().total_length, POINTS.few + 1)))
    spline = fit(shape)
    assert averaged(shape, None, spline) is spline


def test_arcs_over_the_chords_of_a_circle_are_its_arcs():
    s = np.array([0.0, 0.07, 0.1, 0.2, 0.33, 0.42, 0.5]) / 0.5 * half_circle().total_length
    np.testing.assert_allclose(arcs_over_chords(positions(half_circle(), s)), s, rtol=2e-3)


@pytest.mark.parametrize("outlier", [0, 4, 7])
def test_a_chord_to_an_outlier_is_none_of_the_route(outlier):
    s = np.linspace(0.0, half_circle().total_length, 8)
    points, weight = positions(half_circle(), s), np.ones(8)
    points[outlier, 2] += 0.1
    weight[outlier] = 0.0
    inside = np.flatnonzero(weight)
    known = np.asarray(on_chords(clean(points), weight).stations)
    np.testing.assert_allclose(np.diff(known[inside]), np.diff(s[inside]), rtol=0.02)
    assert (np.diff(known) > 0.0).all()


def test_a_stream_goes_on_with_the_stations_and_the_variance_of_its_first_fit():
    rng, last, errors = np.random.default_rng(5), None, []
    points = helix(0.03, 0.04, np.linspace(0.0, 0.3, 8))
    angle = 0.3 * 0.03 / (0.03**2 + (0.04 / (2.0 * np.pi)) ** 2)
    for _ in range(12):
        before = last and last.fit.spline
        last = follow(clean(points + 1e-5 * rng.standard_normal((8, 3))), None, last)
        assert last.fit.spline is not None
        if before is not None:
            assert last.fit.spline.by_chords == before.by_chords
            assert last.fit.spline.ratio_variance == before.ratio_variance
        errors.append(last.fit.arcs.total_angle_se)
        assert last.fit.arcs.total_angle == pytest.approx(angle, rel=0.1)
    assert max(errors) < 2.0 * min(errors)


def _hermite(points: np.ndarray, tangents: np.ndarray) -> float:
    """Φ of cubic Hermite pieces over the chords [rad]."""
    u = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    curve, at = CubicHermiteSpline(u, points, tangents), np.linspace(0.0, u[-1], 1001)
    first, second = curve(at, 1), curve(at, 2)
    rate = np.linalg.norm(np.cross(first, second), axis=1) / np.linalg.norm(first, axis=1) ** 2
    return float(np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(at)))


def sensors(seed: int, n: int) -> tuple[Course, np.ndarray, np.ndarray]:
    """Return a random route, and the points and directions of n sensors along it."""
    rng = np.random.default_rng([seed, n, 7])
    course = random_course(rng)
    joints = np.concatenate(([0.0], np.cumsum(course.length)[:-1]))
    s, form = np.linspace(0.0, 0.5, n), form_of(np.zeros(3), np.eye(3), joints, course.bend)
    position, tangent, _ = along(s, form)
    points = position + 5e-4 * rng.standard_normal((n, 3))
    sensed = tangent + np.radians(0.5) * rng.standard_normal((n, 3))
    return course, points, sensed / np.linalg.norm(sensed, axis=1)[:, None]


@pytest.mark.parametrize("n", [6, 8])
def test_few_sensors_with_directions_give_the_angle_as_hermite_pieces_do(n):
    ours, peer, inside = [], [], []
    for seed in range(16):
        course, points, sensed = sensors(seed, n)
        with suppress(FitError, ShapeError):  # few sensors may be too few, or a coil seem out of order
            arcs = measure(clean(points, None, sensed, np.radians(0.5))).arcs
            ours.append(abs(arcs.total_angle - course.total_angle))
            peer.append(abs(_hermite(points, sensed) - course.total_angle))
            inside.append(ours[-1] < 1.96 * arcs.total_angle_se)
    assert len(ours) >= 14
    assert np.median(ours) < 1.3 * np.median(peer)
    assert np.mean(inside) >= 0.87

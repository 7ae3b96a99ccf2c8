"""The compiled geometry of a route against the same in plain Python, on random routes and broken ones."""

import math
import warnings
from itertools import pairwise

import numpy as np
import pytest

from tests.core.twins import (
    curvature,
    pieces,
    points,
    raw_outliers,
    spline_filter,
    spline_smoother,
    statistics,
)
from tssgeom import core
from tssgeom.errors import FitError
from tssgeom.route.observations import clean
from tssgeom.route.spline import warm as warming
from tssgeom.route.spline.fit import fit
from tssgeom.route.spline.problem import FilterModel

CASES = 250


def random_route(rng, n=None, noise=None):
    """Points along a smooth random curve, some with outliers, leaps or repeats [m]."""
    n = int(rng.integers(4, 40)) if n is None else n
    s = np.linspace(0.0, 1.0, n)
    size, rate, phase = rng.uniform([-3, 0.5, 0], [3, 6, 6], (3, 3)).T[:, :, None]
    tangent = (size * np.sin(rate * s + phase)).T + rng.normal(size=3)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    route = 0.3 * np.cumsum(tangent, axis=0) / n
    noise = 10.0 ** rng.uniform(-7, -3) if noise is None else noise
    return np.ascontiguousarray(route + noise * rng.normal(size=(n, 3)))


def broken_route(rng):
    """A random route with an outlier, a repeated point, a leap or a number that is none, now and then."""
    route, kind = random_route(rng), rng.integers(6)
    i = int(rng.integers(len(route)))
    if kind == 0:
        route[i] += 0.1 * rng.normal(size=3)
    elif kind == 1:
        route[i] = route[i - 1]
    elif kind == 2:
        route[i:] += 0.5
    elif kind == 3:
        route[i, 0] = np.nan if rng.integers(2) else np.inf
    return route


def random_model(rng, n=None):
    """A filter model with uneven stations, missing points and a prior that bends."""
    n = int(rng.integers(4, 25)) if n is None else n
    u = np.cumsum(rng.uniform(0.2, 1.8, n))
    u -= u[0]
    y = np.column_stack((u, 0.3 * np.sin(0.4 * u), 0.02 * u**2)) + 0.05 * rng.normal(size=(n, 3))
    weight = np.where(rng.random(n) < 0.1, 0.0, 1.0)
    weight[[0, 1, n - 2, n - 1]] = 1.0
    coupling = rng.uniform([0.0, -0.1, 0.0], [0.3, 0.1, 0.2], (n, 3))
    coupling[:, 2] = coupling[0, 2]
    transition = core.transitions(u, coupling)
    start = np.zeros((3, 4))
    start[:, 0], start[:, 1] = y[0], (y[-1] - y[0]) / u[-1]
    tangent = np.gradient(y, u, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    ends, across_only = np.array([1e4, 1e3, 2.0, 0.5]), bool(rng.integers(2))
    model = FilterModel(u, y, weight, transition, start, ends, tangent, across_only)
    if rng.integers(2):
        return model, coupling, (None, None)
    variance = np.where(rng.random(n) < 0.4, 10.0 ** rng.uniform(-4, -2), 0.0)
    return model, coupling, (tangent + 0.02 * rng.normal(size=(n, 3)), variance)


def close(value, expected, rtol=1e-10):
    """Compare to a share of the largest number."""
    atol = rtol * np.max(np.abs(expected), initial=0.0)
    np.testing.assert_allclose(value, expected, rtol=rtol, atol=atol)


def test_median_and_isotonic_regression():
    rng = np.random.default_rng(0)
    for n in [1, 2, 3, *rng.integers(1, 60, CASES)]:
        x, weight = np.round(rng.normal(size=n), int(rng.integers(1, 9))), rng.uniform(0.1, 2, n)
        assert core.median(x) == np.median(x)
        close(core.isotonic_regression(x, weight), statistics.isotonic_regression(x, weight))
    assert np.isnan(core.median(np.array([1.0, np.nan, 2.0])))
    assert np.isnan(core.median(np.zeros(0)))


def test_checks_of_points():
    rng, answers = np.random.default_rng(1), set()
    for _ in range(8 * CASES):
        p = broken_route(rng)
        spacing = float(np.median(np.linalg.norm(np.diff(p, axis=0), axis=1)))
        expected = 0
        if len(p) >= 8 and points._plain(p):
            expected = 1 if points.clearly_sound(p) else -1
        assert core.clearly_sound(p) == expected
        answers.add(expected)
        if len(p) >= 8 and np.isfinite(p).all():
            assert core.worst_outlier(p, spacing) == raw_outliers.worst_outlier(p, spacing)
    assert answers == {-1, 0, 1}


def test_lengths_of_points():
    rng = np.random.default_rng(2)
    for _ in range(CASES):
        p = random_route(rng)
        weight, known = (rng.random(len(p)) < 0.8).astype(float), np.cumsum(rng.uniform(0, 0.1, len(p)))
        close(core.path_length(p, weight), points.path_length(p, weight))
        length, angle, root = rng.uniform(0.01, 0.1, 3), rng.uniform(0.0, 1.0, 3), rng.normal(size=(6, 6))
        covariance = root @ root.T
        expected = (length.sum(), math.sqrt(covariance[3:, 3:].sum()), length.min())
        *totals, every, ignored, path = core.totals(length, angle, covariance, p, weight)
        close(totals, expected)
        close(every, length.sum() + angle.sum() + covariance.sum())
        close((ignored, path), points.path_length(p, weight))
        close(core.mean_spacing(p), points.mean_spacing(p))
        close(core.spacing_of_pieces(p, 0.3), points.spacing_of_pieces(p, 0.3))
        every = max(len(p) // 8, 1)
        close(core.against_stations(p, known, every)[:2], points._against_stations(p, known, every))
        assert core.against_stations(p, known, every)[2]
    assert not core.against_stations(p, known[::-1], every)[2]


def test_filter_and_search():
    rng = np.random.default_rng(3)
    for case in range(CASES):
        model, _, sensed = random_model(rng)
        ratio, inverse = 10.0 ** rng.uniform(-2, 5), 10.0 ** rng.uniform(-1, 2)
        out = np.zeros((len(model.u), 3))
        tangents = None if sensed[0] is None else sensed
        expected = spline_filter.innovations(model, ratio, out, tangents, inverse)
        white, *result = core.innovations(*model, *sensed, ratio, inverse)
        close(result, expected, 1e-9)
        if tangents is None:
            close(white, out, 1e-8)
        if case < 60:
            variance = 0.0025 if tangents is not None or rng.integers(2) else 0.0
            guess = 0.0 if case % 2 else 10.0 ** rng.uniform(0, 3)
            expected = spline_filter.best_ratio(model, variance, guess, tangents)
            close(core.best_ratio(*model, *sensed, variance, guess), expected, 1e-6)


def test_smoother_and_transitions():
    rng = np.random.default_rng(4)
    for _ in range(CASES):
        model, coupling, sensed = random_model(rng)
        close(model.transition, spline_smoother.transitions(model.u, coupling), 1e-12)
        ratio, inverse = 10.0 ** rng.uniform(-1, 4), 10.0 ** rng.uniform(-1, 2)
        tangents = None if sensed[0] is None else sensed
        expected = spline_smoother.smooth(model, ratio, tangents, inverse)
        for value, wanted in zip(core.smooth(*model, *sensed, ratio, inverse), expected, strict=True):
            close(value, wanted, 1e-9)


def test_the_next_pass_and_outliers():
    rng = np.random.default_rng(5)
    for _ in range(CASES):
        model, _, _ = random_model(rng)
        ratio, q = 10.0 ** rng.uniform(0, 3), 10.0 ** rng.uniform(-6, -3)
        mean, covariance, _ = core.smooth(*model, None, None, ratio, 0.0)
        given = (model.u, model.y, model.weight)
        known = bool(rng.integers(2))
        expected = spline_smoother.prior_along_curve(*given, ratio, q, mean, covariance, known)
        result = core.prior_along_curve(*given, ratio, q, mean, covariance, known)
        for value, wanted in zip(result, expected, strict=True):
            close(value, wanted)
        outlier, count = points.outlying_points(*given, 0.01, ratio, mean, covariance)
        assert core.outlying_points(*given, 0.01, ratio, mean, covariance)[0] == count
        np.testing.assert_array_equal(core.outlying_points(*given, 0.01, ratio, mean, covariance)[1], outlier)


def test_partition_and_parallel_components():
    rng = np.random.default_rng(6)
    for _ in range(CASES):
        n = int(rng.integers(1, 50))
        value = np.repeat(rng.normal(size=(n, 2)), rng.integers(1, 5), axis=0)
        weight = rng.uniform(0.5, 2.0, len(value))
        penalty = 10.0 ** rng.uniform(-2, 2)
        count, joints = core.best_partition(value, weight, penalty)
        np.testing.assert_array_equal(joints[: count + 1], pieces.best_partition(value, weight, penalty))
        tangent = rng.normal(size=(n, 3)) + np.array([3.0, 0.0, 0.0])
        tangent /= np.linalg.norm(tangent, axis=1)[:, None]
        vector = rng.normal(size=(n, 3))
        close(core.parallel_components(tangent, vector), pieces.parallel_components(tangent, vector), 1e-11)
        close(core.normals(tangent[0]), pieces.normals(tangent[0]), 1e-13)


def test_curvature_angle_and_their_errors():
    rng = np.random.default_rng(7)
    for case in range(40):
        p = random_route(rng, n=int(rng.integers(6, 30)), noise=1e-4)
        if case % 3 == 0:
            p = np.delete(p, slice(2, len(p) // 2), axis=0) if len(p) > 12 else p
        spline = fit(clean(p))
        route = spline.route
        cells = np.arange(len(route.s))
        penalty = 3.0 * np.log(len(route.weight))
        cut = pieces._cut(
            route.s, route.tangent, route.curvature_vector, spline.covariance, cells, spline.freedom, penalty
        )
        np.testing.assert_array_equal(spline.joints, cut)
        known, shared = bool(case % 2), 0.01 * (case % 4)
        kappa, phi, se, variance = curvature._profile(
            route.s, route.curvature_vector, route.tangent, spline.covariance, spline.gain, spline.freedom,
            route.noise, known, shared, route.station, 0.1,
        )  # fmt: skip
        curvature._bridge(route.s, route.tangent, route.station, kappa, phi, variance)
        normal, slant = curvature._sensitivity(route.curvature_vector, route.tangent, known)
        _, spread = curvature._angle_covariance(route.s, spline.covariance, spline.gain, normal, slant, cut)
        spread *= curvature._unknown_prior(spline.freedom)
        profile, lengths_angles, covariance = core.curvature_profile(
            route.s, route.tangent, route.curvature_vector, spline.covariance, spline.gain, spline.freedom,
            route.noise, known, shared, 0.1, route.station, spline.joints,
        )  # fmt: skip
        close(profile, (kappa, phi, se, np.sqrt(variance)), 1e-9)
        angle = pieces.angles(route.s, phi, cut)
        close(lengths_angles, (np.diff(route.s[cut]), angle), 1e-9)
        k, share = len(cut) - 1, angle / angle.sum()
        rest = max(variance[-1] - spread.sum(), 0.0)
        close(covariance[k:, k:], spread + rest * np.outer(share, share), 1e-8)
        longer = curvature._length_variance(route.s, route.curvature_vector, spline.covariance, spline.gain)
        expected = 0.0 if known else longer + 2.0 * route.noise**2
        assert covariance[:k, :k].sum() == pytest.approx(expected, rel=1e-6, abs=1e-24)


@pytest.mark.parametrize("n", [8, 40, 119, 120, 150])
@pytest.mark.parametrize("stations", [False, True])
def test_a_frame_in_one_call_is_the_same_as_in_many(n, stations):
    rng = np.random.default_rng(8)
    p = random_route(rng, n, 2e-4)
    known = (
        np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1)))) if stations else None
    )
    last, agreed = fit(clean(p, known)), 0
    for frame in range(6):
        shape = clean(p + 1e-4 * frame * np.sin(np.arange(n) / 5.0)[:, None], known)
        at_once = warming._pass_of_core(shape, None, last.memory, 1.0 + frame)
        in_parts = warming._pass_in_parts(shape, None, last.memory, 1.0 + frame)
        assert at_once.criterion == pytest.approx(in_parts.criterion, rel=1e-7)
        assert (at_once.spline is None) == (in_parts.spline is None)
        if at_once.spline is None or in_parts.spline is None:
            continue
        spline, expected, agreed = at_once.spline, in_parts.spline, agreed + 1
        for name in ("s", "position", "tangent", "curvature_vector", "station", "residual", "noise"):
            close(getattr(spline.route, name), getattr(expected.route, name), 1e-8)
        for name in ("covariance", "gain", "freedom", "deviance", "joints"):
            close(getattr(spline, name), getattr(expected, name), 1e-7)
        last = spline
    assert agreed > 2


def test_numbers_that_are_none_end_in_an_error_or_in_nan_and_never_hang():
    rng = np.random.default_rng(9)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for _ in range(CASES):
            model, _, sensed = random_model(rng)
            arrays = [np.array(each) for each in model[:-1]]
            spoiled = arrays[int(rng.integers(len(arrays)))]
            spoiled.flat[int(rng.integers(spoiled.size))] = rng.choice([np.nan, np.inf, 0.0, -1.0, 1e300])
            core.best_ratio(*arrays, True, *sensed, 0.01, 0.0)
            try:
                mean, covariance, _ = core.smooth(*arrays, True, *sensed, 10.0, 1.0)
            except FitError:
                continue
            core.prior_along_curve(*arrays[:3], 10.0, 1.0, mean, covariance, False)
            core.outlying_points(*arrays[:3], 0.01, 10.0, mean, covariance)


def test_wrong_shapes_and_types_are_refused_at_the_door():
    with pytest.raises(ValueError, match=r"transitions: coupling has shape \(4, 2\), not \(5, 3\)"):
        core.transitions(np.arange(5.0), np.zeros((4, 2)))
    converted = core.transitions(np.arange(5), np.zeros((5, 3), np.float32))
    np.testing.assert_array_equal(converted, core.transitions(np.arange(5.0), np.zeros((5, 3))))


def test_corners_are_those_of_ramer_and_the_search_ends_beyond_the_highest_number():
    rng = np.random.default_rng(4)
    for n, off in ((2, 1.0), (3, 1.0), (60, 2.0), (400, 5.0)):
        points = np.cumsum(rng.standard_normal((n, 3)), axis=0)
        count, kept = core.corners(points, off, n)
        at = np.flatnonzero(kept)
        assert count == len(at)
        assert (at[0], at[-1]) == (0, n - 1)
        for first, last in pairwise(at):  # all between are near the line
            assert _farthest(points, first, last) <= off
        assert len(at) == 2 or _farthest(points, 0, n - 1) > off
    walk = np.cumsum(rng.standard_normal((10_000, 3)), axis=0)
    count, kept = core.corners(walk, 0.1, 200)
    assert count == kept.sum() == 201
    assert core.corners(walk[:1], 0.1, 200)[0] == 1


def _farthest(points, first, last):
    """Return the greatest distance of the points between two others from the line between these."""
    way = points[last] - points[first]
    off = points[first + 1 : last] - points[first]
    share = np.clip(off @ way / (way @ way), 0.0, 1.0)
    return float(np.linalg.norm(off - share[:, None] * way, axis=1).max(initial=0.0))

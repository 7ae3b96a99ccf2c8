"""Smooth routes: the error of the angle, whether its error bar is right, and fits that start warm."""

import numpy as np
import pytest

from tssgeom.route.observations import clean
from tssgeom.route.pieces import curvature_profile
from tssgeom.route.spline.fit import fit
from tssgeom.route.synthetic import Course, chain, colon, helix, positions

_CELLS = 400


def _waves(seed: int, shift: float = 0.0) -> Course:
    """Half a metre with four random harmonics in each component of curvature, moved on by `shift`."""
    rng = np.random.default_rng(seed)
    t = (np.arange(_CELLS) + 0.5) / _CELLS + shift
    size, phase = 6.0 * rng.standard_normal((2, 4)), rng.uniform(0.0, 2 * np.pi, (2, 4))
    waves = np.cos(np.pi * np.arange(4)[:, None] * t + phase[:, :, None])
    return Course(np.full(_CELLS, 0.5 / _CELLS), np.einsum("ck,ckt->tc", size, waves))


def _clothoid() -> Course:
    s = (np.arange(_CELLS) + 0.5) * 0.5 / _CELLS
    return chain(np.full(_CELLS, 0.5 / _CELLS), 40.0 * s)


def _angle(points, stations=None):
    profile = curvature_profile(fit(clean(points, stations)))
    return profile.total_angle, profile.total_angle_se


def _errors(courses, noise, known):
    """Relative errors of Φ and errors in standard errors."""
    relative, z = [], []
    for seed, course in enumerate(courses):
        s = np.linspace(0.0, course.total_length, 200)
        points = positions(course, s) + noise * np.random.default_rng(seed + 90).standard_normal((200, 3))
        phi, se = _angle(points, s if known else None)
        relative.append(phi / course.total_angle - 1.0)
        z.append((phi - course.total_angle) / se)
    return np.array(relative), np.array(z)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(
    ("courses", "noise", "bound"),
    [
        ([_waves(k) for k in range(24)], 5e-4, 0.0100),
        ([_waves(k) for k in range(24)], 1e-4, 0.0034),
        ([_clothoid()] * 12, 5e-4, 0.0046),
        ([_clothoid()] * 12, 1e-4, 0.0012),
        ([colon()] * 8, 5e-4, 0.0075),
        ([colon()] * 8, 1e-4, 0.0035),
    ],
)
def test_smooth_routes_are_met_within_their_error_bars(courses, noise, bound, known):
    relative, z = _errors(courses, noise, known)
    assert np.sqrt(np.mean(relative**2)) < bound  # 1.4 times the rms of 60 trials
    # of 24 right intervals of 95 %, five or more miss with a chance of 0.6 %
    assert np.sum(np.abs(z) > 1.96) < 5
    assert np.sqrt(np.mean(z**2)) > 0.3  # nor are they so wide that they are of no use


def test_a_helix_is_met_within_its_error_bar():
    s = np.linspace(0.0, 0.42, 200)
    kappa = 0.03 / (0.03**2 + (0.04 / (2 * np.pi)) ** 2)
    z = []
    for seed in range(12):
        points = helix(0.03, 0.04, s) + 1e-4 * np.random.default_rng(seed).standard_normal((200, 3))
        phi, se = _angle(points, s)
        assert phi == pytest.approx(0.42 * kappa, rel=2.5e-3)  # 5 standard deviations of trials
        z.append((phi - 0.42 * kappa) / se)
    assert np.sum(np.abs(z) > 1.96) < 4  # four or more of 12: 0.2 %


def _frames(n, noise, count):
    """Points of a route whose waves move on along it, a hundredth of its length in ten frames."""
    rng = np.random.default_rng(8)
    for k in range(count):
        course = _waves(3, 0.001 * k)
        s = np.linspace(0.0, course.total_length, n)
        yield positions(course, s) + noise * rng.standard_normal((n, 3)), s


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("noise", [3e-4, None])
@pytest.mark.parametrize("n", [60, 200])
def test_a_fit_that_starts_from_the_last_one_agrees_with_one_from_nothing(n, noise, known):
    last, differences = None, []
    for points, s in _frames(n, 3e-4, 30):
        shape = clean(points, s if known else None)
        last = fit(shape, noise, last)
        warm, cold = curvature_profile(last), curvature_profile(fit(shape, noise))
        differences.append((warm.total_angle - cold.total_angle) / cold.total_angle_se)
        assert warm.total_angle_se == pytest.approx(cold.total_angle_se, rel=0.5)
    # where stations are unknown, warm ones are feet of the last frame's points: a third of an error more
    assert np.sqrt(np.mean(np.square(differences))) < (0.25 if known else 0.4)


def test_a_route_that_is_not_the_last_one_is_fitted_from_nothing():
    points, s = next(_frames(80, 3e-4, 1))
    last = fit(clean(points, s))
    louder = points + 3e-3 * np.random.default_rng(1).standard_normal((80, 3))
    for other, stations in ((louder, s), (points[::2], s[::2]), (points, None)):
        again, alone = fit(clean(other, stations), None, last), fit(clean(other, stations))
        np.testing.assert_array_equal(again.route.curvature_vector, alone.route.curvature_vector)
        assert again.deviance == alone.deviance


def test_an_outlier_in_a_stream_is_ignored_like_any_other():
    frames = list(_frames(100, 2e-4, 3))
    last = fit(clean(*frames[0]))
    points = frames[1][0].copy()
    points[40] += 0.004
    result = fit(clean(points, frames[1][1]), None, last)
    assert result.route.weight[40] == 0.0
    assert result.route.weight.sum() == 99.0
    after = fit(clean(*frames[2]), None, result)
    assert after.route.weight.sum() == 100.0

"""Few points that lie in a plane show their noise across it; docs/model.md (256)."""

import numpy as np
import pytest

from tssgeom.route.geometry import measure, noise_of_plane
from tssgeom.route.observations import clean
from tssgeom.route.synthetic import Course, chain, half_circle, positions

LENGTH, NOISE = 0.45, 2e-4
WAVES = chain(np.full(5, LENGTH / 5), np.array([9.0, -8.0, 7.0, -9.0, 8.0]))


def sensed(course: Course, n: int, seed: int) -> np.ndarray:
    """Noisy points at even stations, in a plane of their own [m]."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    s = np.linspace(0.0, course.total_length, n)
    return positions(course, s) @ turn + NOISE * rng.standard_normal((n, 3))


def across(points: np.ndarray) -> float | None:
    """Noise across the plane beside a fit that takes all that it does not follow for noise of 4 mm."""
    shape = clean(points)
    return noise_of_plane(shape, measure(shape, 4e-3, "spline"))


def test_bends_in_a_plane_are_no_noise():
    noise = [across(sensed(WAVES, 8, seed)) for seed in range(40)]
    sizes = np.array([one for one in noise if one is not None])
    assert len(sizes) >= 38
    assert np.exp(np.mean(np.log(sizes))) == pytest.approx(NOISE, rel=0.3)


def test_white_noise_is_as_large_in_the_plane_as_across_it():
    shapes = [clean(sensed(half_circle(), 8, seed)) for seed in range(100)]
    assert sum(noise_of_plane(one, measure(one, NOISE, "spline")) is not None for one in shapes) <= 2


def test_points_that_were_not_sensed_across_their_plane_show_nothing():
    points = sensed(WAVES, 8, 0)
    points -= points.mean(axis=0)
    normal = np.linalg.svd(points)[2][-1]
    assert across(points) is not None
    assert across(points - np.outer(points @ normal, normal)) is None


def test_many_points_show_their_noise_themselves():
    assert across(sensed(WAVES, 60, 0)) is None


def test_a_first_fit_of_unsizes_noise_takes_it():
    """Eight points on five arcs: without it the route is straight, with noise of millimetres."""
    noise = np.array([measure(clean(sensed(WAVES, 8, seed))).noise for seed in range(20)])
    assert np.mean(noise < 3.0 * NOISE) >= 0.85

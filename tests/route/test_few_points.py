"""Points that are few or uneven for their route: an estimate, and an error bar that is right."""

import numpy as np
import pytest

from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean
from tssgeom.route.synthetic import Course, chain, half_circle, positions, setup_a

NOISE = 5e-4
BENDS = chain(
    np.array([0.1, 0.12, 0.1, 0.15]), np.array([12.0, 15.0, 9.0, 14.0]), np.array([0.0, 0.8, 1.6, 0.8])
)
COURSES = {"double circle": setup_a(), "bends": BENDS, "half circle": half_circle()}


def _uneven(course: Course, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Noisy points [m] at stations [m] that lie off even ones by a fifth of the spacing."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, n)
    s[1:-1] += 0.2 / (n - 1) * rng.standard_normal(n - 2)
    s = course.total_length * np.sort(np.clip(s, 0.0, 1.0))
    return positions(course, s) + NOISE * rng.standard_normal((n, 3)), s


@pytest.mark.parametrize("course", COURSES.values(), ids=COURSES)
@pytest.mark.parametrize("n", [8, 10])
def test_points_a_radian_apart_give_an_angle_within_its_error(course, n):
    true, off = course.total_angle, []
    for seed in range(25):
        arcs = measure(clean(_uneven(course, n, seed)[0]), NOISE).arcs
        off.append((arcs.total_angle - true) / arcs.total_angle_se)
        assert arcs.total_angle == pytest.approx(true, rel=0.35)
    assert np.mean(np.abs(off) < 1.96) > 0.8
    assert np.max(np.abs(off)) < 5.0


def test_an_end_far_from_crowded_points_is_no_outlier():
    course = half_circle()
    for seed in range(60):
        rng = np.random.default_rng(seed)
        s = course.total_length * np.sort(np.concatenate(([0.0, 1.0], rng.uniform(0.0, 1.0, 198))))
        arcs = measure(clean(positions(course, s) + NOISE * rng.standard_normal((200, 3))), NOISE).arcs
        assert arcs.total_length == pytest.approx(course.total_length, rel=0.006)


def test_an_outlier_near_an_end_leaves_no_coil():
    course = half_circle()
    for seed in range(20):
        points, _ = _uneven(course, 200, seed)
        points[1 + seed % 3] += 0.01 * np.array([0.2, -0.1, 0.97])
        arcs = measure(clean(points), NOISE).arcs
        assert arcs.total_angle == pytest.approx(np.pi, rel=0.05)


def test_thirty_points_on_an_arc_are_one_piece():
    """Joints that the information criterion prefers by a little lose to the spline at their full price."""
    course, off = half_circle(), []
    for seed in range(80):
        arcs = measure(clean(_uneven(course, 30, seed)[0]), NOISE).arcs
        off.append((arcs.total_angle - np.pi) / np.pi)
    assert np.sqrt(np.mean(np.square(off))) < 1.3 * 0.0018  # the bound is 0.18 %


def test_points_that_no_smooth_curve_follows_are_fitted_or_refused():
    """A curve by chords that ignored all but two of them had ended a whole recording with a ValueError."""
    x = [-0.027, 21.19, 79.563, 158.683, 235.256, 285.997, 277.901, 279.212, 194.617]
    y = [0.012, -0.003, -0.045, -0.086, 0.0, 0.042, -0.032, -0.087, 0.048]
    z = [-0.055, 78.501, 134.854, 152.714, 125.953, 62.721, -56.246, -53.338, -137.614]
    fit = measure(clean(1e-3 * np.column_stack((x, y, z))))
    assert np.isfinite(fit.arcs.total_angle_se)

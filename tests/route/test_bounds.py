"""A curve through points is no shorter and turns no less than their polygon, noise apart."""

import math

import numpy as np
import pytest

from tests.route.test_ratio_average import sensors
from tssgeom.route.bounds import polygon, polygon_of, within_bounds
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean
from tssgeom.route.synthetic import Course, half_circle, positions

LENGTH = half_circle().total_length
LINE = Course(np.array([0.5]), np.zeros((1, 2)))


def _on_half_circle(n: int) -> np.ndarray:
    return positions(half_circle(), np.linspace(0.0, LENGTH, n))


@pytest.mark.parametrize("n", [4, 12, 400])
def test_the_polygon_of_exact_points_is_the_bound(n):
    points = _on_half_circle(n)
    one = polygon(points, np.ones(n))
    chords = 2.0 * (n - 1) * LENGTH / np.pi * np.sin(0.5 * np.pi / (n - 1))
    turns = np.pi * (n - 2) / (n - 1)
    assert one.chord.sum() == pytest.approx(chords)
    assert one.turn.sum() == pytest.approx(turns)
    assert one.broken(chords, turns, 0.0) is None
    assert f"{1e3 * chords:.5g} mm apart" in (one.broken(chords - 1e-6, turns, 0.0) or "")
    assert f"{math.degrees(turns):.4g}°" in (one.broken(chords, turns - 1e-6, 0.0) or "")


def test_a_point_without_weight_bounds_nothing():
    points, weight = _on_half_circle(12), np.ones(12)
    points[5, 2] += 0.1
    weight[5] = 0.0
    assert polygon(points, np.ones(12)).broken(LENGTH, np.pi, 1e-4) is not None
    assert polygon(points, weight).broken(LENGTH, np.pi, 1e-4) is None


@pytest.mark.parametrize("n", [5, 20, 200])
@pytest.mark.parametrize("noise", [2e-5, 5e-4, 2e-3])
@pytest.mark.parametrize("course", [half_circle(), LINE], ids=["arc", "line"])
def test_noise_of_its_size_breaks_no_bound_of_the_true_route(course, noise, n):
    broken = 0
    for seed in range(200):
        points = positions(course, np.linspace(0.0, course.total_length, n))
        points += noise * np.random.default_rng(seed).standard_normal((n, 3))
        broken += (
            polygon(points, np.ones(n)).broken(course.total_length, course.total_angle, noise) is not None
        )
    assert broken <= 2


def test_the_errors_of_both_sums_are_their_derivatives():
    rng = np.random.default_rng(1)
    points = _on_half_circle(10) + 1e-3 * rng.standard_normal((10, 3))
    draws = [polygon(points + 1e-6 * rng.standard_normal((10, 3)), np.ones(10)) for _ in range(4000)]
    one = polygon(points, np.ones(10))
    assert np.std([each.chord.sum() for each in draws]) == pytest.approx(1e-6 * one.length_error, rel=0.05)
    assert np.std([each.turn.sum() for each in draws]) == pytest.approx(1e-6 * one.angle_error, rel=0.05)


def test_a_fit_below_its_polygon_warns_with_both_numbers():
    """Where a noise is stated that is far too small, the residuals are none of it."""
    shape = clean(_on_half_circle(12))
    fit = measure(shape)
    assert within_bounds(fit, shape).warnings == fit.warnings
    bent = clean(np.vstack((shape.points[:-1], shape.points[-1] + [0.0, 0.0, 0.05])))
    (warning,) = [text for text in within_bounds(fit, bent).warnings if "polygon" in text or "apart" in text]
    assert "check noise_mm" in warning


def _sensors(seed, n, gap=None):
    """Return a random route and the shape of n sensors, one of which may lack its direction."""
    course, points, directions = sensors(seed, n)
    if gap is not None:
        directions[gap] = math.nan
    return course, clean(points, None, directions, np.radians(0.5))


@pytest.mark.parametrize(("seed", "n"), [(110, 5), (175, 5), (189, 6), (201, 5), (202, 5)])
def test_a_route_turns_by_no_less_than_the_directions_of_its_sensors(seed, n):
    course, shape = _sensors(seed, n)
    arcs = measure(shape).arcs
    assert abs(arcs.total_angle - course.total_angle) < 2.0 * arcs.total_angle_se
    assert arcs.total_angle > polygon_of(shape, np.ones(n)).directions_angle


@pytest.mark.parametrize("gap", [None, 2])
@pytest.mark.parametrize("seed", range(2, 12))
def test_noise_of_directions_breaks_no_bound_of_the_true_route(seed, gap):
    course, shape = _sensors(seed, 8, gap)
    through = polygon_of(shape, np.ones(8))
    assert 0.0 < through.directions_angle < course.total_angle
    broken = through.broken(0.6, 0.9 * through.directions_angle, 1.0)
    assert broken is not None
    assert "the directions of its sensors by at least" in broken

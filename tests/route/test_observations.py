from dataclasses import replace

import numpy as np
import pytest

from tests.known_routes import Cell, draw
from tssgeom import core
from tssgeom.arrays import read_only
from tssgeom.errors import ShapeError
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean, on_chords, out_of_order
from tssgeom.route.route import step_lengths
from tssgeom.route.synthetic import half_circle, positions, setup_a


def _arc(n=50):
    return positions(half_circle(), np.linspace(0, 0.5, n))


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (_arc(3), "3 distinct points"),
        (np.empty((0, 3)), "0 distinct points"),
        (np.repeat(_arc(3), 4, axis=0), "3 distinct points"),
        (np.full((10, 3), np.nan), "0 distinct points"),
        (np.zeros((10, 3)), "1 distinct points"),
        (1e-9 * _arc(), "span"),
        (np.zeros((5, 2)), "one row of x, y, z"),
        (np.vstack((_arc(), [[np.inf, 0, 0]])), "point 50 is infinite"),
    ],
)
def test_hopeless_points_are_refused_with_the_reason(points, reason):
    with pytest.raises(ShapeError, match=reason):
        clean(points)


@pytest.mark.parametrize("seed", range(5))
def test_shuffled_points_are_refused(seed):
    with pytest.raises(ShapeError, match="not in order"):
        clean(np.random.default_rng(seed).permutation(_arc()))


def test_halves_in_the_wrong_order_are_refused():
    arc = _arc(100)
    with pytest.raises(ShapeError, match="not in order"):
        clean(np.vstack((arc[50:], arc[:50])))


def test_a_half_that_runs_backwards_is_refused():
    arc = _arc(100)
    with pytest.raises(ShapeError, match="not in order"):
        clean(np.vstack((arc[:50], arc[:49:-1])))


@pytest.mark.parametrize("n", [8, 12, 30, 400])
def test_loops_are_no_disorder(n):
    course = setup_a()
    clean(positions(course, np.linspace(0, course.total_length, n)))


def test_dense_noise_is_no_disorder():
    clean(_arc(3000) + 2e-3 * np.random.default_rng(0).normal(size=(3000, 3)))


def test_points_missing_without_a_mark_are_no_disorder():
    clean(np.delete(_arc(100), slice(40, 70), axis=0))


def test_repeated_points_are_merged_with_a_warning():
    shape = clean(np.repeat(_arc(), 2, axis=0))
    assert len(shape.points) == 50
    assert shape.warnings == ("50 repeated points merged",)


def test_missing_points_keep_their_numbers():
    arc = _arc()
    arc[10:13] = np.nan
    shape = clean(arc)
    assert len(shape.points) == 47
    np.testing.assert_array_equal(np.diff(shape.index)[8:11], [1, 4, 1])
    assert shape.warnings == ("3 points missing, bridged",)


def test_points_missing_at_the_ends_are_not_bridged():
    arc = _arc()
    arc[:1] = arc[-3:] = np.nan
    assert clean(arc).warnings == (
        "the first point is missing: the route is computed without it",
        "the last 3 points are missing: the route is computed without them",
    )


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_a_route_of_unlikely_size_is_used_with_a_warning_about_the_unit(scale):
    assert any("check the unit" in text for text in clean(scale * _arc()).warnings)


@pytest.mark.parametrize("scale", [0.0064, 1.0, 100.0])
def test_routes_from_a_few_millimetres_to_tens_of_metres_give_no_warning(scale):
    assert clean(scale * _arc()).warnings == ()


def test_positions_too_far_out_for_their_differences_are_refused():
    with pytest.raises(ShapeError, match="check the unit of the coordinates"):
        clean(1e300 * _arc())


@pytest.mark.parametrize("scale", [1e-3, 0.3, 3.0, 1e3])
def test_stations_that_cannot_belong_to_the_points_are_refused(scale):
    with pytest.raises(ShapeError, match="check the unit of the stations"):
        clean(_arc(), scale * np.linspace(0.0, 0.5, 50))


@pytest.mark.parametrize("stations", [[np.inf] * 5, [-1e308, 1.0, 2.0, 3.0, 1.7e308]])
def test_infinite_stations_are_refused_without_a_warning_of_their_difference(stations):
    with pytest.raises(ShapeError, match="check the unit of the stations"):
        clean(_arc(5), np.array(stations))


def test_stations_a_tenth_too_short_are_worth_a_warning():
    noisy = _arc() + 1e-3 * np.random.default_rng(0).standard_normal((50, 3))
    assert clean(noisy, np.linspace(0.0, 0.5, 50)).warnings == ()
    (text,) = clean(noisy, np.linspace(0.0, 0.45, 50)).warnings
    assert "farther apart than their stations" in text


@pytest.mark.parametrize(
    ("stations", "reason"), [([0, 1, 3, 2, 4], "do not increase"), ([0, 1], "2 stations")]
)
def test_wrong_stations_are_refused(stations, reason):
    with pytest.raises(ShapeError, match=reason):
        clean(_arc(5), np.array(stations, dtype=float))


def test_known_stations_count_from_the_first_sensed_point():
    arc = _arc(20)
    arc[0] = np.nan
    shape = clean(arc, np.linspace(0.1, 0.6, 20))
    assert shape.stations is not None
    assert shape.stations[0] == 0.0
    assert shape.stations[-1] == pytest.approx(0.5 * 18 / 19)


def test_the_shape_cannot_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        clean(_arc()).points[0] = 0.0


def test_points_that_pass_the_quick_bounds_pass_the_full_tests():
    rng, passed = np.random.default_rng(0), 0
    for i in range(300):
        points = _arc(int(rng.integers(8, 60))) + 2e-3 * rng.random() * rng.standard_normal((1, 3))
        points = points + 1e-3 * rng.random() * rng.standard_normal(points.shape)
        if i % 3 == 0:
            points[rng.integers(len(points))] += 0.05 * rng.standard_normal(3)
        if i % 5 == 0:
            points = points[rng.permutation(len(points))] if i % 2 else np.roll(points, len(points) // 2, 0)
        points = read_only(points)  # as `clean` gives them
        if core.clearly_sound(points) > 0:
            passed += 1
            assert not out_of_order(points)
            assert core.worst_outlier(points, np.median(step_lengths(points))) < 0
    assert 50 < passed < 250  # otherwise one of both sides would not be tried


@pytest.mark.parametrize("noise", [5e-5, 1e-3])
@pytest.mark.parametrize("method", ["auto", "spline"])
def test_stations_that_go_farther_than_many_points_are_named(noise, method):
    for route in ("half circle", "colon", "pieces"):
        known = draw(Cell("stations", route, 100, noise), 0)
        for scale in (1.0, 1.1):
            fit = measure(clean(known.points, scale * known.station), noise, method)
            named = any("the stations lie 10% farther apart" in each for each in fit.warnings)
            assert named == (scale > 1.0)


def test_a_point_without_weight_lengthens_no_way_between_the_others():
    points, weight = _arc(), np.ones(50)
    shape = clean(points)
    astray = replace(shape, points=read_only(points + 0.05 * np.eye(50)[:, [20, 20, 20]]))
    weight[20] = 0.0
    others = weight > 0.0
    ways = on_chords(shape), on_chords(astray, weight), on_chords(astray)
    true, given, every = (np.asarray(one.stations) for one in ways)
    assert np.abs(given - true)[others].max() < 1e-5  # of 0.5 m; the chord over two spaces is an arc as well
    assert every[-1] - true[-1] > 0.05

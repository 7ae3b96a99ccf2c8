"""Sensors that are missing at an end of streams and recordings: carried on with the others, or named."""

import numpy as np
import pytest

from tests.route.test_exchanges import COUNT, FRAMES, results, route, sensed
from tssgeom.frame import Frame
from tssgeom.rig import Rig
from tssgeom.route.lost_ends import carried_on, rows_of
from tssgeom.sensed_route import fit_frame

LOST = range(40, 60)


def without(points, which, frames=LOST):
    """The same frames, where these points are missing in some."""
    sent = np.array(points)
    for k in frames:
        sent[k, which] = np.nan
    return sent


def missing(result):
    return [text for text in result.warnings if "missing" in text]


@pytest.mark.parametrize("way", ["stream", "recording"])
@pytest.mark.parametrize(
    ("which", "name"),
    [([-1], "last point is"), ([0], "first point is"), ([-2, -1], "last 2 points are")],
)
def test_an_end_that_was_sensed_before_is_carried_on_and_named(way, which, name):
    true, points = sensed(sum(which) + 20)
    spacing = 450.0 / (COUNT - 1)
    for k, one in enumerate(results(way, without(points, which))):
        assert abs(one.arcs.total_length - 0.45) < 3e-3  # it fell by 50 mm and more
        assert len(one.shape.points) == COUNT
        assert np.linalg.norm(one.shape.points - true[k], axis=1).max() < 5e-3
        assert abs(one.arcs.total_angle - route(k)[1]) < 4 * one.arcs.total_angle_se
        if k not in LOST:
            assert missing(one) == []
            continue
        (text,) = missing(one)
        assert text.startswith(f"the {name} missing, ")
        assert text.endswith(" mm of the route: carried on with the others")
        length = float(text.split(", ")[1].split()[0])
        assert length == pytest.approx(len(which) * spacing, rel=0.05)


def test_the_error_grows_as_the_route_moves_on_without_its_end():
    _, points = sensed(21, noise=1e-4)
    clean = results("stream", points)
    lost = results("stream", without(points, [-1], range(30, FRAMES)))
    assert len({text for one in lost[30:] for text in missing(one)}) == 1
    ratio = [b.arcs.total_angle_se / a.arcs.total_angle_se for a, b in zip(clean, lost, strict=True)]
    assert ratio[29] == 1.0
    assert np.mean(ratio[70:]) > np.mean(ratio[30:34]) > 1.0


def test_an_end_that_was_never_sensed_is_named_without_a_length():
    _, points = sensed(22)
    for one in results("stream", without(points, [-1], range(FRAMES))):
        assert missing(one) == ["the last point is missing: the route is computed without it"]


def test_a_route_that_leaps_does_not_carry_its_end_along():
    _, points = sensed(23)
    sent, last = without(points, [-1]), None
    sent[50:] += 0.2
    for k in range(60):
        shape, last = fit_frame(Frame(sent[k], 0.02 * k), Rig(), last)
        ends = [text for text in shape.warnings if text.endswith("carried on with the others")]
        assert len(ends) == (40 <= k < 50)
        before = [text for text in shape.warnings if text.endswith("which ends before")]
        assert len(before) == (k >= 50)


@pytest.mark.parametrize("way", ["stream", "recording"])
def test_a_list_that_lacks_its_last_point_ends_before_it_and_says_so(way):
    _, points = sensed(24)
    sent = [one[:-1] if k in LOST else one for k, one in enumerate(points)]
    for k, one in enumerate(results(way, sent)):
        named = [text for text in missing(one) if text.endswith(" mm of the route, which ends before")]
        assert len(named) == (k in LOST)
        assert len(one.shape.points) == COUNT - (k in LOST)


@pytest.mark.parametrize("way", ["stream", "recording"])
def test_a_list_that_lacks_a_point_inside_is_bridged(way):
    true, points = sensed(25)
    sent = [np.delete(one, 4, axis=0) if k in LOST else one for k, one in enumerate(points)]
    for k, one in enumerate(results(way, sent)):
        assert missing(one) == (["1 point missing, bridged"] if k in LOST else [])
        off = one.shape.points - true[k, one.shape.index.astype(int)]
        assert np.linalg.norm(off, axis=1).max() < 5e-3


def test_a_list_of_other_points_is_not_taken_for_one_that_lacks_some():
    true, _ = sensed(26)
    along = np.linspace(0.0, COUNT - 1.0, COUNT - 1)
    other = np.column_stack([np.interp(along, np.arange(COUNT), column) for column in true[0].T])
    assert rows_of(other, true[0]) is None
    rows = rows_of(np.delete(true[1], [0, 6], axis=0), true[0])
    assert rows is not None
    np.testing.assert_array_equal(rows, [-1, 0, 1, 2, 3, 4, -1, 5, 6, 7])


def test_a_straight_end_is_not_turned_about_its_axis():
    """The motion of points on a line leaves the turn about it open."""
    before = np.column_stack((0.04 * np.arange(8.0), np.zeros((8, 2))))
    before[7, 1] = 0.02
    now = before + 1e-4 * np.random.default_rng(1).standard_normal(before.shape)
    now[7] = np.nan
    ends = carried_on(now, before, 1e-4)
    assert ends is not None
    assert np.linalg.norm(ends[0][7] - before[7]) < 2e-3

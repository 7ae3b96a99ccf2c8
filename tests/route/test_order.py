"""Points in the order of a tracker: the shortest path through them, or a warning."""

import numpy as np
import pytest

from tests.known_routes import truth
from tests.route.test_real_data import DATA
from tssgeom import Frame, FrameResult, Rig, analyse, process
from tssgeom.engine import alone, recorded
from tssgeom.errors import FitError, ShapeError
from tssgeom.rig import ShapeSensor
from tssgeom.route.agreement import order_warning, there_and_back
from tssgeom.route.order import along_the_shortest_path, shortest_path
from tssgeom.route.synthetic import colon, positions

SHORTEST = Rig(shape=ShapeSensor(order="shortest"))
TENTACLE = {"m1_u005": (3, 1, 2, 4, 0), "m2_u02": (3, 2, 4, 1, 0), "m12_u001002": (3, 2, 1, 0, 4)}


def sensed(n: int, seed: int = 0) -> np.ndarray:
    course, rng = colon(), np.random.default_rng(seed)
    return positions(course, np.linspace(0.0, course.total_length, n)) + 1e-4 * rng.standard_normal((n, 3))


@pytest.mark.parametrize("n", [12, 40, 200])
def test_shuffled_points_are_put_in_order(n):
    points, rng = sensed(n), np.random.default_rng(n)
    shuffled = rng.permutation(n)
    path = shortest_path(points[shuffled])
    in_order = shuffled[path]
    assert in_order.tolist() in ([*range(n)], [*range(n)][::-1])


def test_a_stream_keeps_its_direction_whatever_the_order_of_each_frame():
    rng, n = np.random.default_rng(1), 30
    frames = [Frame(sensed(n, 1), 0.0)]
    frames += [Frame(sensed(n, k)[rng.permutation(n)], 0.1 * k) for k in range(2, 8)]
    frames[4].points[11] = np.nan
    for one in process(frames, SHORTEST, tension_in=5.0):
        assert isinstance(one, FrameResult)
        assert np.linalg.norm(one.route.position[0] - positions(colon(), np.zeros(1))[0]) < 0.002
        assert one.arcs.total_angle == pytest.approx(colon().total_angle, rel=0.03)


@pytest.mark.parametrize("one_order", [True, False])
def test_a_recording_is_put_in_order_before_its_points_are_filtered(one_order):
    rng, n = np.random.default_rng(1), 30
    orders = [rng.permutation(n) for _ in range(8)]
    frames = [Frame(sensed(n, k)[orders[0 if one_order else k]], 0.1 * k) for k in range(8)]
    frames[0] = Frame(sensed(n, 0), 0.0)
    frames[4].points[11] = np.nan
    for results in (recorded(frames, SHORTEST, tension_in=5.0), alone(frames, SHORTEST, tension_in=5.0)):
        for one in results:
            assert isinstance(one, FrameResult)
            assert np.linalg.norm(one.route.position[0] - positions(colon(), np.zeros(1))[0]) < 0.002
            assert one.arcs.total_angle == pytest.approx(colon().total_angle, rel=0.03)


def test_directions_say_which_way_a_route_runs():
    points = sensed(20)
    directions = np.gradient(points, axis=0)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    back = np.arange(20)[::-1]
    assert along_the_shortest_path(points[back], directions[back], None).tolist() == back.tolist()
    assert along_the_shortest_path(points[back], None, None).tolist() == list(range(20))
    assert along_the_shortest_path(points[back], None, points[0]).tolist() == back.tolist()


@pytest.mark.parametrize("name", ["line", "half circle", "setup A", "7 pieces", "helix", "clothoid", "colon"])
def test_points_in_order_give_no_warning(name):
    route = truth(name, np.random.default_rng(0))
    for n in (5, 6, 8, 12, 20, 40):
        assert order_warning(route.position(np.linspace(0.0, route.length, n))) is None


def test_what_is_out_of_order_names_the_hint():
    points = sensed(12)[[0, 1, 2, 5, 6, 3, 4, 8, 7, 10, 9, 11]]
    assert "0 1 2 5 6 3 4" in (order_warning(points) or "")
    points = sensed(12)[[0, 7, 3, 9, 1, 5, 11, 2, 8, 4, 10, 6]]
    with pytest.raises(FitError, match=r"in the order 0 4 7 .*: check their order, set"):
        analyse(points)
    with pytest.raises(ShapeError, match=r"\[shape\] order = 'shortest'"):
        analyse(sensed(60)[np.random.default_rng(0).permutation(60)])


def test_points_that_go_there_and_back_are_no_route_and_the_two_ways_are_lines_of_one():
    there = sensed(60)
    said = analyse(np.concatenate((there, sensed(60, 1)[::-1]))).warnings
    assert any("run there and back: give either way" in text for text in said)
    turn = np.linspace(0.0, 2.0 * np.pi, 80)
    assert there_and_back(np.column_stack((np.cos(turn), np.sin(turn), 0.0 * turn))) is None
    assert there_and_back(there) is None


def test_too_many_points_are_refused():
    with pytest.raises(ShapeError, match="too many to be put in order"):
        along_the_shortest_path(np.random.default_rng(0).standard_normal((1001, 3)), None, None)


@pytest.mark.skipif(not DATA.is_dir(), reason="needs the measured shapes")
@pytest.mark.parametrize("name", TENTACLE)
def test_measured_markers_in_the_order_of_the_tracker_are_flagged(name):
    frame = np.loadtxt(DATA / "real" / "tentacle_mocap" / f"{name}.csv", delimiter=",", max_rows=1)
    points = frame[2:].reshape(-1, 3)
    try:
        said = " ".join(analyse(points).warnings)
    except FitError as error:
        said = str(error)
    assert "check their order" in said
    path = along_the_shortest_path(points, None, points[TENTACLE[name][0]])
    assert tuple(path.tolist()) == TENTACLE[name]

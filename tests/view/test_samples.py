import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tssgeom.engine import process
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.stream import Frame, FrameResult
from tssgeom.tendon.history import last_peak
from tssgeom.view.samples import evenly, outliers, ranges, round_down, round_up, route_samples, staircase


@given(st.integers(2, 5000), st.integers(2, 300))
def test_chosen_nodes_are_few_increasing_and_keep_both_ends(count: int, most: int) -> None:
    chosen = evenly(count, most)
    assert len(chosen) == min(count, most)
    assert (chosen[0], chosen[-1]) == (0, count - 1)
    assert (np.diff(chosen) > 0).all()


@given(st.floats(1e-9, 1e9))
def test_rounded_numbers_are_near_and_on_their_side(value: float) -> None:
    assert value * (1 - 1e-9) <= round_up(value) <= 1.26 * value
    assert value / 2.51 <= round_down(value) <= value * (1 + 1e-9)


def test_nothing_at_all_still_has_a_range() -> None:
    assert round_up(0.0) == 1.0


def test_staircase_encloses_the_whole_angle() -> None:
    arcs = Arcs.exact(np.array([0.1, 0.3, 0.2]), np.array([0.0, 2.0, 1.0]))
    s, kappa = staircase(arcs)
    assert np.trapezoid(kappa, s) == pytest.approx(arcs.total_angle)
    assert (len(s), s[0]) == (6, 0.0)


def test_ranges_hold_every_tension_and_length_of_the_run(moving: list[FrameResult]) -> None:
    frames = [route_samples(result) for result in moving]
    limits = ranges(frames, [result.arcs for result in moving])
    assert limits.tension >= max(frame.tension.max() for frame in frames)
    assert limits.length == max(frame.s[-1] for frame in frames)
    assert limits.kappa > max(np.median(frame.kappa) for frame in frames)


def test_last_of_several_equal_peaks_is_taken_at_its_top() -> None:
    tension = np.array([0.0, 14.9, 15.0, 14.9, 3.0, 14.95, 15.0, 14.95, 1.0])
    assert last_peak(tension) == 6


def test_missing_and_repeated_points_are_no_outliers_and_a_displaced_point_is() -> None:
    points = arc(40)
    points[20] += [0.0, 0.0, 0.02]
    points[10] = np.nan
    (result,) = process([Frame(np.insert(points, 30, points[30], axis=0))], Rig(), tension_in=5.0)
    assert isinstance(result, FrameResult)
    np.testing.assert_array_equal(outliers(result), points[[20]])


def arc(count: int) -> np.ndarray:
    turn = np.linspace(0.0, 2.0, count)
    points = 0.1 * np.column_stack([np.sin(turn), 1 - np.cos(turn), 0 * turn])
    return points + np.random.default_rng(0).normal(0.0, 1e-4, points.shape)

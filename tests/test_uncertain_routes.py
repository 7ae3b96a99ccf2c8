"""What a route that is hardly known, or out of order, says of itself, in each frame of a stream."""

import numpy as np
import pytest

from tssgeom import Frame, FrameResult, Rejected, analyse, process
from tssgeom.rig import Rig
from tssgeom.route.synthetic import chain, positions

BENDS = chain(np.array([0.05, 0.15, 0.08, 0.17]), np.array([0.0, 5.0, 0.0, 4.0]), 0.3)


def sensed(n: int, noise: float, seed: int) -> np.ndarray:
    """Markers on two bends between straights [m]."""
    s = np.linspace(0.0, BENDS.total_length, n)
    return positions(BENDS, s) + noise * np.random.default_rng(seed).standard_normal((n, 3))


def test_neighbours_that_are_exchanged_are_named():
    points = sensed(9, 5e-5, 1)[[0, 1, 2, 4, 3, 5, 6, 7, 8]]
    result = analyse(points)
    assert any("with points 3 and 4 exchanged" in text for text in result.warnings)
    assert abs(result.profile.total_angle - BENDS.total_angle) < 2.5 * result.profile.total_angle_se


def test_a_marker_before_the_exchanged_ones_that_is_missing_is_counted():
    points = sensed(9, 5e-5, 1)[[0, 1, 2, 4, 3, 5, 6, 7, 8]]
    points[1] = np.nan
    assert any("with points 3 and 4 exchanged" in text for text in analyse(points).warnings)


def test_a_stream_that_is_out_of_order_says_so_in_each_frame():
    mixed = [0, 2, 1, 3, 4, 6, 5, 7, 8]
    frames = [Frame(sensed(9, 2e-4, k)[mixed], 0.02 * k) for k in range(30)]
    results = list(process(frames, Rig(), tension_in=10.0))
    for one in results:
        said = one.reason if isinstance(one, Rejected) else " ".join(one.warnings)
        assert "check their order" in said
    assert sum(isinstance(one, FrameResult) for one in results) > 20


@pytest.mark.parametrize("first", [3, 7])
def test_a_stream_that_begins_exchanged_has_a_warning_until_it_is_put_right(first):
    """The last two as well, which a route may pass in a hairpin."""
    mixed = [*range(first), first + 1, first, *range(first + 2, 9)]
    order = [mixed if k < 20 else range(9) for k in range(30)]
    frames = [Frame(sensed(9, 5e-4, k)[list(order[k])], 0.02 * k) for k in range(30)]
    results = list(process(frames, Rig(), tension_in=10.0))
    assert all(isinstance(one, Rejected) or one.warnings for one in results[:21])
    last = results[-1]
    assert isinstance(last, FrameResult)
    assert last.warnings == ()


def test_a_stream_far_out_of_order_is_refused():
    mixed = [4, 2, 3, 7, 6, 1, 5, 8, 0]
    frames = [Frame(sensed(9, 2e-4, k)[mixed], 0.02 * k) for k in range(10)]
    for one in process(frames, Rig(), tension_in=10.0):
        assert isinstance(one, Rejected)
        assert "order" in one.reason


def test_markers_beside_the_centre_line_are_not_believed_in_silence():
    zigzag = np.zeros((5, 3))
    zigzag[:, 2] = np.linspace(0.0, 0.36, 5)
    zigzag[:, 0] = [0.0, 0.025, -0.021, 0.020, 0.0]
    result = analyse(zigzag)
    assert any("hardly known" in text and "marker_offset_mm" in text for text in result.warnings)
    assert result.profile.total_angle_se > np.radians(45.0)


@pytest.mark.parametrize("n", [9, 24])
def test_a_route_that_is_known_has_no_warning(n):
    """Too few points to show their noise are not taken for those of a program that smooths."""
    for seed in range(10, 14):
        assert analyse(sensed(n, 1e-4, seed)).warnings == ()

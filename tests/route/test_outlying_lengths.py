"""Recorded frames whose points lie along another length than those before and after are named; (331)."""

import numpy as np
import pytest

from tssgeom import Frame, FrameResult, Rig
from tssgeom.engine import alone, recorded
from tssgeom.route.synthetic import colon, positions
from tssgeom.smoothed_frames import outlying_lengths

COURSE = colon()


def frames(count: int = 40, n: int = 16, seed: int = 0) -> list[np.ndarray]:
    """Markers on a colon that swings as a whole, with 0.2 mm of noise [m]."""
    rng = np.random.default_rng(seed)
    points = positions(COURSE, np.linspace(0.0, COURSE.total_length, n))
    swing = 0.02 * np.sin(0.3 * np.arange(count))
    return [points * (1.0, 1.0 + each, 1.0) + 2e-4 * rng.standard_normal((n, 3)) for each in swing]


def named(points: list[np.ndarray]) -> list[int]:
    return list(outlying_lengths(dict(enumerate(points))))


def test_a_marker_that_is_taken_for_another_thing_is_named_and_no_clean_frame():
    points = frames()
    assert named(points) == []
    for bad in (0, 12, 13, 39):
        points[bad][7] += 0.05
    assert named(points) == [0, 12, 13, 39]


def test_what_begins_to_lengthen_leaps_or_shrinks_to_another_length_is_not_named():
    points = frames()
    grown = [each * (1.0 + 0.01 * max(k - 20, 0)) for k, each in enumerate(points)]
    leapt = [each * (1.1 if k >= 20 else 1.0) for k, each in enumerate(points)]
    assert named(grown) == named(leapt) == []


def test_frames_that_lack_points_are_left_out_and_few_frames_show_nothing():
    points = frames()
    points[5][3] = np.nan
    points[9] = points[9][:-1]
    points[20][7] += 0.05
    assert named(points) == [20]
    assert named(points[16:24]) == []
    assert outlying_lengths({}) == {}


@pytest.mark.parametrize("way", [recorded, alone])
def test_a_recording_says_it_of_the_frame(way):
    points = frames()
    points[20][7] += 0.05
    results = list(way([Frame(each, 0.05 * k) for k, each in enumerate(points)], Rig(), tension_in=5.0))
    said = [any("the points lie along" in text for text in one.warnings) for one in results]
    assert all(isinstance(one, FrameResult) for one in results)
    assert np.flatnonzero(said).tolist() == [20]

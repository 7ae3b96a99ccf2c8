"""Points side by side without a header, as scripts write them, are read with --unit alone."""

from pathlib import Path

import numpy as np
import pytest

from tssgeom.errors import ShapeError
from tssgeom.io.formats.files import open_recording
from tssgeom.stream import Frame

COUNT, FRAMES = 6, 5


def points(seed: int = 0) -> np.ndarray:
    """Markers on a bend, in an order of their own [frames, points, 3] [mm]."""
    s, rng = np.linspace(0.0, 1.2, COUNT), np.random.default_rng(seed)
    bend = 200.0 * np.column_stack((np.sin(s), 1.0 - np.cos(s), 0.0 * s)) + (300.0, -40.0, 900.0)
    return bend + rng.normal(0.0, 0.5, (FRAMES, COUNT, 3))


BEFORE = {
    "": np.zeros((FRAMES, 0)),
    ", after time": 0.02 * np.arange(FRAMES)[:, None] + 3.5,
    ", after frame": np.arange(FRAMES)[:, None] + 17,
    ", after frame and time": np.column_stack((np.arange(FRAMES), 0.02 * np.arange(FRAMES))),
}


def opened(path: Path, table: np.ndarray, separator: str = " ") -> tuple[tuple[str, ...], list[Frame]]:
    """Write a table, and read notes and frames of it."""
    np.savetxt(path, table, "%.6g", separator)
    recording = open_recording(path, "mm")
    return recording.notes, [frame for frame in recording.frames if isinstance(frame, Frame)]


@pytest.mark.parametrize(("ending", "separator"), [("txt", " "), ("csv", ","), ("tsv", "\t")])
@pytest.mark.parametrize("before", BEFORE)
def test_they_are_frames(tmp_path, before, ending, separator):
    table = np.column_stack((BEFORE[before], points().reshape(FRAMES, -1)))
    notes, read = opened(tmp_path / f"markers.{ending}", table, separator)
    np.testing.assert_allclose([1e3 * frame.points for frame in read], points(), atol=1e-3)
    assert any(note == f"no header: x, y, z of {COUNT} points in turn{before}" for note in notes)
    if "time" in before:
        np.testing.assert_allclose(np.diff([frame.time for frame in read]), 0.02, atol=1e-9)


def test_markers_in_the_order_of_a_tracker_are_points_too(tmp_path):
    mixed = points()[:, [3, 0, 5, 1, 4, 2]]
    first = opened(tmp_path / "markers.txt", mixed.reshape(FRAMES, -1))[1][0]
    np.testing.assert_allclose(1e3 * first.points, mixed[0], atol=1e-3)


def test_a_lost_marker_is_a_missing_point(tmp_path):
    lost = points()
    lost[2, 3] = np.nan
    read = opened(tmp_path / "markers.csv", lost.reshape(FRAMES, -1), ",")[1]
    assert np.isnan(read[2].points[3]).all()
    assert np.isfinite(read[1].points).all()


REFUSED = {
    "no unit": (points().reshape(FRAMES, -1), None),
    "all x first": (points().transpose(0, 2, 1).reshape(FRAMES, -1), "mm"),
    "a time in the place of a coordinate": (
        np.column_stack((0.1 * np.arange(FRAMES), points().reshape(FRAMES, -1)[:, 1:])),
        "mm",
    ),
    "three points": (points()[:, :3].reshape(FRAMES, -1), "mm"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_may_be_something_else_is_refused_with_the_header_to_write(tmp_path, name):
    table, unit = REFUSED[name]
    np.savetxt(tmp_path / "table.txt", table, "%.6g")
    with pytest.raises(ShapeError, match=r"no header: .*S1_x_mm"):
        open_recording(tmp_path / "table.txt", unit)

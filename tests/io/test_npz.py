"""NumPy archives of shapes and recordings."""

import warnings
import zipfile
from contextlib import suppress
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.formats.files import Recording, open_recording
from tssgeom.io.formats.recording import usable
from tssgeom.stream import Frame, Rejected

POINTS = np.random.default_rng(2).normal(size=(3, 6, 3))


def opened(folder: Path, given: str | None = None, **arrays: object) -> Recording:
    np.savez(folder / "run.npz", **arrays)  # type: ignore[arg-type]
    return open_recording(folder / "run.npz", given)


def frames(recording: Recording) -> list[Frame]:
    return [item for item in recording.frames if isinstance(item, Frame)]


def test_a_recording_comes_back_in_si(tmp_path):
    recording = opened(
        tmp_path,
        points=POINTS,
        time_s=[0.0, 0.5, 1.0],
        unit="mm",
        tension_in_N=[1.0, np.nan, 3.0],
        s=np.arange(6.0),
    )
    outcome = frames(recording)
    assert (recording.unit, recording.kind, recording.timed, recording.frame_count) == ("mm", "npz", True, 3)
    np.testing.assert_array_equal([frame.points for frame in outcome], POINTS / 1000)
    assert [frame.time for frame in outcome] == [0.0, 0.5, 1.0]
    assert [frame.tension_in for frame in outcome] == [1.0, None, 3.0]
    assert outcome[2].stations is not None
    np.testing.assert_array_equal(outcome[2].stations, np.arange(6) / 1000)


def test_one_shape_is_static(tmp_path):
    recording = opened(tmp_path, points=POINTS[0], unit="m")
    assert not recording.timed
    np.testing.assert_array_equal(frames(recording)[0].points, POINTS[0])


def test_without_time_the_frames_are_counted_with_a_warning(tmp_path):
    recording = opened(tmp_path, points=POINTS, unit="m")
    assert [frame.time for frame in frames(recording)] == [0.0, 1.0, 2.0]
    assert "no time" in recording.warnings[0]


def test_a_coordinate_of_nan_makes_the_point_a_missing_one(tmp_path):
    points = POINTS.copy()
    points[0, 2, 1] = np.nan
    frame = frames(opened(tmp_path, points=points, unit="m"))[0]
    assert np.isnan(frame.points[2]).all()


def test_a_frame_without_time_is_rejected_alone(tmp_path):
    recording = opened(tmp_path, points=POINTS, time_s=[0.0, np.nan, 1.0], unit="m")
    (rejected,) = [item for item in recording.frames if isinstance(item, Rejected)]
    assert rejected.seq == 1
    assert rejected.reason == "the time of the frame is nan s: give a finite time"


def test_unit_rules_are_those_of_the_other_formats(tmp_path):
    assert frames(opened(tmp_path, "mm", points=POINTS))[0].points[0, 0] == POINTS[0, 0, 0] / 1000
    with pytest.raises(ShapeError, match=r"no unit.*--unit mm\|m"):
        opened(tmp_path, points=POINTS)
    with pytest.raises(ShapeError, match="--unit says m"):
        opened(tmp_path, "m", points=POINTS, unit="mm")
    with pytest.raises(ShapeError, match="'inch': write mm or m"):
        opened(tmp_path, points=POINTS, unit="inch")


@pytest.mark.parametrize(
    ("arrays", "says"),
    [
        ({"route": POINTS, "tip": POINTS}, "no array 'points' among route[3, 6, 3], tip[3, 6, 3]"),
        ({"x": POINTS[..., 0]}, "no array 'points' among unit, x"),
        ({"points": POINTS[..., :2]}, "points has the size (3, 6, 2)"),
        ({"points": np.zeros((0, 6, 3))}, "points has the size (0, 6, 3)"),
        ({"points": POINTS, "time_s": [0.0, 1.0]}, "time_s has the size (2,) for 3 frames"),
        ({"points": POINTS, "s": np.zeros(5)}, "s has the size (5,)"),
        ({"points": np.full((3, 6, 3), "a")}, "points holds no numbers"),
        ({"points": POINTS, "time_s": [0j, 1j, 2j]}, "time_s holds no numbers but complex128"),
        ({"points": POINTS, "time_s": np.arange(3).astype("M8[s]")}, "no numbers but datetime64[s]"),
    ],
)
def test_arrays_of_the_wrong_size_or_kind_are_refused(tmp_path, arrays, says):
    with pytest.raises(ShapeError) as caught:
        opened(tmp_path, unit="m", **arrays)
    assert says in str(caught.value)


@pytest.mark.parametrize("far", [1e300, np.inf])
def test_frames_that_are_too_far_apart_are_rejected_without_a_warning_of_their_distance(tmp_path, far):
    (first, *_) = opened(tmp_path, points=POINTS * [[[far]], [[1.0]], [[1.0]]], unit="m").frames
    assert isinstance(first, Frame)
    assert not usable(first)


@pytest.mark.parametrize("name", ["run.npz", "run.npy"])
def test_an_array_that_python_2_wrote_is_read_without_a_warning(tmp_path, name):
    np.savez(tmp_path / "run.npz", points=POINTS[0])
    np.save(tmp_path / "run.npy", POINTS[0])
    raw = (tmp_path / name).read_bytes().replace(b"(6, 3), } ", b"(6L, 3), }")
    if name == "run.npz":
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            archive.writestr("points.npy", raw[raw.index(b"\x93NUMPY") : raw.index(b"PK\1\2")])
    else:
        (tmp_path / name).write_bytes(raw)
    (frame,) = open_recording(tmp_path / name, "m").frames
    assert isinstance(frame, Frame)
    np.testing.assert_array_equal(frame.points, POINTS[0])


@pytest.mark.parametrize("name", ["run.npz", "run.npy"])
def test_a_damaged_header_gives_no_warning_of_python(tmp_path, name):
    columns = np.zeros(6, [("x_mm", float), ("y_mm", float), ("z_mm", float)])
    np.save(tmp_path / "run.npy", columns)
    raw = (tmp_path / "run.npy").read_bytes().replace(b"x_mm", b"x\\mm")
    (tmp_path / "run.npy").write_bytes(raw)
    with zipfile.ZipFile(tmp_path / "run.npz", "w") as archive:
        archive.writestr("points.npy", raw)
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        with suppress(ShapeError):  # a column of a strange name may be known all the same
            open_recording(tmp_path / name, None)
    assert heard == []


def test_nothing_is_unpickled(tmp_path):
    with pytest.raises(SourceError, match="cannot be read as NPZ"):
        opened(tmp_path, points=np.array([{"a": 1}], dtype=object), unit="m")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut short", b"no archive at all"])
def test_a_broken_archive_is_refused_in_one_line(tmp_path, content):
    (tmp_path / "run.npz").write_bytes(content)
    with pytest.raises(SourceError, match="cannot be read as NPZ"):
        open_recording(tmp_path / "run.npz")


def _packed(head: bytes, packer: int) -> bytes:
    file = BytesIO()
    with zipfile.ZipFile(file, "w", packer) as archive:
        archive.writestr("points.npy", b"\x93NUMPY\1\0" + len(head).to_bytes(2, "little") + head + bytes(999))
    return file.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        _packed(b"{'descr': '<f8', 'shape': (9, 3), \n", zipfile.ZIP_STORED),
        _packed(b"{'descr': '<f8'}", zipfile.ZIP_LZMA).replace(b"\x5d\0\0", b"\xff" * 3),
    ],
    ids=["a header that does not end", "what LZMA did not pack"],
)
def test_whatever_python_raises_on_a_broken_archive_the_refusal_is_one_line(tmp_path, content):
    (tmp_path / "run.npz").write_bytes(content)
    with pytest.raises(SourceError, match="cannot be read as NPZ"):
        open_recording(tmp_path / "run.npz")


MOVING = 100.0 * np.arange(6)[:, None] * np.eye(3)[0] + np.linspace(0.0, 9.0, 20)[:, None, None]
"""[frame, point, axis] [mm]"""


@pytest.mark.parametrize("axes", [(0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)])
def test_axes_in_another_order_are_read_by_the_size_of_the_coordinates_and_the_number_of_times(
    tmp_path, axes
):
    path = tmp_path / "moving.npz"
    np.savez(path, points=MOVING.transpose(axes), time_s=np.arange(20.0), unit="mm")
    recording = open_recording(path, None)
    letters = ",".join("FN3"[k] for k in axes)
    assert recording.notes == (f"points[{letters}] read as [F,N,3]",)
    assert np.allclose([1e3 * frame.points for frame in recording.frames], MOVING)


@pytest.mark.parametrize("name", ["arr_0", "markers"])
def test_the_only_array_of_points_is_read_whatever_its_name(tmp_path, name):
    path = tmp_path / "moving.npz"
    np.savez(path, **{name: MOVING})
    recording = open_recording(path, "mm")
    assert recording.notes == (f"{name} read as points",)
    assert np.allclose([1e3 * frame.points for frame in recording.frames], MOVING)


def stored(path, points):
    np.savez(path, points=np.ascontiguousarray(points), unit="mm")


def compressed(path, points):
    np.savez_compressed(path, points=np.ascontiguousarray(points), unit="mm")


def columns_first(path, points):
    np.savez(path, points=np.asfortranarray(points), unit="mm")


def alone(path, points):
    np.save(path, points)


@pytest.mark.parametrize(
    ("name", "save"),
    [
        ("moving.npz", stored),
        ("moving.npz", compressed),
        ("moving.npz", columns_first),
        ("moving.npy", alone),
    ],
)
def test_points_first_without_times_are_refused_with_the_axis_that_is_to_be_first(tmp_path, name, save):
    path = tmp_path / name
    save(path, MOVING.transpose(1, 0, 2))
    with pytest.raises(
        ShapeError, match=r"frames that span 15\.6 and lie 500 apart, as points do: save the axis"
    ):
        open_recording(path, "mm")


@pytest.mark.parametrize("save", [stored, compressed, columns_first])
def test_frames_first_without_times_are_read(tmp_path, save):
    path = tmp_path / "moving.npz"
    save(path, MOVING)
    assert np.allclose([1e3 * frame.points for frame in open_recording(path, None).frames], MOVING)


def test_opening_frames_without_times_reads_the_first_and_the_last_one_alone(tmp_path):
    path, many = tmp_path / "moving.npz", np.repeat(MOVING, 20, axis=0)
    many[200] = 7.0
    stored(path, many)
    written = path.read_bytes()
    at = written.index(many[200].tobytes())
    path.write_bytes(written[:at] + b"\xff" + written[at + 1 :])  # a damaged byte between both
    recording = open_recording(path, None)
    with pytest.raises(SourceError, match="cannot be read as NPZ"):
        list(recording.frames)

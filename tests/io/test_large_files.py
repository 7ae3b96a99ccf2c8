"""Files too large for the memory: read in blocks, they give the frames that they give when read at once."""

import tracemalloc
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as papq
import pytest

from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.formats import blocks, npz, point_tables
from tssgeom.io.formats.files import open_recording
from tssgeom.io.formats.paths import LONGEST_LINE, require_lines
from tssgeom.stream import Frame, Rejected

FRAMES, POINTS = 40, 12


def columns(rng: np.random.Generator) -> dict[str, np.ndarray]:
    time = np.repeat(np.arange(FRAMES) / 10, POINTS)
    point = np.tile(np.arange(POINTS), FRAMES)
    x, y, z = rng.normal(size=(3, FRAMES * POINTS))
    tension = np.where(point == 3, time, np.nan)
    return {
        "time_s": time,
        "point": point + 1.0,
        "x_mm": x,
        "y_mm": y,
        "z_mm": np.where(point == 5, np.nan, z),
        "tension_in_N": tension,
    }


def csv_of(table: dict[str, np.ndarray], path: Path, more: dict[int, str] | None = None) -> Path:
    rows = zip(*table.values(), strict=True)
    lines = [",".join("" if np.isnan(cell) else repr(float(cell)) for cell in row) for row in rows]
    for line, text in (more or {}).items():
        lines.insert(line, text)
    path.write_text("\n".join([",".join(table), *lines]) + "\n")
    return path


def parquet_of(table: dict[str, np.ndarray], path: Path) -> Path:
    papq.write_table(pa.table(table), path, row_group_size=37)
    return path


@pytest.fixture
def small_blocks(monkeypatch):
    """Take every file for a large one, and read a few rows at a time."""
    monkeypatch.setattr(point_tables, "MOST_AT_ONCE", 0)
    monkeypatch.setattr(blocks, "SIZES", blocks.BlockSizes(part=1000))


def items_of(path: Path) -> list[tuple]:
    recording = open_recording(path)
    items = list(recording.frames)
    assert len(items) == recording.frame_count
    return [_values(item) for item in items]


def _values(item: Frame | Rejected) -> tuple:
    if isinstance(item, Rejected):
        return item.seq, item.reason, item.time
    return item.time, item.tension_in, item.points.tobytes()


def same_both_ways(path: Path, request: pytest.FixtureRequest) -> list[tuple]:
    at_once = items_of(path)
    request.getfixturevalue("small_blocks")
    assert items_of(path) == at_once
    return at_once


def test_a_clean_csv_gives_the_same_frames_in_blocks(tmp_path, request):
    outcome = same_both_ways(csv_of(columns(np.random.default_rng(1)), tmp_path / "a.csv"), request)
    assert len(outcome) == FRAMES
    assert outcome[7][1] == 0.7


def test_a_parquet_file_gives_the_same_frames_in_blocks(tmp_path, request):
    assert (
        len(same_both_ways(parquet_of(columns(np.random.default_rng(2)), tmp_path / "a.parquet"), request))
        == FRAMES
    )


def test_points_in_any_order_within_their_frame_give_the_same_frames_in_blocks(tmp_path, request):
    rng = np.random.default_rng(3)
    table = columns(rng)
    order = np.concatenate([k * POINTS + rng.permutation(POINTS) for k in range(FRAMES)])
    shuffled = {name: values[order] for name, values in table.items()}
    same_both_ways(parquet_of(shuffled, tmp_path / "a.parquet"), request)


def test_faults_are_reported_with_their_lines_in_blocks(tmp_path, request):
    table = columns(np.random.default_rng(4))
    path = csv_of(table, tmp_path / "a.csv", {30: "", 100: "0.8,2,3", 200: "oops,1,2,3,4,5"})
    outcome = same_both_ways(path, request)
    assert "line 102: 3 columns" in outcome[8][1]
    assert any("line 202" in str(each[1]) for each in outcome)


def test_frames_whose_time_goes_back_are_rejected_in_blocks(tmp_path, request):
    table = columns(np.random.default_rng(5))
    table["time_s"][20 * POINTS : 21 * POINTS] = 0.5
    del table["point"]
    outcome = same_both_ways(csv_of(table, tmp_path / "a.csv"), request)
    assert "put the frames in order" in outcome[20][1]


def test_a_large_table_of_numbered_points_has_to_be_in_order(tmp_path, small_blocks):
    table = columns(np.random.default_rng(6))
    path = parquet_of({name: values[::-1].copy() for name, values in table.items()}, tmp_path / "a.parquet")
    with pytest.raises(ShapeError, match="sort so large a file"):
        open_recording(path)


def test_a_large_table_without_time_is_refused(tmp_path, small_blocks):
    table = columns(np.random.default_rng(7))
    del table["time_s"]
    with pytest.raises(ShapeError, match="one shape of more than"):
        open_recording(parquet_of(table, tmp_path / "a.parquet"))


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("order", ["C", "F"])
def test_an_archive_gives_the_same_frames_whatever_the_block(tmp_path, monkeypatch, save, order):
    points = np.random.default_rng(8).normal(size=(FRAMES, POINTS, 3))
    stations = np.cumsum(np.ones((FRAMES, POINTS)), axis=1)
    path = tmp_path / "a.npz"
    save(path, points=np.array(points, order=order), time_s=np.arange(FRAMES) / 10.0, unit="mm", s=stations)
    at_once = list(open_recording(path).frames)
    monkeypatch.setattr(npz, "_BLOCK", 1000)
    for k, (one, other) in enumerate(zip(at_once, open_recording(path).frames, strict=True)):
        assert isinstance(one, Frame)
        assert isinstance(other, Frame)
        np.testing.assert_array_equal(one.points, points[k] / 1000.0)
        np.testing.assert_array_equal(one.points, other.points)
        np.testing.assert_array_equal(other.stations, stations[k] / 1000.0)


def test_an_archive_that_is_corrupt_inside_is_an_error_with_its_path(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, points=np.random.default_rng(9).normal(size=(FRAMES, POINTS, 3)), unit="m")
    raw = bytearray(path.read_bytes())
    raw[5000] ^= 0xFF
    path.write_bytes(bytes(raw))
    with pytest.raises(SourceError, match=r"a\.npz: cannot be read as NPZ"):
        list(open_recording(path).frames)


def _peak(path: Path) -> int:
    """Greatest memory of Python and numpy while a file is read frame by frame [B]."""
    tracemalloc.start()
    for _ in open_recording(path).frames:
        pass
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def test_memory_does_not_grow_with_the_number_of_frames(tmp_path):
    for count in (2000, 8000):
        np.savez(
            tmp_path / f"{count}.npz", points=np.zeros((count, 200, 3)), time_s=np.arange(count), unit="m"
        )
    few, many = _peak(tmp_path / "2000.npz"), _peak(tmp_path / "8000.npz")
    assert many < few + 2_000_000  # the files are 10 and 38 MB; times take 8 B a frame


def test_one_frame_over_many_blocks_is_refused_by_its_size(tmp_path, small_blocks, monkeypatch):
    count = 30_000
    table = {name: np.arange(count) / 1.0 for name in ("point", "x_mm", "y_mm", "z_mm")}
    path = tmp_path / "a.parquet"
    papq.write_table(
        pa.table({"time_s": np.arange(count) // (count - 1), **table}), path, row_group_size=2000
    )
    assert open_recording(path).frame_count == 2
    monkeypatch.setenv("TSSGEOM_MOST_MIB", "1")
    with pytest.raises((ShapeError, SourceError), match="the limit is 1 MiB"):
        open_recording(path)


def test_a_table_of_many_short_lines_is_read_and_one_long_line_among_them_refused(tmp_path):
    path, short = tmp_path / "a.csv", "0.0,0.0,0.0\n" * (LONGEST_LINE // 12)
    path.write_text("x_mm,y_mm,z_mm\n" + short + "1.0,0.0,0.0\n" * 12)
    (frame,) = open_recording(path).frames
    assert isinstance(frame, Frame)
    assert len(frame.points) == LONGEST_LINE // 12 + 12
    assert len(require_lines(path, b"a\n" + b"1" * LONGEST_LINE + b"\n2")) == LONGEST_LINE + 4
    with pytest.raises(ShapeError, match="line 3 is longer than 1048576 bytes"):
        require_lines(path, b"a\nb\n" + b"1" * (LONGEST_LINE + 1) + b"\n2")

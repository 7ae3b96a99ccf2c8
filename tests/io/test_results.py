"""What is told and written about an analysis."""

import json
import math
from pathlib import Path

import numpy as np
import pyarrow.parquet as papq
import pytest

from tssgeom.errors import SourceError
from tssgeom.io.result_tables import FRAMES, SUMMARY, write_frames, write_summary
from tssgeom.io.results import Analysis, analysis_object, shape_summary, summary_row
from tssgeom.io.run_record import Input, RunRecord, Settings, remove_earlier_run, sha256_of, write_run
from tssgeom.settings import Rig
from tssgeom.stream import Frame, process

TENSIONS = [5.0, 15.0, 10.0]


def half_circle(length: float = 0.5, count: int = 40) -> np.ndarray:
    angle = np.linspace(0.0, math.pi, count)
    return length / math.pi * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])


def s_bend() -> np.ndarray:
    first = half_circle()
    return np.concatenate([first, 2 * first[-1] - first[-2::-1]])


@pytest.fixture(scope="module")
def analysis() -> Analysis:
    gap = half_circle()
    gap[20] = np.nan
    shapes = [half_circle(), gap, half_circle()[:3], half_circle()]
    tensions = [*TENSIONS[:2], 99.0, TENSIONS[2]]
    frames = [
        Frame(points, time / 2, tension_in=tension, elongation=0.001, id=str(time))
        for time, (points, tension) in enumerate(zip(shapes, tensions, strict=True))
    ]
    items = list(process(frames, Rig(), tension_in=1.0))
    return Analysis("bend", Path("bend.jsonl"), "mm", "jsonl", timed=True, items=items, notes=("a note",))


def test_one_shape_is_told_with_the_promised_keys():
    (result,) = process([Frame(half_circle())], Rig(), tension_in=15.0)
    told = shape_summary("half", result)
    assert list(told) == [
        *(
            "shape",
            "points",
            "length_m",
            "total_angle_rad",
            "total_angle_se_rad",
            "noise_m",
            "method",
            "segments",
        ),
        *("tension_in_N", "tension_out_N", "elongation_m", "elongation_se_m", "warnings"),
    ]
    assert list(told["segments"][0]) == ["length_m", "kappa_per_m", "angle_rad", "s_start_m"]
    assert json.loads(json.dumps(told, allow_nan=False)) == told


def test_segments_add_up_to_length_and_angle():
    (result,) = process([Frame(s_bend())], Rig(), tension_in=15.0)
    told = shape_summary("s", result)
    assert sum(piece["length_m"] for piece in told["segments"]) == pytest.approx(told["length_m"], abs=1e-12)
    assert sum(piece["angle_rad"] for piece in told["segments"]) == pytest.approx(
        told["total_angle_rad"], abs=1e-12
    )
    starts = np.cumsum([0.0, *(piece["length_m"] for piece in told["segments"])])[:-1]
    np.testing.assert_allclose([piece["s_start_m"] for piece in told["segments"]], starts, atol=1e-12)


def test_a_recording_is_told_by_its_last_good_frame_and_by_ranges(analysis):
    told = analysis_object(analysis)
    assert (told["frames"], told["rejected"], told["time_s"], told["tension_in_N"]) == (
        4,
        1,
        1.5,
        pytest.approx(10),
    )
    assert told["range"]["tension_in_N"] == pytest.approx([5, 15])
    assert told["range"]["elongation_m"][1] == max(r.transmission.elongation for r in analysis.results)
    assert told["warnings"][0] == "a note"
    assert told["warnings"][1].endswith("(1 of 3 frames)")


def test_summary_comes_back_with_units(analysis, tmp_path):
    write_summary(tmp_path / "summary.parquet", [summary_row(analysis)])
    table = papq.read_table(tmp_path / "summary.parquet")
    (row,) = table.to_pylist()
    assert table.schema.equals(SUMMARY)
    assert table.schema.field("elongation_m").metadata[b"unit"] == b"m"
    assert all(field.metadata[b"meaning"] for field in table.schema)
    assert None not in row.values()
    assert (row["name"], row["source"], row["frames"], row["rejected"]) == ("bend", "bend.jsonl", 4, 1)
    assert (row["tension_in_min_N"], row["tension_in_max_N"]) == pytest.approx((5, 15))
    assert row["duration_s"] == 1.5


def test_frames_come_back_with_a_row_for_each_and_the_reason_where_rejected(analysis, tmp_path):
    write_frames(tmp_path / "frames" / "bend.parquet", analysis)
    table = papq.read_table(tmp_path / "frames" / "bend.parquet")
    rows = table.to_pylist()
    assert table.schema.equals(FRAMES)
    assert [row["seq"] for row in rows] == [0, 1, 2, 3]
    assert [row["id"] for row in rows] == ["0", "1", "2", "3"]
    assert [row["rejected"] is None for row in rows] == [True, True, False, True]
    assert rows[2]["elongation_m"] is None
    assert "a route needs at least 4" in rows[2]["rejected"]
    assert sum(piece["angle_rad"] for piece in rows[0]["segments"]) == pytest.approx(
        rows[0]["total_angle_rad"]
    )
    assert (rows[0]["measured_elongation_m"], rows[0]["measured_tension_out_N"]) == (0.001, None)


def record(folder: Path, *files: str) -> RunRecord:
    source = folder / "a.csv"
    source.write_text("x")
    item = Input(
        name="a", source="a.csv", sha256=sha256_of(source), kind="csv", unit="mm", frames=3, rejected=1
    )
    settings = Settings(tension_in_N=15.0, unit=None, rig_file=None, rig=Rig())
    return RunRecord(version="1", settings=settings, inputs=[item], rejected=[], files=files)


def test_the_record_of_a_run_tells_settings_inputs_and_counts(tmp_path):
    write_run(tmp_path, record(tmp_path, "summary.parquet"))
    told = json.loads((tmp_path / "run.json").read_text())
    assert told["settings"]["rig"]["friction"]["coefficient"] == 0.145
    assert told["inputs"][0]["sha256"] == "2d711642b726b04401627ca9fbac32f5c8530fb1903cc4db02258717921a4881"
    assert told["counts"] == {"inputs": 1, "inputs_rejected": 0, "frames": 3, "frames_rejected": 1}


def test_an_earlier_run_is_removed_and_nothing_else(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    for name in ("mine.txt", "summary.parquet", "../outside.csv"):
        (out / name).write_text("x")
    write_run(out, record(tmp_path, "summary.parquet", "gone.rrd", "../outside.csv"))
    remove_earlier_run(out)
    assert [path.name for path in out.iterdir()] == ["mine.txt"]
    assert (tmp_path / "outside.csv").exists()


def test_a_run_json_of_another_program_is_left_alone(tmp_path):
    (tmp_path / "run.json").write_text('{"files": ["a.csv"]}')
    (tmp_path / "a.csv").touch()
    with pytest.raises(SourceError, match="no record of a run"):
        remove_earlier_run(tmp_path)
    assert (tmp_path / "a.csv").exists()


def test_a_folder_without_an_earlier_run_is_left_alone(tmp_path):
    (tmp_path / "a.csv").touch()
    remove_earlier_run(tmp_path)
    remove_earlier_run(tmp_path / "missing")
    assert (tmp_path / "a.csv").exists()

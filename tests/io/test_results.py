"""Summaries of an analysis, and the files of them."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as papq
import pytest

from tssgeom.engine import process
from tssgeom.errors import SourceError
from tssgeom.io.results.run_record import Input, RunRecord, Settings, remove_earlier_run, sha256_of, write_run
from tssgeom.io.results.shapes import Analysis, analysis_object, frame_row, shape_summary, summary_row
from tssgeom.io.results.tables import FRAMES, SEGMENTS, SUMMARY, parts, write_parts, write_summary
from tssgeom.io.storage import Folder
from tssgeom.rig import Rig
from tssgeom.stream import Frame, FrameResult, Rejected
from tssgeom.summary import LIMITS, RunningSummary

TENSIONS = [5.0, 15.0, 10.0]


def half_circle(length: float = 0.5, count: int = 40) -> np.ndarray:
    angle = np.linspace(0.0, math.pi, count)
    return length / math.pi * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])


def s_bend() -> np.ndarray:
    first = half_circle()
    return np.concatenate([first, 2 * first[-1] - first[-2::-1]])


Items = list[FrameResult | Rejected]


@pytest.fixture(scope="module")
def items() -> Items:
    gap = half_circle()
    gap[20] = np.nan
    shapes = [half_circle(), gap, half_circle()[:3], half_circle()]
    tensions = [*TENSIONS[:2], 99.0, TENSIONS[2]]
    frames = [
        Frame(points, time / 2, tension_in=tension, elongation=0.001, id=str(time))
        for time, (points, tension) in enumerate(zip(shapes, tensions, strict=True))
    ]
    return list(process(frames, Rig(), tension_in=1.0))


def summarised(items: Items) -> RunningSummary:
    summary = RunningSummary.of(len(items))
    for item in items:
        summary.add(item, frame_row(item))
    return summary.close()


@pytest.fixture(scope="module")
def analysis(items: Items) -> Analysis:
    return Analysis(
        "bend", "bend.jsonl", "mm", "jsonl", timed=True, summary=summarised(items), notes=("a note",)
    )


def written(items: Items, folder: Path) -> tuple[pa.Table, pa.Table, RunningSummary]:
    folder.mkdir(exist_ok=True)
    summary = RunningSummary.of(len(items))
    write_parts(folder / "frames", folder / "segments", parts("bend", items, summary.stride), summary)
    return papq.read_table(folder / "frames"), papq.read_table(folder / "segments"), summary


def test_the_summary_of_one_shape_has_the_promised_keys():
    (result,) = process([Frame(half_circle())], Rig(), tension_in=15.0)
    reported = shape_summary("half", result)
    assert list(reported) == [
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
        *(
            "tension_in_N",
            "tension_out_N",
            "tension_out_se_N",
            "elongation_m",
            "elongation_se_m",
            "tension_in_assumed",
            "warnings",
        ),
    ]
    assert list(reported["segments"][0]) == [
        *("length_m", "kappa_per_m", "angle_rad", "s_start_m", "angle_se_rad")
    ]
    assert json.loads(json.dumps(reported, allow_nan=False)) == reported


def test_segments_add_up_to_length_and_angle():
    (result,) = process([Frame(s_bend())], Rig(), tension_in=15.0)
    reported = shape_summary("s", result)
    assert sum(piece["length_m"] for piece in reported["segments"]) == pytest.approx(
        reported["length_m"], abs=1e-12
    )
    assert sum(piece["angle_rad"] for piece in reported["segments"]) == pytest.approx(
        reported["total_angle_rad"], abs=1e-12
    )
    starts = np.cumsum([0.0, *(piece["length_m"] for piece in reported["segments"])])[:-1]
    np.testing.assert_allclose([piece["s_start_m"] for piece in reported["segments"]], starts, atol=1e-12)


def test_the_error_of_an_angle_is_that_of_its_piece_and_a_straight_one_may_hide_a_bend():
    """All pieces in one: its error is that of Φ, also where the piece is straight and its angle 0."""
    rng = np.random.default_rng(3)
    line = np.outer(np.linspace(0.0, 0.2, 40), [1.0, 0.0, 0.0]) + rng.normal(0.0, 2e-4, (40, 3))
    (result,) = process([Frame(line)], Rig(), tension_in=15.0)
    (piece,) = shape_summary("line", result)["segments"]
    assert (piece["angle_rad"], piece["angle_se_rad"]) == (0.0, result.arcs.total_angle_se)
    assert piece["angle_se_rad"] > 0.0


def test_a_recording_is_summarised_by_its_last_good_frame_and_by_ranges(analysis, items):
    reported = analysis_object(analysis)
    assert (reported["frames"], reported["rejected"], reported["time_s"]) == (4, 1, 1.5)
    assert reported["tension_in_N"] == pytest.approx(10)
    assert reported["range"]["tension_in_N"] == pytest.approx([5, 15])
    good = [item for item in items if isinstance(item, FrameResult)]
    assert reported["range"]["elongation_m"][1] == max(result.transmission.elongation for result in good)
    assert reported["warnings"][0] == "a note"
    assert reported["warnings"][1].endswith("(1 of 3 frames)")


def test_warnings_that_differ_in_their_quantities_alone_are_one(analysis):
    counts = analysis.summary.warnings
    counts.clear()
    counts.update({"off by 1.5 mm (point 3)": 1, "off by 2e-3 mm (point 3)": 2, "off by 2 mm (point 4)": 1})
    assert analysis.warnings[1:] == [
        "off by 2e-3 mm (point 3) (3 of 3 frames, quantities differ)",
        "off by 2 mm (point 4) (1 of 3 frames)",
    ]


def test_the_summary_has_the_frame_at_the_last_peak_of_tension(analysis):
    row = summary_row(analysis)
    assert (row["time_s"], row["tension_in_N"]) == (0.5, pytest.approx(15))
    assert row["tension_out_N"] == analysis.representative.transmission.tension_out


def test_summary_comes_back_with_units(analysis, tmp_path):
    write_summary(tmp_path / "summary.parquet", [summary_row(analysis)])
    table = papq.read_table(tmp_path / "summary.parquet")
    (row,) = table.to_pylist()
    assert table.schema.equals(SUMMARY)
    assert table.schema.field("elongation_m").metadata[b"unit"] == b"m"
    assert all(field.metadata[b"meaning"] for field in table.schema)
    empty = {name for name, value in row.items() if value is None}
    assert empty == {"clearance_m", "clearance_at_m", "contact_length_m", "outside_length_m"}  # no lumen
    assert (row["name"], row["source"], row["frames"], row["rejected"]) == ("bend", "bend.jsonl", 4, 1)
    assert (row["tension_in_min_N"], row["tension_in_max_N"]) == pytest.approx((5, 15))
    assert row["duration_s"] == 1.5


def test_frames_come_back_with_a_row_for_each_and_the_reason_where_rejected(items, tmp_path):
    table, _, _ = written(items, tmp_path)
    rows = table.to_pylist()
    assert table.schema.equals(FRAMES, check_metadata=True)
    assert [row["seq"] for row in rows] == [0, 1, 2, 3]
    assert [row["id"] for row in rows] == ["0", "1", "2", "3"]
    assert [row["rejected"] is None for row in rows] == [True, True, False, True]
    assert rows[2]["elongation_m"] is None
    assert "a route needs at least 4" in rows[2]["rejected"]
    assert (rows[0]["measured_elongation_m"], rows[0]["measured_tension_out_N"]) == (0.001, None)
    assert {row["name"] for row in rows} == {"bend"}


def test_segments_come_back_with_units_and_add_up_to_their_frame(items, tmp_path):
    frames, table, _ = written(items, tmp_path)
    assert table.schema.equals(SEGMENTS, check_metadata=True)
    assert table.schema.field("kappa_per_m").metadata[b"unit"] == b"1/m"
    pieces = [row for row in table.to_pylist() if row["seq"] == 3]
    assert [row["piece"] for row in pieces] == list(range(len(pieces)))
    total = frames.to_pylist()[3]["total_angle_rad"]
    assert sum(row["angle_rad"] for row in pieces) == pytest.approx(total, abs=1e-12)  # rounding of a sum
    assert all(row["angle_se_rad"] > 0.0 for row in pieces)
    assert {row["seq"] for row in table.to_pylist()} == {0, 1, 3}


def test_summaries_of_parts_add_up_to_that_of_the_whole(items):
    whole, joined = summarised(items * 3), RunningSummary.of(12)
    for k in range(3):
        joined.join(summarised(items))
        assert joined.frames == 4 * (k + 1)
    assert (joined.used, joined.refused, joined.warned) == (whole.used, whole.refused, whole.warned)
    assert (joined.low, joined.high, joined.warnings) == (whole.low, whole.high, whole.warnings)
    assert joined.noise == pytest.approx(whole.noise, rel=1e-12)  # sums in another order
    assert [result.seq for result in joined.results] == [result.seq for result in whole.results]


def test_of_many_frames_so_many_are_kept_evenly_and_the_last(items):
    good = items[0]
    assert isinstance(good, FrameResult)
    many = 2 * LIMITS.kept + 2
    summary = summarised([dataclasses.replace(good, seq=seq) for seq in range(many)])
    kept = [result.seq for result in summary.results]
    assert kept == [*range(0, many - 1, 3), many - 1]
    assert len(kept) <= LIMITS.kept + 1


def record(folder: Path, *files: str) -> RunRecord:
    source = folder / "a.csv"
    source.write_text("x")
    item = Input(
        name="a", source="a.csv", sha256=sha256_of(source), kind="csv", unit="mm", frames=3, rejected=1
    )
    settings = Settings(tension_in_N=15.0, unit=None, rig_file=None, rig=Rig())
    return RunRecord(version="1", settings=settings, inputs=[item], rejected=[], files=files)


def test_the_record_of_a_run_has_settings_inputs_and_counts(tmp_path):
    write_run(Folder.of(str(tmp_path)), record(tmp_path, "summary.parquet"))
    reported = json.loads((tmp_path / "run.json").read_text())
    assert reported["settings"]["rig"]["friction"]["coefficient"] == 0.145
    assert (
        reported["inputs"][0]["sha256"] == "2d711642b726b04401627ca9fbac32f5c8530fb1903cc4db02258717921a4881"
    )
    assert reported["counts"] == {"inputs": 1, "inputs_rejected": 0, "frames": 3, "frames_rejected": 1}


def test_an_earlier_run_is_removed_and_nothing_else(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    for name in ("mine.txt", "summary.parquet", "../outside.csv"):
        (out / name).write_text("x")
    write_run(Folder.of(str(out)), record(tmp_path, "summary.parquet", "gone.rrd", "../outside.csv"))
    remove_earlier_run(Folder.of(str(out)))
    assert [path.name for path in out.iterdir()] == ["mine.txt"]
    assert (tmp_path / "outside.csv").exists()


def test_a_run_json_of_another_program_is_left_alone(tmp_path):
    (tmp_path / "run.json").write_text('{"files": ["a.csv"]}')
    (tmp_path / "a.csv").touch()
    with pytest.raises(SourceError, match="no record of a run"):
        remove_earlier_run(Folder.of(str(tmp_path)))
    assert (tmp_path / "a.csv").exists()


def test_a_folder_without_an_earlier_run_is_left_alone(tmp_path):
    (tmp_path / "a.csv").touch()
    remove_earlier_run(Folder.of(str(tmp_path)))
    remove_earlier_run(Folder.of(str(tmp_path / "missing")))
    assert (tmp_path / "a.csv").exists()

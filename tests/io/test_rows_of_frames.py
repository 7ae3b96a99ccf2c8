"""Tables with a row a frame, their points side by side, are read as trackers export them."""

import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import feather

from tssgeom.errors import ShapeError
from tssgeom.io.formats.files import open_recording
from tssgeom.io.formats.laboratory.mapping import ColumnMap
from tssgeom.io.formats.runs import read_run
from tssgeom.stream import Frame, Rejected

POINTS = np.array([[[10.0 * k + f, k * k, -f] for k in range(5)] for f in range(3)])
"""[frame, point, axis] [mm]"""


def written(path: Path, name: str, separator: str = ",", extra: tuple[str, ...] = ("time_s",)) -> Path:
    header = [*extra, *(name.format(point=k + 1, axis=axis) for k in range(5) for axis in "xyz")]
    rows = [[*(f"{0.5 * f:g}" for _ in extra), *map(str, frame.ravel())] for f, frame in enumerate(POINTS)]
    path.write_text("\n".join(separator.join(row) for row in [header, *rows]), encoding="utf-8")
    return path


def frames_of(path: Path, unit: str | None = None, *said: str) -> list[Frame]:
    frames = [*open_recording(path, unit, ColumnMap(said)).frames]
    assert all(isinstance(frame, Frame) for frame in frames), frames
    return frames  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("S{point}_{axis}", "mm"),
        ("S{point}_{axis}_mm", None),
        ("Sensor {point} {axis} [mm]", None),
        ("{axis}{point}", "mm"),
        ("{axis}_{point} (mm)", None),
        ("EM{point}.{axis}", "mm"),
        ("S{point}{axis}", "mm"),
        ("coil{point}_p{axis}_mm", None),
        ("/shape/poses[{point}]/position/{axis}", "mm"),
    ],
)
def test_points_side_by_side_are_those_of_a_frame_in_the_order_of_the_columns(name, unit, tmp_path):
    frames = frames_of(written(tmp_path / "em.csv", name), unit)
    assert [frame.time for frame in frames] == [0.0, 0.5, 1.0]
    for frame, points in zip(frames, POINTS, strict=True):
        np.testing.assert_allclose(frame.points, points / 1e3, rtol=1e-12)


@pytest.mark.parametrize(("name", "unit"), [("P{point}_{axis}", "mm"), ("P{point}_{axis}_mm", None)])
def test_columns_of_a_variable_of_matlab_are_x_y_and_z(name, unit, tmp_path):
    path = written(tmp_path / "em.csv", name)
    numbered = path.read_text(encoding="utf-8")
    for number, axis in enumerate("xyz", 1):
        numbered = numbered.replace(f"_{axis}", f"_{number}")
    path.write_text(numbered, encoding="utf-8")
    np.testing.assert_allclose(frames_of(path, unit)[2].points, POINTS[2] / 1e3, rtol=1e-12)


def test_units_stand_in_a_row_of_their_own(tmp_path):
    path = written(tmp_path / "em.csv", "S{point}_{axis}")
    head, *rows = path.read_text(encoding="utf-8").split("\n")
    path.write_text("\n".join([head, ",".join(["s", *["cm"] * 15]), *rows]), encoding="utf-8")
    np.testing.assert_allclose(frames_of(path)[1].points, POINTS[1] / 1e2, rtol=1e-12)


def test_an_empty_cell_is_a_lost_sensor_with_semicolons_and_decimal_commas(tmp_path):
    path = tmp_path / "em.csv"
    head = ";".join(["time_ms", *(f"S{k}_{axis}" for k in range(1, 6) for axis in "xyz")])
    path.write_text(f"{head}\n0;0,5;0;0;10;0;0;;;;30;0;0;40;0;0\n25" + ";1,5" * 15, encoding="utf-8")
    first, second = frames_of(path, "mm")
    assert np.isnan(first.points).all(axis=1).tolist() == [False, False, True, False, False]
    assert (first.points[0, 0], second.time, second.points[4, 2]) == (0.0005, 0.025, 0.0015)


def test_turns_and_speeds_beside_the_positions_are_no_points(tmp_path):
    path = tmp_path / "em.csv"
    of_one = ["S{}_x_mm", "S{}_y_mm", "S{}_z_mm", "S{}_q_x", "S{}_q_y", "S{}_q_z", "S{}_v_x", "S{}_v_y"]
    head = [each.format(k) for k in range(5) for each in [*of_one, "S{}_v_z", "S{}_p_w", "S{}_p_x"]]
    path.write_text(",".join(head) + "\n" + ",".join(map(str, range(55))), encoding="utf-8")
    (frame,) = frames_of(path)
    np.testing.assert_allclose(frame.points[:, 0] * 1e3, [0, 11, 22, 33, 44])


def test_without_a_time_the_rows_are_counted_with_a_warning(tmp_path):
    path = written(tmp_path / "em.csv", "S{point}_{axis}_mm", extra=())
    assert [frame.time for frame in frames_of(path)] == [0.0, 1.0, 2.0]
    assert "no time: the frames are counted, one a second, by frame" in open_recording(path).warnings


def test_tensions_beside_the_points_are_those_of_the_frame(tmp_path):
    path = written(tmp_path / "em.csv", "S{point}_{axis}_mm", extra=("time_s", "tension_in_N"))
    assert [frame.tension_in for frame in frames_of(path)] == [0.0, 0.5, 1.0]


def test_a_sensor_that_the_user_leaves_out_is_no_point(tmp_path):
    path = written(tmp_path / "em.csv", "S{point}_{axis}_mm")
    frames = frames_of(path, None, "S1_x_mm=ignore", "S1_y_mm=ignore", "S1_z_mm=ignore")
    np.testing.assert_allclose(frames[0].points, POINTS[0, 1:] / 1e3)


def test_a_cell_that_is_no_number_rejects_its_frame_with_line_and_column(tmp_path):
    path = written(tmp_path / "em.csv", "S{point}_{axis}_mm")
    path.write_text(path.read_text(encoding="utf-8").replace("11.0", "lost", 1), encoding="utf-8")
    item = open_recording(path)[1]
    assert isinstance(item, Rejected)
    assert item.reason == "line 3: S2_x_mm is 'lost': write a number or leave it empty"


def test_points_without_a_unit_or_with_two_are_refused(tmp_path):
    path = written(tmp_path / "em.csv", "S{point}_{axis}")
    with pytest.raises(
        ShapeError, match=r"no unit: name the columns S1_x_mm and so on, or give --unit mm\|m"
    ):
        open_recording(path)
    path = written(tmp_path / "em.csv", "S{point}_{axis}_mm")
    path.write_text(path.read_text(encoding="utf-8").replace("S5_z_mm", "S5_z_cm"), encoding="utf-8")
    with pytest.raises(ShapeError, match="'S1_x_mm' is in mm, 'S5_z_cm' in cm: write one unit"):
        open_recording(path)


def test_the_tip_of_a_machine_and_three_points_stay_what_they_are(tmp_path):
    path = tmp_path / "tip.csv"
    path.write_text("time_s,tip_x_m,tip_y_m,tip_z_m,tension_in_1_N\n0,1,2,3,4\n1,1,2,3,5", encoding="utf-8")
    assert read_run(path).of_machine.keys() == {"tip_x_m", "tip_y_m", "tip_z_m", "tension_in_1_N"}


def test_stations_that_count_the_points_name_their_column(tmp_path):
    path = tmp_path / "em.csv"
    rows = [f"{k + 1},{100 * k},0,0" for k in range(7)]
    path.write_text("\n".join(["S,x,y,z", *rows]), encoding="utf-8")
    (warning,) = open_recording(path, "mm").warnings
    assert warning == "column 'S' is read as arc length: if it numbers the points, give --map \"S=point\""
    path.write_text("\n".join(["S,x,y,z", *(f"{k + 1},{k},0,0" for k in range(7))]), encoding="utf-8")
    assert open_recording(path, "mm").warnings == ()
    path.write_text("\n".join(["S,x,y,z", "inf,0,0,0", *rows, "inf,1e300,0,0"]), encoding="utf-8")
    assert open_recording(path, "mm").warnings == ()  # nor one of NumPy, of a difference


def test_stations_without_a_unit_are_refused_by_their_own_name_and_numbers_of_sensors_named(tmp_path):
    path = tmp_path / "em.csv"
    rows = [f"{k + 1},{t},{4 * k},{0.1 * k * k},0" for t in (0, 25) for k in range(7)]
    path.write_text("\n".join(["Station,Timestamp (ms),X (in),Y (in),Z (in)", *rows]), encoding="utf-8")
    counted = 'if it numbers the points, give --map "Station=point", else state it: --map "Station=s_mm"'
    with pytest.raises(
        ShapeError, match=re.escape(f"column 'Station', read as arc length, has no unit: {counted}")
    ):
        open_recording(path)
    assert [len(frame.points) for frame in frames_of(path, None, "Station=point")] == [7, 7]
    path.write_text(path.read_text(encoding="utf-8").replace("\n7,", "\n60,"), encoding="utf-8")
    with pytest.raises(ShapeError, match='has no unit: state it: --map "Station=s_mm"'):
        open_recording(path)
    stations = frames_of(path, None, "Station=s_mm")[0].stations
    assert stations is not None
    assert stations[-1] == 0.06


@pytest.mark.parametrize(("unit", "mm"), [("in", 25.4), ("cm", 10.0), ("ft", 304.8), ("mm", 1.0)])
def test_the_unit_of_a_file_without_one_may_be_any_that_headers_have(tmp_path, unit, mm):
    for path in (
        written(tmp_path / "side_by_side.csv", "S{point}_{axis}"),
        tmp_path / "plain.csv",
    ):
        if path.stem == "plain":
            rows = [f"{f},{x},{y},{z}" for f, frame in enumerate(POINTS) for x, y, z in frame]
            path.write_text("\n".join(["time_s,x,y,z", *rows]), encoding="utf-8")
        assert open_recording(path, unit).unit == unit
        for frame, points in zip(frames_of(path, unit), POINTS, strict=True):
            np.testing.assert_allclose(1e3 * frame.points, mm * points, rtol=1e-12)


def test_a_unit_beside_that_of_the_columns_has_to_be_the_same(tmp_path):
    path = written(tmp_path / "em.csv", "S{point}_{axis} (inch)")
    np.testing.assert_allclose(1e3 * frames_of(path, "in")[0].points, 25.4 * POINTS[0], rtol=1e-12)
    with pytest.raises(ShapeError, match="the file is in inch, --unit says cm: read it without --unit"):
        open_recording(path, "cm")
    with pytest.raises(ShapeError, match="'furlong': write mm or m"):
        open_recording(path, "furlong")


@pytest.mark.parametrize(
    ("times", "warning", "kept"),
    [
        ((0, 1, 2, 3, 1, 2, 4), "line 6: the clock jumps back from 3 s to 1 s: 2 rows of times that were", 5),
        ((0, 1, 1, 2), "line 4: time 1 s is there twice: 1 row of a time that was there before left out", 3),
        ((0, 2, 1, 3), "line 4: the clock jumps back from 2 s to 1 s: the frames are sorted by time", 4),
        ((0, 1, 2, 3), None, 4),
    ],
)
def test_of_rows_of_frames_with_one_time_the_first_is_kept_and_a_clock_that_jumps_back_is_stated(
    tmp_path, times, warning, kept
):
    path = tmp_path / "em.csv"
    head = ["time_s", "tension_in_N", *(f"S{k}_{axis}_mm" for k in range(5) for axis in "xyz")]
    rows = [
        ",".join([str(time), str(row), *(f"{10 * k},{k * k},{row}" for k in range(5))])
        for row, time in enumerate(times)
    ]
    path.write_text("\n".join([",".join(head), *rows]), encoding="utf-8")
    recording = open_recording(path)
    assert [each.startswith(warning or "?") for each in recording.warnings] == [True] * (warning is not None)
    frames = [frame for frame in recording if isinstance(frame, Frame)]
    first = sorted({time: row for row, time in reversed([*enumerate(times)])}.items())
    assert [(frame.time, frame.tension_in) for frame in frames] == first
    assert len(frames) == len(recording) == kept


@pytest.mark.parametrize("word", ["lost", "?"])
def test_a_sensor_of_which_most_cells_are_words_is_refused_with_line_and_column(tmp_path, word):
    path = written(tmp_path / "em.csv", "S{point}_{axis}_mm")
    lines = path.read_text(encoding="utf-8").splitlines()
    broken = [line.split(",")[:7] + [word] * 3 + line.split(",")[10:] for line in lines[2:]]
    path.write_text("\n".join([*lines[:2], *map(",".join, broken)]), encoding="utf-8")
    with pytest.raises(ShapeError, match=re.escape(f"line 3: S3_x_mm is {word!r}, ")) as error:
        frames_of(path)
    assert str(error.value).endswith('--map "S3_x_mm=ignore"')
    assert {len(frame.points) for frame in frames_of(path, None, "S3_x_mm=ignore")} == {4}


def test_an_error_of_a_spreadsheet_is_a_lost_sensor(tmp_path):
    path = written(tmp_path / "em.csv", "S{point}_{axis}_mm")
    lines = path.read_text(encoding="utf-8").splitlines()
    broken = [line.split(",")[:7] + ["#DIV/0!"] * 3 + line.split(",")[10:] for line in lines[2:]]
    path.write_text("\n".join([*lines[:2], *map(",".join, broken)]), encoding="utf-8")
    assert [np.isnan(frame.points[2]).all() for frame in frames_of(path)] == [False, True, True]


@pytest.mark.parametrize(
    "stamp",
    [
        "header.stamp.sec,header.stamp.nanosec",
        "stamp.secs,stamp.nsecs",
        "/shape/header/stamp/sec,/shape/header/stamp/nanosec",
        "header_stamp_sec,header_stamp_nanosec",
    ],
)
@pytest.mark.parametrize("name", ["poses[{point}].position.{axis}", "row a point"])
def test_stamps_of_ros_in_two_columns_are_the_time(tmp_path, stamp, name):
    times = [(1700000000, 950000000), (1700000001, 0), (1700000001, 50000000)]
    if name == "row a point":
        lines = [f"{stamp},point,x_mm,y_mm,z_mm"]
        for (sec, nano), frame in zip(times, POINTS, strict=True):
            lines += [f"{sec},{nano},{k},{x},{y},{z}" for k, (x, y, z) in enumerate(frame)]
    else:
        lines = [f"{stamp}," + ",".join(name.format(point=k, axis=a) for k in range(5) for a in "xyz")]
        for (sec, nano), frame in zip(times, POINTS, strict=True):
            lines.append(f"{sec},{nano}," + ",".join(map(str, frame.ravel())))
    path = tmp_path / "shape-pose_array.csv"
    path.write_text("\n".join(lines))
    frames = frames_of(path, "mm")
    # a float64 of seconds since 1970 resolves 0.24 µs
    assert [frame.time for frame in frames] == pytest.approx([s + 1e-9 * n for s, n in times], abs=3e-7)
    assert np.allclose([1e3 * frame.points for frame in frames], POINTS)
    assert any("read as time_s" in note for note in open_recording(path, "mm").notes)
    assert not open_recording(path, "mm").warnings


def test_a_time_that_is_stated_is_read_beside_stamps_of_ros(tmp_path):
    path = tmp_path / "both.csv"
    lines = ["header.stamp.sec,header.stamp.nanosec,time_s,x_mm,y_mm,z_mm"]
    lines += [f"{17 + f},0,{f},{x},{y},{z}" for f in range(3) for x, y, z in POINTS[f]]
    path.write_text("\n".join(lines))
    assert [frame.time for frame in frames_of(path)] == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("lost", ["", "nan", "9999"])
def test_frames_that_a_logger_wrote_twice_are_read_once_with_their_lost_points(tmp_path, lost):
    path = written(tmp_path / "polled.csv", "S{point}_{axis}_mm")
    head, *rows = path.read_text().splitlines()
    cells = rows[1].split(",")
    cells[4:7] = [lost] * 3
    rows[1] = ",".join(cells)
    path.write_text("\n".join([head, *(row for row in rows for _ in range(2))]))
    frames = frames_of(path)
    assert [frame.time for frame in frames] == [0.0, 0.5, 1.0]
    assert [np.flatnonzero(np.isnan(frame.points[:, 0])).tolist() for frame in frames] == [[], [1], []]
    assert "15 doubled rows left out" in open_recording(path).notes


def test_of_frames_of_one_time_with_other_numbers_the_first_is_kept_with_a_warning(tmp_path):
    path = written(tmp_path / "polled.csv", "S{point}_{axis}_mm")
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, rows[0], rows[0].replace("20.0", "21.5"), *rows[1:]]))
    recording = open_recording(path)
    assert "time 0 s is there twice: 1 row of a time that was there before left out" in recording.warnings[0]
    np.testing.assert_allclose(1e3 * frames_of(path)[0].points, POINTS[0], atol=1e-12)


def test_a_row_a_point_without_numbers_whose_frames_are_there_twice_is_read_once(tmp_path):
    path = tmp_path / "polled.csv"
    lines = ["time_s,x_mm,y_mm,z_mm"]
    for f in range(3):
        lines += [f"{f},{x},{y},{z}" for x, y, z in POINTS[f]] * (1 + f % 2)
    path.write_text("\n".join(lines))
    assert [len(frame.points) for frame in frames_of(path)] == [5, 5, 5]
    assert open_recording(path).notes == ("5 doubled rows left out",)


@pytest.mark.parametrize("unit", ["s", "ms", "ns"])
def test_times_that_are_dates_are_seconds_since_1970(tmp_path, unit):
    time = np.repeat(np.array(["2024-03-01T09:30:00", "2024-03-01T09:30:02"], f"M8[{unit}]"), 6)
    points = {name: np.tile(np.arange(6.0) ** k, 2) for k, name in enumerate(("x_mm", "y_mm", "z_mm"))}
    feather.write_feather(pa.table({"time_s": pa.array(time), **points}), tmp_path / "a.feather")
    assert [frame.time for frame in frames_of(tmp_path / "a.feather")] == [1709285400.0, 1709285402.0]

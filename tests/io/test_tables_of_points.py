"""CSV and Parquet: columns, units, missing points, recordings in long form."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as papq
import pytest
from pyarrow.feather import write_feather

from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.formats import tables
from tssgeom.io.formats.files import Recording, open_recording
from tssgeom.io.formats.laboratory.mapping import ColumnMap
from tssgeom.stream import Frame, Rejected

ROWS = "0,0,0\n1,0,0\n2,1,0\n3,1,1\n4,2,1\n"
POINTS = np.array([[0, 0, 0], [1, 0, 0], [2, 1, 0], [3, 1, 1], [4, 2, 1]], dtype=float)


def opened(folder: Path, text: str, unit: str | None = None) -> Recording:
    path = folder / "shape.csv"
    path.write_text(text)
    return open_recording(path, unit)


def frames(recording: Recording) -> list[Frame]:
    items = list(recording.frames)
    assert all(isinstance(item, Frame) for item in items), items
    return [item for item in items if isinstance(item, Frame)]


def reasons(recording: Recording) -> dict[int, str]:
    return {item.seq: item.reason for item in recording.frames if isinstance(item, Rejected)}


@pytest.mark.parametrize(("unit", "metre"), [("mm", 1000.0), ("m", 1.0)])
def test_unit_in_the_header_scales_to_metres(tmp_path, unit, metre):
    recording = opened(tmp_path, f"x_{unit},y_{unit},z_{unit}\n{ROWS}")
    (frame,) = frames(recording)
    np.testing.assert_array_equal(frame.points, POINTS / metre)
    assert (recording.unit, recording.kind, recording.timed, recording.frame_count) == (unit, "csv", False, 1)


def test_points_are_read_only(tmp_path):
    (frame,) = frames(opened(tmp_path, f"x_mm,y_mm,z_mm\n{ROWS}"))
    with pytest.raises(ValueError, match="read-only"):
        frame.points[0, 0] = 1.0


def test_columns_may_stand_in_any_order_with_spaces_quotes_and_a_byte_order_mark(tmp_path):
    rows = "".join(f"{z}, {x},{y}\n" for x, y, z in POINTS)
    (frame,) = frames(opened(tmp_path, f'\ufeffz_mm, x_mm ,"y_mm"\r\n{rows}'))
    np.testing.assert_array_equal(frame.points, POINTS / 1000)


def test_no_unit_is_refused_with_the_hint(tmp_path):
    with pytest.raises(ShapeError, match=r"no unit.*x_mm,y_mm,z_mm.*--unit mm\|m"):
        opened(tmp_path, f"x,y,z\n{ROWS}")


def test_unit_option_serves_a_header_without_one(tmp_path):
    (frame,) = frames(opened(tmp_path, f"x,y,z\n{ROWS}", "mm"))
    np.testing.assert_array_equal(frame.points, POINTS / 1000)


def test_unit_option_that_contradicts_the_header_is_refused(tmp_path):
    with pytest.raises(ShapeError, match="the file is in mm, --unit says m"):
        opened(tmp_path, f"x_mm,y_mm,z_mm\n{ROWS}", "m")


@pytest.mark.parametrize("header", ["x_mm,y_m,z_mm", "x_mm,y_mm,z_mm,s_m", "x_mm,y_mm,z_mm,x_m"])
def test_mixed_units_are_refused(tmp_path, header):
    with pytest.raises(ShapeError, match="mixed units"):
        opened(tmp_path, f"{header}\n" + "1,2,3,4\n" * 5)


def test_a_column_without_unit_beside_others_with_one_is_refused(tmp_path):
    with pytest.raises(ShapeError, match="column 's' has no unit: name it s_mm"):
        opened(tmp_path, "x_mm,y_mm,z_mm,s\n" + "1,2,3,4\n" * 5)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "line 1 is empty"),
        ("1,2,3\n4,5,6\n", "line 1 holds numbers, no header"),
        ("1,2,3,4,5,6\n4,5,6,7,8,9\n", "points side by side a header such as S1_x_mm"),
        ("x_mm,y_mm\n1,2\n", "no column z_mm or z_m"),
        ("x_mm,y_mm,z_mm,x_mm\n1,2,3,4\n", "column 'x_mm' is there twice"),
        ("x_mm,y_mm,z_mm\n", "no row of points"),
        ("x_mm,y_mm,z_mm\n1,2,3\n1,zwei,3\n", "line 3: y_mm is 'zwei': write a number"),
        ("x_mm,y_mm,z_mm\n1,2,3\n1,2\n", "line 3: 2 columns, the header has 3"),
        (
            "x_mm,y_mm,z_mm\n\n1,2,3\n1,2\n1\n",
            "line 4: 2 columns, the header has 3: mend the line (and 1 more",
        ),
        (
            "x_m,y_m,z_m,elongation_m,elongation_mm\n1,2,3,4,5\n",
            "elongation_m and elongation_mm are both there",
        ),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_in_one_line_that_names_it(tmp_path, text, says):
    with pytest.raises(ShapeError) as caught:
        opened(tmp_path, text)
    message = str(caught.value)
    assert says in message
    assert message.startswith(str(tmp_path / "shape.csv"))
    assert "\n" not in message


def test_a_binary_file_called_csv_is_refused(tmp_path):
    (tmp_path / "shape.csv").write_bytes(b"\xff\xfe\x00\x01" * 50)
    with pytest.raises(ShapeError, match=r"no UTF-8 text|no rows of numbers"):
        open_recording(tmp_path / "shape.csv")


@pytest.mark.parametrize("cells", ["nan,nan,nan", ",,", "2,,0", "NaN,1,0"])
def test_empty_cells_and_nan_are_a_missing_point(tmp_path, cells):
    (frame,) = frames(opened(tmp_path, f"x_mm,y_mm,z_mm\n0,0,0\n1,0,0\n{cells}\n3,1,1\n4,2,1\n"))
    assert np.isnan(frame.points[2]).all()
    np.testing.assert_array_equal(np.delete(frame.points, 2, axis=0), np.delete(POINTS, 2, axis=0) / 1000)


def test_blank_lines_are_no_points(tmp_path):
    (frame,) = frames(opened(tmp_path, "x_mm,y_mm,z_mm\n0,0,0\n\n1,0,0\n2,1,0\n\n"))
    np.testing.assert_array_equal(frame.points, POINTS[:3] / 1000)


def test_stations_are_scaled_with_the_points(tmp_path):
    (frame,) = frames(opened(tmp_path, "x_mm,y_mm,z_mm,s_mm\n0,0,0,0\n1,0,0,1\n2,1,0,2.5\n3,1,1,4\n"))
    assert frame.stations is not None
    np.testing.assert_array_equal(frame.stations, [0, 0.001, 0.0025, 0.004])


def test_rows_of_one_time_make_one_frame(tmp_path):
    recording = opened(
        tmp_path,
        "time_s,x_mm,y_mm,z_mm,tension_in_N,elongation_mm\n"
        "0.5,0,0,0,3,\n0.5,1,0,0,3,\n0.6,0,0,0,,2\n0.6,1,0,0,,2\n0.6,2,1,0,,2\n",
    )
    first, second = frames(recording)
    assert (recording.timed, recording.frame_count) == (True, 2)
    assert (first.time, len(first.points), first.tension_in, first.elongation) == (0.5, 2, 3.0, None)
    assert (second.time, len(second.points), second.tension_in, second.elongation) == (0.6, 3, None, 0.002)


def test_frames_are_the_same_when_read_again(tmp_path):
    recording = opened(tmp_path, "time_s,x_mm,y_mm,z_mm\n0,0,0,0\n0,1,0,0\n1,0,0,0\n1,1,0,0\n")
    again = zip(frames(recording), frames(recording), strict=True)
    assert all(np.array_equal(one.points, other.points) and one.time == other.time for one, other in again)


def test_with_point_numbers_the_order_of_rows_does_not_matter(tmp_path):
    rows = [f"{time},{point},{point},{time},0" for time in (0, 1, 2) for point in (0, 1, 2, 3)]
    shuffled = [rows[k] for k in np.random.default_rng(1).permutation(len(rows))]
    in_time = frames(opened(tmp_path, "time_s,point,x_mm,y_mm,z_mm\n" + "\n".join(rows)))
    by_chance = frames(opened(tmp_path, "time_s,point,x_mm,y_mm,z_mm\n" + "\n".join(shuffled)))
    for one, other in zip(in_time, by_chance, strict=True):
        np.testing.assert_array_equal(one.points, other.points)


def test_a_point_number_left_out_is_a_missing_point(tmp_path):
    (frame,) = frames(opened(tmp_path, "point,x_mm,y_mm,z_mm,s_mm\n1,0,0,0,0\n2,1,0,0,1\n4,3,0,0,3\n"))
    np.testing.assert_array_equal(np.isnan(frame.points[:, 0]), [False, False, True, False])
    assert frame.stations is not None
    np.testing.assert_array_equal(frame.stations, [0, 0.001, np.nan, 0.003])


RECORDING = ["0,0,1,0,0", "0,1,2,0,0", "1,0,1,0,0", "1,1,2,0,0", "2,0,1,0,0", "2,1,2,0,0"]


@pytest.mark.parametrize(
    ("row", "text", "says"),
    [
        (3, "1,1,2,0", "line 5: 4 columns, the header has 5"),
        (3, "1,1,2,0,zero", "line 5: z_mm is 'zero'"),
        (3, ",1,2,0,0", "line 5: time_s is empty"),
        (3, "1,0,2,0,0", "line 5: point 0 is there twice"),
        (3, "1,0.5,2,0,0", "line 5: point is no whole number"),
        (3, "1,1e9,2,0,0", "line 5: point is no whole number from 0 to 100000"),
    ],
)
def test_a_bad_row_of_a_recording_rejects_its_frame_only(tmp_path, row, text, says):
    rows = [*RECORDING[:row], text, *RECORDING[row + 1 :]]
    recording = opened(tmp_path, "time_s,point,x_mm,y_mm,z_mm\n" + "\n".join(rows))
    outcome = reasons(recording)
    assert says in outcome[1]
    assert list(outcome) == [1]
    assert [item.time for item in recording.frames if isinstance(item, Frame)] == [0.0, 2.0]


def test_points_numbered_by_infinity_are_rejected_in_one_line(tmp_path):
    rows = [row.replace(",0,", ",inf,", 1).replace(",1,", ",inf,", 1) for row in RECORDING]
    recording = opened(tmp_path, "time_s,point,x_mm,y_mm,z_mm\n" + "\n".join(rows))
    assert "point is no whole number from 0" in reasons(recording)[0]


def test_two_values_of_one_measurement_in_a_frame_reject_it(tmp_path):
    recording = opened(
        tmp_path, "time_s,x_m,y_m,z_m,tension_in_N\n0,0,0,0,1\n0,1,0,0,2\n1,0,0,0,1\n1,1,0,0,1\n"
    )
    assert reasons(recording) == {0: "line 2: tension_in_N is 1 and 2 in one frame: give one"}


def test_time_that_runs_back_rejects_the_late_frame(tmp_path):
    recording = opened(
        tmp_path, "time_s,x_m,y_m,z_m\n" + "".join(f"{t},{k},0,0\n" for t in (0, 2, 1, 3) for k in range(4))
    )
    assert list(reasons(recording)) == [2]
    assert "1 s comes after 2 s" in reasons(recording)[2]


def test_a_column_that_resembles_a_measurement_and_is_not_read_gives_a_warning(tmp_path):
    recording = opened(
        tmp_path, "x_mm,y_mm,z_mm,tension_in_N,tension_out_raw_V,colour\n" + "1,2,3,4,5,6\n" * 4
    )
    (warning,) = recording.warnings
    assert warning.startswith("column 'tension_out_raw_V' is not read: the nearest name is tension_out_N; ")


def test_parquet_reads_as_the_same_csv_does(tmp_path):
    text = "time_s,point,x_mm,y_mm,z_mm,tension_in_N\n" + "".join(f"{row},7\n" for row in RECORDING)
    from_csv = frames(opened(tmp_path, text))
    values = np.array([[float(cell) for cell in f"{row},7".split(",")] for row in RECORDING]).T
    names = ["time_s", "point", "x_mm", "y_mm", "z_mm", "tension_in_N"]
    columns = [pa.array(values[k], pa.float32() if k else pa.float64()) for k in range(len(names))]
    columns[1] = pa.array(values[1].astype(np.int32))
    papq.write_table(pa.table(columns, names=names), tmp_path / "shape.parquet")
    recording = open_recording(tmp_path / "shape.parquet")
    assert (recording.kind, recording.unit, recording.timed) == ("parquet", "mm", True)
    for one, other in zip(from_csv, frames(recording), strict=True):
        np.testing.assert_array_equal(one.points, other.points)
        assert (one.time, one.tension_in) == (other.time, other.tension_in)


def test_parquet_null_is_a_missing_point(tmp_path):
    column = pa.array([0.0, None, 2.0, 3.0])
    papq.write_table(pa.table({"x_m": column, "y_m": column, "z_m": column}), tmp_path / "shape.parquet")
    (frame,) = frames(open_recording(tmp_path / "shape.parquet"))
    np.testing.assert_array_equal(np.isnan(frame.points).all(axis=1), [False, True, False, False])


def test_parquet_of_text_is_refused(tmp_path):
    column = pa.array(["a", "b"])
    papq.write_table(pa.table({"x_m": column, "y_m": column, "z_m": column}), tmp_path / "shape.parquet")
    with pytest.raises(ShapeError, match="a column holds no numbers"):
        open_recording(tmp_path / "shape.parquet")


def test_a_table_of_one_column_holds_no_points(tmp_path):
    papq.write_table(pa.table({"force_N": np.arange(5.0)}), tmp_path / "force.parquet")
    with pytest.raises(ShapeError, match=r"force\.parquet: no column x_mm or x_m in"):
        open_recording(tmp_path / "force.parquet")


@pytest.mark.parametrize("ending", ["npy", "parquet", "feather"])
def test_a_file_without_columns_holds_no_table(tmp_path, ending):
    path, write = tmp_path / f"shape.{ending}", {"parquet": papq.write_table, "feather": write_feather}
    if ending == "npy":
        np.save(path, np.zeros((4, 0)))
    else:
        write[ending](pa.table({}), path)
    with pytest.raises(ShapeError, match="no table of numbers in it"):
        open_recording(path)


def test_a_broken_parquet_file_is_refused(tmp_path):
    (tmp_path / "shape.parquet").write_bytes(b"PAR1 and no more")
    with pytest.raises(SourceError, match="cannot be read as Parquet"):
        open_recording(tmp_path / "shape.parquet")


def test_columns_of_directions_arrive_all_three_or_none(tmp_path):
    text = "x_mm,y_mm,z_mm,tx,ty,tz\n0,0,0,1,0,0\n1,0,0,,,\n"
    (frame,) = frames(opened(tmp_path, text))
    np.testing.assert_array_equal(frame.directions, [[1.0, 0.0, 0.0], [np.nan] * 3])
    with pytest.raises(ShapeError, match="no column tz beside tx"):
        opened(tmp_path, "x_mm,y_mm,z_mm,tx,ty\n0,0,0,1,0\n")


@pytest.mark.parametrize("strange", ["", "nan", "inf", " 7 ", "1_0", '"1.5"', "+1", "1e400", "NA", "x", "-0"])
def test_a_table_reads_the_same_whether_numpy_pyarrow_or_neither_can_read_it(tmp_path, monkeypatch, strange):
    rng = np.random.default_rng(len(strange))
    numbers = rng.normal(size=(60, 3)) * 10.0 ** rng.integers(-12, 12, (60, 3))
    cells = [[repr(float(number)) for number in row] for row in numbers]
    cells[30][1] = strange or cells[30][1]
    path = tmp_path / "shape.csv"
    path.write_text("time_s,x_mm,y_mm,z_mm\n" + "\n".join(",".join(("0", *row)) for row in cells) + "\n")
    raw, names = path.read_bytes(), ["time_s", "x_mm", "y_mm", "z_mm"]
    small = tables.read_csv(path, raw, names, None)
    monkeypatch.setattr(tables, "_SMALL", 0)
    large = tables.read_csv(path, raw, names, None)
    assert (small.faults, small.columns) == (large.faults, large.columns)
    for one, other in zip(
        (small.number, *small.values.values()), (large.number, *large.values.values()), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def test_a_row_that_begins_with_an_error_of_a_spreadsheet_is_a_missing_point_and_no_comment(tmp_path):
    path = tmp_path / "route.csv"
    rows = [f"{10 * k},{k * k},0" for k in range(6)]
    rows[2] = "#N/A,#N/A,#N/A"
    path.write_text("\n".join(["x_mm,y_mm,z_mm", *rows]), encoding="utf-8")
    (frame,) = open_recording(path).frames
    assert isinstance(frame, Frame)
    assert np.isnan(frame.points).all(axis=1).tolist() == [k == 2 for k in range(6)]


def numbers_of_points(recording: Recording) -> list[int]:
    return [len(frame.points) for frame in recording.frames if isinstance(frame, Frame)]


def two_routes(path, doubled=None):
    """Write frames of five sensors of two instruments, or of one with one frame written twice."""
    bodies = [("A", 0)] if doubled is not None else [("A", 0), ("B", 50)]
    rows = [
        f"{0.5 * frame},{body},{sensor + 1},{10 * sensor + frame},{sensor**2},{shift}"
        for frame in range(3)
        for body, shift in bodies
        for _ in range(1 + (frame == doubled))
        for sensor in range(5)
    ]
    path.write_text("\n".join(["Time,Body,Sensor,x_mm,y_mm,z_mm", *rows]), encoding="utf-8")
    return path


def test_sensors_that_each_frame_has_twice_are_refused_with_the_option_for_the_routes(tmp_path):
    path = two_routes(tmp_path / "both.csv")
    with pytest.raises(ShapeError, match=r'2 rows of Sensor 1 at 0 s: .*--map "NAME=recording"'):
        open_recording(path)
    one = open_recording(Path(f"{path}#B"), None, ColumnMap(["Body=recording"]))
    assert numbers_of_points(one) == [5, 5, 5]


@pytest.mark.parametrize("doubled", range(3))
def test_a_frame_of_sensors_that_was_written_twice_is_read_once(tmp_path, doubled):
    recording = open_recording(two_routes(tmp_path / "one.csv", doubled))
    assert numbers_of_points(recording) == [5, 5, 5]
    assert {"5 doubled rows left out", "markers in the order of Sensor"} <= {*recording.notes}

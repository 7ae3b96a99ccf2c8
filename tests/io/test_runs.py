"""Measured runs: channels in SI, and every fault with its line or column."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as papq
import pytest

from tssgeom.errors import SettingsError, ShapeError, SourceError
from tssgeom.io.formats.runs import read_run


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "run.csv"
    path.write_text(text)
    return path


def test_columns_are_read_in_si_and_others_passed_over(tmp_path):
    run = read_run(written(tmp_path, "note,time_s,elongation_mm,tension_in_N\na,0,1.5,3\nb,1,,4\n"))
    assert run.name == "run"
    np.testing.assert_array_equal(run.time, [0.0, 1.0])
    np.testing.assert_array_equal(run.elongation, [1.5e-3, np.nan])
    assert run.tension_out is None
    name, values = run.channel(["displacement_in_m", "tension_in_N"])
    assert (name, values.tolist()) == ("tension_in_N", [3.0, 4.0])


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_column_that_resembles_a_channel_and_is_not_read_is_reported(tmp_path, kind):
    path = tmp_path / f"run.{kind}"
    columns = {
        "time_s": [0.0, 1.0],
        "tension_in_N": [2.0, 3.0],
        "tension_middle_N": [2.0, 2.0],
        "note": [0, 0],
    }
    write = papq.write_table if kind == "parquet" else pyarrow.csv.write_csv
    write(pa.table(columns), path)
    (warning,) = read_run(path).warnings
    assert warning.startswith("column 'tension_middle_N' is not read: the nearest name is tension_in_N; ")


def test_parquet_holds_the_same(tmp_path):
    path = tmp_path / "run.parquet"
    papq.write_table(pa.table({"time_s": [0, 1], "tension_in_N": [2, 3], "word": ["a", "b"]}), path)
    np.testing.assert_array_equal(read_run(path).tension_in, [2.0, 3.0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("tension_in_N\n1\n", "no column time_s"),
        ("time_s,speed\n0,1\n", "no measured column: known are time_s, tension_in_N, .*, motor_angle_rad, "),
        ("time_s,motor\n0,1\n", "and of each tendon displacement_in_1_m, .*, tension_out_1_N$"),
        ("time_s,force\n0,1000\n", "'force' has no unit: give --map \"force=tension_in_N:mN\""),
        ("time_s,tension_in_N\n", "no row"),
        ("", "line 1 is empty: write a header such as .* or time_s"),
        ("time_s,tension_in_N\n0,1\n0,2\n", "row 2: time_s is 0, as above: times must"),
        ("time_s,tension_in_N\n1792893600,1\n1792890000,2\n", "3600 s before the row above"),
        ("time_s,tension_in_N\nnan,1\n0,2\n", "row 1|row 2"),
        ("time_s,tension_in_N\n0,one\n", "line 2: tension_in_N is 'one'"),
        ("time_s,tension_in_N\n0,1,2\n", "line 2: 3 columns"),
        ("time_s,tension_in_N,tension_in_N\n0,1,2\n", "there twice"),
        ("time_s,elongation_m,elongation_mm\n0,1,2\n", "both there"),
    ],
)
def test_a_fault_is_reported_with_its_line_or_column(tmp_path, text, said):
    with pytest.raises((SettingsError, ShapeError), match=said):
        read_run(written(tmp_path, text))


def test_a_drive_with_a_missing_value_is_refused(tmp_path):
    run = read_run(written(tmp_path, "time_s,tension_in_N\n0,1\n0.5,\n"))
    with pytest.raises(SettingsError, match=r"tension_in_N has no value at time_s = 0\.5"):
        run.channel(["tension_in_N"])
    with pytest.raises(SettingsError, match="no column displacement_in_m"):
        run.channel(["displacement_in_m"])


def test_what_is_no_table_is_refused(tmp_path):
    with pytest.raises(SourceError, match="a run is a table"):
        read_run(tmp_path / "run.doc")
    with pytest.raises(SourceError, match="cannot be read"):
        read_run(tmp_path / "none.csv")
    broken = tmp_path / "broken.parquet"
    broken.write_bytes(b"no parquet")
    with pytest.raises(SourceError, match="Parquet magic bytes"):
        read_run(broken)


def test_columns_that_no_reader_knows_are_named_together(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time_s,tension_in_N,Colour,Person\n" + "".join(f"{k},{k},3,{k}\n" for k in range(5)))
    assert "not read: 'Colour', 'Person'; --map states what a column is" in read_run(path).notes

"""Files as a loss of power leaves them, and files of another kind than their ending."""

from io import BytesIO

import numpy as np
import pytest
from openpyxl import Workbook

from tssgeom import read, read_run
from tssgeom.errors import ShapeError, SourceError
from tssgeom.stream import Frame

ROUTE = np.array([[60.0 * np.sin(k / 9), 60.0 * (1 - np.cos(k / 9)), k] for k in range(8)])


def recorded(frames=4):
    lines = ["time_s,point,x_mm,y_mm,z_mm,tension_in_N"]
    lines += [
        f"{0.1 * f:.1f},{k},{x:.3f},{y:.3f},{z:.3f},{5 + f}"
        for f in range(frames)
        for k, (x, y, z) in enumerate(ROUTE + f)
    ]
    return "\n".join(lines)


@pytest.mark.parametrize("zeros", [40, 4096])
@pytest.mark.parametrize("end", ["", "\n"])
def test_zero_bytes_that_a_disk_leaves_at_the_end_of_a_table_are_left_out(tmp_path, zeros, end):
    (tmp_path / "cut.csv").write_bytes((recorded() + end).encode() + b"\0" * zeros)
    recording = read(tmp_path / "cut.csv")
    frames = list(recording)
    assert len(frames) == 4
    assert all(isinstance(frame, Frame) for frame in frames)
    assert f"{zeros} zero bytes at the end left out" in recording.notes


def test_zero_bytes_at_the_end_of_a_run_are_left_out(tmp_path):
    text = "time_s,tension_in_N\n" + "".join(f"{k},{k + 3}\n" for k in range(9))
    (tmp_path / "run.csv").write_bytes(text.encode() + b"\0" * 500)
    run = read_run(tmp_path / "run.csv")
    np.testing.assert_array_equal(run.tension_in, np.arange(9) + 3.0)
    assert run.notes == ("500 zero bytes at the end left out",)


def test_a_long_cell_is_no_long_message(tmp_path):
    (tmp_path / "long.csv").write_text(recorded().replace(",8", ",8" + "x" * 3000))
    rejected = list(read(tmp_path / "long.csv"))[3]
    assert rejected.reason == f"line 26: tension_in_N is '8{'x' * 39}': write a number or leave it empty"


def test_a_spreadsheet_named_csv_is_refused_with_its_own_ending(tmp_path):
    book, content = Workbook(), BytesIO()
    book.active.append(["x_mm", "y_mm", "z_mm"])
    book.save(content)
    (tmp_path / "sheet.csv").write_bytes(content.getvalue())
    with pytest.raises(ShapeError, match=r"no UTF-8 text: it begins as \.xlsx does: name it so$"):
        read(tmp_path / "sheet.csv")


def test_text_named_as_a_spreadsheet_is_refused_with_the_ending_of_text(tmp_path):
    rows = "\n".join("\t".join(f"{x:.3f}" for x in point) for point in ROUTE)
    (tmp_path / "labview.xls").write_text(f"x [mm]\ty [mm]\tz [mm]\n{rows}\n")
    with pytest.raises(SourceError, match=r"cannot be read as \.xls .*: it is text: name it \.csv$"):
        read(tmp_path / "labview.xls")
    (tmp_path / "labview.xls").rename(tmp_path / "labview.csv")
    (frame,) = read(tmp_path / "labview.csv")
    np.testing.assert_allclose(frame.points, ROUTE / 1000, atol=1e-6)


def test_a_damaged_spreadsheet_is_to_be_written_anew(tmp_path):
    (tmp_path / "cut.xlsx").write_bytes(b"PK\x03\x04" + bytes(range(256)) * 4)
    with pytest.raises(SourceError, match=r"write it anew$"):
        read(tmp_path / "cut.xlsx")

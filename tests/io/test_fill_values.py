"""Values that programs write for lost coordinates are missing points, in tables of every form."""

import re

import numpy as np
import pytest

from tssgeom import Frame, read
from tssgeom.io.formats.files import open_recording

ROUTE = np.array([[600.0 * np.sin(k / 9), 600.0 * (1 - np.cos(k / 9)), -1500.0] for k in range(8)])
"""[mm]; as far from the tracker as they usually are."""


def row(points, lost, value):
    cells = [[f"{x:.2f}" for x in point] for point in points]
    for k in lost:
        cells[k] = [value] * 3
    return cells


def side_by_side(value):
    lines = ["time_s," + ",".join(f"{axis}{k}" for k in range(1, 9) for axis in "xyz")]
    lines += [
        f"{0.1 * f:.1f}," + ",".join(map(",".join, row(ROUTE + f, [3][: f // 2], value))) for f in range(4)
    ]
    return "\n".join(lines)


def row_a_point(value):
    lines = ["time_s,point,x_mm,y_mm,z_mm"]
    for f in range(4):
        cells = row(ROUTE + f, [3][: f // 2], value)
        lines += [f"{0.1 * f:.1f},{k}," + ",".join(cells[k]) for k in range(8)]
    return "\n".join(lines)


def lost_in(tmp_path, text, unit=None):
    file = tmp_path / "recorded.csv"
    file.write_text(text + "\n")
    recording = read(file, unit=unit)
    frames = [frame for frame in recording if isinstance(frame, Frame)]
    return [np.flatnonzero(np.isnan(f.points[:, 0])).tolist() for f in frames], recording.notes


@pytest.mark.parametrize("value", ["9999", "-9999.000", "-3.7e28", "-3.697314E28", "99999.9"])
def test_lost_points_are_missing_in_both_forms_of_tables(tmp_path, value):
    for text, unit in ((side_by_side(value), "mm"), (row_a_point(value), None)):
        lost, notes = lost_in(tmp_path, text, unit)
        assert lost == [[], [], [3], [3]]
        assert notes[-1] == f"2 points of {float(value):g} read as missing"


def test_two_fill_values_of_one_file_are_both_missing(tmp_path):
    text = row_a_point("9999").replace("0.3,3,9999,9999,9999", "0.3,3,-3.7e28,-3.7e28,-3.7e28")
    lost, notes = lost_in(tmp_path, text)
    assert lost == [[], [], [3], [3]]
    assert notes == ("2 points of -3.7e+28 and 9999 read as missing",)


@pytest.mark.parametrize("point", ["9999,-120.5,-1500.25", "-2500,-2500,-1500", "650,650,650", "0,0,0"])
def test_a_coordinate_that_may_be_measured_stays(tmp_path, point):
    text = row_a_point("9999").replace("9999,9999,9999", point)
    assert "read as missing" not in " ".join(
        lost_in(tmp_path, text.replace("0.3,3," + point, "0.3,3,1,2,3"))[1]
    )


def test_points_far_from_the_origin_stay(tmp_path):
    text = re.sub(r"-1(500|499|498|497)[.]00", "9999.00", row_a_point("150.00"))
    lost, notes = lost_in(tmp_path, text)
    assert lost == [[], [], [], []]
    assert not notes


@pytest.mark.parametrize("names", ["x_mm,y_mm,z_mm", "X [mm],Y [mm],Z [mm]"])
@pytest.mark.parametrize(("flag", "no", "yes"), [("valid", "0", "1"), ("Is tracked", "False", "True")])
def test_points_that_were_not_tracked_have_a_warning(tmp_path, names, flag, no, yes):
    path = tmp_path / "shape.csv"
    rows = [f"{k},{k * k},0" for k in range(5)]
    path.write_text("\n".join([f"{names},{flag}", *(f"{row},{yes}" for row in rows)]))
    assert not open_recording(path).warnings
    path.write_text("\n".join([f"{names},{flag}", f"{rows[0]},{no}", *(f"{row},{yes}" for row in rows[1:])]))
    (warning,) = open_recording(path).warnings
    assert warning.startswith(f"{flag} is {no.lower()} in 1 line, whose points are read all the same: empty")

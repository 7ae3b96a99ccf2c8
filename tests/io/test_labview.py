"""Measurements as LabVIEW writes them, `.lvm`: two headers, times in X_Value, units in a row of keys."""

from pathlib import Path

import numpy as np
import pytest

from tssgeom.errors import ShapeError
from tssgeom.io.formats.runs import MeasuredRun, read_run

TIME = np.arange(40) * 0.05
IN, OUT, DRIVE = 8.0 + 5.0 * np.sin(TIME), 5.0 + 3.0 * np.sin(TIME), 2.0 + np.sin(TIME)
UNITS = ("Newtons", "Newtons", "Millimeters")


def written(path: Path, units=UNITS, dimension="Time", mark="\t", decimal=",", segments=1) -> Path:
    def cells(*words: str) -> str:
        return mark.join(words) + mark

    head = ["LabVIEW Measurement", cells("Writer_Version", "2"), cells("Decimal_Separator", decimal)]
    head += [
        cells("Date", "2026/03/02"),
        cells("Time", f"11:20:04{decimal}512"),
        "***End_of_Header***" + mark,
    ]
    number = [f"{value:.6f}".replace(".", decimal) for value in (0.0, 0.05)]
    segment = [mark, cells("Channels", "3"), cells("Samples", *["40"] * 3)]
    segment += [cells("Y_Unit_Label", *units)] if units else []
    segment += [cells("X_Dimension", *[dimension] * 3), cells("X0", *[number[0]] * 3)]
    segment += [cells("Delta_X", *[number[1]] * 3), "***End_of_Header***" + 4 * mark]
    segment += [mark.join(("X_Value", "Force proximal", "Force distal", "Drive position", "Comment"))]
    for row in zip(TIME, IN, OUT, DRIVE, strict=True):
        segment.append(cells(*(f"{value:.6f}".replace(".", decimal) for value in row)))
    path.write_text("\r\n".join([*head, *segments * segment]) + "\r\n")
    return path


@pytest.mark.parametrize("name", ["run.lvm", "run.txt"])
@pytest.mark.parametrize(("mark", "decimal"), [("\t", ","), ("\t", "."), (",", ".")])
def test_channels_of_a_measurement_have_the_units_of_its_header(tmp_path, name, mark, decimal):
    read = read_run(written(tmp_path / name, mark=mark, decimal=decimal))
    assert "LabVIEW's headers left out" in read.notes
    np.testing.assert_allclose(read.time, TIME, atol=1e-6)
    assert_channels(read, IN)


def assert_channels(read: MeasuredRun, tension: np.ndarray) -> None:
    assert read.tension_in is not None
    assert read.tension_out is not None
    assert read.displacement_in is not None
    np.testing.assert_allclose(read.tension_in, tension, rtol=1e-6)
    np.testing.assert_allclose(read.tension_out, OUT, atol=1e-6)
    np.testing.assert_allclose(read.displacement_in, 1e-3 * DRIVE, atol=1e-9)


def test_a_force_in_kilonewton_is_scaled(tmp_path):
    assert_channels(read_run(written(tmp_path / "run.lvm", ("kN", "N", "mm"))), 1e3 * IN)


def test_a_force_in_volts_is_no_tension(tmp_path):
    read = read_run(written(tmp_path / "run.lvm", ("Volts", "Newtons", "mm")))
    assert read.tension_in is None
    assert any('--map "Force proximal [Volts]=tension_in_N"' in warning for warning in read.warnings)


def test_a_displacement_without_a_unit_is_asked_for(tmp_path):
    with pytest.raises(ShapeError, match="'Drive position' has no unit"):
        read_run(written(tmp_path / "run.lvm", ()))


def test_several_segments_are_refused_at_the_line_of_the_second(tmp_path):
    with pytest.raises(ShapeError, match="line 63: LabVIEW wrote several segments"):
        read_run(written(tmp_path / "run.lvm", segments=2))


def test_what_ends_with_the_header_holds_no_numbers(tmp_path):
    path = written(tmp_path / "run.lvm")
    whole = path.read_text()
    path.write_text(whole[: whole.index("X_Value")])
    with pytest.raises(ShapeError, match=r"run\.lvm: "):
        read_run(path)

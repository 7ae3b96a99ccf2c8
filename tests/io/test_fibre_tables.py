"""Tables of curvatures that a fibre sensed."""

import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as papq
import pytest

from tssgeom.errors import ShapeError
from tssgeom.io.formats.files import Recording, open_recording
from tssgeom.io.formats.laboratory.mapping import ColumnMap
from tssgeom.stream import Frame

S = np.array([10.0, 20, 30, 40])
BEND = np.array([[1.0, -2], [0, 0.5], [np.nan, np.nan], [3, 4]])


def opened(folder: Path, text: str, unit: str | None = None) -> Recording:
    path = folder / "fibre.csv"
    path.write_text(text)
    return open_recording(path, unit)


def rows(*columns: np.ndarray) -> str:
    return "".join(
        ",".join("" if np.isnan(x) else f"{x:.9g}" for x in row) + "\n" for row in zip(*columns, strict=True)
    )


def frames(recording: Recording) -> list[Frame]:
    items = list(recording.frames)
    assert all(isinstance(item, Frame) for item in items), items
    return [item for item in items if isinstance(item, Frame)]


@pytest.mark.parametrize(
    ("header", "per_metre", "radian"),
    [
        ("s_mm,Kappa [1/m],Theta [deg]", 1.0, np.degrees(1.0)),
        ("s_mm,curvature_per_mm,bend angle (rad)", 1e-3, 1.0),
    ],
)
def test_size_and_direction_are_components(tmp_path, header, per_metre, radian):
    size, direction = np.hypot(*BEND.T), np.arctan2(*BEND.T[::-1])
    table = rows(S, per_metre * size, radian * direction)
    (frame,) = frames(opened(tmp_path, f"{header}\n{table}"))
    np.testing.assert_allclose(frame.curvatures, BEND, rtol=1e-7, atol=1e-8)  # nine digits in the file


def test_a_direction_without_a_unit_is_not_taken_for_one(tmp_path):
    with pytest.raises(ShapeError):
        opened(tmp_path, "s_mm,kappa_per_m,theta\n" + rows(S, *BEND.T))


@pytest.mark.parametrize(("unit", "per_metre"), [("mm", 1000.0), ("m", 1.0)])
@pytest.mark.parametrize(("bend_unit", "times"), [("mm", 1000.0), ("m", 1.0)])
def test_each_unit_in_the_header_scales_its_own_columns(tmp_path, unit, per_metre, bend_unit, times):
    header = f"s_{unit},kappa_x_per_{bend_unit},kappa_y_per_{bend_unit}\n"
    (frame,) = frames(opened(tmp_path, header + rows(S, *BEND.T)))
    np.testing.assert_array_equal(frame.stations, S / per_metre)
    np.testing.assert_array_equal(frame.curvatures, BEND * times)
    assert frame.points.shape == (4, 3)
    assert np.isnan(frame.points).all()


def test_a_recording_of_curvatures_carries_time_and_tension(tmp_path):
    time = np.repeat([0.0, 0.5], 4)
    text = "time_s,s_mm,kappa_y_per_m,kappa_x_per_m,tension_in_N\n"
    text += rows(time, np.tile(S, 2), *np.tile(BEND[:, ::-1], (2, 1)).T, np.repeat([3.0, 4.0], 4))
    recording = opened(tmp_path, text)
    first, second = frames(recording)
    assert (recording.timed, first.time, second.time, second.tension_in) == (True, 0.0, 0.5, 4.0)
    np.testing.assert_array_equal(second.curvatures, BEND)


def test_parquet_holds_the_same_columns(tmp_path):
    path = tmp_path / "fibre.parquet"
    papq.write_table(pa.table({"s_mm": S, "kappa_x_per_m": BEND[:, 0], "kappa_y_per_m": BEND[:, 1]}), path)
    (frame,) = frames(open_recording(path))
    np.testing.assert_array_equal(frame.curvatures, BEND)


@pytest.mark.parametrize(
    ("header", "reason"),
    [
        ("s_mm,kappa_x,kappa_y", "name them kappa_x_per_m,kappa_y_per_m or kappa_x_per_mm,kappa_y_per_mm"),
        ("s_mm,kappa_x_per_m,kappa_y_per_mm", "both in one unit"),
        ("s_mm,kappa_x_per_m,other", "curvature columns kappa_x_per_m: name them"),
        ("other,kappa_x_per_m,kappa_y_per_m", "add a column s_mm or s_m"),
        ("s,kappa_x_per_m,kappa_y_per_m", "name the columns s_mm or s_m, or give --unit mm|m|cm|in|…"),
    ],
)
def test_a_unit_that_is_missing_or_mixed_is_refused_with_the_hint(tmp_path, header, reason):
    with pytest.raises(ShapeError) as refused:
        opened(tmp_path, f"{header}\n10,1,2\n20,1,2\n30,1,2\n")
    assert reason in str(refused.value)


@pytest.mark.parametrize(("name", "factor"), [("Position [mm]", 1.0), ("Pos [cm]", 10.0)])
def test_a_column_that_may_hold_the_stations_is_named_with_the_option_that_accepts_it(tmp_path, name, factor):
    text = f"{name},kappa_x_per_m,kappa_y_per_m\n" + rows(S, *BEND.T)
    with pytest.raises(ShapeError, match=re.escape(f'--map "{name}=s_mm"')):
        opened(tmp_path, text)
    mapped = ColumnMap([f"{name}=s_mm"])
    (frame,) = frames(open_recording(tmp_path / "fibre.csv", None, mapped))
    assert frame.stations is not None
    np.testing.assert_allclose(frame.stations, factor * S / 1000.0, rtol=1e-12)


@pytest.mark.parametrize(("unit", "value"), [("m", 0.15), ("mm", 0.00015)])
def test_the_noise_of_curvatures_is_a_column_in_either_unit(tmp_path, unit, value):
    header = f"s_mm,kappa_x_per_m,kappa_y_per_m,curvature_noise_per_{unit}\n"
    (frame,) = frames(opened(tmp_path, header + rows(S, *BEND.T, np.full(4, value))))
    assert frame.curvature_noise == pytest.approx(0.15)


@pytest.mark.parametrize("column", ["noise_m", "noise", "noise_per_m"])
def test_a_noise_that_is_not_that_of_curvatures_gives_a_warning_with_the_name_to_use(tmp_path, column):
    header = f"s_mm,kappa_x_per_m,kappa_y_per_m,{column}\n"
    recording = opened(tmp_path, header + rows(S, *BEND.T, np.full(4, 0.15)))
    (warning,) = recording.warnings
    assert f"column '{column}' is not read" in warning
    assert "curvature_noise_per_m" in warning
    assert frames(recording)[0].noise is None


def test_unit_option_is_for_the_stations(tmp_path):
    (frame,) = frames(opened(tmp_path, "s,kappa_x_per_m,kappa_y_per_m\n" + rows(S, *BEND.T), "mm"))
    np.testing.assert_array_equal(frame.stations, S / 1000.0)
    np.testing.assert_array_equal(frame.curvatures, BEND)


def test_gratings_side_by_side_are_refused_with_the_form_that_is_read(tmp_path):
    with pytest.raises(ShapeError, match="need a row for each grating, under s_mm,kappa_x_per_m"):
        opened(tmp_path, "time_s,Curvature 1 [1/cm],Curvature 2 [1/cm],Angle 1 [deg]\n0,1,2,3\n1,1,2,3\n")


@pytest.mark.parametrize(("meant", "noise"), [("curvature_noise", 0.2), ("curvature_noise:1/mm", 200.0)])
def test_the_noise_of_curvatures_may_be_a_column_that_is_mapped(tmp_path, meant, noise):
    table = "s_mm,kappa_x_per_m,kappa_y_per_m,wobble\n" + rows(S, *BEND.T, np.full(4, 0.2))
    (tmp_path / "fibre.csv").write_text(table)
    recording = open_recording(tmp_path / "fibre.csv", None, ColumnMap([f"wobble={meant}"]))
    assert frames(recording)[0].curvature_noise == pytest.approx(noise)

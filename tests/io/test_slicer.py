"""3D Slicer's markups and its older point lists."""

import json
from pathlib import Path

import numpy as np
import pytest

from tssgeom.errors import ShapeError, SourceError, TssgeomError
from tssgeom.io.formats.files import Recording, find_inputs, open_recording
from tssgeom.stream import Frame

CORPUS = Path(__file__).parent / "corpus"
LPS = [[10.0, 0, 5], [20, 2, 5], [np.nan] * 3, [40, 9, 5.5], [50, 15, 6], [60, 23, 6.5]]


def points_of(recording: Recording) -> np.ndarray:
    (frame,) = recording.frames
    assert isinstance(frame, Frame)
    return frame.points


def curve(**fields: object) -> dict:
    points = [{"position": row} for row in np.arange(12.0).reshape(4, 3).tolist()]
    return {
        "type": "Curve",
        "coordinateSystem": "LPS",
        "coordinateUnits": "mm",
        "controlPoints": points,
    } | fields


def saved(folder: Path, *markups: dict, **fields: object) -> Path:
    path = folder / "scene.mrk.json"
    path.write_text(json.dumps({"@schema": "markups-schema-v1.0.3.json#", "markups": markups} | fields))
    return path


def test_a_curve_is_a_shape_in_si_whose_undefined_points_are_missing():
    recording = open_recording(CORPUS / "curve.mrk.json")
    assert (recording.name, recording.unit, recording.kind, recording.timed) == (
        "curve",
        "mm",
        "slicer",
        False,
    )
    np.testing.assert_array_equal(points_of(recording), np.array(LPS) / 1000)


def test_ras_and_lps_give_the_same_positions(tmp_path):
    right = curve(
        coordinateSystem="RAS",
        controlPoints=[{"position": [-x, -y, z]} for x, y, z in np.arange(12.0).reshape(4, 3)],
    )
    here = points_of(open_recording(saved(tmp_path, right)))
    there = points_of(open_recording(saved(tmp_path, curve())))
    np.testing.assert_array_equal(here, there)


@pytest.mark.parametrize(
    ("units", "per_metre"),
    [
        ("mm", 1e3),
        ("um", 1e6),
        ("m", 1.0),
        (["mm", "UCUM", "millimeter"], 1e3),
        (["um", "UCUM", "micrometer"], 1e6),
    ],
)
def test_the_unit_is_the_file_s_as_text_or_as_code(tmp_path, units, per_metre):
    outcome = points_of(open_recording(saved(tmp_path, curve(coordinateUnits=units))))
    np.testing.assert_array_equal(outcome, np.arange(12.0).reshape(4, 3) / per_metre)


def test_without_a_unit_it_is_the_schema_s_millimetre(tmp_path):
    plain = curve()
    del plain["coordinateUnits"]
    assert open_recording(saved(tmp_path, plain)).unit == "mm"
    with pytest.raises(ShapeError, match="the file is in mm, --unit says m"):
        open_recording(saved(tmp_path, plain), "m")


def test_a_previewed_point_has_no_position_yet(tmp_path):
    points = [*curve()["controlPoints"], {"position": [1, 2, 3], "positionStatus": "preview"}, {"id": "6"}]
    outcome = points_of(open_recording(saved(tmp_path, curve(controlPoints=points))))
    assert np.isnan(outcome[4:]).all()
    assert len(outcome) == 6


def test_each_curve_of_a_file_is_a_shape_of_its_own_called_by_its_name_or_number(tmp_path):
    path = saved(
        tmp_path, curve(name="left"), curve(), curve(name="twin"), curve(name="twin"), {"type": "ROI"}
    )
    assert [outcome.name for outcome in find_inputs([path])] == [
        "scene.mrk.json#left",
        "scene.mrk.json#2",
        "scene.mrk.json#3",
        "scene.mrk.json#4",
    ]
    assert open_recording(f"{path}#left").name == "scene-left"
    assert open_recording(f"{path}#1").name == "scene-1"


def test_point_lists_are_routes_only_where_there_is_no_curve(tmp_path):
    landmarks = curve(type="Fiducial", controlPoints=curve()["controlPoints"][:2])
    assert len(points_of(open_recording(saved(tmp_path, landmarks, curve())))) == 4
    assert len(points_of(open_recording(saved(tmp_path, landmarks)))) == 2


@pytest.mark.parametrize(
    ("markups", "part", "says"),
    [
        ([curve(), curve()], "", "it holds 2 routes (1, 2): name one, as"),
        ([curve(name="a")], "#b", "no route 'b' in it: it holds a"),
        ([{"type": "ClosedCurve"}, {"type": "ROI"}], "", "it holds ClosedCurve, ROI, no route"),
        ([], "", "it holds no markup, no route"),
        ([curve(coordinateUnits="inch")], "", "coordinateUnits is 'inch': write mm, m or um"),
        ([curve(coordinateSystem="IJK")], "", "coordinateSystem is 'IJK': write LPS or RAS"),
        ([curve(controlPoints=[{"position": [1, 2]}])], "", "no Slicer markup"),
    ],
)
def test_what_cannot_be_used_is_refused_with_the_hint(tmp_path, markups, part, says):
    path = saved(tmp_path, *markups)
    with pytest.raises(TssgeomError) as caught:
        open_recording(f"{path}{part}")
    assert str(path) in str(caught.value)
    assert says in str(caught.value)


def test_a_schema_to_come_is_refused(tmp_path):
    path = saved(tmp_path, curve(), **{"@schema": "markups-schema-v2.0.0.json#"})
    with pytest.raises(ShapeError, match="schema 2 is not known"):
        open_recording(path)


def test_json_of_something_else_is_refused(tmp_path):
    (tmp_path / "a.mrk.json").write_text('{"points": []}')
    with pytest.raises(SourceError, match=r"no Slicer markup \(Object missing required field `markups`\)"):
        open_recording(tmp_path / "a.mrk.json")


def test_a_point_list_of_slicer_4_is_read_in_mm():
    recording = open_recording(CORPUS / "points.fcsv")
    assert (recording.unit, recording.kind, recording.timed) == ("mm", "fcsv", False)
    np.testing.assert_array_equal(points_of(recording)[:2], [[0.010, 0, 0.005], [0.020, 0.002, 0.005]])


def test_slicer_5_adds_a_status_behind_a_carriage_return_and_writes_ras():
    outcome = points_of(open_recording(CORPUS / "points_slicer5.fcsv"))
    np.testing.assert_array_equal(outcome, np.array(LPS[:5]) / 1000)


@pytest.mark.parametrize(("system", "sign"), [("0", -1), ("RAS", -1), ("1", 1), ("LPS", 1)])
def test_coordinate_systems_have_numbers_in_old_lists_and_names_in_new_ones(tmp_path, system, sign):
    (tmp_path / "a.fcsv").write_text(f"# CoordinateSystem = {system}\n0,1,2,3\n")
    np.testing.assert_array_equal(
        points_of(open_recording(tmp_path / "a.fcsv")), [[sign * 1e-3, sign * 2e-3, 3e-3]]
    )


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no control point"),
        ("# columns = id,x,y,z\n", "no control point"),
        ("# CoordinateSystem = 2\n0,1,2,3\n", "CoordinateSystem is '2'"),
        ("0,1,2,3\n\n1,2,x,4\n", "line 3: no point in '1,2,x,4'"),
        ("0,1,2\n", "line 1: no point in '0,1,2'"),
    ],
)
def test_a_bad_point_list_is_refused_with_its_line(tmp_path, text, says):
    (tmp_path / "a.fcsv").write_text(text)
    with pytest.raises(ShapeError) as caught:
        open_recording(tmp_path / "a.fcsv")
    assert says in str(caught.value)

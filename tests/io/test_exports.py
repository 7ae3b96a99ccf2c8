"""Routes with their tension, as other programs read them."""

import json
import sys

import numpy as np
import pytest
import trimesh
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkFiltersCore import vtkFeatureEdges
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

from tssgeom.errors import SettingsError, SourceError
from tssgeom.io.formats.files import open_recording
from tssgeom.io.results.exports import WRITERS, TensionLine, selected_endings, write_exports
from tssgeom.view.mesh import SIDES, tube

NODES = 300
S = np.linspace(0.0, 0.5, NODES)
ARC = np.column_stack([np.sin(4 * S), 1 - np.cos(4 * S), 0 * S]) / 4
TANGENT = np.column_stack([np.cos(4 * S), np.sin(4 * S), 0 * S])
TENSION = 15 * np.exp(-0.145 * 4 * S)


@pytest.fixture(params=["mm", "m"])
def line(request) -> TensionLine:
    values = {
        "tension_N": TENSION,
        "kappa_per_m": 0 * S + 4,
        "kappa_se_per_m": 0 * S + 0.1,
        "angle_rad": 4 * S,
    }
    totals = {
        "length_m": 0.5,
        "total_angle_rad": 2.0,
        "tension_in_N": 15.0,
        "tension_out_N": TENSION[-1],
        "elongation_m": 2e-3,
    }
    return TensionLine("arc", request.param, S, ARC, values, totals)


@pytest.fixture
def mesh(line) -> trimesh.Trimesh:
    return tube(ARC, TANGENT, TENSION, 0.003, carried=line.values)


@pytest.fixture
def written(line, mesh, tmp_path):
    write_exports(tmp_path, tuple(WRITERS), line, mesh)
    return tmp_path


def per_metre(line: TensionLine) -> float:
    return 1000.0 if line.unit == "mm" else 1.0


def poly_data(path):
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    return reader


@pytest.mark.parametrize("ending", ["mrk.json", "vtp", "csv"])
def test_what_is_written_is_a_shape_that_is_read_again_without_a_stated_unit(written, line, ending):
    recording = open_recording(written / f"arc_tension.{ending}")
    (frame,) = recording.frames
    assert recording.unit == ("mm" if ending == "mrk.json" else line.unit)
    near = np.linalg.norm(frame.points[:, None] - ARC[None], axis=2).min(axis=1)
    assert near.max() < 1e-9  # nine digits of a table
    np.testing.assert_allclose(frame.points[[0, -1]], ARC[[0, -1]], atol=1e-9)


def test_a_slicer_curve_has_what_schema_1_0_3_asks_for(written):
    held = json.loads((written / "arc_tension.mrk.json").read_text())
    (curve,) = held["markups"]
    assert held["@schema"].endswith("markups-schema-v1.0.3.json#")
    assert (curve["type"], curve["coordinateSystem"], curve["coordinateUnits"]) == ("Curve", "LPS", "mm")
    assert len(curve["controlPoints"]) == 200
    for point in curve["controlPoints"]:
        assert isinstance(point["id"], str)
        assert [type(number) for number in point["position"]] == [float] * 3
        assert point["positionStatus"] == "defined"
    for measurement in curve["measurements"]:
        assert [type(word) for word in measurement["units"]] == [str] * 3
        assert {*measurement} <= {"name", "enabled", "value", "units", "printFormat", "controlPointValues"}


def test_a_slicer_curve_carries_tension_and_curvature_at_each_control_point(written):
    (curve,) = json.loads((written / "arc_tension.mrk.json").read_text())["markups"]
    reported = {measurement["name"]: measurement for measurement in curve["measurements"]}
    positions = np.array([point["position"] for point in curve["controlPoints"]]) / 1000
    s = np.arctan2(positions[:, 0], 0.25 - positions[:, 1]) / 4
    np.testing.assert_allclose(
        reported["tension"]["controlPointValues"], 15 * np.exp(-0.145 * 4 * s), rtol=1e-9
    )
    assert reported["tension"]["units"] == ["N", "UCUM", "newton"]
    assert reported["curvature (tssgeom)"]["controlPointValues"] == [4.0] * 200
    assert reported["elongation"]["value"] == pytest.approx(2.0)
    assert not {"length", "curvature mean", "curvature max"} & {
        *reported
    }  # Slicer's own, which it would overwrite


def test_a_vtk_tube_is_closed_and_carries_the_tension_on_tube_and_line(written, line):
    reader = poly_data(written / "arc_tension.vtp")
    data = reader.GetOutput()
    edges = vtkFeatureEdges()
    edges.SetInputConnection(reader.GetOutputPort())
    edges.FeatureEdgesOff()
    edges.ManifoldEdgesOff()
    edges.Update()
    assert edges.GetOutput().GetNumberOfCells() == 0
    assert (data.GetNumberOfPolys(), data.GetNumberOfLines()) == (2 * SIDES * NODES, 1)
    tension = vtk_to_numpy(data.GetPointData().GetScalars())
    assert data.GetPointData().GetScalars().GetName() == "tension_N"
    np.testing.assert_allclose(tension[-NODES:], TENSION)
    np.testing.assert_allclose(
        tension[: SIDES * NODES].reshape(NODES, SIDES), TENSION[:, None] * np.ones(SIDES), rtol=1e-6
    )
    positions = vtk_to_numpy(data.GetPoints().GetData())
    np.testing.assert_allclose(positions[-NODES:], per_metre(line) * ARC, atol=1e-12)


def test_a_ply_tube_is_watertight_in_the_unit_of_the_source_and_carries_the_tension(written, line, mesh):
    read = trimesh.load_mesh(written / "arc_tension.ply", process=False)
    assert read.is_watertight
    np.testing.assert_allclose(
        read.vertices, per_metre(line) * mesh.vertices, rtol=1e-6, atol=1e-6 * per_metre(line)
    )
    held = read.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_allclose(
        held["tension_N"][: SIDES * NODES : SIDES], TENSION, rtol=1e-6
    )  # single precision


def test_a_table_has_a_row_for_each_node_with_units_in_its_header(written, line):
    path = written / "arc_tension.csv"
    header = path.read_text().partition("\n")[0]
    u = line.unit
    assert header == f"s_{u},x_{u},y_{u},z_{u},tension_N,kappa_per_m,kappa_se_per_m,angle_rad"
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    expected = np.column_stack(
        [per_metre(line) * S, per_metre(line) * ARC, TENSION, 0 * S + 4, 0 * S + 0.1, 4 * S]
    )
    np.testing.assert_allclose(rows, expected, rtol=1e-8, atol=1e-8)  # nine digits


def test_an_export_leaves_the_tube_as_it_was(line, mesh, tmp_path):
    before = mesh.vertices.copy()
    write_exports(tmp_path, tuple(WRITERS), line, mesh)
    np.testing.assert_array_equal(mesh.vertices, before)


def test_endings_are_a_list_with_or_without_dots():
    assert selected_endings("mrk.json, .vtp") == ("mrk.json", "vtp")
    assert selected_endings("") == ()
    with pytest.raises(SettingsError, match="no writer for 'obj': choose from mrk"):
        selected_endings("vtp,obj")


def test_without_vtk_the_hint_is_the_extra(line, mesh, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "vtkmodules.vtkIOXML", None)
    with pytest.raises(SourceError, match=r"pip install 'tssgeom\[vtk\]'"):
        write_exports(tmp_path, ("vtp",), line, mesh)

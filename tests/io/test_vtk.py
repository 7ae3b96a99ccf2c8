"""VTK poly lines, written by VTK itself."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from vtkmodules.vtkCommonCore import vtkDoubleArray, vtkPoints, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

from tssgeom.errors import ShapeError, SourceError, TssgeomError
from tssgeom.io.formats.files import Recording, find_inputs, open_recording
from tssgeom.io.formats.recording import usable
from tssgeom.stream import Frame

CORPUS = Path(__file__).parent / "corpus"
AORTA = Path(__file__).resolve().parents[3] / "shared" / "data" / "vmtk_aorta"
ARC = np.column_stack([np.sin(np.linspace(0, 1, 7)), 1 - np.cos(np.linspace(0, 1, 7)), np.zeros(7)])


def points_of(recording: Recording) -> np.ndarray:
    (frame,) = recording.frames
    assert isinstance(frame, Frame)
    return frame.points


def poly_data(points: np.ndarray, *lines: list[int], unit: str | None = None) -> vtkPolyData:
    data, positions, cells = vtkPolyData(), vtkPoints(), vtkCellArray()
    positions.SetDataTypeToDouble()
    for point in points.tolist():
        positions.InsertNextPoint(point)
    for line in lines:
        cells.InsertNextCell(len(line), line)
    data.SetPoints(positions)
    data.SetLines(cells)
    if unit is not None:
        said = vtkStringArray()
        said.SetName("unit")
        said.InsertNextValue(unit)
        data.GetFieldData().AddArray(said)
    return data


def written(folder: Path, points: np.ndarray, *lines: list[int], unit: str | None = None) -> Path:
    writer = vtkXMLPolyDataWriter()
    writer.SetFileName(str(folder / "route.vtp"))
    writer.SetInputData(poly_data(points, *lines, unit=unit))
    writer.Write()
    return folder / "route.vtp"


def test_a_poly_line_is_a_shape_in_the_order_of_its_line(tmp_path):
    order = [3, 1, 0, 2, 6, 5]
    recording = open_recording(written(tmp_path, ARC, order), "mm")
    assert (recording.name, recording.unit, recording.kind, recording.timed) == ("route", "mm", "vtk", False)
    np.testing.assert_array_equal(points_of(recording), ARC[order] / 1000)


@pytest.mark.parametrize(
    ("array", "source"), [("MaximumInscribedSphereRadius", "centreline"), ("Curvature", None)]
)
def test_a_line_with_the_radii_of_the_spheres_inside_a_vessel_is_a_centreline(tmp_path, array, source):
    data, radii = poly_data(ARC, [*range(7)]), vtkDoubleArray()
    radii.SetName(array)
    for _ in ARC:
        radii.InsertNextValue(0.01)
    data.GetPointData().AddArray(radii)
    writer = vtkXMLPolyDataWriter()
    writer.SetFileName(str(tmp_path / "route.vtp"))
    writer.SetInputData(data)
    writer.Write()
    (frame,) = open_recording(tmp_path / "route.vtp", "mm").frames
    assert isinstance(frame, Frame)
    assert frame.source == source


def test_the_unit_is_that_of_a_field_array_or_has_to_be_said(tmp_path):
    path = written(tmp_path, ARC, list(range(7)), unit="m")
    np.testing.assert_array_equal(points_of(open_recording(path)), ARC)
    with pytest.raises(ShapeError, match="the file is in m, --unit says mm"):
        open_recording(path, "mm")
    with pytest.raises(
        ShapeError,
        match=r"no unit: add a field array 'unit' that states mm or m, or give --unit mm\|m\|cm\|in",
    ):
        open_recording(written(tmp_path, ARC, list(range(7))))


@pytest.mark.parametrize("kind", ["ascii", "binary", "appended"])
def test_each_way_of_writing_gives_the_same_lines(kind):
    path = CORPUS / f"lines_{kind}.vtp"
    outcome = find_inputs([path])
    assert [each.name for each in outcome] == [f"lines_{kind}.vtp#1", f"lines_{kind}.vtp#2"]
    first, second = (points_of(open_recording(each, "mm")) for each in outcome)
    a = np.linspace(0, 1.5, 6)
    np.testing.assert_allclose(first, 0.05 * np.column_stack([np.sin(a), 1 - np.cos(a), 0 * a]), atol=1e-8)
    assert len(second) == 5


def test_the_lines_of_a_vessel_tree_are_two_shapes():
    if not AORTA.is_dir():
        pytest.skip("needs the VMTK aorta lines")
    outcome = find_inputs([AORTA / "aorta-centerline.vtp"])
    assert [len(points_of(open_recording(each, "mm"))) for each in outcome] == [211, 198]


@pytest.mark.parametrize(
    ("lines", "part", "says"),
    [
        ([], "", "no poly line in it"),
        ([[0, 1, 2], [3, 4, 5]], "", "it holds 2 routes (1, 2): name one, as"),
        ([[0, 1, 2], [3, 4, 5]], "#3", "no route '3' in it: it holds 1, 2"),
        ([[0, 1, 2], [3, 4, 5]], f"#{'9' * 200}", "no route '999"),
        ([[0, 1, 99]], "", "a line goes through point 99 of 7"),
    ],
)
def test_what_is_no_single_line_is_refused(tmp_path, lines, part, says):
    path = written(tmp_path, ARC, *lines, unit="mm")
    with pytest.raises(TssgeomError) as caught:
        open_recording(f"{path}{part}")
    assert says in str(caught.value)


@pytest.mark.parametrize("mode", ["SetDataModeToAscii", "SetDataModeToBinary", "SetDataModeToAppended"])
@pytest.mark.parametrize(
    "compressor", ["SetCompressorTypeToNone", "SetCompressorTypeToZLib", "SetCompressorTypeToLZMA"]
)
@pytest.mark.parametrize("heading", ["SetHeaderTypeToUInt32", "SetHeaderTypeToUInt64"])
@pytest.mark.parametrize("order", ["SetByteOrderToLittleEndian", "SetByteOrderToBigEndian"])
@pytest.mark.parametrize("encoded", [True, False])
def test_whatever_vtk_writes_is_read(tmp_path, mode, compressor, heading, order, encoded):
    """Blocks of 4 KiB, so that 1000 points take six of them and a rest."""
    points = np.random.default_rng(3).normal(size=(1000, 3))
    data = poly_data(points, list(range(1000)), list(range(7)), unit="mm")
    writer = vtkXMLPolyDataWriter()
    for way in (mode, compressor, heading, order):
        getattr(writer, way)()
    writer.SetEncodeAppendedData(encoded)
    writer.SetBlockSize(4096)
    writer.SetFileName(str(tmp_path / "route.vtp"))
    writer.SetInputData(data)
    writer.Write()
    long, short = find_inputs([tmp_path])
    # As text, VTK writes a coordinate with up to seventeen digits less their last rounding.
    np.testing.assert_allclose(
        points_of(open_recording(long)), points / 1000, rtol=1e-11 if "Ascii" in mode else 0
    )
    assert len(points_of(open_recording(short))) == 7


def test_lz4_is_refused_with_the_hint(tmp_path):
    writer = vtkXMLPolyDataWriter()
    writer.SetCompressorTypeToLZ4()
    writer.SetFileName(str(tmp_path / "route.vtp"))
    writer.SetInputData(poly_data(ARC, list(range(7))))
    writer.Write()
    with pytest.raises(
        SourceError, match="vtkLZ4DataCompressor is not known, write it with vtkZLibDataCompressor"
    ):
        open_recording(tmp_path / "route.vtp", "mm")


@pytest.mark.parametrize("cut", [0, 100, 900, 1800])
def test_a_broken_file_is_refused_in_one_line(tmp_path, cut):
    (tmp_path / "cut.vtp").write_bytes((CORPUS / "lines_binary.vtp").read_bytes()[:cut])
    with pytest.raises(SourceError, match="cannot be read as VTK poly data") as caught:
        open_recording(tmp_path / "cut.vtp", "mm")
    assert "\n" not in str(caught.value)


def test_a_point_beyond_single_precision_is_infinite_and_rejected_without_a_warning(tmp_path):
    text = (CORPUS / "lines_ascii.vtp").read_text().replace("0 0 0 14.7", "0 0 1e300 14.7")
    (tmp_path / "far.vtp").write_text(text)
    (frame,) = open_recording(f"{tmp_path / 'far.vtp'}#1", "mm")
    assert isinstance(frame, Frame)
    assert not usable(frame)


def test_another_kind_of_vtk_file_is_refused(tmp_path):
    (tmp_path / "grid.vtp").write_text('<VTKFile type="ImageData" version="0.1"><ImageData/></VTKFile>')
    with pytest.raises(SourceError, match="it holds ImageData"):
        open_recording(tmp_path / "grid.vtp", "mm")


def segments(*numbers: int) -> list[list[int]]:
    return [[a, b] for a, b in pairwise(numbers)]


@pytest.mark.parametrize(
    ("points", "lines"),
    [
        (ARC, segments(*range(7))),
        (ARC, [[4, 5], [0, 1], [5, 6], [2, 3], [1, 2], [3, 4]]),
        (ARC, [[0, 1], [2, 1], [3, 2], [3, 4], [5, 4], [5, 6]]),
        (np.repeat(ARC, 2, axis=0)[1:-1], [[2 * k, 2 * k + 1] for k in range(6)]),
    ],
)
def test_lines_of_two_points_are_joined_to_one_route_where_they_connect(tmp_path, points, lines):
    path = written(tmp_path, points, *lines, unit="mm")
    assert find_inputs([path]) == [path]
    np.testing.assert_array_equal(points_of(open_recording(path)), ARC / 1000)


def test_two_routes_of_lines_of_two_points_stay_two(tmp_path):
    path = written(
        tmp_path, np.vstack([ARC, ARC + 1.0]), *segments(*range(7)), *segments(*range(7, 14)), unit="mm"
    )
    first, second = find_inputs([path])
    np.testing.assert_array_equal(points_of(open_recording(first)), ARC / 1000)
    np.testing.assert_array_equal(points_of(open_recording(second)), (ARC + 1.0) / 1000)


def test_lines_of_two_points_end_where_three_meet_and_a_ring_of_them_closes(tmp_path):
    tree = np.vstack([ARC, ARC[3:] + np.array([0, 0, 1])])
    path = written(tmp_path, tree, *segments(*range(7)), *segments(3, 8, 9, 10), unit="mm")
    assert [len(points_of(open_recording(each))) for each in find_inputs([path])] == [4, 4, 4]
    path = written(tmp_path, ARC, *segments(*range(7)), [6, 0], unit="mm")
    np.testing.assert_array_equal(points_of(open_recording(path)), np.vstack([ARC, ARC[:1]]) / 1000)

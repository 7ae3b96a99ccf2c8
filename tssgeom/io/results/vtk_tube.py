"""A tube and the route inside it as VTK poly data, `.vtp`; needs the extra `[vtk]`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from tssgeom.atomic import replacing
from tssgeom.errors import SourceError
from tssgeom.io.formats.units import PER_METRE
from tssgeom.io.formats.vtk import UNIT
from tssgeom.io.results.tension_line import TensionLine


def write_vtp(path: Path, line: TensionLine, tube: trimesh.Trimesh) -> None:
    """Write the tube as polygons and the route as a poly line, both with the numbers at the nodes.

    Tension is the active scalar. A field array states the unit of length, so that the file is read again.

    Raises
    ------
    SourceError
        Where the disk refuses, or VTK is not installed.
    """
    try:
        from vtkmodules.vtkCommonCore import vtkPoints, vtkStringArray
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
        from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter
    except ImportError as error:
        raise SourceError(f"{path}: .vtp files need VTK: pip install 'tssgeom[vtk]'") from error
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray

    places = PER_METRE[line.unit] * np.concatenate([tube.vertices, line.position])
    points, faces, route = vtkPoints(), vtkCellArray(), vtkCellArray()
    points.SetData(numpy_to_vtk(places, deep=True))
    corners = np.column_stack([np.full(len(tube.faces), 3), tube.faces]).astype(np.int64)
    faces.ImportLegacyFormat(numpy_to_vtkIdTypeArray(corners.ravel(), deep=True))
    nodes = len(tube.vertices) + np.arange(len(line.s))
    route.InsertNextCell(len(nodes), nodes.tolist())
    data = vtkPolyData()
    data.SetPoints(points)
    data.SetPolys(faces)
    data.SetLines(route)
    for name, values in line.values.items():
        array = numpy_to_vtk(np.concatenate([tube.vertex_attributes[name], values]), deep=True)
        array.SetName(name)
        data.GetPointData().AddArray(array)
    data.GetPointData().SetActiveScalars("tension_N")
    unit = vtkStringArray()
    unit.SetName(UNIT)
    unit.InsertNextValue(line.unit)
    data.GetFieldData().AddArray(unit)
    with replacing(path) as draft:
        writer = vtkXMLPolyDataWriter()
        writer.SetFileName(str(draft))
        writer.SetInputData(data)
        if not writer.Write():
            raise SourceError(f"{path}: cannot be written: check the folder")

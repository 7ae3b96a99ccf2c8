"""Routes with their tension for other programs: Slicer curves, VTK and PLY tubes, tables."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tssgeom.arrays import Points, Vector
from tssgeom.atomic import replacing, write_text
from tssgeom.errors import SettingsError, SourceError
from tssgeom.io.formats.recording import PER_METRE
from tssgeom.io.formats.vtk import UNIT
from tssgeom.stream import FrameResult

if TYPE_CHECKING:
    import trimesh

_SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    "markups-schema-v1.0.3.json#"
)
_MM = PER_METRE["mm"]
_MOST_POINTS = 200  # control points of a curve, each with a handle in Slicer; chosen
_AT_NODES = {
    "tension_N": ("tension", ["N", "UCUM", "newton"]),
    "kappa_per_m": ("curvature (tssgeom)", ["/m", "UCUM", "per meter"]),
    "kappa_se_per_m": ("curvature standard error", ["/m", "UCUM", "per meter"]),
    "angle_rad": ("accumulated curve angle", ["rad", "UCUM", "radian"]),
}
"""Slicer's name and unit of each number at the nodes; its own "curvature mean" and "length" stay apart."""
_OF_ROUTE = {
    "total_angle_rad": ("total curve angle", ["rad", "UCUM", "radian"], 1.0),
    "tension_in_N": ("tension in", ["N", "UCUM", "newton"], 1.0),
    "tension_out_N": ("tension out", ["N", "UCUM", "newton"], 1.0),
    "elongation_m": ("elongation", ["mm", "UCUM", "millimeter"], _MM),
}


VALUES = {
    "tension_N": "tension of the tendon",
    "kappa_per_m": "curvature of the route",
    "kappa_se_per_m": "standard error of the curvature",
    "angle_rad": "curve angle from the proximal end",
    "tension_se_N": "standard error of the tension that comes from the geometry",
    "angle_se_rad": "standard error of the curve angle",
}
"""Numbers at each node of an exported route, by name with the unit."""


@dataclass(frozen=True, slots=True)
class TensionLine:
    """A route with the tension along it: its nodes, proximal to distal, and the numbers at each."""

    name: str
    unit: str
    """Unit of length to write in, where the format leaves a choice: "m" or "mm"."""
    s: Vector
    """Arc length at the nodes [m]."""
    position: Points
    """Positions of the nodes [m]."""
    values: Mapping[str, Vector]
    """Further numbers at the nodes, by name with the unit."""
    totals: Mapping[str, float]
    """Numbers of the whole route, by name with the unit."""


def tension_line(
    name: str, unit: str, result: FrameResult, tension: Vector, tension_se: Vector
) -> TensionLine:
    """Gather the numbers of a frame's route and tendon that are exported.

    Parameters
    ----------
    name
        Name of the shape.
    unit
        Unit of length of its source; a unit that is neither m nor mm becomes mm.
    result
        The frame.
    tension
        Tension at the nodes of its route [N].
    tension_se
        Its standard error [N].
    """
    profile, transmission = result.profile, result.transmission
    values = (tension, profile.kappa, profile.kappa_se, profile.phi, tension_se, profile.phi_se)
    return TensionLine(
        name,
        "m" if unit == "m" else "mm",
        result.route.s,
        result.route.position,
        dict(zip(VALUES, values, strict=True)),
        {
            "length_m": profile.length,
            "total_angle_rad": profile.total_angle,
            "tension_in_N": transmission.tension_in,
            "tension_out_N": transmission.tension_out,
            "elongation_m": transmission.elongation,
        },
    )


def write_table(path: Path, line: TensionLine, tube: trimesh.Trimesh) -> None:
    """Write a row for each node: arc length, position, then the other numbers, each with its unit.

    Raises SourceError where the disk refuses.
    """
    per_metre = PER_METRE[line.unit]
    names = [f"{name}_{line.unit}" for name in ("s", "x", "y", "z")]
    numbers = np.column_stack([per_metre * line.s, per_metre * line.position, *line.values.values()])
    rows = (",".join(f"{number:.9g}" for number in row) for row in numbers.tolist())
    write_text(path, "\n".join([",".join([*names, *line.values]), *rows]) + "\n")


def write_ply(path: Path, line: TensionLine, tube: trimesh.Trimesh) -> None:
    """Write the tube with its colours and numbers; raises SourceError where the disk refuses."""
    with replacing(path) as draft:
        tube.copy().apply_scale(PER_METRE[line.unit]).export(draft)


def write_curve(path: Path, line: TensionLine, tube: trimesh.Trimesh) -> None:
    """Write the route as one open curve, in mm and LPS, by schema 1.0.3.

    Raises SourceError where the disk refuses.
    """
    count = len(line.s)
    kept = np.unique(np.linspace(0, count - 1, min(count, _MOST_POINTS)).round().astype(int))
    positions = (_MM * line.position[kept]).tolist()
    curve = {
        "type": "Curve",
        "name": line.name,
        "coordinateSystem": "LPS",
        "coordinateUnits": "mm",
        "locked": True,
        "fixedNumberOfControlPoints": False,
        "labelFormat": "%N-%d",
        "lastUsedControlPointNumber": len(positions),
        "controlPoints": [_point(number, position) for number, position in enumerate(positions, start=1)],
        "measurements": [*_at_nodes(line.values, kept), *_of_route(line.totals)],
        "display": {"visibility": True, "opacity": 1.0, "pointLabelsVisibility": False, "glyphScale": 1.0},
    }
    text = json.dumps({"@schema": _SCHEMA, "markups": [curve]}, indent=1, allow_nan=False)
    write_text(path, text + "\n")


def _point(number: int, position: Sequence[float]) -> dict[str, Any]:
    return {
        "id": str(number),
        "label": "",
        "position": position,
        "selected": True,
        "locked": True,
        "visibility": True,
        "positionStatus": "defined",
    }


def _at_nodes(values: Mapping[str, np.ndarray], kept: np.ndarray) -> list[dict[str, Any]]:
    return [
        {"name": name, "enabled": True, "units": unit, "controlPointValues": values[key][kept].tolist()}
        for key, (name, unit) in _AT_NODES.items()
    ]


def _of_route(totals: Mapping[str, float]) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "enabled": True,
            "value": per_unit * totals[key],
            "units": unit,
            "printFormat": "%-#4.4g%s",
        }
        for key, (name, unit, per_unit) in _OF_ROUTE.items()
    ]


def write_vtp(path: Path, line: TensionLine, tube: trimesh.Trimesh) -> None:
    """Write the tube as polygons and the route as a poly line, with the numbers at the nodes; needs `[vtk]`.

    Tension is the active scalar. A field array states the unit of length, which the reader needs.

    Raises SourceError where the disk refuses, or VTK is not installed.
    """
    if lacking := missing_libraries(("vtp",)):
        raise SourceError(f"{path}: {lacking['vtp']}")
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints, vtkStringArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    positions = PER_METRE[line.unit] * np.concatenate([tube.vertices, line.position])
    points, faces, route = vtkPoints(), vtkCellArray(), vtkCellArray()
    points.SetData(numpy_to_vtk(positions, deep=True))
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


Writer: TypeAlias = "Callable[[Path, TensionLine, trimesh.Trimesh], None]"

WRITERS: dict[str, Writer] = {"mrk.json": write_curve, "vtp": write_vtp, "ply": write_ply, "csv": write_table}
"""The writer of each ending."""


def selected_endings(text: str) -> tuple[str, ...]:
    """Return the endings in a list such as "vtp,csv".

    Raises SettingsError where one of them has no writer.
    """
    endings = tuple(word.strip().lstrip(".") for word in text.split(",") if word.strip())
    for ending in endings:
        if ending not in WRITERS:
            raise SettingsError(f"--export: no writer for {ending!r}: choose from {','.join(WRITERS)}")
    return endings


def missing_libraries(endings: Sequence[str]) -> dict[str, str]:
    """Return the endings whose library is not installed, each with the line that states it."""
    if "vtp" not in endings:
        return {}
    try:
        import vtkmodules.vtkIOXML  # noqa: F401
    except ImportError:
        return {"vtp": "no .vtp file is written, as VTK is not installed: pip install 'tssgeom[vtk]'"}
    return {}


def write_exports(folder: Path, endings: Sequence[str], line: TensionLine, tube: trimesh.Trimesh) -> None:
    """Write a route in each of the formats, as `NAME_tension.ending`, which never replaces its source.

    Parameters
    ----------
    folder, endings
        Folder of the files, and their formats.
    line
        The route.
    tube
        A tube around it, whose vertices carry its numbers [m].

    Raises
    ------
    SourceError
        Where the disk refuses, or VTK is not installed.
    """
    for ending in endings:
        WRITERS[ending](folder / f"{line.name}_tension.{ending}", line, tube)

"""A route as a curve of 3D Slicer, with tension and curvature as measurements at its control points."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from tssgeom.atomic import write_text
from tssgeom.io.results.tension_line import TensionLine

_SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    "markups-schema-v1.0.3.json#"
)
_MOST_POINTS = 200  # Slicer draws a handle for each
_PER_METRE = 1000.0  # Slicer's unit is mm
_ALONG = {
    "tension_N": ("tension", ["N", "UCUM", "newton"]),
    "kappa_per_m": ("curvature (tssgeom)", ["/m", "UCUM", "per meter"]),
    "kappa_se_per_m": ("curvature standard error", ["/m", "UCUM", "per meter"]),
    "angle_rad": ("accumulated curve angle", ["rad", "UCUM", "radian"]),
}
"""Name and unit of each number at the nodes; Slicer has a "curvature mean" and a "length" of its own."""
_OF_ALL = {
    "total_angle_rad": ("total curve angle", ["rad", "UCUM", "radian"], 1.0),
    "tension_in_N": ("tension in", ["N", "UCUM", "newton"], 1.0),
    "tension_out_N": ("tension out", ["N", "UCUM", "newton"], 1.0),
    "elongation_m": ("elongation", ["mm", "UCUM", "millimeter"], _PER_METRE),
}


def write_curve(path: Path, line: TensionLine, tube: trimesh.Trimesh) -> None:
    """Write the route as one open curve, in mm and LPS, by schema 1.0.3.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    count = len(line.s)
    kept = np.unique(np.linspace(0, count - 1, min(count, _MOST_POINTS)).round().astype(int))
    places = (_PER_METRE * line.position[kept]).tolist()
    curve = {
        "type": "Curve",
        "name": line.name,
        "coordinateSystem": "LPS",
        "coordinateUnits": "mm",
        "locked": True,
        "fixedNumberOfControlPoints": False,
        "labelFormat": "%N-%d",
        "lastUsedControlPointNumber": len(places),
        "controlPoints": [_point(number, place) for number, place in enumerate(places, start=1)],
        "measurements": [*_along(line.values, kept), *_of_all(line.totals)],
        "display": {"visibility": True, "opacity": 1.0, "pointLabelsVisibility": False, "glyphScale": 1.0},
    }
    text = json.dumps({"@schema": _SCHEMA, "markups": [curve]}, indent=1, allow_nan=False)
    write_text(path, text + "\n")


def _point(number: int, place: Sequence[float]) -> dict[str, Any]:
    return {
        "id": str(number),
        "label": "",
        "position": place,
        "selected": True,
        "locked": True,
        "visibility": True,
        "positionStatus": "defined",
    }


def _along(values: Mapping[str, np.ndarray], kept: np.ndarray) -> list[dict[str, Any]]:
    return [
        {"name": name, "enabled": True, "units": unit, "controlPointValues": values[key][kept].tolist()}
        for key, (name, unit) in _ALONG.items()
    ]


def _of_all(totals: Mapping[str, float]) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "enabled": True,
            "value": per_unit * totals[key],
            "units": unit,
            "printFormat": "%-#4.4g%s",
        }
        for key, (name, unit, per_unit) in _OF_ALL.items()
    ]

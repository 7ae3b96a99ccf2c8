"""3D Slicer markups, `.mrk.json`: control points of curves and of point lists, each markup a shape."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from tssgeom.arrays import Points, read_only
from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.formats.names import chosen, split, stem
from tssgeom.io.formats.recording import Recording
from tssgeom.io.formats.tables import bytes_of
from tssgeom.io.formats.units import PER_METRE, agreed_unit
from tssgeom.stream import Frame

TO_LPS = {"LPS": (1.0, 1.0, 1.0), "RAS": (-1.0, -1.0, 1.0)}
"""What turns coordinates of each system into LPS, in which Slicer writes meshes and markups."""

_PER_METRE = PER_METRE | {"um": 1e6}  # the third unit that the schema knows
_ROUTES = ("Curve", "Fiducial")
_MAJOR = re.compile(r"markups-(?:schema-)?v(\d+)\.")


class _Point(msgspec.Struct, frozen=True, rename="camel"):
    position: tuple[float, float, float] | str | None = None
    """Slicer writes an empty text where a point has no place."""
    position_status: str = "defined"


class _Markup(msgspec.Struct, frozen=True, rename="camel"):
    type: str
    name: str = ""
    coordinate_system: str = "LPS"
    coordinate_units: str | list[str] = "mm"
    control_points: list[_Point] = []


class _File(msgspec.Struct, frozen=True):
    markups: list[_Markup]
    schema: str = msgspec.field(name="@schema", default="")


_decoder = msgspec.json.Decoder(_File)


def markup_names(file: Path) -> list[str]:
    """Return a name for each route in a file: its own where it has one and no other has it, else its number.

    Raises
    ------
    ShapeError, SourceError
        Where the file holds no route or cannot be read.
    """
    return _named(_routes(file))


def open_markups(path: Path, unit: str | None) -> Recording:
    """Open one markup of a file.

    Raises
    ------
    ShapeError
        Where there is no curve and no point list, where there are several and none is named, or where the
        coordinate system or unit is unknown.
    SourceError
        Where the file cannot be read.
    """
    file, _ = split(path)
    routes = _routes(file)
    markup = routes[chosen(path, _named(routes))]
    stated = markup.coordinate_units
    found = stated if isinstance(stated, str) else next(iter(stated), "")
    if found not in _PER_METRE:
        raise ShapeError(f"{file}: coordinateUnits is {found!r}: write mm, m or um")
    if markup.coordinate_system not in TO_LPS:
        raise ShapeError(f"{file}: coordinateSystem is {markup.coordinate_system!r}: write LPS or RAS")
    if found in PER_METRE:
        agreed_unit(file, found, unit, "")
    points = read_only(_positions(markup) / _PER_METRE[found])
    return Recording(stem(path), path, found, "slicer", False, 1, (Frame(points),))


def _routes(file: Path) -> list[_Markup]:
    """Return the curves of a file, or its point lists where it has no curve."""
    held = _decoded(file).markups
    for kind in _ROUTES:
        if found := [markup for markup in held if markup.type == kind]:
            return found
    kinds = ", ".join(sorted({markup.type for markup in held})) or "no markup"
    raise ShapeError(f"{file}: it holds {kinds}, no route: save an open curve or a point list")


def _decoded(file: Path) -> _File:
    raw = bytes_of(file)
    try:
        held = _decoder.decode(raw)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise SourceError(f"{file}: no Slicer markup ({error}): save it from Slicer as .mrk.json") from error
    major = _MAJOR.search(held.schema)
    if major and major[1] != "1":
        raise ShapeError(f"{file}: markups schema {major[1]} is not known: save it with schema 1")
    return held


def _named(routes: Sequence[_Markup]) -> list[str]:
    names = [route.name for route in routes]
    return [
        name if name and names.count(name) == 1 else str(number) for number, name in enumerate(names, start=1)
    ]


def _positions(markup: _Markup) -> Points:
    """Return the control points in LPS; those that are not defined are NaN."""
    unseen = (np.nan, np.nan, np.nan)
    rows = [
        point.position if isinstance(point.position, tuple) and point.position_status == "defined" else unseen
        for point in markup.control_points
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 3) * TO_LPS[markup.coordinate_system]

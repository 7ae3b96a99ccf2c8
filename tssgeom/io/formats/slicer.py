"""Shapes of 3D Slicer: control points of curves and point lists, `.mrk.json` or the older `.fcsv`."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np

from tssgeom.arrays import Points, read_only
from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.formats.paths import (
    bytes_of,
    kept_while_unchanged,
    require_lines,
    require_room,
    selected,
    split,
    stem,
)
from tssgeom.io.formats.recording import PER_METRE, Recording, agreed_unit
from tssgeom.stream import Frame

TO_LPS = {"LPS": (1.0, 1.0, 1.0), "RAS": (-1.0, -1.0, 1.0)}
"""What turns coordinates of each system into LPS, in which Slicer writes meshes and markups."""

_ROUTES = ("Curve", "Fiducial")
_SYSTEMS = {"0": "RAS", "1": "LPS", "RAS": "RAS", "LPS": "LPS"}
_FIRST, _LAST = 1, 4  # columns of the coordinates in an .fcsv file, the same in every version
_STATUS, _DEFINED = 14, "2"  # since Slicer 5: a column after those that the header names
_BYTES_A_VALUE, _LARGER = 100, 8
"""Memory of a value [B], and how much larger than a file its objects may be. Measured: an empty point of 3 B
takes 72 B; files of Slicer have 4 values in 400 B."""
_MAJOR = re.compile(r"markups-(?:schema-)?v(\d+)\.")


class _Point(msgspec.Struct, frozen=True, rename="camel"):
    position: tuple[float, float, float] | str | None = None
    """Slicer writes an empty text for a point without a position."""
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

    Raises ShapeError or SourceError where the file holds no route or cannot be read.
    """
    return _routes(file)[1]


def open_markups(path: Path, unit: str | None) -> Recording:
    """Open one markup of a file.

    Raises ShapeError where there is no curve and no point list, where there are several and none is named, or
    where the coordinate system or unit is unknown; SourceError where the file cannot be read.
    """
    file, _ = split(path)
    routes, names = _routes(file)
    markup = routes[selected(path, names)]
    stated = markup.coordinate_units
    own = stated if isinstance(stated, str) else next(iter(stated), "")
    if own not in PER_METRE:
        raise ShapeError(f"{file}: coordinateUnits is {own!r}: write mm, m or um")
    if markup.coordinate_system not in TO_LPS:
        raise ShapeError(f"{file}: coordinateSystem is {markup.coordinate_system!r}: write LPS or RAS")
    if own in PER_METRE:
        agreed_unit(file, own, unit, "")
    points = read_only(_positions(markup) / PER_METRE[own])
    return Recording(stem(path), path, own, "slicer", False, 1, (Frame(points),))


@kept_while_unchanged
def _routes(file: Path) -> tuple[list[_Markup], list[str]]:
    """Return the curves of a file, or its point lists where it has no curve, and their names."""
    held = _decoded(file).markups
    for kind in _ROUTES:
        if routes := [markup for markup in held if markup.type == kind]:
            return routes, _named(routes)
    kinds = ", ".join(sorted({markup.type for markup in held})) or "no markup"
    raise ShapeError(f"{file}: it holds {kinds}, no route: save an open curve or a point list")


def _decoded(file: Path) -> _File:
    raw = bytes_of(file)
    require_room(file, sum(raw.count(sign) for sign in (b"{", b"[", b",")) * _BYTES_A_VALUE // _LARGER)
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
    counts = Counter(names)
    return [name if name and counts[name] == 1 else str(number) for number, name in enumerate(names, start=1)]


def _positions(markup: _Markup) -> Points:
    """Return the control points in LPS; those that are not defined are NaN."""
    unknown = (np.nan, np.nan, np.nan)
    rows = [
        point.position
        if isinstance(point.position, tuple) and point.position_status == "defined"
        else unknown
        for point in markup.control_points
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 3) * TO_LPS[markup.coordinate_system]


def open_fcsv(path: Path, unit: str | None) -> Recording:
    """Open an older point list, `.fcsv`: a row for each control point, in mm.

    Raises ShapeError where a row holds no numbers, where there is none, or where the coordinate system is
    unknown; SourceError where the file cannot be read.
    """
    agreed = agreed_unit(path, "mm", unit, "")
    # A row of Slicer 5 may hold a carriage return in its middle, so that lines end at "\n" alone.
    lines = require_lines(path, bytes_of(path)).decode("utf-8-sig", errors="replace").split("\n")
    head = _header(lines)
    system = head.get("CoordinateSystem", "RAS")
    if system not in _SYSTEMS:
        raise ShapeError(f"{path}: CoordinateSystem is {system!r}: save the list in LPS or RAS")
    points = _rows(path, lines) * TO_LPS[_SYSTEMS[system]] / PER_METRE[agreed]
    return Recording(stem(path), path, agreed, "fcsv", False, 1, (Frame(read_only(points)),))


def _header(lines: list[str]) -> Mapping[str, str]:
    pairs = (line[1:].split("=", 1) for line in lines if line.startswith("#") and "=" in line)
    return {name.strip(): value.strip() for name, value in pairs}


def _rows(path: Path, lines: list[str]) -> Points:
    rows = [
        _row(path, number, line)
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.startswith("#")
    ]
    if not rows:
        raise ShapeError(f"{path}: no control point: save a list with points")
    return np.array(rows, dtype=np.float64)


def _row(path: Path, number: int, line: str) -> list[float]:
    cells = _cells(line)
    if len(cells) > _STATUS and cells[_STATUS].strip() != _DEFINED:
        return [np.nan] * 3
    try:
        x, y, z = map(float, cells[_FIRST:_LAST])
    except ValueError as error:
        raise ShapeError(
            f"{path}: line {number}: no point in {line[:40]!r}: write id,x,y,z and the rest of the columns"
        ) from error
    return [x, y, z]


def _cells(line: str) -> list[str]:
    try:
        return next(csv.reader([line.replace("\r", " ")]))
    except csv.Error:
        return line.split(",")

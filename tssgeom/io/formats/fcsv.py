"""3D Slicer's older point lists, `.fcsv`: a row for each control point, in mm."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tssgeom.arrays import Points, read_only
from tssgeom.errors import ShapeError
from tssgeom.io.formats.names import stem
from tssgeom.io.formats.recording import Recording
from tssgeom.io.formats.slicer import TO_LPS
from tssgeom.io.formats.tables import bytes_of
from tssgeom.io.formats.units import PER_METRE, agreed_unit
from tssgeom.stream import Frame

_SYSTEMS = {"0": "RAS", "1": "LPS", "RAS": "RAS", "LPS": "LPS"}
_FIRST, _LAST = 1, 4  # columns of the coordinates, the same in every version
_STATUS, _DEFINED = 14, "2"  # since Slicer 5, after the columns that the header names


def open_fcsv(path: Path, unit: str | None) -> Recording:
    """Open a point list.

    Raises
    ------
    ShapeError
        Where a row holds no numbers, where there is none, or where the coordinate system is unknown.
    SourceError
        Where the file cannot be read.
    """
    agreed = agreed_unit(path, "mm", unit, "")
    # A row of Slicer 5 may hold a carriage return in its middle, so that lines end at "\n" alone.
    lines = bytes_of(path).decode("utf-8-sig", errors="replace").split("\n")
    head = _head(lines)
    system = head.get("CoordinateSystem", "RAS")
    if system not in _SYSTEMS:
        raise ShapeError(f"{path}: CoordinateSystem is {system!r}: save the list in LPS or RAS")
    points = _positions(path, lines) * TO_LPS[_SYSTEMS[system]] / PER_METRE[agreed]
    return Recording(stem(path), path, agreed, "fcsv", False, 1, (Frame(read_only(points)),))


def _head(lines: list[str]) -> Mapping[str, str]:
    pairs = (line[1:].split("=", 1) for line in lines if line.startswith("#") and "=" in line)
    return {name.strip(): value.strip() for name, value in pairs}


def _positions(path: Path, lines: list[str]) -> Points:
    rows = [
        _position(path, number, line)
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.startswith("#")
    ]
    if not rows:
        raise ShapeError(f"{path}: no control point: save a list with points")
    return np.array(rows, dtype=np.float64)


def _position(path: Path, number: int, line: str) -> list[float]:
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

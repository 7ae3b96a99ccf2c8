"""VTK poly data, `.vtp`: each poly line a shape."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from tssgeom.arrays import Points, read_only
from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.formats.names import chosen, split, stem
from tssgeom.io.formats.recording import Recording
from tssgeom.io.formats.tables import bytes_of
from tssgeom.io.formats.units import PER_METRE, agreed_unit
from tssgeom.io.formats.vtk_xml import Element, XmlFile, parsed
from tssgeom.stream import Frame

UNIT = "unit"
"""Field array that states the unit of length; VTK itself knows none."""


def line_names(file: Path) -> list[str]:
    """Return the numbers of the poly lines in a file, from "1".

    Raises
    ------
    ShapeError, SourceError
        Where the file holds no poly line or cannot be read.
    """
    return [str(number) for number, _ in enumerate(_read(file)[0], start=1)]


def open_vtp(path: Path, unit: str | None) -> Recording:
    """Open one poly line of a file.

    Raises
    ------
    ShapeError
        Where there is no poly line, where there are several and none is named, or where no unit is stated.
    SourceError
        Where the file cannot be read.
    """
    lines, stated = _read(split(path)[0])
    agreed = agreed_unit(path, stated, unit, f"add a field array {UNIT!r} that says mm or m")
    names = [str(number) for number, _ in enumerate(lines, start=1)]
    points = lines[chosen(path, names)] / PER_METRE[agreed]
    points[np.isnan(points).any(axis=1)] = np.nan
    return Recording(stem(path), path, agreed, "vtk", False, 1, (Frame(read_only(points)),))


def _read(file: Path) -> tuple[list[Points], str | None]:
    """Return the points of each poly line in the file's unit, and that unit if it is stated."""
    try:
        held = parsed(bytes_of(file))
        data = held.root.find("PolyData")
        if data is None:
            raise ValueError(f"it holds {held.root.get('type')}")
        lines = [line for piece in data.findall("Piece") for line in _lines(held, piece)]
        stated = _stated_unit(held, data)
    except (ValueError, OverflowError) as error:
        told = " ".join(str(error).split()) or type(error).__name__
        raise SourceError(f"{file}: cannot be read as VTK poly data ({told}): write it anew") from error
    if not lines:
        raise ShapeError(f"{file}: no poly line in it: write the route as one line through its points")
    return lines, stated


def _lines(held: XmlFile, piece: Element) -> list[Points]:
    cells = {array.get("Name"): array for array in piece.findall("Lines/DataArray")}
    places = piece.find("Points/DataArray")
    if places is None or not {"connectivity", "offsets"} <= {*cells} or piece.get("NumberOfLines") == "0":
        return []
    points = held.numbers(places).astype(np.float64).reshape(-1, 3)
    through = held.numbers(cells["connectivity"]).astype(np.int64)
    ends = held.numbers(cells["offsets"]).astype(np.int64).tolist()
    if through.size and not 0 <= through.min() <= through.max() < len(points):
        raise ValueError(f"a line goes through point {through.max()} of {len(points)}")
    if ends and not 0 <= min(ends) <= max(ends) <= len(through):
        raise ValueError(f"a line ends at place {max(ends)} of {len(through)}")
    starts = [0, *ends] if ends[:1] != [0] else ends  # since VTK 9 a leading 0 may stand there
    return [points[through[a:b]] for a, b in pairwise(starts) if b > a]


def _stated_unit(held: XmlFile, data: Element) -> str | None:
    """Return the text of the field array; VTK writes the numbers of its characters, and 0 behind it."""
    for array in data.findall("FieldData/Array"):
        if array.get("Name") == UNIT and array.get("type") == "String":
            letters = Element("DataArray", {**array.attrib, "type": "UInt8"})
            letters.text = array.text
            return bytes(held.numbers(letters).tolist()).partition(b"\0")[0].decode("ascii", errors="replace")
    return None

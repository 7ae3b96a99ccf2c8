"""VTK poly data, `.vtp`: each poly line a shape.

Arrays of the XML file are text, base64 or appended, compressed or not. VTK's own reader ends the whole
process on some broken files; this one raises.
"""

from __future__ import annotations

import lzma
import re
import zlib
from base64 import b64decode
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Points, read_only
from tssgeom.errors import ShapeError, SourceError, first_line
from tssgeom.io.formats.paths import bytes_of, kept_while_unchanged, require_room, selected, split, stem
from tssgeom.io.formats.recording import PER_METRE, Recording, agreed_unit
from tssgeom.rig import Source
from tssgeom.stream import Frame

UNIT = "unit"
"""Field array that states the unit of length; VTK itself has none."""

SPHERES = "MaximumInscribedSphereRadius"
"""Point array of a centre line: VMTK computes lines of vessels through the centres of maximal spheres."""

Element = ElementTree.Element

_TYPES = {"Float": "f", "Int": "i", "UInt": "u"}
_APPENDED = re.compile(rb"<AppendedData\b[^>]*>\s*_")
_BLANK = re.compile(r"\s")
_TEXT_BLOCK = 1 << 20
"""Characters of an array that are read at a time; chosen."""
_SEGMENT = 2  # points of a line that is joined with others, and lines that meet where a chain goes on
_AFTER = b"</AppendedData>"
_DECOMPRESSORS: dict[str, Callable[[], Any]] = {
    "vtkZLibDataCompressor": zlib.decompressobj,
    "vtkLZMADataCompressor": lzma.LZMADecompressor,
}


def line_names(file: Path) -> list[str]:
    """Return the numbers of the poly lines in a file, from "1".

    Raises ShapeError or SourceError where the file holds no poly line or cannot be read.
    """
    return _numbers(len(_read(file)[0]))


@lru_cache(maxsize=1)
def _numbers(count: int) -> list[str]:
    return [str(number) for number in range(1, count + 1)]


def open_vtp(path: Path, unit: str | None) -> Recording:
    """Open one poly line of a file.

    Raises ShapeError where there is no poly line, where there are several and none is named, or where no unit
    is stated; SourceError where the file cannot be read.
    """
    lines, stated, source = _read(split(path)[0])
    agreed = agreed_unit(path, stated, unit, f"add a field array {UNIT!r} that states mm or m")
    points = lines[selected(path, _numbers(len(lines)))] / PER_METRE[agreed]
    points[np.isnan(points).any(axis=1)] = np.nan
    return Recording(stem(path), path, agreed, "vtk", False, 1, (Frame(read_only(points), source=source),))


@kept_while_unchanged
def _read(file: Path) -> tuple[list[Points], str | None, Source | None]:
    """Return the points of each poly line in the file's unit, that unit if it is stated, and their source."""
    try:
        held = _parsed(file, bytes_of(file))
        data = held.root.find("PolyData")
        if data is None:
            raise ValueError(f"it holds {held.root.get('type')}")
        lines = joined_segments([line for piece in data.findall("Piece") for line in _lines(held, piece)])
        stated = _stated_unit(held, data)
        spheres = any(a.get("Name") == SPHERES for a in data.iterfind("Piece/PointData/DataArray"))
    except (ValueError, OverflowError) as error:
        raise SourceError(
            f"{file}: cannot be read as VTK poly data ({first_line(error)}): write it anew"
        ) from error
    if not lines:
        raise ShapeError(f"{file}: no poly line in it: write the route as one line through its points")
    return lines, stated, "centreline" if spheres else None


def joined_segments(lines: list[Points]) -> list[Points]:
    """Return lines with those of two points joined where they connect end to end, after the longer ones.

    A chain ends where more than two meet, and runs as its first line in the file does.
    """
    segments = [line for line in lines if len(line) == _SEGMENT]
    if len(segments) < _SEGMENT:
        return lines
    _, numbers = np.unique(np.concatenate(segments), axis=0, return_inverse=True)
    ends = numbers.reshape(-1, _SEGMENT)
    at = dict[int, list[int]]()
    for k, pair in enumerate(ends.tolist()):
        for end in pair:
            at.setdefault(end, []).append(k)
    left = dict.fromkeys(range(len(ends)))
    chains = list[Points]()
    while left:
        first = next(iter(left))
        del left[first]
        onward, back = (_followed(ends, at, left, first, side) for side in (1, 0))
        points = [*(segments[k][side] for k, side in reversed(back)), *segments[first]]
        chains.append(np.array([*points, *(segments[k][side] for k, side in onward)]))
    return [*(line for line in lines if len(line) != _SEGMENT), *chains]


def _followed(
    ends: NDArray[np.intp], at: dict[int, list[int]], left: dict[int, None], segment: int, side: int
) -> list[tuple[int, int]]:
    """Take the segments that follow one side of a first one from those left, each with its far side."""
    way = list[tuple[int, int]]()
    while True:
        end = int(ends[segment, side])
        onward = [k for k in at[end] if k in left]
        if len(at[end]) != _SEGMENT or not onward:
            return way
        segment = onward[0]
        side = 1 - int(np.flatnonzero(ends[segment] == end)[0])
        del left[segment]
        way.append((segment, side))


def _lines(held: _XmlFile, piece: Element) -> list[Points]:
    cells = {array.get("Name"): array for array in piece.findall("Lines/DataArray")}
    positions = piece.find("Points/DataArray")
    if positions is None or not {"connectivity", "offsets"} <= {*cells} or piece.get("NumberOfLines") == "0":
        return []
    points = held.numbers(positions).astype(np.float64).reshape(-1, 3)
    through = held.numbers(cells["connectivity"]).astype(np.int64)
    ends = held.numbers(cells["offsets"]).astype(np.int64).tolist()
    if through.size and not 0 <= through.min() <= through.max() < len(points):
        raise ValueError(f"a line goes through point {through.max()} of {len(points)}")
    if ends and not 0 <= min(ends) <= max(ends) <= len(through):
        raise ValueError(f"a line ends at entry {max(ends)} of {len(through)}")
    starts = [0, *ends] if ends[:1] != [0] else ends  # VTK 9 may write a 0 in front
    return [points[through[a:b]] for a, b in pairwise(starts) if b > a]


def _stated_unit(held: _XmlFile, data: Element) -> str | None:
    """Return the text of the field array; VTK writes the codes of its characters and a final 0."""
    for array in data.findall("FieldData/Array"):
        if array.get("Name") == UNIT and array.get("type") == "String":
            letters = Element("DataArray", {**array.attrib, "type": "UInt8"})
            letters.text = array.text
            return bytes(held.numbers(letters).tolist()).partition(b"\0")[0].decode("ascii", errors="replace")
    return None


@dataclass(frozen=True, slots=True)
class _XmlFile:
    """A parsed file, and the encoding of its arrays."""

    root: Element
    order: str
    """"<" or ">"."""
    heading: np.dtype[Any]
    """Type of the counts before the bytes of an array."""
    compressor: str | None
    appended: bytes
    raw: bool
    """True where the appended bytes are raw, False where they are base64."""
    path: Path
    unpacked: list[int]
    """Size of each block so far [B]."""

    def numbers(self, array: Element) -> NDArray[Any]:
        """Return the numbers of a DataArray, flat.

        Raises ValueError where it is broken, or written in an unknown way.
        """
        kind = _kind(array, self.order)
        form = array.get("format")
        if form == "ascii":
            return _from_text(array.text or "", kind)
        if form == "appended":
            held = self.appended[int(array.get("offset", "")) :]
            return self._decoded(held, kind, raw=self.raw)
        if form == "binary":
            return self._decoded("".join((array.text or "").split()).encode("ascii"), kind, raw=False)
        raise ValueError(f"an array has the format {form!r}")

    def _decoded(self, held: bytes, kind: np.dtype[Any], *, raw: bool) -> NDArray[Any]:
        take = _from_raw if raw else _from_base64
        size = self.heading.itemsize
        if self.compressor is None:
            count = int(np.frombuffer(take(held, 0, size), self.heading)[0])
            return np.frombuffer(take(held, 0, size + count)[size:], kind)
        blocks = int(np.frombuffer(take(held, 0, size), self.heading)[0])
        counts = np.frombuffer(take(held, 0, (3 + blocks) * size), self.heading)
        return np.frombuffer(b"".join(self._blocks(held, counts, raw=raw)), kind)

    def _blocks(self, held: bytes, counts: NDArray[Any], *, raw: bool) -> Iterator[bytes]:
        """Yield each block decompressed; its size is known, so that none can grow beyond it."""
        blocks, full, last = map(int, counts[:3])
        take = _from_raw if raw else _from_base64
        begin = len(counts) * self.heading.itemsize
        begin = begin if raw else 4 * -(-begin // 3)  # base64 begins anew after the counts
        body = take(held, begin, int(counts[3:].sum()))
        begin = 0
        for block, packed in enumerate(map(int, counts[3:])):
            size = last if last and block == blocks - 1 else full
            if size <= 0:  # a decompressor takes this for no limit
                raise ValueError(f"a block states a size of {size} bytes")
            self.unpacked.append(size)
            require_room(self.path, sum(self.unpacked))
            try:
                whole = _DECOMPRESSORS[self.compressor or ""]().decompress(body[begin : begin + packed], size)
            except (zlib.error, lzma.LZMAError, EOFError) as error:
                raise ValueError(f"a block cannot be decompressed, {error}") from error
            if len(whole) != size:
                raise ValueError(f"a block holds {len(whole)} bytes of {size}")
            yield whole
            begin += packed


def _parsed(path: Path, content: bytes) -> _XmlFile:
    """Parse a file; raises ValueError where it is no XML of VTK, or written in an unknown way."""
    match = _APPENDED.search(content)
    end = content.rfind(_AFTER)
    text, appended = content, b""
    if match and end >= match.end():
        text, appended = content[: match.end() - 1] + content[end:], content[match.end() : end]
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"no XML, {error}") from error
    compressor = root.get("compressor")
    if compressor is not None and compressor not in _DECOMPRESSORS:
        raise ValueError(f"the compressor {compressor} is not known, write it with vtkZLibDataCompressor")
    order = ">" if root.get("byte_order") == "BigEndian" else "<"
    heading = np.dtype(f"{order}u{8 if root.get('header_type') == 'UInt64' else 4}")
    data = root.find("AppendedData")
    raw = data is not None and data.get("encoding") == "raw"
    return _XmlFile(root, order, heading, compressor, appended, raw, path, [])


def _kind(array: Element, order: str) -> np.dtype[Any]:
    """Return the type of an array's numbers, such as "Float32"."""
    named = re.fullmatch(r"(Float|Int|UInt)(8|16|32|64)", array.get("type", ""))
    if named is None or named[0] == "Float8":
        raise ValueError(f"an array has the type {array.get('type')!r}")
    return np.dtype(f"{order}{_TYPES[named[1]]}{int(named[2]) // 8}")


def _from_text(text: str, kind: np.dtype[Any]) -> NDArray[Any]:
    """Read numbers between blanks, some of them at a time, since a word takes more memory than a number."""
    ends = [0]
    while ends[-1] < len(text):
        blank = _BLANK.search(text, ends[-1] + _TEXT_BLOCK)
        ends.append(blank.start() if blank else len(text))
    with np.errstate(over="ignore"):  # a point beyond single precision is infinite, and refused as one
        blocks = [np.array(text[begin:end].split(), dtype=kind) for begin, end in pairwise(ends)]
    return np.concatenate(blocks) if blocks else np.array([], dtype=kind)


def _from_raw(held: bytes, begin: int, count: int) -> bytes:
    if not 0 <= begin <= begin + count <= len(held):
        raise ValueError(f"an array ends beyond the file, at byte {begin + count} of {len(held)}")
    return held[begin : begin + count]


def _from_base64(held: bytes, begin: int, count: int) -> bytes:
    """Return the first `count` bytes that the text from `begin` on stands for."""
    return _from_raw(b64decode(_from_raw(held, begin, 4 * -(-count // 3)), validate=True), 0, count)

"""Arrays in VTK's XML files: text, base64 or appended, compressed or not.

VTK's own reader ends the whole process on some broken files; this one raises.
"""

from __future__ import annotations

import lzma
import re
import zlib
from base64 import b64decode
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

Element = ElementTree.Element

_TYPES = {"Float": "f", "Int": "i", "UInt": "u"}
_APPENDED = re.compile(rb"<AppendedData\b[^>]*>\s*_")
_AFTER = b"</AppendedData>"
_DECOMPRESSORS: dict[str, Callable[[], Any]] = {
    "vtkZLibDataCompressor": zlib.decompressobj,
    "vtkLZMADataCompressor": lzma.LZMADecompressor,
}


@dataclass(frozen=True, slots=True)
class XmlFile:
    """A parsed file, and what it says of the bytes of its arrays."""

    root: Element
    order: str
    """"<" or ">"."""
    heading: np.dtype[Any]
    """Type of the counts before the bytes of an array."""
    compressor: str | None
    appended: bytes
    raw: bool
    """True where the appended bytes are themselves, False where they are base64."""

    def numbers(self, array: Element) -> NDArray[Any]:
        """Return the numbers of a DataArray, flat.

        Raises
        ------
        ValueError
            Where it is broken, or written in a way that is not known.
        """
        kind = _kind(array, self.order)
        form = array.get("format")
        if form == "ascii":
            return np.array((array.text or "").split(), dtype=kind)
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
        begin = begin if raw else 4 * -(-begin // 3)  # base64 begins anew behind the counts
        body = take(held, begin, int(counts[3:].sum()))
        at = 0
        for block, packed in enumerate(map(int, counts[3:])):
            size = last if last and block == blocks - 1 else full
            if size <= 0:  # to a decompressor that is no limit
                raise ValueError(f"a block says that it holds {size} bytes")
            try:
                whole = _DECOMPRESSORS[self.compressor or ""]().decompress(body[at : at + packed], size)
            except (zlib.error, lzma.LZMAError, EOFError) as error:
                raise ValueError(f"a block cannot be decompressed, {error}") from error
            if len(whole) != size:
                raise ValueError(f"a block holds {len(whole)} bytes of {size}")
            yield whole
            at += packed


def parsed(content: bytes) -> XmlFile:
    """Parse a file.

    Raises
    ------
    ValueError
        Where it is no XML of VTK, or written in a way that is not known.
    """
    found = _APPENDED.search(content)
    end = content.rfind(_AFTER)
    text, appended = content, b""
    if found and end >= found.end():
        text, appended = content[: found.end() - 1] + content[end:], content[found.end() : end]
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"no XML, {error}") from error
    compressor = root.get("compressor")
    if compressor is not None and compressor not in _DECOMPRESSORS:
        raise ValueError(f"the compressor {compressor} is not known, write it with vtkZLibDataCompressor")
    order = ">" if root.get("byte_order") == "BigEndian" else "<"
    heading = np.dtype(f"{order}u{8 if root.get('header_type') == 'UInt64' else 4}")
    place = root.find("AppendedData")
    raw = place is not None and place.get("encoding") == "raw"
    return XmlFile(root, order, heading, compressor, appended, raw)


def _kind(array: Element, order: str) -> np.dtype[Any]:
    """Return the type of an array's numbers, such as "Float32"."""
    named = re.fullmatch(r"(Float|Int|UInt)(8|16|32|64)", array.get("type", ""))
    if named is None or named[0] == "Float8":
        raise ValueError(f"an array has the type {array.get('type')!r}")
    return np.dtype(f"{order}{_TYPES[named[1]]}{int(named[2]) // 8}")


def _from_raw(held: bytes, begin: int, count: int) -> bytes:
    if not 0 <= begin <= begin + count <= len(held):
        raise ValueError(f"an array ends beyond the file, at byte {begin + count} of {len(held)}")
    return held[begin : begin + count]


def _from_base64(held: bytes, begin: int, count: int) -> bytes:
    """Return the first `count` bytes that the text from `begin` on stands for."""
    return _from_raw(b64decode(_from_raw(held, begin, 4 * -(-count // 3)), validate=True), 0, count)

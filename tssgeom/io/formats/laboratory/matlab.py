"""Variables of MATLAB files up to version 7, checked before the library that reads them."""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

from tssgeom.errors import SourceError
from tssgeom.io.formats.paths import bytes_of, reading, require_room, room

_HEAD, _TAG = 128, 8
"""Bytes before the first element, and of the tag of each. Source: MATLAB's format 5, as all below."""
_MATRIX, _PACKED = 14, 15
_NUMBERS = frozenset((1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18))
"""Kinds of elements that hold other elements, and of those that hold numbers or text."""
_HOLDERS = frozenset((1, 2, 3, 16, 17, 18))
"""Classes of arrays of arrays: cells, structs and objects."""
_USER_BLOCK, _HDF5 = 512, b"\x89HDF\r\n\x1a\n"
"""Bytes before the content of a file of version 7.3, and how that begins. Source: format of HDF5."""
_DEEPEST = 32  # arrays inside each other; chosen: deeper than what a laboratory saves
_BLOCK = 1 << 20  # bytes that are unpacked at a time; chosen


class _Element(NamedTuple):
    kind: int
    content: memoryview


def matlab_variables(path: Path) -> dict[str, Any]:
    """Read the variables of a file; structs become dicts.

    Raises SourceError where the file is damaged, too large, or of version 7.3.
    """
    from scipy.io import loadmat

    _require_no_hdf5(path)
    packed = bytes_of(path)
    if 0 not in packed[:4]:  # version 4 has a zero there, and no elements
        _require_sound(path, packed)
    with warnings.catch_warnings():  # those of the library are no lines for users
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", "Duplicate variable name")  # which of them counts is not known
        content = loadmat(BytesIO(packed), simplify_cells=True)
    return {name: value for name, value in content.items() if not name.startswith("__")}


def _require_no_hdf5(path: Path) -> None:
    """Refuse a file of version 7.3, or of Octave's -hdf5, before its size is: with what to type in MATLAB."""
    with reading(path), path.open("rb") as file:
        head = file.read(_USER_BLOCK + len(_HDF5))
    if head.startswith((b"MATLAB 7.3", _HDF5)) or head.endswith(_HDF5):
        raise SourceError(
            f"{path}: MATLAB 7.3 (HDF5) is not read: in MATLAB, load it and "
            f"save('{path.stem}_v7.mat', '-v7'), or writematrix(points, '{path.stem}.csv')"
        )


def _require_sound(path: Path, content: bytes) -> None:
    """Refuse a file whose arrays are not as they declare; the library would read outside its memory."""
    order, size = "<" if content[126:128] == b"IM" else ">", 0
    for element in _elements(memoryview(content)[_HEAD:], order, multiple=1):
        if element.kind == _PACKED:
            unpacked = _unpacked(element.content, room() - size)
            size += len(unpacked)
            require_room(path, size)
            (element,) = _elements(memoryview(unpacked), order, multiple=1)
        _require_array(element, order, _DEEPEST)


def _require_array(array: _Element, order: str, depth: int) -> None:
    """Raise ValueError where an element is no array, or those in it do not fit its class."""
    if array.kind != _MATRIX or not depth:
        raise ValueError(f"an element of the kind {array.kind} for an array")
    parts = list(_elements(array.content, order))
    if not parts:
        return
    if parts[0].kind != 6 or len(parts[0].content) != 8:
        raise ValueError("an array without a class")
    holds = struct.unpack(f"{order}I", parts[0].content[:4])[0] & 0xFF in _HOLDERS
    for part in parts[1:]:
        if part.kind not in _NUMBERS:
            _require_array(part, order, depth - holds if holds else 0)


def _elements(content: memoryview, order: str, multiple: int = 8) -> Iterator[_Element]:
    """Yield elements that begin at multiples of some bytes; raises ValueError where one is cut short."""
    at = 0
    while at < len(content):
        if at + _TAG > len(content):
            raise ValueError("an element is cut short")
        kind, count = struct.unpack_from(f"{order}II", content, at)
        begin, end = at + _TAG, at + _TAG + count
        if kind >> 16:  # a short one has its content in its tag
            kind, begin, end = kind & 0xFFFF, at + 4, at + 4 + (kind >> 16)
        if end > len(content):
            raise ValueError("an element is cut short")
        yield _Element(kind, content[begin:end])
        at = max(at + _TAG, end + -end % multiple)


def _unpacked(content: memoryview, most: int) -> bytes:
    """Unpack an element, up to a little above `most` bytes."""
    unpacker, rest, parts, size = zlib.decompressobj(), bytes(content), list[bytes](), 0
    while rest and size <= most:
        parts.append(unpacker.decompress(rest, _BLOCK))
        size += len(parts[-1])
        rest = unpacker.unconsumed_tail
    return b"".join(parts)

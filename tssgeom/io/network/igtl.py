"""OpenIGTLink messages: shapes out of those in `SHAPES`, results into POLYDATA and STRING.

Lengths are millimetres, as the protocol's users have them.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from tssgeom import core
from tssgeom.arrays import Points
from tssgeom.errors import ShapeError
from tssgeom.io.formats.recording import PER_METRE

_FIELDS = struct.Struct(">H12s20sIIQQ")  # version, kind, device, time in s and in 2⁻³² s, size, checksum
HEADER = _FIELDS.size
"""Bytes of a header."""
LARGEST = 1 << 20
"""Bytes of the largest body that is read, 1 MiB: the limit of the stream."""
LONGEST_TEXT = 0xFFFF
"""Bytes of the longest text that a STRING holds, which states their number in 16 bits."""

_EXTENDED = struct.Struct(">HHII")  # bytes of itself, of the index and the text of metadata, and an id
_COUNT = struct.Struct(">H")  # entries of the index
_ENTRY = struct.Struct(">HHI")  # bytes of a key, encoding and bytes of its value
_ASCII, _UTF_8 = 3, 106
_ENCODINGS = {_ASCII: "ascii", 4: "latin-1", _UTF_8: "utf-8"}  # as IANA numbers them; another counts as UTF-8
_POINT = np.dtype([("about", "S100"), ("position", ">f4", 3), ("more", "S24")])
_LIST = np.dtype([("about", "S100"), ("position", ">f4", 3), ("turn", ">f4", 4), ("more", "S24")])
_TOOL = np.dtype([("name", "S20"), ("about", "S2"), ("position", ">f4", 3), ("turn", ">f4", 4)])
_TOOL_MATRIX = np.dtype([("name", "S20"), ("about", "S2"), ("turn", ">f4", 9), ("position", ">f4", 3)])
LISTS = {"TDATA": _TOOL_MATRIX, "QTDATA": _TOOL}
"""Messages that list sensors by name, and a row of each."""
SHAPES = ("POINT", "POLYDATA", "POSITION", "TRANSFORM", *LISTS)
"""Messages out of which shapes are read."""
_POLYDATA = 40  # bytes with the numbers of points and cells
_COORDINATE = ">f4"
_KINDS = (*SHAPES, "STRING")
_VERSIONS = (1, 2, 3)  # from 2 on, an extended header and metadata


@dataclass(frozen=True, slots=True)
class Header:
    """The first bytes of a message."""

    kind: str
    device: str
    time: float
    """Time of the sender since 1970 [s]; 0 where it states none."""
    size: int
    """Bytes of the body."""
    version: int
    checksum: int


@dataclass(frozen=True, slots=True)
class Message:
    """One message with its content."""

    header: Header
    positions: Points
    """Positions [n, 3] of one sensor or of a whole route [m]."""
    metadata: dict[str, str]
    text: str = ""
    """Of a STRING."""
    sensors: tuple[str, ...] = ()
    """Names of the sensors [n], of a message that lists them."""


def header_of(data: bytes | bytearray) -> Header:
    """Read a header; raises ShapeError where it is none, or announces a body that is too large."""
    if len(data) < HEADER:
        raise ShapeError(f"no OpenIGTLink header in {len(data)} bytes: check what listens on this port")
    version, kind_text, device_text, seconds, fraction, size, checksum = _FIELDS.unpack_from(data)
    kind = kind_text.decode("ascii", "replace").rstrip(" \t\r\n\0")
    device = device_text.decode("utf-8", "replace").rstrip(" \t\r\n\0")
    if version not in _VERSIONS:
        raise ShapeError(
            f"OpenIGTLink header of version {version}: only 1 to 3 are known; "
            "a body of a wrong length gives this error too: check what listens on this port"
        )
    if size > LARGEST:
        raise ShapeError(f"a body of {size} bytes: send {LARGEST} (1 MiB) at most")
    time = seconds + fraction * 2.0**-32
    return Header(kind, device, time, size, version, checksum)


def message_of(header: Header, body: bytes) -> Message | None:
    """Read the body of a message; None where its kind holds no shape.

    Raises ShapeError where checksum, length or content are wrong.
    """
    if header.kind not in _KINDS:
        return None
    if checksum(body) != header.checksum:
        raise ShapeError(f"{header.kind} of {header.device!r}: wrong checksum: the message is damaged")
    try:
        content, metadata = (body, {}) if header.version == 1 else _extended(body)
    except (struct.error, ValueError) as error:
        raise ShapeError(f"{header.kind} of {header.device!r}: broken extended header ({error})") from error
    if header.kind == "STRING":
        return Message(header, np.empty((0, 3)), metadata, _text(content))
    positions, sensors = _positions(header, content), ()
    if header.kind in LISTS:
        names = np.frombuffer(content, LISTS[header.kind])["name"].tolist()
        sensors = tuple(name.partition(b"\0")[0].decode("utf-8", "replace").strip() for name in names)
    return Message(header, positions.astype(np.float64) / PER_METRE["mm"], metadata, sensors=sensors)


def _extended(body: bytes) -> tuple[bytes, dict[str, str]]:
    """Split a body into content and metadata, as an extended header at its beginning says."""
    begin, index, text, _ = _EXTENDED.unpack_from(body)
    end = len(body) - index - text
    if not _EXTENDED.size <= begin <= end:
        raise ValueError(f"{begin}, {index} and {text} bytes do not fit into {len(body)}")
    if not index:
        return body[begin:end], {}
    (count,) = _COUNT.unpack_from(body, end)
    at, metadata = end + _COUNT.size + count * _ENTRY.size, dict[str, str]()
    for i in range(count):
        key_size, encoding, size = _ENTRY.unpack_from(body, end + _COUNT.size + i * _ENTRY.size)
        key, at = body[at : at + key_size], at + key_size
        value, at = body[at : at + size], at + size
        metadata[key.decode("utf-8", "replace")] = value.decode(_ENCODINGS.get(encoding, "utf-8"), "replace")
    if at > len(body):
        raise ValueError(f"metadata of {at - end} bytes in {len(body) - end}")
    return body[begin:end], metadata


def _positions(header: Header, content: bytes) -> np.ndarray:
    if header.kind in LISTS:
        return _rows(header, content, LISTS[header.kind])
    if header.kind == "POINT":
        return _rows(header, content, _POINT)
    if header.kind == "POLYDATA":
        return _polydata(header, content)
    if header.kind == "TRANSFORM":
        _require(header, content, len(content) == 48)
        return np.frombuffer(content, _COORDINATE)[None, 9:12]
    if len(content) in (12, 24, 28):  # the protocol's own: one position, with a quaternion of 3 or 4 numbers
        return np.frombuffer(content, _COORDINATE, 3)[None]
    return _rows(header, content, _LIST)  # pyigtl's: a list of named positions


def _rows(header: Header, content: bytes, row: np.dtype) -> np.ndarray:
    _require(header, content, len(content) % row.itemsize == 0)
    return np.frombuffer(content, row)["position"]


def _polydata(header: Header, content: bytes) -> np.ndarray:
    _require(header, content, len(content) >= _POLYDATA)
    points, *cells = np.frombuffer(content, ">u4", 10).tolist()
    _require(header, content, _POLYDATA + 12 * points + sum(cells[1:8:2]) <= len(content))
    return np.frombuffer(content, _COORDINATE, 3 * points, _POLYDATA).reshape(-1, 3)


def _require(header: Header, content: bytes, sound: bool) -> None:
    if not sound:
        raise ShapeError(
            f"{header.kind} of {header.device!r}: {len(content)} bytes do not hold what it announces"
        )


def _text(content: bytes) -> str:
    """Return the text of a STRING; empty where its length is wrong."""
    if len(content) < 4 or len(content) - 4 != int.from_bytes(content[2:4], "big"):
        return ""
    return content[4:].decode("utf-8", "replace")


def checksum(body: bytes) -> int:
    """Return the checksum of a body."""
    return core.crc64(np.frombuffer(body, np.uint8)) & 0xFFFFFFFFFFFFFFFF


def route_message(position: Points, time: float) -> bytes:
    """Write a route [m] as one line of a POLYDATA, in mm."""
    count = len(position)
    line = np.arange(-1, count)
    line[0] = count
    numbers = np.array([count, 0, 0, 1, 4 * len(line), 0, 0, 0, 0, 0])  # points, then cells and their bytes
    points = (PER_METRE["mm"] * position).astype(_COORDINATE)
    parts = (numbers.astype(">u4"), points, line.astype(">u4"))
    return _packed("POLYDATA", "tssgeom_route", time, b"".join(part.tobytes() for part in parts))


def text_message(text: str, time: float) -> bytes:
    """Write a text, such as a line of JSON, as a STRING."""
    encoded = text.encode()
    about = struct.pack(">HH", _ASCII if text.isascii() else _UTF_8, len(encoded))
    return _packed("STRING", "tssgeom", time, about + encoded)


def _packed(kind: str, device: str, time: float, content: bytes) -> bytes:
    """Write a message under a header of version 1."""
    seconds, fraction = divmod(round(time * 2.0**32), 1 << 32)
    about = (1, kind.encode(), device.encode(), seconds, fraction, len(content), checksum(content))
    return _FIELDS.pack(*about) + content

"""OpenIGTLink on sockets: a client that is a source, and a server that is a sink."""

from __future__ import annotations

import errno
import json
import math
import re
import selectors
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from time import monotonic, perf_counter_ns

import numpy as np

from tssgeom.arrays import Points, read_only
from tssgeom.errors import ShapeError
from tssgeom.io.formats.columns import MEASURED, OF_MACHINE, of_machine
from tssgeom.io.formats.laboratory.unknown import unknown_names
from tssgeom.io.network.addresses import Access, Endpoint, resolved
from tssgeom.io.network.channel import WRITE, Channel
from tssgeom.io.network.igtl import (
    HEADER,
    LONGEST_TEXT,
    Header,
    Message,
    header_of,
    message_of,
    route_message,
    text_message,
)
from tssgeom.io.network.mailbox import LIMITS, Mailbox, Sender
from tssgeom.io.network.sinks import TcpSink
from tssgeom.io.network.sources import Source
from tssgeom.stream import Frame, FrameResult, Rejected

_ONE_POINT = 200  # bytes of a POINT message that can hold one point only
_MOST_NODES = 256  # nodes of a route that is sent; chosen: as many as a display resolves
_NUMBERS = {name: field for name, (field, per_si) in MEASURED.items() if per_si == 1.0} | {
    "displacement_target_m": "displacement_target",
    "tension_out_target_N": "tension_out_target",
    "length_m": "length",
}
"""Names of numbers in the metadata, and the fields of `Frame` that they fill."""
_DRIVES = frozenset(("tension_in", "displacement_in", "displacement_target", "tension_out_target"))


@dataclass(frozen=True, slots=True)
class Backoff:
    """Pauses between attempts to connect, each twice as long as the last."""

    first_s: float = 0.1
    """First pause [s]; chosen."""
    longest_s: float = 5.0
    """Longest pause [s]; chosen: a restarted server is reached soon."""


BACKOFF = Backoff()


@dataclass(slots=True)
class Rounds:
    """Shapes out of sensors that send their positions one after the other.

    A shape is complete when every sensor has sent its position, or when one of them sends again; a sensor
    that has not is a point that was not observed. Its metadata are those of all its messages, the newest of
    each name.
    """

    names: Sequence[str]
    """The sensors, proximal to distal; by default all that send, in the order of their names."""
    learning: bool
    _received: dict[str, Message] = field(default_factory=dict)

    def shape(self, message: Message) -> tuple[Message, Points] | None:
        """Add one position; return a shape if one is complete [n, 3], and its last message with all metadata.

        Raises ShapeError where more sensors than points of a frame have sent since one sent again; they begin
        anew.
        """
        whole, device = None, message.header.device
        if not self.learning and device not in self.names:
            return None
        if device in self._received:
            whole = self._ended()
        if self.learning and max(len(self._received) + 1, len(self.names)) > LIMITS.points:
            self._received.clear()
            self.names = ()
            many = f"more than {LIMITS.points} sensors, the last is {device!r}"
            raise ShapeError(f"{many}: name them in the address, ?sensors=A,B")
        self._received[device] = message
        complete = len(self._received) == len(self.names) and set(self.names) == set(self._received)
        return self._ended() if complete else whole

    def _ended(self) -> tuple[Message, Points]:
        metadata = {name: text for each in self._received.values() for name, text in each.metadata.items()}
        last = replace(next(reversed(self._received.values())), metadata=metadata)
        if self.learning and not set(self._received) <= set(self.names):
            self.names = sorted({*self.names, *self._received}, key=_natural)
        unknown = np.full((1, 3), np.nan)
        rows = [self._received[name].positions if name in self._received else unknown for name in self.names]
        self._received.clear()
        return last, np.concatenate(rows)


def _natural(name: str) -> list[tuple[int, int | str]]:
    """Order numbers inside names as numbers."""
    return [(0, int(part)) if part.isdecimal() else (1, part) for part in re.split(r"(\d+)", name) if part]


class IgtlSource(Source):
    """A client of an OpenIGTLink server; after a lost connection it tries again and again."""

    def __init__(
        self,
        selector: selectors.BaseSelector,
        mailbox: Mailbox,
        endpoint: Endpoint,
        allowed: Access,
        report: Callable[[str], object],
    ) -> None:
        self._family, self._address = resolved(endpoint, allowed, socket.SOCK_STREAM)
        self.text = endpoint.at(self._address)
        self._sensors = endpoint.sensors()
        self._selector, self._mailbox, self._report = selector, mailbox, report
        self._channel: Channel | None = None
        self._connecting: socket.socket | None = None
        self._pause, self._next = BACKOFF.first_s, 0.0
        self._sender = Sender()
        self._begin()

    def due(self) -> float | None:
        """Return when to connect next, in the time of `monotonic` [s]; None while connected."""
        return None if self._channel or self._connecting else self._next

    def pull(self) -> None:
        """Try to connect."""
        sock = socket.socket(self._family, socket.SOCK_STREAM)
        sock.setblocking(False)
        if sock.connect_ex(self._address) not in (0, errno.EINPROGRESS):
            sock.close()
            self._wait()
            return
        self._connecting = sock
        self._selector.register(sock, WRITE, self._connected)

    def close(self) -> None:
        """Close the connection."""
        if self._connecting is not None:
            self._selector.unregister(self._connecting)
            self._connecting.close()
        if self._channel is not None:
            self._channel.close()

    def _begin(self) -> None:
        self._data, self._sender = bytearray(), Sender(track=self._sender.track)
        self._rounds = Rounds(self._sensors, not self._sensors)

    def _connected(self, events: int) -> None:
        sock, self._connecting = self._connecting, None
        if sock is None:
            return
        self._selector.unregister(sock)
        if sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            sock.close()
            self._wait()
            return
        self._begin()
        self._channel = Channel(
            self._selector,
            sock,
            self._received,
            self._gone,
            has_to_wait=lambda: self._mailbox.is_behind(self._sender),
        )
        self._report(f"{self.text}: connected")

    def _gone(self) -> None:
        self._channel = None
        self._report(f"{self.text}: the server has gone: connecting again")
        self._wait()

    def _wait(self) -> None:
        self._next = monotonic() + self._pause
        self._pause = min(2.0 * self._pause, BACKOFF.longest_s)

    def _received(self, data: bytes) -> None:
        now = perf_counter_ns()
        self._data += data
        while len(self._data) >= HEADER:
            try:
                header = header_of(self._data)
            except ShapeError as error:
                self._refuse(error, now)
                if self._channel is not None:
                    self._channel.close()
                self._gone()
                return
            if len(self._data) < HEADER + header.size:
                return
            body = bytes(memoryview(self._data)[HEADER : HEADER + header.size])
            del self._data[: HEADER + header.size]
            self._taken(header, body, now)

    def _taken(self, header: Header, body: bytes, now: int) -> None:
        one = header.kind in ("TRANSFORM", "POSITION") or (
            header.kind == "POINT" and header.size < _ONE_POINT
        )
        if one:
            self._sensed(header, body, now)
        elif header.kind in ("POINT", "POLYDATA"):
            self._pause = BACKOFF.first_s
            self._mailbox.post(self._sender, partial(_decoded, header, body), now)

    def _sensed(self, header: Header, body: bytes, now: int) -> None:
        try:
            message = message_of(header, body)
        except ShapeError as error:
            self._refuse(error, now)
            return
        if message is None:
            return
        self._pause = BACKOFF.first_s
        if len(message.positions) > 1:
            self._mailbox.post(self._sender, partial(_frame_or_refusal, message, message.positions), now)
            return
        try:
            whole = self._rounds.shape(message)
        except ShapeError as error:
            self._refuse(error, now)
            return
        if whole is not None:
            self._mailbox.post(self._sender, partial(_frame_or_refusal, *whole), now)

    def _refuse(self, error: ShapeError, now: int) -> None:
        refused = Rejected(0, math.nan, str(error))
        self._mailbox.post(self._sender, lambda: refused, now)


def _decoded(header: Header, body: bytes) -> Frame | Rejected:
    try:
        message = message_of(header, body)
    except ShapeError as error:
        return Rejected(0, header.time or math.nan, str(error))
    if message is None:
        return Rejected(0, header.time, f"{header.kind} holds no shape")
    return _frame_or_refusal(message, message.positions)


def _frame_or_refusal(message: Message, positions: Points) -> Frame | Rejected:
    when = message.header.time or time.time()
    stated = {field: message.metadata[name] for name, field in _NUMBERS.items() if name in message.metadata}
    known = message.metadata.keys() & OF_MACHINE.keys()
    unknown = message.metadata.keys() - _NUMBERS.keys() - known - {"id"}  # most are of programs on the way
    try:
        numbers = {field: float(text) for field, text in stated.items()}
        machine = of_machine({name: float(message.metadata[name]) for name in known})
        driven = machine is not None or not _DRIVES.isdisjoint(numbers)
        warnings = unknown_names(unknown, _NUMBERS, driven=driven) if unknown else ()
    except ShapeError as error:
        return Rejected(0, when, f"metadata: {error}")
    except ValueError as error:
        return Rejected(0, when, f"metadata: {error}: write numbers")
    frame = Frame(read_only(positions), when, id=message.metadata.get("id", ""), warnings=warnings)
    return replace(frame, of_machine=machine, **numbers)


class IgtlSink(TcpSink):
    """An OpenIGTLink server: each answer as a STRING, and its route as a POLYDATA."""

    def __init__(
        self,
        selector: selectors.BaseSelector,
        endpoint: Endpoint,
        allowed: Access,
        report: Callable[[str], object],
    ) -> None:
        super().__init__(selector, endpoint, allowed, report, split_token=first_string, pack=_string)

    def publish(self, line: bytes, result: FrameResult | None) -> None:
        """Send an answer, and the route of its result."""
        if not (peers := self.peers):
            return
        data = _string(line)
        if result is not None:
            data += route_message(_fewer(result.route.position), time.time())
        self.send(data, peers)


def _string(line: bytes) -> bytes:
    """Write an answer; of one that a STRING cannot hold, what has one value."""
    line = line.rstrip(b"\n")
    if len(line) > LONGEST_TEXT:
        kept = {
            key: value for key, value in json.loads(line).items() if isinstance(value, int | float | None)
        }
        left_out = f"its texts and lists are left out: a STRING holds {LONGEST_TEXT} bytes, not {len(line)}"
        line = json.dumps(kept | {"warnings": [left_out]}).encode()
    return text_message(line.decode(), time.time())


def _fewer(position: Points) -> Points:
    """Return at most `_MOST_NODES` nodes, with both ends."""
    index = np.linspace(0, len(position) - 1, min(len(position), _MOST_NODES))
    return position[np.rint(index).astype(np.intp)]


def first_string(greeting: bytes) -> tuple[bytes, bytes] | None:
    """Split the text of a first STRING message from what follows; None as long as it is incomplete."""
    if len(greeting) < HEADER:
        return None
    try:
        header = header_of(greeting)
        end = HEADER + header.size
        if len(greeting) < end:
            return None
        message = message_of(header, greeting[HEADER:end])
    except ShapeError:
        return b"", b""
    return (message.text.encode() if message else b""), greeting[end:]

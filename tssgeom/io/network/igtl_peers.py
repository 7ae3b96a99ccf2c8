"""OpenIGTLink on sockets: a client that is a source, and a server that is a sink."""

from __future__ import annotations

import errno
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
from tssgeom.io.network.addresses import Access, Endpoint, resolved
from tssgeom.io.network.channel import WRITE, Channel
from tssgeom.io.network.igtl import (
    HEADER,
    Header,
    Message,
    header_of,
    message_of,
    route_message,
    text_message,
)
from tssgeom.io.network.mailbox import Clock, Mailbox
from tssgeom.io.network.sinks import TcpSink
from tssgeom.stream import Frame, FrameResult, Rejected

_FIRST_PAUSE, _LONGEST_PAUSE = 0.1, 5.0  # s until the next attempt to connect
_ONE_PLACE = 200  # bytes of a POINT message that can hold no more than one
_MOST_NODES = 256  # of a route that is sent
_NUMBERS = {
    "tension_in_N": "tension_in",
    "tension_out_N": "tension_out",
    "displacement_in_m": "displacement_in",
    "elongation_m": "elongation",
    "displacement_target_m": "displacement_target",
    "tension_out_target_N": "tension_out_target",
    "length_m": "length",
    "temperature_C": "temperature",
    "noise_m": "noise",
}


@dataclass(slots=True)
class Rounds:
    """Sensors that tell their places one after the other, put together to shapes.

    A shape is whole when every sensor has told its place, or when one of them does so again; who has not
    is a point that was not seen.
    """

    names: Sequence[str]
    """The sensors, proximal to distal; where none is named, all that come, in the order of their names."""
    learning: bool
    _told: dict[str, Message] = field(default_factory=dict)

    def shape(self, message: Message) -> tuple[Message, Points] | None:
        """Take in one place; return a shape if one is whole [n, 3], and the message that came last in it."""
        whole, device = None, message.header.device
        if not self.learning and device not in self.names:
            return None
        if device in self._told:
            whole = self._ended()
        self._told[device] = message
        return self._ended() if set(self.names) == set(self._told) else whole

    def _ended(self) -> tuple[Message, Points]:
        last = next(reversed(self._told.values()))
        if self.learning and not set(self._told) <= set(self.names):
            self.names = sorted({*self.names, *self._told}, key=_natural)
        unseen = np.full((1, 3), np.nan)
        rows = [self._told[name].places if name in self._told else unseen for name in self.names]
        self._told.clear()
        return last, np.concatenate(rows)


def _natural(name: str) -> list[tuple[int, int | str]]:
    """Order numbers inside names as numbers."""
    return [(0, int(part)) if part.isdigit() else (1, part) for part in re.split(r"(\d+)", name) if part]


class IgtlSource:
    """A client of an OpenIGTLink server; where the server goes away, it is looked for again and again."""

    ended = False

    def __init__(
        self,
        selector: selectors.BaseSelector,
        mailbox: Mailbox,
        endpoint: Endpoint,
        allowed: Access,
        tell: Callable[[str], object],
    ) -> None:
        self._family, self._address = resolved(endpoint, allowed, socket.SOCK_STREAM)
        self.text = endpoint.at(self._address)
        self._sensors = endpoint.sensors()
        self._selector, self._mailbox, self._tell = selector, mailbox, tell
        self._channel: Channel | None = None
        self._calling: socket.socket | None = None
        self._pause, self._next = _FIRST_PAUSE, 0.0
        self._begin()

    def due(self) -> float | None:
        """When to connect next, as `monotonic` tells time [s]; None while connected."""
        return None if self._channel or self._calling else self._next

    def pull(self) -> None:
        """Try to connect."""
        sock = socket.socket(self._family, socket.SOCK_STREAM)
        sock.setblocking(False)
        if sock.connect_ex(self._address) not in (0, errno.EINPROGRESS):
            sock.close()
            self._wait()
            return
        self._calling = sock
        self._selector.register(sock, WRITE, self._called)

    def tick(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Let go of the connection."""
        if self._calling is not None:
            self._selector.unregister(self._calling)
            self._calling.close()
        if self._channel is not None:
            self._channel.close()

    def _begin(self) -> None:
        self._data, self._clock = bytearray(), Clock()
        self._rounds = Rounds(self._sensors, not self._sensors)

    def _called(self, events: int) -> None:
        sock, self._calling = self._calling, None
        if sock is None:
            return
        self._selector.unregister(sock)
        if sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            sock.close()
            self._wait()
            return
        self._begin()
        self._channel = Channel(self._selector, sock, self._received, self._gone)
        self._tell(f"{self.text}: connected")

    def _gone(self) -> None:
        self._channel = None
        self._tell(f"{self.text}: the server has gone: looking for it again")
        self._wait()

    def _wait(self) -> None:
        self._next = monotonic() + self._pause
        self._pause = min(2.0 * self._pause, _LONGEST_PAUSE)

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
            header.kind == "POINT" and header.size < _ONE_PLACE
        )
        if one:
            self._sensed(header, body, now)
        elif header.kind in ("POINT", "POLYDATA"):
            self._pause = _FIRST_PAUSE
            self._mailbox.post(self._clock, partial(_opened, header, body), now)

    def _sensed(self, header: Header, body: bytes, now: int) -> None:
        try:
            message = message_of(header, body)
        except ShapeError as error:
            self._refuse(error, now)
            return
        if message is None:
            return
        self._pause = _FIRST_PAUSE
        if len(message.places) > 1:
            self._mailbox.post(self._clock, partial(_frame_or_refusal, message, message.places), now)
            return
        if (whole := self._rounds.shape(message)) is not None:
            self._mailbox.post(self._clock, partial(_frame_or_refusal, *whole), now)

    def _refuse(self, error: ShapeError, now: int) -> None:
        refused = Rejected(0, math.nan, str(error))
        self._mailbox.post(self._clock, lambda: refused, now)


def _opened(header: Header, body: bytes) -> Frame | Rejected:
    try:
        message = message_of(header, body)
    except ShapeError as error:
        return Rejected(0, header.time or math.nan, str(error))
    if message is None:
        return Rejected(0, header.time, f"{header.kind} tells no shape")
    return _frame_or_refusal(message, message.places)


def _frame_or_refusal(message: Message, places: Points) -> Frame | Rejected:
    when = message.header.time or time.time()
    told = {field: message.metadata[name] for name, field in _NUMBERS.items() if name in message.metadata}
    try:
        numbers = {field: float(text) for field, text in told.items()}
    except ValueError as error:
        return Rejected(0, when, f"metadata: {error}: write numbers")
    return replace(Frame(read_only(places), when, id=message.metadata.get("id", "")), **numbers)


class IgtlSink:
    """An OpenIGTLink server: each answer as a STRING, and its route as a POLYDATA."""

    broken = False

    def __init__(
        self,
        selector: selectors.BaseSelector,
        endpoint: Endpoint,
        allowed: Access,
        tell: Callable[[str], object],
    ) -> None:
        self._sink = TcpSink(
            selector, endpoint, allowed, tell, shown=first_string, farewell=lambda line: _string(line)
        )
        self.text = self._sink.text
        self.tick, self.close = self._sink.tick, self._sink.close

    @property
    def unsent(self) -> int:
        """Answers that found no room."""
        return self._sink.unsent

    @property
    def waiting(self) -> bool:
        """Whether a client still has to take something."""
        return self._sink.waiting

    def publish(self, line: bytes, result: FrameResult | None) -> None:
        """Send an answer, and the route where it tells one."""
        if not (peers := self._sink.peers):
            return
        data = _string(line)
        if result is not None:
            data += route_message(_fewer(result.route.position), time.time())
        self._sink.send(data, peers)


def _string(line: bytes) -> bytes:
    return text_message(line.decode().rstrip("\n"), time.time())


def _fewer(position: Points) -> Points:
    """At most so many nodes as are sent, with both ends."""
    chosen = np.linspace(0, len(position) - 1, min(len(position), _MOST_NODES))
    return position[np.rint(chosen).astype(np.intp)]


def first_string(greeting: bytes) -> tuple[bytes, bytes] | None:
    """Split the text of a first STRING message from what follows; None as long as it is not whole."""
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

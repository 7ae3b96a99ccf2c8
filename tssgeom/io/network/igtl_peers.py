"""OpenIGTLink on sockets: a client that is a source, and a server that is a sink."""

from __future__ import annotations

import errno
import json
import math
import os
import selectors
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
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
    LISTS,
    LONGEST_TEXT,
    SHAPES,
    Header,
    Message,
    header_of,
    message_of,
    route_message,
    text_message,
)
from tssgeom.io.network.igtl_rounds import Rounds
from tssgeom.io.network.mailbox import Mailbox, Sender
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
        self._passed_over = set[str]()
        self._called_since, self._is_reported = math.inf, False
        self._sender = Sender()
        self._begin()

    def due(self) -> float | None:
        """Return when to connect next, in the time of `monotonic` [s]; None while connected."""
        return None if self._channel or self._connecting else self._next

    def pull(self) -> None:
        """Try to connect."""
        sock = socket.socket(self._family, socket.SOCK_STREAM)
        sock.setblocking(False)
        error = sock.connect_ex(self._address)
        if error not in (0, errno.EINPROGRESS):
            sock.close()
            self._unreached(os.strerror(error))
            return
        self._connecting, self._called_since = sock, monotonic()
        self._selector.register(sock, WRITE, self._connected)

    def tick(self) -> None:
        """Report where the server lets the first call wait: a firewall answers nothing."""
        if self._connecting is not None and monotonic() - self._called_since > BACKOFF.longest_s:
            self._report_unreached("no answer")

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
        if error := sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            sock.close()
            self._unreached(os.strerror(error))
            return
        self._begin()
        self._is_reported = True
        self._channel = Channel(
            self._selector,
            sock,
            self._received,
            self._gone,
            has_to_wait=lambda: self._mailbox.is_behind(self._sender),
        )
        self._report(f"{self.text}: connected")

    def _unreached(self, why: str) -> None:
        self._report_unreached(why)
        self._wait()

    def _report_unreached(self, why: str) -> None:
        """Report once that the server was never reached."""
        if not self._is_reported:
            self._is_reported = True
            self._report(f"{self.text}: not reachable yet ({why}): trying again until it is")

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
        if header.kind not in SHAPES:
            self._pass_over(header.kind)
        elif header.kind not in ("POINT", "POLYDATA") or (
            header.size < _ONE_POINT and header.kind == "POINT"
        ):
            self._sensed(header, body, now)
        else:
            self._pause = BACKOFF.first_s
            self._mailbox.post(self._sender, partial(_decoded, header, body), now)

    def _pass_over(self, kind: str) -> None:
        """Report once that messages of a kind are not read; of few kinds, as a server may invent any."""
        if kind not in self._passed_over and len(self._passed_over) < len(SHAPES):
            self._passed_over.add(kind)
            self._report(f"{self.text}: {kind!r} messages are not read, only {', '.join(SHAPES)}")

    def _sensed(self, header: Header, body: bytes, now: int) -> None:
        try:
            message = message_of(header, body)
        except ShapeError as error:
            self._refuse(error, now)
            return
        if message is None:
            return
        self._pause = BACKOFF.first_s
        try:
            if header.kind in LISTS:
                whole = message, self._rounds.listed(message)
            elif len(message.positions) > 1:
                whole = message, message.positions
            else:
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

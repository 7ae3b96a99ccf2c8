"""Sources of frames: standard input, TCP, UDP and files that are replayed.

Senders on a socket cannot be held back, so their newest frame wins. Standard input and files wait instead:
their next frame is read when the last one has been answered.
"""

from __future__ import annotations

import math
import os
import re
import select
import selectors
import socket
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from time import monotonic, perf_counter_ns

from tssgeom.errors import ShapeError, TssgeomError
from tssgeom.io.formats.files import open_recording
from tssgeom.io.formats.jsonl import frame_or_refusal
from tssgeom.io.formats.laboratory.mapping import NO_MAP, ColumnMap
from tssgeom.io.formats.recording import usable
from tssgeom.io.network.addresses import Access, Endpoint, resolved
from tssgeom.io.network.channel import READ
from tssgeom.io.network.listener import LIMITS as CONNECTIONS
from tssgeom.io.network.listener import Listener, Peer, first_line, socket_error
from tssgeom.io.network.mailbox import LIMITS, Clock, Lines, Mailbox
from tssgeom.stream import Frame, Rejected

_CHUNK = 1 << 16  # bytes that are read at once from standard input: the size of a pipe of Linux
_HTTP = re.compile(rb"[A-Z]+ \S+ HTTP/")
_LOST = 40  # SO_RXQ_OVFL of Linux: counts the datagrams without room


@dataclass(frozen=True, slots=True)
class DatagramLimits:
    """Limits of a socket that receives datagrams."""

    largest_bytes: int = 1 << 16
    """Bytes of a datagram; cited: UDP allows 65 507."""
    buffer_bytes: int = 1 << 22
    """Size of the system's buffer for datagrams [bytes]; chosen: 64 of the largest."""
    at_once: int = 64
    """Datagrams that are read before other work; derived: those that the buffer holds."""
    senders: int = 64
    """Senders whose clocks are kept; chosen."""


DATAGRAMS = DatagramLimits()


class Source:
    """Frames from one address; by default they are posted as they arrive and never end."""

    text: str
    """Its address, as the user reads it."""

    @property
    def ended(self) -> bool:
        """Whether no further frame can come."""
        return False

    def due(self) -> float | None:
        """Return when to pull the next frame, in the time of `monotonic` [s]; None: on arrival."""
        return None

    def pull(self) -> None:
        """Post the next frame, if there is one."""

    def tick(self) -> None:
        """Do periodic work."""

    def close(self) -> None:
        """Close sockets and files."""


class StandardInput(Source):
    """JSON lines on standard input; the writer waits until its frames are answered."""

    text = "-"

    def __init__(
        self, selector: selectors.BaseSelector, mailbox: Mailbox, unit: str | None, fd: int = 0
    ) -> None:
        self._mailbox, self._unit, self._fd = mailbox, unit, fd
        self._lines, self._clock = Lines(), Clock()
        self._waiting: list[Callable[[], Frame | Rejected]] = []
        self._at_end = False
        self._poll = select.poll()
        self._poll.register(fd, select.POLLIN)
        self._selector = selector
        self._watched = self._ready = False
        self._watch()

    @property
    def ended(self) -> bool:
        """Whether the writer has closed it and every line is read."""
        return self._at_end and not self._waiting

    def due(self) -> float | None:
        """Return 0, which is now, if lines wait or the input is a file, for which no selector works."""
        return 0.0 if self._waiting or self._ready or not (self._watched or self._at_end) else None

    def pull(self) -> None:
        """Post the next line."""
        if not self._waiting and not self._at_end and self._poll.poll(0):
            self._read()
        if self._waiting:
            self._mailbox.post(self._clock, self._waiting.pop())
        self._watch()

    def close(self) -> None:
        """Unregister from the selector; the descriptor belongs to the process."""
        if self._watched:
            self._selector.unregister(self._fd)
            self._watched = False

    def _watch(self) -> None:
        """Let the selector wake the loop for input only while no line waits."""
        wanted = not self._waiting and not self._at_end
        if wanted == self._watched:
            return
        if self._watched:
            self.close()
            return
        try:
            self._selector.register(self._fd, READ, self._woken)
        except PermissionError:  # a file is always ready
            return
        self._watched = True

    def _woken(self, events: int) -> None:
        self._ready = True

    def _read(self) -> None:
        self._ready = False
        try:
            data = os.read(self._fd, _CHUNK)
        except OSError:
            data = b""
        self._at_end = not data
        try:
            lines, _ = self._lines.split(data or b"\n")
        except ShapeError as error:
            self._waiting = [partial(_refused, error)]
        else:
            self._waiting = [partial(frame_or_refusal, line, self._unit) for line in reversed(lines)]


class TcpSource(Source):
    """JSON lines from each client that connects."""

    def __init__(
        self,
        selector: selectors.BaseSelector,
        mailbox: Mailbox,
        endpoint: Endpoint,
        allowed: Access,
        unit: str | None,
        report: Callable[[str], object],
    ) -> None:
        self._mailbox, self._unit = mailbox, unit
        self._listener = Listener(
            selector,
            endpoint,
            allowed,
            connected=self._connected,
            report=report,
            split_token=first_line,
            longest_silence=CONNECTIONS.silent_s,
        )
        self.text = self._listener.text

    def tick(self) -> None:
        """Cut off clients without a token."""
        self._listener.tick()

    def close(self) -> None:
        """Close the socket and all connections."""
        self._listener.close()

    def _connected(self, peer: Peer) -> None:
        peer.received = partial(self._received, peer, Lines(), Clock())
        peer.ended = partial(peer.received, b"\n")  # the last line may come without its end

    def _received(self, peer: Peer, lines: Lines, clock: Clock, data: bytes) -> None:
        now = perf_counter_ns()
        if not peer.greeted:
            begins = lines.rest + data
            if _HTTP.match(begins):
                self._listener.cut(peer, "this is no web server: send frames as lines of JSON")
                return
            peer.greeted = b"\n" in begins
        try:
            whole, skipped = lines.split(data, LIMITS.waiting)
        except ShapeError as error:
            self._mailbox.post(clock, partial(_refused, error), now)
            self._listener.cut(peer, str(error))
            return
        if skipped:
            self._mailbox.skip(skipped)
        for line in whole:
            self._mailbox.post(clock, partial(frame_or_refusal, line, self._unit), now)


class UdpSource(Source):
    """A frame as JSON in each datagram; a required token is its first line."""

    def __init__(
        self,
        selector: selectors.BaseSelector,
        mailbox: Mailbox,
        endpoint: Endpoint,
        allowed: Access,
        unit: str | None,
    ) -> None:
        family, address = resolved(endpoint, allowed, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            raise socket_error(endpoint, error) from error
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, DATAGRAMS.buffer_bytes)
        self._counts_lost = os.uname().sysname == "Linux"
        if self._counts_lost:
            self._socket.setsockopt(socket.SOL_SOCKET, _LOST, 1)
        self.text = endpoint.at(self._socket.getsockname())
        self._mailbox, self._allowed, self._unit = mailbox, allowed, unit
        self._clocks = dict[tuple, Clock]()
        self._lost = 0
        self._selector = selector
        selector.register(self._socket, READ, self._ready)

    def close(self) -> None:
        """Close the socket."""
        self._selector.unregister(self._socket)
        self._socket.close()

    def _ready(self, events: int) -> None:
        for _ in range(DATAGRAMS.at_once):
            try:
                data, about, _, sender = self._socket.recvmsg(
                    DATAGRAMS.largest_bytes, 64 if self._counts_lost else 0
                )
            except OSError:
                return
            self._count_lost(about)
            self._received(data, sender)

    def _count_lost(self, about: list[tuple[int, int, bytes]]) -> None:
        """Count the datagrams without room in the system's buffer as dropped."""
        for _, kind, value in about:
            if kind == _LOST:
                lost = int.from_bytes(value[:4], sys.byteorder)
                self._mailbox.skip((lost - self._lost) & 0xFFFFFFFF)
                self._lost = lost

    def _received(self, data: bytes, sender: tuple) -> None:
        if self._allowed.token:
            token, _, data = data.partition(b"\n")
            if not self._allowed.admits(token):
                return  # a sender without the token gets no answer and no count
        if not data.strip():
            return
        self._mailbox.post(self._clock(sender), partial(frame_or_refusal, data.strip(), self._unit))

    def _clock(self, sender: tuple) -> Clock:
        if sender not in self._clocks:
            while len(self._clocks) >= DATAGRAMS.senders:
                del self._clocks[next(iter(self._clocks))]
            self._clocks[sender] = Clock()
        return self._clocks[sender]


class Replay(Source):
    """A recorded file, at its own pace or faster; it is late where answers take longer."""

    def __init__(
        self, mailbox: Mailbox, endpoint: Endpoint, unit: str | None, columns: ColumnMap = NO_MAP
    ) -> None:
        self.text = endpoint.text
        self._mailbox, self._speed, self._clock = mailbox, endpoint.speed(), Clock()
        recording = open_recording(endpoint.path, unit, columns)
        self.notes = (*recording.notes, *recording.warnings)
        """How the file was read, and what was not."""
        self._frames: Iterator[Frame | Rejected] = iter(recording.frames)
        self._begun: tuple[float, float] | None = None
        self._next: Frame | Rejected | None = None
        self._paced = False
        self._advance()

    def _advance(self) -> None:
        """Read the next frame; the time of an unusable one is ignored."""
        self._next = next(self._frames, None)
        self._paced = isinstance(self._next, Frame) and usable(self._next)

    @property
    def ended(self) -> bool:
        """Whether the last frame has been posted."""
        return self._next is None

    def due(self) -> float | None:
        """Return when the next frame is to be answered, in the time of `monotonic` [s]."""
        if self._next is None:
            return None
        if self._begun is None or not self._paced:
            return 0.0
        wall, time = self._begun
        return wall + (self._next.time - time) / self._speed

    def pull(self) -> None:
        """Post the next frame if its time has come."""
        item, due = self._next, self.due()
        if item is None or due is None or due > monotonic():
            return
        if self._begun is None and self._paced:
            self._begun = monotonic(), item.time
        self._mailbox.post(self._clock, lambda: item)
        try:
            self._advance()
        except TssgeomError as error:  # the file was removed or changed meanwhile
            self._mailbox.post(self._clock, partial(_refused, error))
            self._next = None


def _refused(error: TssgeomError) -> Rejected:
    return Rejected(0, math.nan, str(error))

"""Where frames come from: standard input, TCP, UDP and files that are replayed.

Senders on a socket cannot be held back, so their newest frame wins. Standard input and files wait instead:
the next frame is taken from them when the last one has been answered.
"""

from __future__ import annotations

import math
import os
import select
import selectors
import socket
import sys
from collections.abc import Callable, Iterator
from functools import partial
from time import monotonic, perf_counter_ns
from typing import Protocol

from tssgeom.errors import ShapeError, TssgeomError
from tssgeom.io.formats.files import open_recording
from tssgeom.io.formats.jsonl import frame_or_refusal
from tssgeom.io.formats.recording import usable
from tssgeom.io.network.addresses import Access, Endpoint, resolved
from tssgeom.io.network.channel import READ
from tssgeom.io.network.listener import Listener, Peer, first_line, socket_error
from tssgeom.io.network.mailbox import LOOKED_AT, Clock, Lines, Mailbox
from tssgeom.stream import Frame, Rejected

_CHUNK = 1 << 16  # bytes
_LARGEST = 1 << 16  # bytes of a datagram
_ROOM = 1 << 22  # bytes of datagrams that the system is asked to hold
_AT_ONCE = 64  # datagrams
_LOST = 40  # SO_RXQ_OVFL of Linux: tells datagrams that found no room
_MOST_SENDERS = 64


class Source(Protocol):
    """What a source can do."""

    text: str
    """Its address, as it is told to the user."""

    @property
    def ended(self) -> bool:
        """Whether no frame can come any more."""
        ...

    def due(self) -> float | None:
        """When the next frame is to be pulled, as `monotonic` tells time [s]; None: it comes by itself."""
        ...

    def pull(self) -> None:
        """Post the next frame, if it is there."""
        ...

    def tick(self) -> None:
        """Do what is to be done once a while."""
        ...

    def close(self) -> None:
        """Let go of sockets and files."""
        ...


class StandardInput:
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
        """Whether the writer has closed it and all is read."""
        return self._at_end and not self._waiting

    def due(self) -> float | None:
        """Now, if lines wait or a file is read, which no selector takes."""
        return 0.0 if self._waiting or self._ready or not (self._watched or self._at_end) else None

    def pull(self) -> None:
        """Post the next line."""
        if not self._waiting and not self._at_end and self._poll.poll(0):
            self._read()
        if self._waiting:
            self._mailbox.post(self._clock, self._waiting.pop())
        self._watch()

    def tick(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Let go of the selector; the descriptor belongs to the process."""
        if self._watched:
            self._selector.unregister(self._fd)
            self._watched = False

    def _watch(self) -> None:
        """Let the selector wake the loop for input only while nothing waits."""
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
            lines, _ = self._lines.fed(data or b"\n")
        except ShapeError as error:
            self._waiting = [partial(_refused, error)]
        else:
            self._waiting = [partial(frame_or_refusal, line, self._unit) for line in reversed(lines)]


class TcpSource:
    """JSON lines from each client that connects."""

    ended = False

    def __init__(
        self,
        selector: selectors.BaseSelector,
        mailbox: Mailbox,
        endpoint: Endpoint,
        allowed: Access,
        unit: str | None,
        tell: Callable[[str], object],
    ) -> None:
        self._mailbox, self._unit = mailbox, unit
        self._listener = Listener(
            selector, endpoint, allowed, connected=self._connected, tell=tell, shown=first_line
        )
        self.text = self._listener.text
        self.tick, self.close = self._listener.tick, self._listener.close

    def due(self) -> float | None:
        """Frames come by themselves."""
        return None

    def pull(self) -> None:
        """Nothing."""

    def _connected(self, peer: Peer) -> None:
        peer.received = partial(self._received, peer, Lines(), Clock())
        peer.ended = partial(peer.received, b"\n")  # the last line may come without its end

    def _received(self, peer: Peer, lines: Lines, clock: Clock, data: bytes) -> None:
        now = perf_counter_ns()
        try:
            found, skipped = lines.fed(data, LOOKED_AT)
        except ShapeError as error:
            self._mailbox.post(clock, partial(_refused, error), now)
            self._listener.cut(peer, str(error))
            return
        if skipped:
            self._mailbox.skip(skipped)
        for line in found:
            self._mailbox.post(clock, partial(frame_or_refusal, line, self._unit), now)


class UdpSource:
    """A frame as JSON in each datagram; where a token is asked for, it is the first line."""

    ended = False

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
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _ROOM)
        self._counts_lost = os.uname().sysname == "Linux"
        if self._counts_lost:
            self._socket.setsockopt(socket.SOL_SOCKET, _LOST, 1)
        self.text = endpoint.at(self._socket.getsockname())
        self._mailbox, self._allowed, self._unit = mailbox, allowed, unit
        self._clocks = dict[tuple, Clock]()
        self._lost = 0
        self._selector = selector
        selector.register(self._socket, READ, self._ready)

    def due(self) -> float | None:
        """Frames come by themselves."""
        return None

    def pull(self) -> None:
        """Nothing."""

    def tick(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Close the socket."""
        self._selector.unregister(self._socket)
        self._socket.close()

    def _ready(self, events: int) -> None:
        for _ in range(_AT_ONCE):
            try:
                data, about, _, sender = self._socket.recvmsg(_LARGEST, 64 if self._counts_lost else 0)
            except OSError:
                return
            self._count_lost(about)
            self._received(data, sender)

    def _count_lost(self, about: list[tuple[int, int, bytes]]) -> None:
        """Count the datagrams for which the system had no room as dropped."""
        for _, kind, value in about:
            if kind == _LOST:
                lost = int.from_bytes(value[:4], sys.byteorder)
                self._mailbox.skip((lost - self._lost) & 0xFFFFFFFF)
                self._lost = lost

    def _received(self, data: bytes, sender: tuple) -> None:
        if self._allowed.token:
            token, _, data = data.partition(b"\n")
            if not self._allowed.admits(token):
                return  # who does not know the token is not answered and not counted
        if not data.strip():
            return
        self._mailbox.post(self._clock(sender), partial(frame_or_refusal, data.strip(), self._unit))

    def _clock(self, sender: tuple) -> Clock:
        if sender not in self._clocks:
            while len(self._clocks) >= _MOST_SENDERS:
                del self._clocks[next(iter(self._clocks))]
            self._clocks[sender] = Clock()
        return self._clocks[sender]


class Replay:
    """A recorded file, at its own pace or faster; where answers take longer it is late."""

    def __init__(self, mailbox: Mailbox, endpoint: Endpoint, unit: str | None) -> None:
        self.text = endpoint.text
        self._mailbox, self._speed, self._clock = mailbox, endpoint.speed(), Clock()
        self._frames: Iterator[Frame | Rejected] = iter(open_recording(endpoint.path, unit).frames)
        self._begun: tuple[float, float] | None = None
        self._next: Frame | Rejected | None = None
        self._paced = False
        self._advance()

    def _advance(self) -> None:
        """Read the next frame; one that cannot be used has no time that counts."""
        self._next = next(self._frames, None)
        self._paced = isinstance(self._next, Frame) and usable(self._next)

    @property
    def ended(self) -> bool:
        """Whether the last frame has been posted."""
        return self._next is None

    def due(self) -> float | None:
        """When the next frame is to be answered, as `monotonic` tells time [s]."""
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
        except TssgeomError as error:  # the file has gone or changed meanwhile
            self._mailbox.post(self._clock, partial(_refused, error))
            self._next = None

    def tick(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


def _refused(error: TssgeomError) -> Rejected:
    return Rejected(0, math.nan, str(error))

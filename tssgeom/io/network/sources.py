"""Sources of frames: standard input, TCP and files that are replayed; `datagrams` has UDP.

Senders on a socket cannot be held back, so their newest frame wins. Standard input and files wait instead:
their next frame is read when the last one has been answered.
"""

from __future__ import annotations

import math
import os
import select
import selectors
from collections.abc import Callable, Iterator
from functools import partial
from time import monotonic, perf_counter_ns

from tssgeom.engine import Track
from tssgeom.errors import ShapeError, TssgeomError
from tssgeom.io.formats.files import open_recording
from tssgeom.io.formats.jsonl import frame_or_refusal
from tssgeom.io.formats.laboratory.mapping import NO_MAP, ColumnMap
from tssgeom.io.formats.recording import usable
from tssgeom.io.network.addresses import Access, Endpoint
from tssgeom.io.network.channel import READ
from tssgeom.io.network.listener import LIMITS as CONNECTIONS
from tssgeom.io.network.listener import Listener, Peer, first_line
from tssgeom.io.network.mailbox import LIMITS, Lines, Mailbox, Sender
from tssgeom.stream import Frame, Rejected

_CHUNK = 1 << 16  # bytes that are read at once from standard input: the size of a pipe of Linux


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
        self._lines, self._sender = Lines(), Sender()
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
        if self._sender.pending:
            return None
        return 0.0 if self._waiting or self._ready or not (self._watched or self._at_end) else None

    def pull(self) -> None:
        """Post the next line."""
        if not self._waiting and not self._at_end and self._poll.poll(0):
            self._read()
        if self._waiting:
            self._mailbox.post(self._sender, self._waiting.pop())
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
        self._left: Track | None = None
        self._listener = Listener(
            selector,
            endpoint,
            allowed,
            connected=self._connected,
            report=report,
            split_token=first_line,
            purpose="send frames as lines of JSON",
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
        sender, lines = Sender(), Lines()
        peer.received = partial(self._received, peer, lines, sender)
        peer.ended = partial(peer.received, b"\n")  # the last line may come without its end
        peer.gone = partial(self._gone, sender)
        peer.has_to_wait = partial(self._mailbox.is_behind, sender)

    def _gone(self, sender: Sender) -> None:
        if not sender.busy and sender.track.last is not None:
            self._left = sender.track

    def _received(self, peer: Peer, lines: Lines, sender: Sender, data: bytes) -> None:
        now = perf_counter_ns()
        if not sender.arrived and self._left is not None:  # it may be the one that has gone
            sender.track, self._left = self._left, None
        try:
            whole, skipped = lines.split(data, LIMITS.waiting)
        except ShapeError as error:
            self._mailbox.post(sender, partial(_refused, error), now)
            self._listener.cut(peer, str(error))
            return
        if skipped:
            self._mailbox.skip(skipped)
        for line in whole:
            self._mailbox.post(sender, partial(frame_or_refusal, line, self._unit), now)
        self._mailbox.charge(sender, 1e-9 * (perf_counter_ns() - now))


class Replay(Source):
    """A recorded file, at its own pace or faster; it is late where answers take longer."""

    def __init__(
        self, mailbox: Mailbox, endpoint: Endpoint, unit: str | None, columns: ColumnMap = NO_MAP
    ) -> None:
        self.text = endpoint.text
        self._mailbox, self._speed, self._sender = mailbox, endpoint.speed(), Sender()
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
        if self._next is None or self._sender.pending:
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
        self._mailbox.post(self._sender, lambda: item)
        try:
            self._advance()
        except TssgeomError as error:  # the file was removed or changed meanwhile
            self._mailbox.post(self._sender, partial(_refused, error))
            self._next = None


def _refused(error: TssgeomError) -> Rejected:
    return Rejected(0, math.nan, str(error))

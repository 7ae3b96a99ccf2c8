"""Frames that wait for the engine: the newest wins, older ones are counted as dropped."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter_ns

from tssgeom.errors import ShapeError
from tssgeom.io.formats.paths import LONGEST_LINE
from tssgeom.io.formats.recording import late
from tssgeom.stream import Frame, Rejected


@dataclass(frozen=True, slots=True)
class FrameLimits:
    """Limits of frames that wait, so that none delays those after it."""

    waiting: int = 16
    """Newest frames that are kept until one is used; chosen: so many bad ones may follow a good one."""
    points: int = 10_000
    """Points of a frame; chosen: a larger one would delay all frames after it."""
    id_length: int = 256
    """Characters of the id of a frame; chosen."""


LIMITS = FrameLimits()


@dataclass(slots=True)
class Lines:
    """The lines of a stream of bytes that arrives in pieces, without their ends."""

    rest: bytes = b""
    """A line that has not ended yet."""
    overlong: bool = field(default=False)
    """Whether it has exceeded the longest line."""

    def split(self, data: bytes, most: int | None = None) -> tuple[list[bytes], int]:
        """Add bytes; return the last `most` complete lines, and the number of those before.

        Raises
        ------
        ShapeError
            Where a line is too long; the rest of it is ignored.
        """
        end = data.rfind(b"\n")
        if end < 0:
            self._keep(self.rest + data)
            return [], 0
        whole, rest = data[:end], data[end + 1 :]
        if self.overlong:  # its end has come
            whole = whole.partition(b"\n")[2]
            self.overlong = False
        elif self.rest:
            whole = self.rest + whole
        self.rest = b""
        self._keep(rest)
        if most is None:
            return [line for line in whole.split(b"\n") if line.strip()], 0
        lines = whole.rsplit(b"\n", most)
        before = lines.pop(0) if len(lines) > most else b""
        skipped = before.count(b"\n") + 1 if before.strip() else 0
        return [line for line in lines if line.strip()], skipped

    def _keep(self, rest: bytes) -> None:
        if self.overlong or len(rest) > LONGEST_LINE:
            reported, self.overlong, self.rest = self.overlong, True, b""
            if not reported:
                raise ShapeError(f"the line is longer than {LONGEST_LINE} bytes (1 MiB): send fewer points")
        else:
            self.rest = rest


@dataclass(slots=True)
class Clock:
    """Time of the last answered frame of one connection."""

    latest: float = -math.inf
    offset: float = 0.0
    """Time of the stream minus time of this sender [s]."""

    def refusal(self, frame: Frame) -> str:
        """Return why a frame is not later than all answered ones; empty where it is."""
        return "" if self.latest < frame.time < math.inf else late(frame.time, self.latest)


@dataclass(frozen=True, slots=True)
class Waiting:
    """An undecoded frame."""

    seq: int
    """Count on arrival, from 0."""
    arrived: int
    """Time of its last byte, of `perf_counter_ns` [ns]."""
    clock: Clock
    decode: Callable[[], Frame | Rejected]
    """Decodes the frame."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """The frame that is answered next, and the newer ones that were rejected."""

    seq: int
    arrived: int
    frame: Frame | None
    """None where all frames were bad."""
    clock: Clock
    rejected: tuple[Rejected, ...]


@dataclass(slots=True)
class Mailbox:
    """A bounded number of frames that have arrived and are not answered yet."""

    arrived: int = 0
    """Frames so far."""
    dropped: int = 0
    """Frames that were dropped for newer ones."""
    _waiting: deque[Waiting] = field(default_factory=deque)

    def __len__(self) -> int:
        return len(self._waiting)

    def post(self, clock: Clock, decode: Callable[[], Frame | Rejected], arrived: int | None = None) -> None:
        """Add one frame; where too many wait, the oldest is dropped."""
        if len(self._waiting) >= LIMITS.waiting:
            self._waiting.popleft()
            self.dropped += 1
        now = perf_counter_ns() if arrived is None else arrived
        self._waiting.append(Waiting(self.arrived, now, clock, decode))
        self.arrived += 1

    def skip(self, count: int) -> None:
        """Count frames that are dropped on arrival."""
        self.arrived += count
        self.dropped += count

    def newest(self) -> Arrival:
        """Return the newest good frame; earlier ones are dropped, later ones are bad and rejected."""
        rejected = list[Rejected]()
        while self._waiting:
            waiting = self._waiting.pop()
            frame = waiting.decode()
            if isinstance(frame, Rejected):
                rejected.append(replace(frame, seq=waiting.seq))
                continue
            if reason := _too_large(frame) or waiting.clock.refusal(frame):
                rejected.append(Rejected(waiting.seq, frame.time, reason, frame.id))
                continue
            self.dropped += len(self._waiting)
            self._waiting.clear()
            return Arrival(waiting.seq, waiting.arrived, frame, waiting.clock, tuple(reversed(rejected)))
        return Arrival(-1, 0, None, Clock(), tuple(reversed(rejected)))


def _too_large(frame: Frame) -> str:
    """Return why a frame would delay others; empty where it would not."""
    if len(frame.points) > LIMITS.points:
        return f"the frame has {len(frame.points)} points: send {LIMITS.points} at most"
    if isinstance(frame.id, str) and len(frame.id) > LIMITS.id_length:
        return f"the id has {len(frame.id)} characters: use {LIMITS.id_length} at most"
    return ""

"""Where frames wait for the engine: the newest wins, older ones are counted as dropped."""

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

LOOKED_AT = 16
"""Of the lines that arrive at once, so many of the last are looked at; the others are dropped."""
MOST_POINTS = 10_000
"""Points of a frame at most: more would keep all frames after it waiting."""
_LONGEST_ID = 256


@dataclass(slots=True)
class Lines:
    """The lines that came in, without their ends."""

    rest: bytes = b""
    """A line that has not ended yet."""
    overlong: bool = field(default=False)
    """Whether it has been longer than a line may be."""

    def fed(self, data: bytes, most: int | None = None) -> tuple[list[bytes], int]:
        """Take in bytes; return the last `most` lines that are whole, and the number of those before.

        Raises
        ------
        ShapeError
            Where a line is too long; what remains of it is passed over.
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
            told, self.overlong, self.rest = self.overlong, True, b""
            if not told:
                raise ShapeError(f"the line is longer than {LONGEST_LINE} bytes (1 MiB): send fewer points")
        else:
            self.rest = rest


@dataclass(slots=True)
class Clock:
    """Time of the last answered frame of one sender; a sender that connects anew has a new one."""

    latest: float = -math.inf
    ahead: float = 0.0
    """Time of the stream less that of this sender [s]."""

    def refusal(self, frame: Frame) -> str:
        """Say why a frame is not later than all that were answered; nothing where it is."""
        return "" if self.latest < frame.time < math.inf else late(frame.time, self.latest)


@dataclass(frozen=True, slots=True)
class Letter:
    """A frame as it came in."""

    seq: int
    """Count on arrival, from 0."""
    arrived: int
    """Time of its last byte, of `perf_counter_ns` [ns]."""
    clock: Clock
    opened: Callable[[], Frame | Rejected]
    """Decodes it."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """The frame that is to be answered next, and what was found wrong with newer ones."""

    seq: int
    arrived: int
    frame: Frame | None
    """None where all that came were bad."""
    clock: Clock
    rejected: tuple[Rejected, ...]


@dataclass(slots=True)
class Mailbox:
    """What has arrived and was not answered yet, bounded."""

    arrived: int = 0
    """Frames so far."""
    dropped: int = 0
    """Frames that were given up for newer ones."""
    _letters: deque[Letter] = field(default_factory=deque)

    def __len__(self) -> int:
        return len(self._letters)

    def post(self, clock: Clock, opened: Callable[[], Frame | Rejected], arrived: int | None = None) -> None:
        """Take in one frame; where too many wait, the oldest is dropped."""
        if len(self._letters) >= LOOKED_AT:
            self._letters.popleft()
            self.dropped += 1
        now = perf_counter_ns() if arrived is None else arrived
        self._letters.append(Letter(self.arrived, now, clock, opened))
        self.arrived += 1

    def skip(self, count: int) -> None:
        """Count frames that are dropped as they come in."""
        self.arrived += count
        self.dropped += count

    def newest(self) -> Arrival:
        """Take out the newest good frame; those before it are dropped, bad ones after it rejected."""
        rejected = list[Rejected]()
        while self._letters:
            letter = self._letters.pop()
            frame = letter.opened()
            if isinstance(frame, Rejected):
                rejected.append(replace(frame, seq=letter.seq))
                continue
            if reason := _too_much(frame) or letter.clock.refusal(frame):
                rejected.append(Rejected(letter.seq, frame.time, reason, frame.id))
                continue
            self.dropped += len(self._letters)
            self._letters.clear()
            return Arrival(letter.seq, letter.arrived, frame, letter.clock, tuple(reversed(rejected)))
        return Arrival(-1, 0, None, Clock(), tuple(reversed(rejected)))


def _too_much(frame: Frame) -> str:
    """Say where a frame would keep others waiting; nothing where it would not."""
    if len(frame.points) > MOST_POINTS:
        return f"the frame has {len(frame.points)} points: send {MOST_POINTS} at most"
    if isinstance(frame.id, str) and len(frame.id) > _LONGEST_ID:
        return f"the id has {len(frame.id)} characters: use {_LONGEST_ID} at most"
    return ""

"""Where frames wait for the engine: the newest wins, older ones are counted as dropped."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter_ns

from tssgeom.io.formats.recording import late
from tssgeom.io.network.lines import LOOKED_AT
from tssgeom.stream import Frame, Rejected

MOST_POINTS = 10_000
"""Points of a frame at most: more would keep all frames after it waiting."""
_LONGEST_ID = 256


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

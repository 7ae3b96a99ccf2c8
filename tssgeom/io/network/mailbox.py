"""Frames that wait for the engine: the newest wins, older ones are counted as dropped."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter_ns

from tssgeom.engine import Track
from tssgeom.errors import ShapeError
from tssgeom.io.formats.paths import LONGEST_LINE
from tssgeom.io.formats.recording import late
from tssgeom.stream import Frame, Rejected


@dataclass(frozen=True, slots=True)
class FrameLimits:
    """Limits of frames that wait, so that none delays those after it."""

    waiting: int = 16
    """Newest frames of a sender that are kept until one is used; chosen: so many bad ones may follow a good
    one."""
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

        Raises ShapeError where a line is too long; the rest of it is ignored.
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


@dataclass(slots=True, eq=False, weakref_slot=True)
class Sender:
    """One connection: its clock, its waiting frames, its fits, and the time that they took."""

    latest: float = -math.inf
    """Time of its last answered frame, on its own clock [s]."""
    offset: float = 0.0
    """Time of the stream minus time of this sender [s]."""
    before_leap: tuple[float, float] | None = None
    """`latest` and `offset` before the clock leapt to the last answered frame; None where it did not."""
    track: Track = field(default_factory=Track)
    """What the fit of its next frame starts from."""
    busy: bool = False
    """Whether a frame of it is being fitted; its later ones wait."""
    used: float = 0.0
    """Time that its frames took; once it is answered, at least that of others when it began to wait [s]."""
    arrived: int = 0
    """Frames so far."""
    waiting: deque[Waiting] = field(default_factory=deque)
    rejected: list[Rejected] = field(default_factory=list)
    """Frames newer than the good one, which is not known yet."""

    @property
    def pending(self) -> bool:
        """Whether a frame of it waits or is being fitted."""
        return self.busy or bool(self.waiting)

    @property
    def is_new(self) -> bool:
        """Whether no frame of it has been answered yet."""
        return self.latest == -math.inf

    def refusal(self, frame: Frame) -> str:
        """Return why a frame is not later than all answered ones; empty where it is."""
        latest, _ = self.clock_of(frame.time)
        return "" if latest < frame.time < math.inf else late(frame.time, latest)

    def clock_of(self, time: float) -> tuple[float, float]:
        """Return the `latest` and the `offset` that hold for a time [s]: a clock may return from a leap."""
        if self.before_leap is not None and self.before_leap[0] < time <= self.latest:
            return self.before_leap
        return self.latest, self.offset

    def answered(self, time: float, offset: float, *, leapt: bool) -> None:
        """Take in the time of an answered frame [s], and whether the clock leapt to it."""
        self.before_leap = (self.before_leap or (self.latest, self.offset)) if leapt else None
        self.latest, self.offset = time, offset


@dataclass(frozen=True, slots=True)
class Waiting:
    """An undecoded frame."""

    seq: int
    """Count on arrival, from 0."""
    arrived: int
    """Time of its last byte, of `perf_counter_ns` [ns]."""
    decode: Callable[[], Frame | Rejected]
    """Decodes the frame."""


@dataclass(frozen=True, slots=True)
class Refused:
    """Frames of a sender that were rejected; none where its next one is still to be decoded."""

    sender: Sender
    rejected: tuple[Rejected, ...]


@dataclass(frozen=True, slots=True)
class Arrival(Refused):
    """The frame that is answered next, and the newer ones of its sender that were rejected."""

    seq: int
    arrived: int
    """Time of its last byte, of `perf_counter_ns` [ns]."""
    frame: Frame


@dataclass(slots=True)
class Mailbox:
    """A bounded number of frames of each sender that have arrived and are not answered yet.

    The sender whose frames have taken the least time is next, so that none waits for the flood of another.
    """

    arrived: int = 0
    """Frames so far."""
    dropped: int = 0
    """Frames that were dropped for newer ones."""
    _senders: list[Sender] = field(default_factory=list)
    """Those with frames that wait."""
    _used: float = 0.0
    """Time that the frames of a sender had taken when its turn came, the most so far [s]."""
    _used_by_new: float = 0.0
    """Time that the frames of all new senders took together: many ports of a flood count as one [s]."""

    def __len__(self) -> int:
        """Return how many senders have a frame to be answered now."""
        return sum(not sender.busy for sender in self._senders)

    def post(
        self, sender: Sender, decode: Callable[[], Frame | Rejected], arrived: int | None = None
    ) -> None:
        """Add one frame; where too many of its sender wait, the oldest is dropped."""
        if len(sender.waiting) >= LIMITS.waiting:
            sender.waiting.popleft()
            self.dropped += 1
        sender.arrived += 1
        if not sender.waiting:
            self._senders.append(sender)
            self.charge(sender, 0.0)
        now = perf_counter_ns() if arrived is None else arrived
        sender.waiting.append(Waiting(self.arrived, now, decode))
        self.arrived += 1

    def forget(self, sender: Sender) -> None:
        """Drop the frames of a sender that is not heard any more."""
        if sender.waiting:
            self._senders.remove(sender)
            self.dropped += len(sender.waiting) + len(sender.rejected)
            sender.waiting.clear()
            sender.rejected.clear()

    def charge(self, sender: Sender, time: float) -> None:
        """Count the time that a frame took [s]; while others were served, its sender saved nothing."""
        if sender.is_new:
            self._used_by_new = max(self._used_by_new, self._used) + time
            sender.used += time
        else:
            sender.used = max(sender.used, self._used) + time

    def is_behind(self, sender: Sender) -> bool:
        """Whether a frame waits of another sender that has not taken more time: this one is not read yet."""
        share = self._share(sender)
        return any(self._share(one) <= share for one in self._senders if one is not sender and not one.busy)

    def _share(self, sender: Sender) -> float:
        return self._used_by_new if sender.is_new else sender.used

    def _turn(self, sender: Sender) -> tuple[float, float]:
        return self._share(sender), sender.used

    def skip(self, count: int) -> None:
        """Count frames that are dropped on arrival."""
        self.arrived += count
        self.dropped += count

    @property
    def next_sender(self) -> Sender | None:
        """The sender whose turn it is; None where no frame is to be answered now."""
        return min((one for one in self._senders if not one.busy), key=self._turn, default=None)

    def newest(self) -> Arrival | Refused:
        """Decode the newest frame of the sender whose turn it is, of which there must be one.

        Where it is good, the earlier ones are dropped. Where it is bad, it is kept until an earlier one is
        good, none is left, or as many bad ones are kept as may wait: then these are reported, in their order.
        """
        sender = self.next_sender
        assert sender is not None
        self._used = max(self._used, self._share(sender))
        waiting = sender.waiting.pop()
        frame = waiting.decode()
        if isinstance(frame, Rejected):
            sender.rejected.append(replace(frame, seq=waiting.seq))
        elif reason := _too_large(frame) or sender.refusal(frame):
            sender.rejected.append(Rejected(waiting.seq, frame.time, reason, frame.id))
        else:
            self.dropped += len(sender.waiting)
            sender.waiting.clear()
            return Arrival(sender, self._rejected(sender), waiting.seq, waiting.arrived, frame)
        kept = sender.waiting and len(sender.rejected) < LIMITS.waiting
        return Refused(sender, () if kept else self._rejected(sender))

    def _rejected(self, sender: Sender) -> tuple[Rejected, ...]:
        """Take out the rejected frames of a sender, the oldest first."""
        if not sender.waiting:
            self._senders.remove(sender)
        rejected = tuple(reversed(sender.rejected))
        sender.rejected.clear()
        return rejected


def _too_large(frame: Frame) -> str:
    """Return why a frame would delay others; empty where it would not."""
    if len(frame.points) > LIMITS.points:
        return f"the frame has {len(frame.points)} points: send {LIMITS.points} at most"
    if isinstance(frame.id, str) and len(frame.id) > LIMITS.id_length:
        return f"the id has {len(frame.id)} characters: use {LIMITS.id_length} at most"
    return ""

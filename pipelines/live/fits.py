"""Fits that may take long, in threads beside the stream: it goes on, and says which frame is late.

The core leaves the interpreter to other threads while it computes, so that no process is needed.
"""

from __future__ import annotations

import math
import selectors
import socket
import sys
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from queue import Empty, SimpleQueue
from threading import Lock, Thread
from time import monotonic, thread_time
from weakref import WeakKeyDictionary

from pipelines.interruption import FIT_THREAD
from pipelines.live.priorities import Rests, lower_own_priority
from tssgeom.core.binding import give_way
from tssgeom.engine import Engine, Track
from tssgeom.io.network.channel import READ
from tssgeom.io.network.mailbox import Arrival, Sender
from tssgeom.sensed_route import SensedRoute
from tssgeom.stream import Frame, Rejected


@dataclass(frozen=True, slots=True)
class FitLimits:
    """Which fits the stream makes itself, and when one is late."""

    inline: float = 3e-3
    """Time that a sender's last fits took, up to which the stream makes the next one itself [s];
    derived: half of the 5 ms in which others are to be answered, and a thread costs 0.2 ms."""
    fade: float = 0.9
    """What is left of the slowest fit's time after each quicker one [1]; chosen: a leap is remembered for
    some 30 frames."""
    more_points: float = 2.0
    """Ratio of points to those of the last frame beyond which the time is unknown [1]; chosen."""
    threads: int = 2
    """Fits at a time of senders that were answered before [1], and two more of new ones; chosen: one sender
    with long fits leaves a thread to the others."""
    first_waiting: int = 4
    """First frames that wait for their thread [1]; chosen: newer ones win, however many ports a flood has."""
    bearable: float = 20e-3
    """The same as `inline` where all threads are busy or no other sender waits [s]; chosen: less than waiting
    for a thread, and far less than the half second in which a signal is heard."""
    alone: float = 1.0
    """Time without a frame of another sender after which a sender is alone [s]; chosen."""
    switch: float = 5e-4
    """Time after which a thread leaves the interpreter to another one, while a fit is beside the stream [s];
    derived: a tenth of the 5 ms; Python's own is all of them."""
    gives_way: float = 3e-3
    """Longest time that a fit beside the stream waits before each of its parts while the stream answers [s];
    chosen: a frame takes less, and in a flood of frames the fit goes on all the same."""
    intervals: float = 3.0
    """Time between frames of a sender, times this, is the deadline of its next answer [1]; chosen."""
    least_deadline: float = 0.05
    """Least deadline that is not stated by the user [s]; chosen: less than a person notices."""
    averaged: int = 16
    """Frames over which the time between frames is averaged [1]; chosen: one late frame changes nothing."""
    few_points: int = 300
    """Points up to which the stream makes the model check of a frame itself, and up to which first fits have
    a thread of their own [1]; measured: a step of a check then takes 3 ms at most, and 5 ms are the time in
    which others are to be answered."""


_LIMITS = FitLimits()


@dataclass(slots=True)
class _Pace:
    """How fast frames of one sender come, and how long their fits take."""

    slowest: float = math.inf
    """Time of the slowest fits that went on from a last one, of the quicker of each two in a row, fading from
    frame to frame [s]; not known before the first."""
    last: float = math.inf
    """That of the last one: a single slow one is an accident of the machine."""
    points: int = 0
    """Points of the last frame."""
    interval: float = math.nan
    """Mean time between frames [s]; not known before the second."""
    arrived: int = 0
    """When the last one arrived, of `perf_counter_ns` [ns]."""

    def comes(self, arrival: Arrival) -> None:
        """Take in a frame."""
        if self.arrived:
            interval = 1e-9 * (arrival.arrived - self.arrived)
            mean = interval if math.isnan(self.interval) else self.interval
            self.interval = mean + (interval - mean) / _LIMITS.averaged
        self.arrived = arrival.arrived

    def took(self, time: float) -> None:
        """Take in the processor time of a fit [s]."""
        faded = 0.0 if math.isinf(self.slowest) else _LIMITS.fade * self.slowest
        self.slowest, self.last = max(min(time, self.last), faded), time


@dataclass(slots=True, eq=False)
class LongFit:
    """A frame that is being fitted beside the stream."""

    arrival: Arrival
    frame: Frame
    """The frame, its time on the tendon's clock."""
    first: bool
    """Whether it starts from nothing."""
    due: float
    """When it is late [s]; infinite once it is reported."""
    sensed: SensedRoute | Rejected | BaseException | None = None
    """What came of it."""
    took: float = 0.0
    """Processor time that it took [s]."""


@dataclass(slots=True)
class Fits:
    """The fits of a stream: those that are quick are its own, the others are beside it."""

    selector: selectors.BaseSelector
    engine: Engine
    deadline: float | None
    """Time in which an answer has to be out [s]; None: from the sender's rate."""
    longest_deadline: float
    """Greatest deadline that the user has not stated [s]: after it a stale line comes anyway."""
    running: list[LongFit] = field(default_factory=list)
    """Those that wait for a thread too, in the order in which they began."""
    _last: Sender | None = None
    """The sender of the last frame."""
    _turn: int = 0
    """When its first frame after one of another sender arrived, of `perf_counter_ns` [ns]."""
    _paces: WeakKeyDictionary[Sender, _Pace] = field(default_factory=WeakKeyDictionary)
    _first: SimpleQueue[LongFit] = field(default_factory=SimpleQueue)
    """First frames of new senders: however many come, they have one thread."""
    _first_of_many_points: SimpleQueue[LongFit] = field(default_factory=SimpleQueue)
    """Those that take seconds have another one, so that no new sender waits for them."""
    _next: SimpleQueue[LongFit] = field(default_factory=SimpleQueue)
    """Later frames."""
    _done: deque[LongFit] = field(default_factory=deque)
    awake: Lock = field(default_factory=Lock)
    """Held while the stream does anything but wait: fits beside it leave it the interpreter."""
    _wake: socket.socket | None = None

    def are_quick(self, arrival: Arrival, points: int) -> bool:
        """Take in a frame of so many points; return whether the stream tries the fit itself."""
        sender = arrival.sender
        pace = self._paces.setdefault(sender, _Pace())
        pace.comes(arrival)
        if sender is not self._last:
            self._last, self._turn = sender, arrival.arrived
        before, pace.points = pace.points, points
        if sender.track.last is None or not 0 <= points <= _LIMITS.more_points * before:
            return False
        if points > _LIMITS.few_points and sender.track.is_due:
            return False
        free = sum(not fit.first for fit in self.running) < _LIMITS.threads
        others = free and not self.is_alone(arrival.arrived)
        return pace.slowest <= (_LIMITS.inline if others else _LIMITS.bearable)

    def is_alone(self, at: int) -> bool:
        """Whether for some time before one of `perf_counter_ns` [ns] all frames were of one sender."""
        return 1e-9 * (at - self._turn) > _LIMITS.alone

    def check_model(self, sender: Sender, points: int) -> None:
        """Make the check that follows an answer, unless so many points are checked beside the stream."""
        self.engine.idle(sender.track if points <= _LIMITS.few_points else _NOTHING)

    def took(self, sender: Sender, time: float) -> None:
        """Take in the processor time of a fit that the stream made itself [s]."""
        self._paces[sender].took(time)

    def begin(self, arrival: Arrival, frame: Frame) -> Arrival | None:
        """Begin a fit beside the stream, for which the sender's later frames wait.

        Return the frame that is dropped for it, if one is.
        """
        if self._wake is None:
            self._start()
        if not self.running:
            sys.setswitchinterval(_LIMITS.switch)
        sender = arrival.sender
        sender.busy = True
        fit = LongFit(arrival, frame, sender.track.last is None, monotonic() + self._allowed(sender))
        self.running.append(fit)
        queue = self._next
        if fit.first:
            few = len(frame.points) <= _LIMITS.few_points
            queue = self._first if few else self._first_of_many_points
        queue.put(fit)
        if not fit.first or queue.qsize() <= _LIMITS.first_waiting:
            return None
        try:
            oldest = queue.get_nowait()
        except Empty:  # its thread was quicker
            return None
        self.running.remove(oldest)
        oldest.arrival.sender.busy = False
        return oldest.arrival

    def ended(self) -> LongFit | None:
        """Return a fit that has ended; None where there is none.

        Raises BaseException where it ended with an error that no frame should raise.
        """
        if not self._done:
            return None
        fit = self._done.popleft()
        self.running.remove(fit)
        if not self.running:
            sys.setswitchinterval(_OWN_SWITCH)
        sender = fit.arrival.sender
        sender.busy = False
        if isinstance(fit.sensed, SensedRoute) and fit.sensed.tracked.age:  # one from nothing is no estimate
            self._paces[sender].took(fit.took)
        if isinstance(fit.sensed, BaseException):
            raise fit.sensed
        return fit

    def next_due(self) -> float:
        """Return when the next fit is late [s]; infinite where none is going to be."""
        return min((fit.due for fit in self.running), default=math.inf)

    def late(self, now: float) -> list[LongFit]:
        """Return the fits that are late now [s], each once."""
        late = [fit for fit in self.running if fit.due <= now]
        for fit in late:
            fit.due = math.inf
        return late

    def _allowed(self, sender: Sender) -> float:
        if self.deadline is not None:
            return self.deadline
        interval = self._paces[sender].interval
        if math.isnan(interval):
            return self.longest_deadline
        return min(max(_LIMITS.intervals * interval, _LIMITS.least_deadline), self.longest_deadline)

    def _start(self) -> None:
        woken, self._wake = socket.socketpair()
        woken.setblocking(False)
        self._wake.setblocking(False)
        self.selector.register(woken, READ, partial(_emptied, woken))
        for work in (self._first, self._first_of_many_points, *[self._next] * _LIMITS.threads):
            Thread(target=self._serve, args=(work,), name=FIT_THREAD, daemon=True).start()

    def _give_way(self, rests: Rests) -> None:
        if rests.are_due():
            rests.take_one()
        if self.awake.locked() and self.awake.acquire(timeout=_LIMITS.gives_way):
            self.awake.release()

    def _serve(self, work: SimpleQueue[LongFit]) -> None:
        lower_own_priority()
        give_way(partial(self._give_way, Rests()))
        while True:
            fit, begun = work.get(), thread_time()
            try:
                fit.sensed = self.engine.sense(fit.arrival.frame, fit.arrival.sender.track)
            except BaseException as error:  # the stream raises it
                fit.sensed = error
            fit.took = thread_time() - begun
            self._done.append(fit)
            if self._wake is not None:
                with suppress(OSError):  # full: it is awake already
                    self._wake.send(b"\0")


_NOTHING = Track()
_OWN_SWITCH = sys.getswitchinterval()


def _emptied(woken: socket.socket, events: int) -> None:
    with suppress(OSError):
        woken.recv(1 << 12)

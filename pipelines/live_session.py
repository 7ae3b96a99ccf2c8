"""One stream: frames in from all sources, answers out to all sinks, in one thread that waits for no peer."""

from __future__ import annotations

import gc
import math
import selectors
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from time import monotonic, perf_counter_ns
from typing import Protocol

from pipelines.live_numbers import Numbers
from tssgeom.io.network.mailbox import Arrival, Clock, Mailbox
from tssgeom.io.network.sinks import Sink
from tssgeom.io.network.sources import Source
from tssgeom.io.results import answers
from tssgeom.stream import Frame, FrameResult, Rejected

TICK = 1.0
"""Time from one round of housekeeping to the next [s]."""
_LEAST, _MOST = 1e-3, 60.0  # s that pass from the last frame of one clock to the first of another
_SOON = 2e-3
"""Time between frames up to which the next one is awaited without sleep [s]."""
_SMOOTHED = 16  # frames over which that time is taken
_FLUSH = 1.0  # s in which sinks may take what still waits for them at the end


class Beside(Protocol):
    """Who takes in answered frames when their answers are out."""

    def take(self, result: FrameResult, now: float) -> None:
        """Take in a frame answered `now` [s]."""
        ...

    def flush(self) -> None:
        """Hand on what has been kept back."""
        ...


@dataclass(slots=True)
class Session:
    """Sources, sinks, and what is between them."""

    selector: selectors.BaseSelector
    mailbox: Mailbox
    sources: Sequence[Source]
    sinks: list[Sink]
    stale_after: float
    """Time without a good frame after which that is said [s]."""
    ticked: Callable[[], object]
    """Called once a second."""
    spin: bool = False
    """Whether to await the next frame without sleep while frames come fast."""
    besides: Sequence[Beside] = ()
    """Who takes in answered frames beside the sinks."""
    time: float = -math.inf
    """Time of the last answered frame, as the tendon has it [s]."""
    numbers: Numbers = field(default_factory=Numbers)
    stopping: bool = False
    _present: Arrival | None = None
    """The frame that was yielded last."""
    _ahead: float = 0.0
    """Time of the stream less that of its sender [s]."""
    _good: Arrival | None = None
    """The last frame that was answered and not rejected."""
    _heard: float = math.inf
    """When the last good frame was answered [s]; infinite where that was said to be long ago, or never."""
    _answered: float = field(default_factory=monotonic)
    """When the last good frame was answered [s]; before the first one, when the session began."""
    _next_tick: float = 0.0
    _gap: float = math.inf
    """Time between frames, as it was of late [s]."""

    def frames(self) -> Iterator[Frame]:
        """Yield the newest good frame when the last one has been answered, until all sources end."""
        self.numbers.begin()
        self._next_tick = monotonic() + TICK
        while not self.stopping:
            if not len(self.mailbox) and all(source.ended for source in self.sources):
                return
            self._turn()
            if not len(self.mailbox):
                continue
            arrival = self.mailbox.newest()
            if arrival.frame is not None:
                self._note_gap(arrival)
                self._present = arrival
                yield self._in_stream_time(arrival.frame, arrival.clock)
            for rejected in arrival.rejected:
                self._refuse(rejected)

    def _in_stream_time(self, frame: Frame, clock: Clock) -> Frame:
        """Put a frame after all before it, though its sender's clock may have begun anew.

        The tendon's own time never goes back: what creeps goes on creeping when a sender is replaced. The
        time of the frame counts only once it is answered: it may yet be rejected.
        """
        self._ahead = clock.ahead
        if not frame.time + clock.ahead > self.time:
            passed = min(max(monotonic() - self._answered, _LEAST), _MOST)
            self._ahead = self.time + passed - frame.time
        return frame if self._ahead == 0.0 else replace(frame, time=frame.time + self._ahead)

    def _note_gap(self, arrival: Arrival) -> None:
        if self._present is not None:
            gap = min(1e-9 * (arrival.arrived - self._present.arrived), 1.0)
            self._gap = gap if math.isinf(self._gap) else self._gap + (gap - self._gap) / _SMOOTHED

    def answer(self, result: FrameResult | Rejected) -> None:
        """Tell all sinks what the engine made of the frame that was yielded last."""
        arrival = self._present
        assert arrival is not None
        frame = arrival.frame
        assert frame is not None
        if isinstance(result, Rejected):
            self._refuse(Rejected(arrival.seq, frame.time, result.reason, result.id))
            return
        self._good, self.time = arrival, frame.time + self._ahead
        arrival.clock.latest, arrival.clock.ahead = frame.time, self._ahead
        self._heard = self._answered = monotonic()
        waited = (perf_counter_ns() - arrival.arrived) / 1e3
        line = answers.answer(result, frame.time, arrival.seq, round(waited, 1), self.mailbox.dropped)
        for sink in self.sinks:
            sink.publish(line, result)
        self.numbers.add(result, (perf_counter_ns() - arrival.arrived) / 1e3)
        for one in self.besides:
            one.take(result, self._heard)

    def stop(self) -> None:
        """Take no further frame."""
        self.stopping = True

    def close(self) -> None:
        """Give the sinks a moment for what still waits, and let go of everything."""
        for source in self.sources:
            source.close()
        end = monotonic() + _FLUSH
        while any(sink.waiting for sink in self.sinks) and (left := end - monotonic()) > 0:
            self._call_back(left)
        for sink in self.sinks:
            sink.close()
        for one in self.besides:
            one.flush()

    def _refuse(self, rejected: Rejected) -> None:
        self.numbers.rejected += 1
        line = answers.refusal(rejected)
        for sink in self.sinks:
            sink.publish(line, None)

    def _turn(self) -> None:
        """Let peers be heard, wait for them if there is nothing else to do, and keep house."""
        due = self._next_due()
        self._call_back(0.0 if len(self.mailbox) else max(due - monotonic(), 0.0))
        now = monotonic()
        for source in self.sources:
            if len(self.mailbox):
                break
            if (pulled := source.due()) is not None and pulled <= now:
                source.pull()
        if now - self._heard >= self.stale_after and not len(self.mailbox):
            self._say_stale(now)
        if now >= self._next_tick:
            self._next_tick = now + TICK
            self._tick()

    def _next_due(self) -> float:
        due = min(self._next_tick, self._heard + self.stale_after)
        for source in self.sources:
            if (pulled := source.due()) is not None:
                due = min(due, pulled)
        return due

    def _call_back(self, timeout: float) -> None:
        for key, events in self._heard_from(timeout):
            key.data(events)

    def _heard_from(self, timeout: float) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait for peers; without sleep where the next frame is due soon, as to be woken takes time."""
        if timeout > 0.0 and self.spin and self._gap < _SOON:
            end = monotonic() + min(timeout, _SOON)
            while monotonic() < end:
                if ready := self.selector.select(0.0):
                    return ready
        return self.selector.select(timeout)

    def _say_stale(self, now: float) -> None:
        arrival = self._good
        if arrival is not None and arrival.frame is not None:
            silent = now - self._heard
            line = answers.stale(arrival.frame.time, arrival.seq, silent, self.mailbox.dropped)
            for sink in self.sinks:
                sink.publish(line, None)
        self._heard, self.numbers.stale = math.inf, True

    def _tick(self) -> None:
        for part in (*self.sources, *self.sinks):
            part.tick()
        for one in self.besides:
            one.flush()
        self.sinks[:] = [sink for sink in self.sinks if not sink.broken]
        if not self.sinks:
            self.stop()
        self.ticked()
        gc.collect(0)

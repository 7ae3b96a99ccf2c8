"""One stream: frames in from all sources, answers out to all sinks, in one thread that waits for no peer."""

from __future__ import annotations

import gc
import math
import selectors
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from time import monotonic, perf_counter_ns
from typing import Protocol

from pipelines.live.status import Statistics
from tssgeom.io.network.mailbox import Arrival, Clock, Mailbox
from tssgeom.io.network.sinks import Sink
from tssgeom.io.network.sources import Source
from tssgeom.io.results import answers
from tssgeom.stream import Frame, FrameResult, Rejected


@dataclass(frozen=True, slots=True)
class LiveLimits:
    """Times of a stream."""

    housekeeping: float = 1.0
    """Time from one round of housekeeping and statistics to the next [s]; `--stats` promises it."""
    least_pause: float = 1e-3
    """Least time from the last frame of one clock to the first of another [s]; chosen: time increases."""
    longest_pause: float = 60.0
    """Greatest such time [s]; chosen: a tendon does not creep through a night of silence."""
    no_sleep_interval: float = 2e-3
    """Time between frames up to which the next one is awaited without sleep [s].
    Measured: waking takes 0.1 ms, a twentieth of it."""
    smoothed_frames: int = 16
    """Frames over which that time is averaged [1]; chosen: one late frame changes nothing."""
    last_flush: float = 1.0
    """Time in which sinks may take waiting lines at the end [s]; chosen."""


_LIMITS = LiveLimits()


class ResultConsumer(Protocol):
    """Takes in answered frames after their answers are sent."""

    def take(self, result: FrameResult, now: float) -> None:
        """Take in a frame answered `now` [s]."""
        ...

    def flush(self) -> None:
        """Send what waits."""
        ...

    def finish(self) -> None:
        """Send the last."""
        ...


@dataclass(slots=True)
class Session:
    """Sources, sinks, and the frame between them."""

    selector: selectors.BaseSelector
    mailbox: Mailbox
    sources: Sequence[Source]
    sinks: list[Sink]
    stale_after: float
    """Time without a good frame after which a stale line is sent [s]."""
    report_statistics: Callable[[], object]
    """Called at each housekeeping."""
    spin: bool = False
    """Whether to await the next frame without sleep while frames come fast."""
    consumers: Sequence[ResultConsumer] = ()
    """Take in answered frames beside the sinks."""
    time: float = -math.inf
    """Time of the last answered frame, on the tendon's clock [s]."""
    statistics: Statistics = field(default_factory=Statistics)
    stopping: bool = False
    _present: Arrival | None = None
    """The frame that was yielded last."""
    _clock_offset: float = 0.0
    """The tendon's clock less the sender's [s]."""
    _last_good: Arrival | None = None
    """The last frame that was answered and not rejected."""
    _fresh_since: float = math.inf
    """When the last good frame was answered [s]; infinite before the first, and after its stale line."""
    _last_answer: float = field(default_factory=monotonic)
    """When the last good frame was answered [s]; before the first one, when the session began."""
    _next_housekeeping: float = 0.0
    _frame_interval: float = math.inf
    """Time between frames, averaged over the last ones [s]."""

    def frames(self) -> Iterator[Frame]:
        """Yield the newest good frame when the last one has been answered, until all sources end."""
        self.statistics.begin()
        self._next_housekeeping = monotonic() + _LIMITS.housekeeping
        while not self.stopping:
            if not len(self.mailbox) and all(source.ended for source in self.sources):
                return
            self._serve()
            if not len(self.mailbox):
                continue
            arrival = self.mailbox.newest()
            if arrival.frame is not None:
                self._measure_interval(arrival)
                self._present = arrival
                yield self._on_tendon_clock(arrival.frame, arrival.clock)
            for rejected in arrival.rejected:
                self._refuse(rejected)

    def _on_tendon_clock(self, frame: Frame, clock: Clock) -> Frame:
        """Shift the time of a frame so that it is later than all before it, whatever clock its sender has.

        The tendon's clock never goes back, so creep goes on when a sender is replaced. The offset is kept
        only when the frame is answered, since it may still be rejected.
        """
        offset = clock.offset
        if not frame.time + offset > self.time:
            pause = monotonic() - self._last_answer
            offset = self.time + min(max(pause, _LIMITS.least_pause), _LIMITS.longest_pause) - frame.time
        self._clock_offset = offset
        return frame if offset == 0.0 else replace(frame, time=frame.time + offset)

    def _measure_interval(self, arrival: Arrival) -> None:
        if self._present is not None:
            interval = min(1e-9 * (arrival.arrived - self._present.arrived), 1.0)
            mean = interval if math.isinf(self._frame_interval) else self._frame_interval
            self._frame_interval = mean + (interval - mean) / _LIMITS.smoothed_frames

    def answer(self, result: FrameResult | Rejected) -> None:
        """Send the result of the frame that was yielded last to all sinks."""
        arrival = self._present
        assert arrival is not None
        frame = arrival.frame
        assert frame is not None
        if isinstance(result, Rejected):
            self._refuse(Rejected(arrival.seq, frame.time, result.reason, result.id))
            return
        self._last_good, self.time = arrival, frame.time + self._clock_offset
        arrival.clock.latest, arrival.clock.offset = frame.time, self._clock_offset
        self._fresh_since = self._last_answer = monotonic()
        latency_us = (perf_counter_ns() - arrival.arrived) / 1e3
        line = answers.answer(result, frame.time, arrival.seq, round(latency_us, 1), self.mailbox.dropped)
        for sink in self.sinks:
            sink.publish(line, result)
        self.statistics.add(result, (perf_counter_ns() - arrival.arrived) / 1e3)
        for consumer in self.consumers:
            consumer.take(result, self._last_answer)

    def stop(self) -> None:
        """Take no further frame."""
        self.stopping = True

    def close(self) -> None:
        """Let the sinks take the lines that wait, for a limited time, and close everything."""
        for source in self.sources:
            source.close()
        end = monotonic() + _LIMITS.last_flush
        while any(sink.waiting for sink in self.sinks) and (left := end - monotonic()) > 0:
            self._call_back(left)
        for sink in self.sinks:
            sink.close()
        for consumer in self.consumers:
            consumer.finish()

    def _refuse(self, rejected: Rejected) -> None:
        self.statistics.rejected += 1
        line = answers.refusal(rejected)
        for sink in self.sinks:
            sink.publish(line, None)

    def _serve(self) -> None:
        """Read and write at all peers, wait where no frame is there, and do the housekeeping that is due."""
        due = self._next_due()
        self._call_back(0.0 if len(self.mailbox) else max(due - monotonic(), 0.0))
        now = monotonic()
        for source in self.sources:
            if len(self.mailbox):
                break
            if (pulled := source.due()) is not None and pulled <= now:
                source.pull()
        if now - self._fresh_since >= self.stale_after and not len(self.mailbox):
            self._send_stale(now)
        if now >= self._next_housekeeping:
            self._next_housekeeping = now + _LIMITS.housekeeping
            self._keep_house()

    def _next_due(self) -> float:
        due = min(self._next_housekeeping, self._fresh_since + self.stale_after)
        for source in self.sources:
            if (pulled := source.due()) is not None:
                due = min(due, pulled)
        return due

    def _call_back(self, timeout: float) -> None:
        for key, events in self._ready(timeout):
            key.data(events)

    def _ready(self, timeout: float) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait for peers; without sleep where the next frame is due soon, since waking takes time."""
        if timeout > 0.0 and self.spin and self._frame_interval < _LIMITS.no_sleep_interval:
            end = monotonic() + min(timeout, _LIMITS.no_sleep_interval)
            while monotonic() < end:
                if ready := self.selector.select(0.0):
                    return ready
        return self.selector.select(timeout)

    def _send_stale(self, now: float) -> None:
        arrival = self._last_good
        if arrival is not None and arrival.frame is not None:
            silent = now - self._fresh_since
            line = answers.stale(arrival.frame.time, arrival.seq, silent, self.mailbox.dropped)
            for sink in self.sinks:
                sink.publish(line, None)
        self._fresh_since, self.statistics.stale = math.inf, True

    def _keep_house(self) -> None:
        for part in (*self.sources, *self.sinks):
            part.tick()
        for consumer in self.consumers:
            consumer.flush()
        self.sinks[:] = [sink for sink in self.sinks if not sink.broken]
        if not self.sinks:
            self.stop()
        self.report_statistics()
        gc.collect(0)

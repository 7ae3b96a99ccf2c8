"""One stream: frames in from all sources, answers out to all sinks, in one thread that waits for no peer."""

from __future__ import annotations

import gc
import math
import selectors
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from time import monotonic, perf_counter_ns, thread_time
from typing import Protocol, TypeVar

from pipelines.live.fits import Fits, LongFit
from pipelines.live.priorities import Rests
from pipelines.live.status import Statistics
from tssgeom.io.network.mailbox import Arrival, Mailbox, Refused, Sender
from tssgeom.io.network.sinks import Sink
from tssgeom.io.network.sources import Source
from tssgeom.io.results import answers
from tssgeom.sensed_route import SensedRoute
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
    longest_step: float = 3600.0
    """Greatest time from one frame of a clock to its next, or from a saved state to the first frame [s];
    chosen: longer pauses than between two readings of one experiment."""
    latest_start: float = 1e11
    """Greatest time at which a tendon's clock begins [s]; chosen: beyond it a clock of today is in another
    unit, and the time between frames is rounded to 15 µs."""
    no_sleep_interval: float = 0.011
    """Time between frames up to which the next one is awaited without sleep [s]; chosen: 100 a second are.
    Measured: at 200 a second the answer to 200 points takes 0.8 ms, and 1.6 ms after a sleep."""
    smoothed_frames: int = 16
    """Frames over which that time is averaged [1]; chosen: one late frame changes nothing."""
    last_flush: float = 1.0
    """Time in which sinks may take waiting lines at the end [s]; chosen."""


_LIMITS = LiveLimits()
_Waited = TypeVar("_Waited")


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
    report: Callable[[str], object]
    """Called with a sentence for the user."""
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
    fits: Fits = field(init=False)
    """The engine, and the fits that it makes; set before `run`."""
    statistics: Statistics = field(default_factory=Statistics)
    stopping: bool = False
    _arrived: int = 0
    """When the last frame arrived that was taken, of `perf_counter_ns` [ns]; 0 before the first."""
    _last_good: Arrival | None = None
    """The last frame that was answered and not rejected."""
    _before_last: Sender | None = None
    """The sender that was answered before that of the last good frame."""
    _said_many: bool = False
    """Whether it was said that senders take turns."""
    _fresh_since: float = math.inf
    """When the last good frame was answered [s]; infinite before the first, and after its stale line."""
    _last_answer: float = field(default_factory=monotonic)
    """When the last good frame was answered [s]; before the first one, when the session began."""
    _next_housekeeping: float = 0.0
    _rests: Rests = field(default_factory=Rests)
    _taken: Sender | None = None
    """The sender of the last frame that was decoded."""
    _frame_interval: float = math.inf
    """Time between frames, averaged over the last ones [s]."""

    def run(self) -> None:
        """Answer the newest good frame of each sender in turn, until all sources end or `stop` is called."""
        self.statistics.begin()
        self.fits.awake.acquire()
        self._next_housekeeping = monotonic() + _LIMITS.housekeeping
        while not (self.stopping or self._at_end):
            self._serve()
            while (fit := self.fits.ended()) is not None:
                self._finish(fit)
            if self._rests.are_due(urgent=self._another_waits or self.fits.is_alone(self._arrived)):
                self._leave_interpreter(self._rests.take_one)
            elif len(self.mailbox):
                self._take_next()

    @property
    def _at_end(self) -> bool:
        waiting = len(self.mailbox) or self.fits.running
        return not waiting and all(source.ended for source in self.sources)

    @property
    def _another_waits(self) -> bool:
        """Whether the next frame is of a sender in use that has waited for the last one, of another."""
        sender = self.mailbox.next_sender
        return sender is not None and sender is not self._taken and not sender.is_new

    def _take_next(self) -> None:
        """Decode the next frame, and answer it or begin its fit."""
        begun = perf_counter_ns()
        arrival = self.mailbox.newest()
        self._taken = arrival.sender
        if not isinstance(arrival, Arrival):
            self._refuse_all(arrival)
        else:
            self._measure_interval(arrival)
            frame = self._on_tendon_clock(arrival.frame, arrival.sender)
            quick = self.fits.are_quick(arrival, len(frame.points))
            if not (quick and self._answered_now(arrival, frame)):
                self._begin_fit(arrival, frame)
        self.mailbox.charge(arrival.sender, 1e-9 * (perf_counter_ns() - begun))

    def _begin_fit(self, arrival: Arrival, frame: Frame) -> None:
        if (dropped := self.fits.begin(arrival, frame)) is not None:
            self.mailbox.dropped += 1
            self._refuse_all(dropped)

    def _answered_now(self, arrival: Arrival, frame: Frame) -> bool:
        """Answer a frame whose fit goes on from the last one; return whether it does."""
        engine, sender, begun = self.fits.engine, arrival.sender, thread_time()
        sensed = engine.sense_warm(arrival.frame, sender.track)  # its filters go by the sender's own clock
        if sensed is None:
            self.fits.took(sender, thread_time() - begun)
            return False
        if isinstance(sensed, SensedRoute):
            sensed = engine.push(frame, track=sender.track, sensed=sensed)
        self._answer(arrival, frame, sensed)
        self.fits.took(sender, thread_time() - begun)
        self.fits.check_model(sender, len(frame.points))  # the answer is out: no frame that arrived waits
        self._refuse_all(arrival)
        return True

    def _finish(self, fit: LongFit) -> None:
        """Answer a frame that was fitted beside the stream; others may have moved the tendon since."""
        arrival, frame, sensed = fit.arrival, fit.frame, fit.sensed
        self.mailbox.charge(arrival.sender, fit.took)
        if frame.time <= self.time:
            frame = self._on_tendon_clock(arrival.frame, arrival.sender)
        if isinstance(sensed, SensedRoute):
            sensed = self.fits.engine.push(frame, track=arrival.sender.track, sensed=sensed)
        assert isinstance(sensed, FrameResult | Rejected)
        self._answer(arrival, frame, sensed)
        self._refuse_all(arrival)

    def _on_tendon_clock(self, frame: Frame, sender: Sender) -> Frame:
        """Shift the time of a frame so that it is later than all before it, whatever clock its sender has.

        The tendon's clock never goes back, so creep goes on when a sender is replaced, and it never leaps:
        where a clock does, or where a new one joins others, it goes on by the time that has passed here. It
        is kept only when the frame is answered, since the frame may still be rejected.
        """
        latest, offset = sender.clock_of(frame.time)
        time, warnings = frame.time + offset, frame.warnings
        step = time - self.time
        joins = self._last_good is not None and latest == -math.inf
        if math.isinf(self.time):
            if abs(time) > _LIMITS.latest_start:
                time = 0.0
                warnings += (f"t is {frame.time:g} s: the tendon's clock begins at 0 s; send seconds",)
        elif joins or not 0.0 < step <= _LIMITS.longest_step:
            passed = monotonic() - self._last_answer
            passed = min(max(passed, _LIMITS.least_pause), _LIMITS.longest_pause)
            time = self.time + passed
            if step > _LIMITS.longest_step:
                leap = f"t is {step:.3g} s later than the last frame: it counts as {passed:.3g} s"
                warnings += (f"{leap}; send seconds of one clock",)
        if time != frame.time + offset:
            sender.track.watch.leave_clock()
        if time == frame.time and warnings is frame.warnings:
            return frame
        return replace(frame, time=time, warnings=warnings)

    def _measure_interval(self, arrival: Arrival) -> None:
        if self._arrived:
            interval = min(1e-9 * (arrival.arrived - self._arrived), 1.0)
            mean = interval if math.isinf(self._frame_interval) else self._frame_interval
            self._frame_interval = mean + (interval - mean) / _LIMITS.smoothed_frames
        self._arrived = arrival.arrived

    def _answer(self, arrival: Arrival, frame: Frame, result: FrameResult | Rejected) -> None:
        """Send the result of a frame, whose time is on the tendon's clock, to all sinks."""
        given, sender = arrival.frame, arrival.sender
        if isinstance(result, Rejected):
            self._refuse(Rejected(arrival.seq, given.time, result.reason, result.id))
            return
        self._note_turns(sender)
        self._last_good, self.time = arrival, frame.time
        sender.answered(given.time, frame.time - given.time, leapt=_leaps(given.time, sender))
        self._fresh_since = self._last_answer = monotonic()
        latency_us = (perf_counter_ns() - arrival.arrived) / 1e3
        line = answers.answer(result, given.time, arrival.seq, round(latency_us, 1), self.mailbox.dropped)
        self._publish(line, result)
        self.statistics.add(result, (perf_counter_ns() - arrival.arrived) / 1e3)
        for consumer in self.consumers:
            consumer.take(result, self._last_answer)

    def _note_turns(self, sender: Sender) -> None:
        """Say once where a second sender does not replace the first one, but both go on."""
        last = None if self._last_good is None else self._last_good.sender
        if last is None or last is sender:
            return
        if sender is self._before_last and not self._said_many:
            self._said_many = True
            self.report(
                "two senders drive one tendon: each has its own fits, filters and clock; end one of them, or "
                "let one sensor send from one connection"
            )
        self._before_last = last

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

    def _publish(self, line: bytes, result: FrameResult | None = None) -> None:
        for sink in self.sinks:
            sink.publish(line, result)

    def _refuse_all(self, of: Refused) -> None:
        for rejected in of.rejected:
            self._refuse(rejected)

    def _refuse(self, rejected: Rejected) -> None:
        self.statistics.reject(rejected.reason)
        self._publish(answers.refusal(rejected))

    def _serve(self) -> None:
        """Read and write at all peers, wait where no frame is there, and do the housekeeping that is due."""
        due = self._next_due()
        self._call_back(0.0 if len(self.mailbox) else max(due - monotonic(), 0.0))
        now = monotonic()
        for source in self.sources:
            if (pulled := source.due()) is not None and pulled <= now:
                source.pull()
        for fit in self.fits.late(now):
            self._say_late(fit.arrival)
        if now - self._fresh_since >= self.stale_after and not len(self.mailbox):
            self._send_stale(now)
        if now >= self._next_housekeeping:
            self._next_housekeeping = now + _LIMITS.housekeeping
            self._keep_house()

    def _next_due(self) -> float:
        pulls = (pulled for source in self.sources if (pulled := source.due()) is not None)
        stale = self._fresh_since + self.stale_after
        return min(self._next_housekeeping, stale, self.fits.next_due(), *pulls)

    def _call_back(self, timeout: float) -> None:
        for key, events in self._ready(timeout):
            key.data(events)

    def _ready(self, timeout: float) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait for peers; where a frame is due soon, without sleep but for rests, since waking takes time."""
        if timeout > 0.0 and self.spin and self._frame_interval < _LIMITS.no_sleep_interval:
            end = monotonic() + min(timeout, _LIMITS.no_sleep_interval)
            while monotonic() < end:
                if ready := self.selector.select(0.0):
                    return ready
                left = self._frame_interval - 1e-9 * (perf_counter_ns() - self._arrived)
                if self._rests.end_within(left) and self._rests.are_due():
                    self._leave_interpreter(self._rests.take_one)
        return self._leave_interpreter(partial(self.selector.select, timeout))

    def _leave_interpreter(self, wait: Callable[[], _Waited]) -> _Waited:
        """Wait, and let fits beside the stream go on."""
        self.fits.awake.release()
        try:
            return wait()
        finally:
            self.fits.awake.acquire()

    def _send_stale(self, now: float) -> None:
        arrival = self._last_good
        if arrival is not None:
            silent = now - self._fresh_since
            self._publish(answers.stale(arrival.frame.time, arrival.seq, silent, self.mailbox.dropped))
        self._fresh_since, self.statistics.stale = math.inf, True

    def _say_late(self, arrival: Arrival) -> None:
        good, waited = self._last_good, 1e-9 * (perf_counter_ns() - arrival.arrived)
        time, seq = (None, -1) if good is None else (good.frame.time, good.seq)
        self._publish(answers.late(time, seq, arrival.seq, waited, self.mailbox.dropped))

    def _keep_house(self) -> None:
        for part in (*self.sources, *self.sinks):
            part.tick()
        for consumer in self.consumers:
            consumer.flush()
        self.sinks[:] = [sink for sink in self.sinks if not sink.broken]
        if not self.sinks:
            self.stop()
        self.report_statistics()
        gc.collect()  # of what came since the start, which is little: clients that have gone outlive a round


def _leaps(time: float, sender: Sender) -> bool:
    """Whether the clock of a sender leaps to a time [s], or begins at one that none has."""
    latest, _ = sender.clock_of(time)
    return time - latest > _LIMITS.longest_step if math.isfinite(latest) else abs(time) > _LIMITS.latest_start

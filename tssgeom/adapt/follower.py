"""A rig that follows its readings in a stream: the filter, the watch beside it, and its alerts."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from tssgeom.adapt.alert import Alert, Cause
from tssgeom.adapt.diagnosis import SLICE, Explanation
from tssgeom.adapt.ensemble import Ensemble
from tssgeom.adapt.kinds import kind_of, remarks
from tssgeom.adapt.members import SETTINGS
from tssgeom.adapt.readings import FollowedRig, Moment
from tssgeom.adapt.saved import SavedFilter
from tssgeom.adapt.watch import WATCH, Watch
from tssgeom.errors import SettingsError, TssgeomError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.statistics import HELD
from tssgeom.tendon.machine_stream import CarriedMachine
from tssgeom.tendon.state import TendonState


class FollowerSettings(NamedTuple):
    """Numbers of what happens about an alarm."""

    kept: float = 15.0
    """Time for which readings are kept [s]. Chosen: a few strokes."""
    copies: float = 1.0
    """Time between two copies of the filter [s]. Chosen: a fault is then at most so much younger."""
    comparisons: tuple[float, ...] = (1.5, 4.0, 8.0)
    """Times after an alarm at which mechanisms are compared [s]. Chosen: a stroke, and two more."""
    quiet: float = 60.0
    """Time without a disagreement after which an alert ends [s]. Chosen: several strokes."""


_SETTINGS = FollowerSettings()


class Follower:
    """Follows a rig from frame to frame.

    Parameters
    ----------
    rig
        The rig as its file has it.
    seed
        Of the filter.
    saved
        A filter of this rig to go on with.
    """

    def __init__(self, rig: Rig, *, seed: int = 0, saved: SavedFilter | None = None) -> None:
        self._first, self._seed = rig, seed
        self._warnings = tuple[str, ...]()
        self._kind = kind_of(rig)
        self._filter: Ensemble | None = None
        self._watch = Watch(self._kind.channels)
        self._copies = deque[Ensemble]()
        self._moments = deque[Moment]()
        self._alert: Alert | None = None
        self._concluded = False
        """Whether every comparison of an alert is done."""
        self._adopted = False
        """Whether its mechanism is in the rig."""
        self._alarmed = self._disagreed = math.nan
        self._compared = 0
        self._work: Iterator[tuple[Explanation, ...] | None] | None = None
        self._next: Iterator[Ensemble | None] | None = None
        self._coldest = math.nan
        self._worked = True
        """Whether work was done since the last frame."""
        self.carried = self._kind.carried()
        """The mean tendon, or machine, and its rig, as streams carry them."""
        self.known: FollowedRig | None = None
        """What is known after the last frame."""
        if saved is not None:
            self._go_on(saved)

    @property
    def rig(self) -> Rig:
        """The rig as it is now."""
        if self._filter is None:
            return self._first
        return self._kind.stated(self._filter.rig_now())

    @property
    def taken(self) -> Any:
        """What was used of the readings of the last frame."""
        return self._moments[-1].readings

    @property
    def filter(self) -> Ensemble | None:
        """The filter; None before the first frame."""
        return self._filter

    @property
    def alert(self) -> Alert | None:
        """What readings and model disagree in; None where they do not."""
        return self._alert

    @property
    def warnings(self) -> tuple[str, ...]:
        """What had to be assumed, a sentence each."""
        return self._warnings

    def begin(self, arcs: Arcs, readings: Any, state: TendonState | CarriedMachine | None = None) -> Ensemble:
        """Return the filter; it begins with the first frame, on its route, with the history of its tendon.

        Raises
        ------
        SettingsError
            Where what is to be followed cannot be.
        """
        if self._filter is None:
            self._filter = self._kind.begin(arcs, readings, state, self._seed)
            self._warnings = remarks(self._kind, readings)
        return self._filter

    def _go_on(self, saved: SavedFilter) -> None:
        self._filter, self._kind.measured = saved.restored(self._kind.with_noise()[0]), saved.measured
        self._coldest = saved.coldest
        self.carried.restart(saved.sensed, self.rig)
        self._alert, self._disagreed = saved.alert, saved.disagreed
        self._concluded = saved.alert is not None  # what it would be compared by is gone

    def saved(self) -> SavedFilter | None:
        """Return what a filter needs to go on after a restart; None before the first frame."""
        now = self._filter
        if now is None or math.isnan(now.time):
            return None
        sensed = now.cut if self.carried.sensed is None else self.carried.sensed
        kept = self._kind.captured(now, sensed, self._coldest)
        return replace(kept, alert=self._alert, disagreed=self._disagreed)

    def take(self, arcs: Arcs, readings: Any, time: float, temperature: float | None = None) -> FollowedRig:
        """Take in a frame.

        Raises
        ------
        SettingsError
            Where what is to be followed cannot be, or where time does not increase.
        FitError
            Where the tendon finds no equilibrium.
        """
        now = self.begin(arcs, readings)
        if not math.isnan(now.time) and not time > now.time:
            raise SettingsError(f"time goes from {now.time:g} to {time:g} s: give increasing times")
        readings = self._kind.usable(readings, now.muted)
        if temperature is not None and math.isnan(self._coldest):
            self._coldest = temperature
        warmth = 0.0 if temperature is None else temperature - self._coldest
        moment = Moment(time, arcs, readings, warmth)
        self._keep(moment)
        try:
            self.known = now.step(moment)
        except TssgeomError:
            self._moments.pop()
            raise
        self._compare(self.known, time)
        self._worked = False
        return self.known

    def kept(self) -> Ensemble | None:
        """Return the filter as it is, for `go_back`."""
        return None if self._filter is None else self._filter.copied()

    def go_back(self, kept: Ensemble | None) -> None:
        """Forget the frame that came since the filter was `kept`."""
        self._filter = kept
        self._moments.pop()

    def catch_up(self) -> None:
        """Do a slice of the work before a frame where none was done after the last: readings wait for it."""
        if not self._worked:
            self.work()

    def work(self) -> None:
        """Do a slice of the work that no frame waits for."""
        self._worked = True
        if self._next is not None:
            following = next(self._next)
            if following is not None:
                self._adopt(following)
            return
        if self._alert is None or self._concluded or self._filter is None:
            return
        if self._work is None:
            comparisons = _SETTINGS.comparisons
            if self._filter.time >= self._alarmed + comparisons[self._compared]:
                self._compared += 1
                self._work = self._search()
            return
        try:
            result = next(self._work, ())
        except (TssgeomError, ArithmeticError):  # what explains nothing may not stop the stream
            result = ()
        if result is not None:
            self._work = None
            self._conclude(result)

    def _compare(self, known: FollowedRig, time: float) -> None:
        """Let an alert begin where readings and model disagree, and end where they agree again for long."""
        disagreement = self._watch.take(known.off, known.off_sd, known.beyond, time)
        if disagreement is not None:
            self._disagreed = time
            if self._alert is None or (self._concluded and self._next is None):
                if self._alert is None or self._adopted:  # what is in the rig explains nothing further
                    since = disagreement.since
                    self._alert = Alert(disagreement.channel, since, self._phase(since))
                self._alarmed, self._compared, self._concluded, self._adopted = time, 0, False, False
        elif self._is_over(time):
            self._alert, self._concluded = None, False

    def _is_over(self, time: float) -> bool:
        """Whether readings and model agree again; a sensor that is not used any more disagrees for ever."""
        done = self._concluded and self._next is None and time > self._disagreed + _SETTINGS.quiet
        return done and self._filter is not None and not self._filter.muted

    def _keep(self, moment: Moment) -> None:
        """Keep what came in, and copies of the filter, from which an alert is explained."""
        self._moments.append(moment)
        copies, now = self._copies, self._filter
        assert now is not None
        if (
            math.isnan(now.time)
            or (self._alert is not None and not self._concluded)
            or self._next is not None
        ):
            return
        if not copies or moment.time >= copies[-1].time + _SETTINGS.copies:
            copies.append(now.copied())
        oldest = moment.time - _SETTINGS.kept
        while len(copies) > 2 and copies[1].time < oldest:
            copies.popleft()
        while self._moments[0].time < copies[0].time:
            self._moments.popleft()

    def _search(self) -> Iterator[tuple[Explanation, ...] | None]:
        assert self._alert is not None
        sound = [one for one in self._copies if one.time <= self._alert.since - WATCH.onset]
        start = sound[-1] if sound else self._copies[0]
        return self._kind.explained(start, list(self._moments), self._alert.since)

    def _conclude(self, result: tuple[Explanation, ...]) -> None:
        assert self._alert is not None
        causes = tuple(Cause(one.mechanism, one.where, one.probability, one.sentence) for one in result)
        self._alert = replace(self._alert, explanations=causes)
        self._concluded = self._compared >= len(_SETTINGS.comparisons)
        following = result[0].filter if result else None
        if self._concluded and following is not None and result[0].probability >= HELD:
            self._next = self._caught_up(following)

    def _caught_up(self, following: Ensemble) -> Iterator[Ensemble | None]:
        """Let the likeliest mechanism take in the frames that came while it was sought; yield it at last."""
        while True:
            waiting = [one for one in self._moments if one.time > following.time]
            for one in waiting[:SLICE]:
                try:
                    following.step(one)
                except TssgeomError:
                    yield following
            if len(waiting) <= SLICE:
                yield following
            yield None

    def _adopt(self, following: Ensemble) -> None:
        """Go on with a filter in whose rig the likeliest mechanism is."""
        self._filter, self._next, self._adopted = following, None, True
        self._copies.clear()
        self.carried.restart(self.carried.sensed, self.rig)
        self._watch.restart(following.time)
        self._disagreed = following.time

    def _phase(self, since: float) -> str:
        """Return what the drive did at a time."""
        before = [one for one in self._moments if one.time <= since]
        pair = before[-10:] if len(before) > 1 else list(self._moments)[:10]
        drive = [self._kind.drive(one.readings) for one in pair]
        moved = drive[-1] - drive[0] if drive else 0.0
        if abs(moved) < 10 * SETTINGS.least_noise:
            return "hold"
        return "pulling" if moved > 0.0 else "releasing"

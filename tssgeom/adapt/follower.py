"""A rig that follows its readings in a stream: the filter, the watch beside it, and what it makes of an alarm."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from tssgeom.adapt.diagnosis import Explanation, Moment, explained
from tssgeom.adapt.followed import followed_numbers
from tssgeom.adapt.rig_filter import CHANNELS, FollowedRig, Readings, RigFilter
from tssgeom.adapt.watch import Watch
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs


class FollowerSettings(NamedTuple):
    """Numbers of what happens about an alarm."""

    kept: float = 15.0
    """Time for which readings are kept [s]. Chosen: a few strokes."""
    copies: float = 1.0
    """Time between two copies of the filter [s]. Chosen: a fault is then at most so much younger."""
    before: float = 0.5
    """Time before a disagreement began at which the filter is taken for sound [s]; chosen."""
    looks: tuple[float, ...] = (1.5, 4.0, 8.0)
    """Times after an alarm at which mechanisms are compared [s]. Chosen: a stroke, and two more."""
    sure: float = 0.8
    """Probability from which the likeliest mechanism is taken into the rig [1]; chosen."""
    stands_by: float = 1e-6
    """Change of the drive between frames below which it holds [m, N]; chosen."""


_SETTINGS = FollowerSettings()


@dataclass(frozen=True, slots=True)
class Alert:
    """A disagreement between readings and model, and what is known of it so far."""

    channel: str
    since: float
    """[s]"""
    phase: str
    """What the drive did when it began: `pulling`, `releasing` or `hold`."""
    explanations: tuple[Explanation, ...] = ()
    """The likeliest first; none as long as they are not compared."""


class Follower:
    """Follows a rig from frame to frame.

    Parameters
    ----------
    rig
        The rig as its file has it.
    seed
        Of the filter.
    """

    def __init__(self, rig: Rig, *, seed: int = 0) -> None:
        self._first, self._seed = rig, seed
        self._filter: RigFilter | None = None
        self._watch = Watch(CHANNELS)
        self._copies = deque[RigFilter]()
        self._moments = deque[Moment]()
        self._alert: Alert | None = None
        self._alarmed = math.nan
        self._looks = 0
        self._work: Iterator[tuple[Explanation, ...] | None] | None = None
        self._coldest = math.nan
        self.known: FollowedRig | None = None
        """What is known after the last frame."""

    @property
    def rig(self) -> Rig:
        """The rig as it is now."""
        return self._first if self._filter is None else self._filter.rig_now()

    @property
    def filter(self) -> RigFilter | None:
        """The filter; None before the first frame."""
        return self._filter

    @property
    def alert(self) -> Alert | None:
        """What readings and model disagree in; None where they do not."""
        return self._alert

    def take(
        self, arcs: Arcs, readings: Readings, time: float, temperature: float | None = None
    ) -> FollowedRig:
        """Take in a frame.

        Raises
        ------
        SettingsError
            Where what is to be followed cannot be.
        FitError
            Where the tendon finds no equilibrium.
        """
        if self._filter is None:
            measured = [
                name for name in CHANNELS[:2] if getattr(readings, name.removesuffix("_N")) is not None
            ]
            self._filter = RigFilter(
                self._first, followed_numbers(self._first, measured), arcs, seed=self._seed
            )
        now = self._filter
        if "displacement_in_m" in now.muted:
            readings = readings._replace(displacement_in=None)
        if temperature is not None and math.isnan(self._coldest):
            self._coldest = temperature
        warmth = 0.0 if temperature is None else temperature - self._coldest
        self._keep(Moment(time, arcs, readings, warmth))
        self.known = now.step(arcs, readings, time, warmth)
        found = self._watch.take(self.known.off, self.known.off_sd, self.known.beyond, time)
        if found is not None and self._alert is None:
            self._alert = Alert(found.channel, found.since, self._phase(found.since))
            self._alarmed, self._looks = time, 0
        return self.known

    def work(self) -> None:
        """Do a slice of the work that no frame waits for."""
        if self._alert is None or self._filter is None:
            return
        if self._work is None:
            looks = _SETTINGS.looks
            if self._looks < len(looks) and self._filter.time >= self._alarmed + looks[self._looks]:
                self._looks += 1
                self._work = self._begin()
            return
        result = next(self._work, None)
        if result:
            self._work = None
            self._conclude(result)

    def _keep(self, moment: Moment) -> None:
        self._moments.append(moment)
        copies = self._copies
        now = self._filter
        assert now is not None
        if math.isnan(now.time):
            return
        if self._alert is None and (not copies or moment.time >= copies[-1].time + _SETTINGS.copies):
            copies.append(now.with_more(()))
        oldest = moment.time - _SETTINGS.kept
        if self._alert is None:
            while len(copies) > 2 and copies[1].time < oldest:
                copies.popleft()
            while self._moments[0].time < copies[0].time:
                self._moments.popleft()

    def _begin(self) -> Iterator[tuple[Explanation, ...] | None]:
        assert self._alert is not None
        sound = [one for one in self._copies if one.time <= self._alert.since - _SETTINGS.before]
        start = sound[-1] if sound else self._copies[0]
        moments = [one for one in self._moments if one.time > start.time]
        return explained(start, moments, self._alert.since)

    def _conclude(self, result: tuple[Explanation, ...]) -> None:
        assert self._alert is not None
        self._alert = replace(self._alert, explanations=result)
        first = result[0]
        if first.probability < _SETTINGS.sure or self._looks < len(_SETTINGS.looks):
            return
        self._adopt(first)

    def _adopt(self, first: Explanation) -> None:
        """Go on with the likeliest mechanism in the rig."""
        self._filter = first.filter
        self._copies.clear()
        self._watch.restart(first.filter.time)

    def _phase(self, since: float) -> str:
        """Return what the drive did at a time."""
        before = [one for one in self._moments if one.time <= since]
        pair = before[-10:] if len(before) > 1 else list(self._moments)[:10]
        drive = [one.readings.displacement_in or one.readings.tension_in or 0.0 for one in pair]
        moved = drive[-1] - drive[0] if drive else 0.0
        if abs(moved) < 10 * _SETTINGS.stands_by:
            return "hold"
        return "pulling" if moved > 0.0 else "releasing"

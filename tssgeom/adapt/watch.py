"""Whether readings disagree with the model beyond chance: sequential tests; docs/model.md (206)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE


class WatchSettings(NamedTuple):
    """Numbers of the sequential tests."""

    block: float = 0.25
    """Time over which innovations are averaged [s]. Chosen: longer than they stay alike in sound running."""
    shift: float = 0.75
    """Half of the mean that the test is best at, in standard deviations of a block [1]. Chosen: a fault of
    1.5."""
    false_alarm_interval: float = 86400.0
    """Mean time between two false alarms, over all channels [s]. Chosen: a day."""
    memory: float = 1.0 / 400.0
    """Share of the newest block in the usual spread of blocks [1]. Chosen: it is learnt in some minutes."""
    least_spread: float = 2.0
    """Least variance of a block over that of white innovations [1]. Chosen: the error of a turn stays for a
    leg, and full faults are ten times as large."""
    warm_up: float = 5.0
    """Time from the first reading before anything counts [s]. Chosen: the first pull is then behind."""

    @property
    def onset(self) -> float:
        """Time by which the tests may be wrong about when a fault began [s]; derived: two blocks."""
        return 2.0 * self.block


WATCH = WatchSettings()
_OVERSHOOT = 1.166  # of a random walk over a boundary: D. Siegmund, Sequential Analysis, 1985, ch. 10


def threshold(tests: int) -> float:
    """Return the bound at which so many one-sided CUSUM tests together give one false alarm in the interval.

    Source: D. Siegmund, Sequential Analysis, 1985: a run lasts (exp(2kb) − 2kb − 1) / 2k² blocks, with
    b = h + 1.166.
    """
    wanted, k = tests * WATCH.false_alarm_interval / WATCH.block, WATCH.shift
    b = 1.0
    for _ in range(50):
        b = math.log(2.0 * k * k * wanted + 2.0 * k * b + 1.0) / (2.0 * k)
    return b - _OVERSHOOT


@dataclass(frozen=True, slots=True)
class Disagreement:
    """A channel that disagrees beyond chance."""

    channel: str
    since: float
    """Time from which on it does [s]."""
    time: float
    """Time at which that was certain [s]."""
    way: int
    """+1 where it reads more than expected, −1 where less; 0 where it is far off."""


class _Channel:
    """Both one-sided tests of one channel."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.spread = WATCH.least_spread
        self.sums, self.since = [0.0, 0.0], [math.nan, math.nan]
        self.total, self.count, self.ends = 0.0, 0, math.nan
        self.far_since = math.nan

    def is_far(self, beyond: float, time: float) -> bool:
        """Whether readings have been far off for long enough."""
        if not math.isnan(beyond):
            if beyond < CHANCE.never:
                self.far_since = math.nan
            elif math.isnan(self.far_since):
                self.far_since = time
        return time - self.far_since > WATCH.onset

    def take(self, z: float, time: float, bound: float) -> int:
        """Take in a standardised innovation; return the way of an alarm, or 0."""
        if math.isnan(self.ends):
            self.ends = time + WATCH.block
        if time >= self.ends:
            way = self._close(bound)
            self.total, self.count, self.ends = 0.0, 0, time + WATCH.block
            if way:
                return way
        if not math.isnan(z):
            self.total += min(max(z, -CHANCE.never), CHANCE.never)
            self.count += 1
        return 0

    def _close(self, bound: float) -> int:
        if self.count == 0:
            return 0
        raw = self.total / math.sqrt(self.count)
        u = raw / math.sqrt(self.spread)
        u = min(max(u, -CHANCE.never), CHANCE.never)
        self.spread = max(WATCH.least_spread, self.spread + WATCH.memory * self.spread * (u * u - 1.0))
        for i, sign in enumerate((1.0, -1.0)):
            grown = max(self.sums[i] + sign * u - WATCH.shift, 0.0)
            if grown == 0.0 or self.sums[i] == 0.0:
                self.since[i] = self.ends - WATCH.block
            self.sums[i] = grown
            if grown > bound:
                return int(sign)
        return 0


class Watch:
    """Tests the innovations of channels, one after the other as they come.

    Parameters
    ----------
    channels
        Their names.
    """

    def __init__(self, channels: Sequence[str]) -> None:
        self._channels = [_Channel(name) for name in channels]
        self._bound = threshold(2 * len(channels))
        self._begins = math.nan

    def take(self, off: Vector, sd: Vector, beyond: Vector, time: float) -> Disagreement | None:
        """Take in what readings were off by, and the standard deviations of that [channels]; NaN is none.

        `beyond` [channels] is as in `FollowedRig`, also where a reading is not to be used.
        """
        if math.isnan(self._begins):
            self._begins = time + WATCH.warm_up
        if time < self._begins:
            return None
        for i, channel in enumerate(self._channels):
            if channel.is_far(float(beyond[i]), time):
                return Disagreement(channel.name, channel.far_since, time, 0)
            way = channel.take(float(off[i] / sd[i]), time, self._bound)
            if way:
                since = channel.since[0 if way > 0 else 1]
                return Disagreement(channel.name, since, time, way)
        return None

    def restart(self, time: float) -> None:
        """Begin anew: the model has changed."""
        for channel in self._channels:
            channel.sums, channel.total, channel.count = [0.0, 0.0], 0.0, 0
            channel.ends = channel.far_since = math.nan
        self._begins = time

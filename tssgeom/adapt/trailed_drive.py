"""Where a drive is that is read with noise, and what of its way is certain; docs/model.md (239).

Friction keeps every turn, those of noise too. So the state that is kept trails the drive by more than its
noise, and each frame is a step from there to where the drive is by now, which noise may move to and fro.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE


class TrailSettings(NamedTuple):
    """Numbers of drives with noise."""

    agree: float = 1.5
    """Standard errors from which a line through fewer readings contradicts one through more [1]. Chosen: the
    lag of a motion is then as large as the noise that is left."""
    longest: int = 64
    """Most readings of a line [1]; chosen: a standing drive is then known to a quarter of its noise."""
    speed: float = 1.0
    """Noises from reading to reading by which it has to rise too [1]. Chosen: it then takes some readings to
    turn."""
    may_turn: float = 2.5
    """The same from which it may have turned, and readings are not used [1]; chosen."""
    sharp: float = 1.8
    """Standard deviations by which the farthest of the means of a leg is beyond its end [1]. Measured: 2 is
    0.15 noises short, 1.6 leaves 0.6."""
    turn_error: float = 0.5
    """Standard deviation of where it turned, over the noise [1]; measured."""
    margin: float = 4.0
    """Noises by which the state that is kept trails the drive at least [1]. Chosen: no noise gets behind."""


TRAIL = TrailSettings()


class TrailedDrive:
    """Follows one drive.

    Parameters
    ----------
    noise
        Standard deviation of a reading, in its unit.
    """

    def __init__(self, noise: float) -> None:
        self.noise = noise
        self.recent = deque[float](maxlen=2 * TRAIL.longest)
        self.way, self.moves = 0, False
        self.value = self.error = self.farthest = self.committed = math.nan
        """Where the drive is by now, its standard error, the farthest such value of this leg, and where the
        state that is kept has it."""

    @property
    def may_have_turned(self) -> bool:
        """Whether it may have turned, and may not."""
        return self.way * (self.farthest - self.value) > TRAIL.may_turn * self.noise

    def take(self, reading: float) -> float | None:
        """Take in a reading; return where the drive has turned, if it has."""
        self.recent.append(reading)
        self.value, self.error, count = _end_of_line(self.recent, self.noise)
        self.moves = self._is_moving(count)
        if math.isnan(self.farthest):
            self.farthest = self.committed = self.value
        way, behind = self.way, self.farthest - self.value
        if way == 0:
            if abs(behind) > CHANCE.never * self.noise:
                self.way, self.farthest = (-1 if behind > 0.0 else 1), self.value
            return None
        self.farthest = way * max(way * self.farthest, way * self.value)
        if way * behind <= CHANCE.never * self.noise:
            return None
        turned = way * max(_end_of_leg(way * np.array(self.recent), self.noise), way * self.committed)
        kept = [one for one in self.recent if way * (turned - one) > 0.0][-count:]
        self.recent.clear()
        self.recent.extend(kept or [reading])
        self.way, self.farthest = -way, self.value
        return turned

    def plain(self) -> dict[str, Any]:
        """Return all of it, for `of`."""
        return {**vars(self), "recent": np.array(self.recent)}

    @classmethod
    def of(cls, kept: Mapping[str, Any]) -> TrailedDrive:
        """Return the drive that `plain` describes."""
        made = cls(0.0)
        for name, value in kept.items():
            setattr(made, name, deque(value.tolist(), made.recent.maxlen) if name == "recent" else value)
        return made

    def _is_moving(self, count: int) -> bool:
        """Whether the line through the last readings rises for sure in the way of the drive."""
        last = np.array(self.recent)[-max(count, 2) :]
        steps = np.arange(len(last)) - 0.5 * (len(last) - 1)
        squares = float(steps @ steps)
        least = max(CHANCE.clear * math.sqrt(squares), TRAIL.speed * squares) * self.noise
        return self.way * float(steps @ last) > least > 0.0

    def set(self, value: float) -> None:
        """Set the drive to a position that is exact."""
        if value != self.value and not math.isnan(self.value):
            self.way = 1 if value > self.value else -1
        self.recent.clear()
        self.value = self.farthest = self.committed = value
        self.error, self.moves = 0.0, True

    def effect(self, higher: Vector, lower: Vector) -> Vector:
        """Return what an error of it does, from what the probes read beside it: the greater."""
        return np.maximum(np.abs(higher), np.abs(lower))

    def repeated(self, slides: bool) -> float:
        """Return how many readings share the error of this one [1]: each has its own."""
        return 1.0

    @property
    def share(self) -> float:
        """Standard error of where it is, over the noise of a reading [1]."""
        return self.error / self.noise if self.noise > 0.0 else 1.0

    def safe(self) -> float:
        """Return how far the drive has gone for sure."""
        certain = self.way * (self.value - self.committed) - TRAIL.margin * self.noise
        return self.committed + self.way * max(certain, 0.0)

    def needs_commit(self) -> bool:
        """Whether the state that is kept trails by more than it needs to."""
        return self.way * (self.value - self.committed) > 2.0 * TRAIL.margin * self.noise


def _end_of_line(recent: Sequence[float], noise: float) -> tuple[float, float, int]:
    """Return where the drive is by a straight line through its last readings, its error, and how many.

    They are as many as lines through fewer of them do not contradict.
    """
    total = moment = 0.0
    low, high, best, next_count = -math.inf, math.inf, (recent[-1], noise, 1), 2
    for count, reading in enumerate(reversed(recent), start=1):
        total, moment = total + reading, moment + (count - 1) * reading  # (count - 1) steps ago
        if count < next_count:
            continue
        now = (2.0 * (2 * count - 1) * total - 6.0 * moment) / (count * (count + 1))
        error = noise * math.sqrt(2.0 * (2 * count - 1) / (count * (count + 1)))
        if not low <= now <= high or count > TRAIL.longest:
            break
        best, next_count = (now, error, count), 2 * count
        low, high = max(low, now - TRAIL.agree * error), min(high, now + TRAIL.agree * error)
    return best


def _end_of_leg(readings: np.ndarray, noise: float) -> float:
    """Return how far a drive went that then turned back, by the means of its readings of many widths."""
    sums, best, count = np.concatenate(([0.0], np.cumsum(readings))), -math.inf, 1
    while count <= min(TRAIL.longest, len(readings)):
        farthest = float((sums[count:] - sums[:-count]).max()) / count
        best, count = max(best, farthest - TRAIL.sharp * noise / math.sqrt(count)), 2 * count
    return best

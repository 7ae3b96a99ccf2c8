"""The true drive behind noisy readings, while it runs; docs/model.md (202).

Friction keeps every turn of the drive, those of its noise too: a few micrometres back take half a newton off T_in.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class DriveNoise(NamedTuple):
    """How noise of the drive is kept from turning the tendon."""

    play: float = 3.0
    """Standard deviations of a reading by which the drive has to turn back before it counts [1].
    Chosen: one reading in 700 does so by noise."""
    memory: float = 0.1
    """Share of the newest step in the mean step [1]. Chosen: ten readings of a motion."""
    alike: float = 3.0
    """Readings of a slide that share an error [1]. Measured: the correlation with the next one is 0.28."""


_NOISE = DriveNoise()


class DriveTracker:
    """Follows one drive.

    Parameters
    ----------
    noise
        Standard deviation of a reading [N] or [m].
    """

    def __init__(self, noise: float) -> None:
        self._noise = noise
        self._middle: float | None = None
        self._way = 0
        self._step = 0.0
        self._stood = 0
        self._in_leg = 0
        self.value = 0.0

    def take(self, reading: float) -> float:
        """Take in a reading; return the standard deviation of the `value` that follows from it."""
        noise, width = self._noise, _NOISE.play * self._noise
        if self._middle is None or width == 0.0:
            self._middle = self.value = reading
            return noise
        before, self._in_leg = self._middle, self._in_leg + 1
        self._middle = min(max(before, reading - width), reading + width)
        moved = self._middle - before
        self._step += _NOISE.memory * (abs(moved) / noise - self._step)
        if moved == 0.0:  # it stands, or turns
            self._stood += 1
            return width
        self._stood = 0
        way = 1 if moved > 0.0 else -1
        value = self._middle + way * noise * (_NOISE.play - highest_of_noise(self._step))
        self._in_leg = self._in_leg if way == self._way else 0
        if way != self._way or way * (value - self.value) > 0.0:
            self.value = value
        self._way = way
        return noise

    def repeated(self, slides: bool) -> float:
        """Return how many readings share the error of this one [1].

        The k-th reading of a hold counts as 1/k², all as less than two. Where the tendon does not slide from end to
        end, the error of the last turn stays.
        """
        return max(1.0 + self._stood**2, _NOISE.alike if slides else 1.0 + self._in_leg)


def highest_of_noise(step: float) -> float:
    """Return how far the highest of all readings so far is above the last true value, on the average [1].

    The drive moves by `step` from reading to reading; all in standard deviations of a reading. Derived: a curve
    through what 4000 simulated motions gave, to 0.14 from 0.03 to 4.
    """
    return 0.5 * math.log1p((0.65 / max(step, 1e-3)) ** 1.2)

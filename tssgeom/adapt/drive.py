"""The true drive behind noisy readings of the last seconds, through which mechanisms are marched.

Friction keeps every turn of the drive, those of its noise too: a few micrometres back take half a newton off
T_in. Filters know a drive by `tssgeom.adapt.trailed_drive`; a march keeps no state behind the drive, so that
this one goes only on; docs/model.md (202).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from tssgeom.core.constants import CHANCE


class DriveNoise(NamedTuple):
    """How noise of the drive is kept from turning the tendon."""

    overshoot: float = 1.5
    """Error of a drive that stands for long, which its last readings have moved too far, over the noise [1].
    Measured: 1.54 to 1.64 in holds of four simulated machines, 0.9 to 1.0 in their first ten readings."""
    memory: float = 0.1
    """Share of the newest reading in mean reading and mean step [1]. Chosen: ten readings of a motion."""
    slow: float = 0.3
    """Standard deviations that a drive moves from reading to reading below which the mean reading says
    more than the highest one [1]; chosen."""


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
        self._extreme: float | None = None
        self._way = 1
        self._mean = 0.0
        self._step = 0.0
        self._stood = 0
        self.value = 0.0

    def take(self, reading: float) -> float:
        """Take in a reading; return the standard deviation of the `value` that follows from it."""
        noise = self._noise
        if self._extreme is None or noise == 0.0:
            self._extreme = self._mean = self.value = reading
            return noise
        self._mean += _NOISE.memory * (reading - self._mean)
        beyond = self._way * (reading - self._extreme) / noise
        turned = self._way * (reading - self.value) < -CHANCE.never * noise
        self._step += _NOISE.memory * (max(beyond, 0.0) - self._step)
        if not turned and beyond <= 0.0:  # it stands, or turns
            self._stood += 1
            return noise * (_NOISE.overshoot if self._stood * _NOISE.memory > 1.0 else 1.0)
        self._extreme, self._stood = reading, 0
        if turned:
            self._way = -self._way
        way = self._way
        value = reading - way * noise * highest_of_noise(self._step)
        if self._step < _NOISE.slow and not turned:
            value = way * min(way * value, way * self._mean + noise)
        if turned or way * (value - self.value) > 0.0:
            self.value = value
        return noise


def highest_of_noise(step: float) -> float:
    """Return how far the highest of all readings so far is above the last true value, on the average [1].

    The drive moves by `step` from reading to reading; all in standard deviations of a reading. Derived: a
    curve through what 4000 simulated motions gave, to 0.14 from 0.03 to 4.
    """
    return 0.5 * math.log1p((0.65 / max(step, 1e-3)) ** 1.2)

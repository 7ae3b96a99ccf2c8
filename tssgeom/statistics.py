"""Statistics that several parts use, each written once; the core has those of arrays."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tssgeom import core
from tssgeom.arrays import Vector
from tssgeom.core.constants import MEDIANS, ROUNDING

HELD = 0.95
"""Probability that an interval holds the truth, and from which the likeliest is taken for true. Cited: what
intervals are usually stated for."""
NORMAL_95 = 1.959964
"""Standard deviations to either side of a 95 % interval. Derived: the 97.5 % quantile of the normal law."""
EVEN = 0.5
"""Probability of what is as likely as not. Mathematics."""


@dataclass(frozen=True, slots=True)
class EvidenceScale:
    """When a difference counts, whatever is compared. Cited: Kass and Raftery, JASA 90 (1995) 777."""

    strong: float = 6.0
    """Fall of BIC, or 2 Δ ln Z, below which two models are not separated [1]; cited: odds of 20."""
    very_strong: float = 10.0
    """The same that a part of a model needs [1]; cited: odds of 150."""
    false_alarms: float = 0.01
    """Share of sound runs, of clean campaigns or of readings that chance alone may take beyond a limit, and
    probability below which something is ruled out [1]; chosen: one in a hundred."""
    fewest: int = 5
    """Values of which a median is known, and readings of a channel that calibration uses [1]; chosen: a short
    run serves beside others. From five of T_out and of the elongation each, 95 % intervals hold as often as
    from twenty."""

    @property
    def draws(self) -> int:
        """Samples of a distribution: four are beyond that share, and its s.d. is known to 4 %."""
        return round(4.0 / self.false_alarms)


EVIDENCE_SCALE = EvidenceScale()
_THROUGH = (3, 5, 7)  # readings whose differences show the noise; derived: lines to quintics vanish
_OFF_GRID = (
    0.05  # of a step between two readings; derived: 3 readings that are no multiples are so by chance 1 %
)
_FLICKER = 0.1  # of the readings, where a display begins or ceases to repeat itself [1]; chosen: holds last


def root_mean_square(values: np.ndarray) -> float:
    """Return the root of the mean square, in the unit of the values."""
    return float(np.sqrt(np.mean(np.square(values))))


def robust_sd(off: np.ndarray) -> float:
    """Return the standard deviation of deviations [n] by their median absolute value, whatever a few do."""
    return MEDIANS.sd_per_absolute * float(np.median(np.abs(off)))


def information_price(parameters: float, values: float) -> float:
    """Return what BIC, the Bayesian information criterion, adds to -2 ln likelihood for its parameters."""
    return parameters * math.log(values)


def monotone(values: Vector, *, rising: bool) -> Vector:
    """Return the values [n] nearest to others by squares that nowhere fall, or nowhere rise."""
    way = 1.0 if rising else -1.0
    return way * core.isotonic_regression(way * values, np.ones(len(values)))


def reading_noise(readings: Vector, time: Vector | None = None) -> float:
    """Return the standard deviation of the white noise of readings [n].

    Each reading is held against polynomials through its neighbours, the smoothest of which counts: a drive
    that swings like a sine bends more from sample to sample than a good encoder's noise. Where most readings
    repeat their neighbours or step as they do, the smallest step is the digit of a display, and the noise is
    that of rounding to it.

    Parameters
    ----------
    readings
        [n] Changing slowly from one to the next.
    time
        [n] Increasing; left out, the readings are evenly spaced.
    """
    when = np.arange(len(readings), dtype=float) if time is None else time
    spread = [_off_polynomial(when, readings, points) for points in _THROUGH if len(readings) > points]
    rounding = ROUNDING.exact * float(np.max(np.abs(readings), initial=0.0))
    steps = np.abs(np.diff(readings))
    moved = steps > rounding
    stepwise = np.count_nonzero(np.diff(moved)) > _FLICKER * len(steps)
    if spread and spread[0] > (rounding if stepwise else 0.0):
        return min(each for each in spread if each > 0.0)
    return float(steps[moved].min()) / np.sqrt(12.0) if moved.any() else 0.0


def digit_noise(readings: Vector) -> float:
    """Return the standard deviation that rounding gives to readings [n] in whole steps; 0 where they are not.

    The step is the least between two of them that differ.
    """
    values = np.unique(readings)
    steps = np.diff(values)
    steps = steps[steps > ROUNDING.exact * float(np.max(np.abs(values), initial=0.0))]
    if not steps.size:
        return 0.0
    step = float(steps.min())
    counts = steps / step
    on_grid = bool(np.all(np.abs(counts - np.round(counts)) < _OFF_GRID))
    return step / math.sqrt(12.0) if on_grid else 0.0


def _off_polynomial(time: Vector, readings: Vector, points: int) -> float:
    """Return the noise that divided differences of so many readings show, by their median."""
    when, what = (np.lib.stride_tricks.sliding_window_view(values, points) for values in (time, readings))
    apart = when[:, :, None] - when[:, None, :] + np.eye(points)
    weight = 1.0 / np.prod(apart / np.abs(apart).max(axis=(1, 2), keepdims=True), axis=2)
    off = np.abs(np.sum(weight * what, axis=1)) / np.linalg.norm(weight, axis=1)
    return robust_sd(off)


def turns(values: Vector, least: float) -> NDArray[np.intp]:
    """Return the first reading, each from which values go back by more than `least`, and the last one."""
    if len(values) == 0:
        return np.zeros(1, dtype=np.intp)
    edges, way, best, low, high = [0], 0, 0, 0, 0
    for k, value in enumerate(values):
        if way == 0:
            low, high = (k if value < values[low] else low), (k if value > values[high] else high)
            if values[high] - values[low] > least:
                way, best = (1, high) if high > low else (-1, low)
                edges[0] = low if way > 0 else high
        elif way * (value - values[best]) >= 0:
            best = k
        elif way * (values[best] - value) > least:
            edges.append(best)
            way, best = -way, k
    return np.array([*edges, len(values) - 1] if way else [0], dtype=np.intp)

"""The proximal tension behind noisy readings: monotone between turning points, as friction sees it.

A tendon in a sheath remembers extremes. Driven by raw readings the model would take each tooth of the noise
for a small reversal and its largest for the peak; so each leg is made monotone, and each turning point gets a
value of its own with a standard error.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from tssgeom.arrays import Vector, read_only
from tssgeom.statistics import robust_sd

_REVERSAL = 6.0  # standard deviations of the noise: less is not a reversal
_LEAST_REVERSAL = 0.02  # share of the range of the drive: less is ripple
_LONGEST_STAIR = 8  # readings: longer ones are holds of the drive
_THROUGH = (3, 5, 7)  # readings whose differences show the noise
_NEAR_TURN = 15  # readings beside a turning point that tell its value


@dataclass(frozen=True, slots=True)
class Legs:
    """A drive that is monotone from one turning point to the next."""

    values: Vector
    """[n] Tension at each reading [N]."""
    turns: NDArray[np.intp]
    """[m] Readings at which the drive turns, without both ends."""
    turn_values: Vector
    """[m] Tension at the turning points [N]."""
    turn_se: Vector
    """[m] Their standard errors [N]."""
    noise: float
    """Standard deviation of one reading [N]."""


def legs(readings: Vector) -> Legs:
    """Make readings of a proximal tension [n] [N] monotone from turn to turn."""
    noise = reading_noise(readings)
    turns = _turns(readings, max(_REVERSAL * noise, _LEAST_REVERSAL * float(np.ptp(readings))))
    edges = np.concatenate(([0], turns, [len(readings) - 1]))
    values = np.array(readings, dtype=np.float64)
    for start, stop in itertools.pairwise(edges):
        rising = readings[stop] > readings[start]
        leg = isotonic_regression(readings[start : stop + 1], increasing=bool(rising)).x
        values[start : stop + 1] = _without_stairs(leg)
    at, se = _turn_values(readings, edges, noise)
    for k, turn in enumerate(turns):
        bound = np.minimum if readings[turn] > readings[edges[k]] else np.maximum
        near = slice(edges[k], edges[k + 2] + 1)
        values[near] = bound(values[near], at[k])
    return Legs(
        read_only(np.maximum(values, 0.0)), turns, read_only(np.maximum(at, 0.0)), read_only(se), noise
    )


def _without_stairs(leg: Vector) -> Vector:
    """Put straight lines between the middles of short stairs, which digits and pooling make; holds stay."""
    edges = np.concatenate(([0], np.flatnonzero(np.diff(leg)) + 1, [len(leg)]))
    short = np.diff(edges) <= _LONGEST_STAIR
    first, last = edges[:-1], edges[1:] - 1
    middle = 0.5 * (first + last)
    place = np.where(short, middle, first)
    nodes = np.concatenate([place, np.where(short, middle, last)])
    order = np.argsort(nodes, kind="stable")
    return np.interp(np.arange(len(leg)), nodes[order], np.tile(leg[first], 2)[order])


def reading_noise(readings: Vector, time: Vector | None = None) -> float:
    """Return the standard deviation of the white noise of readings [n].

    Each reading is held against polynomials through its neighbours, the smoothest of which counts: a drive
    that swings like a sine bends more from sample to sample than a good encoder's noise.

    Parameters
    ----------
    readings
        [n] Changing slowly from one to the next.
    time
        [n] Increasing; left out, the readings are evenly spaced.
    """
    when = np.arange(len(readings), dtype=float) if time is None else time
    spread = [_off_polynomial(when, readings, points) for points in _THROUGH if len(readings) > points]
    if spread and spread[0] > 0.0:
        return min(each for each in spread if each > 0.0)
    steps = np.abs(np.diff(readings))
    return float(steps[steps > 0].min()) / np.sqrt(12.0) if (steps > 0).any() else 0.0


def _off_polynomial(time: Vector, readings: Vector, points: int) -> float:
    """Return the noise that divided differences of so many readings show, by their median."""
    when, what = (np.lib.stride_tricks.sliding_window_view(values, points) for values in (time, readings))
    apart = when[:, :, None] - when[:, None, :] + np.eye(points)
    weight = 1.0 / np.prod(apart / np.abs(apart).max(axis=(1, 2), keepdims=True), axis=2)
    off = np.abs(np.sum(weight * what, axis=1)) / np.linalg.norm(weight, axis=1)
    return robust_sd(off)


def _turns(readings: Vector, threshold: float) -> NDArray[np.intp]:
    """Return the readings from which the drive goes back by more than the threshold."""
    found, best, way = list[int](), 0, 0
    low = high = 0
    for k, value in enumerate(readings):
        if way == 0:
            low, high = (k if value < readings[low] else low), (k if value > readings[high] else high)
            if readings[high] - readings[low] > threshold:
                way, best = (1, high) if high > low else (-1, low)
            continue
        if way * (value - readings[best]) >= 0:
            best = k
        elif way * (readings[best] - value) > threshold:
            found.append(best)
            way, best = -way, k
    return np.array(found, dtype=np.intp)


def _turn_values(readings: Vector, edges: NDArray[np.intp], noise: float) -> tuple[Vector, Vector]:
    """Value of each turning point from a line through the readings on its flatter side."""
    at, se = np.empty(len(edges) - 2), np.empty(len(edges) - 2)
    for k in range(len(at)):
        turn = edges[k + 1]
        before = min(_NEAR_TURN, (turn - edges[k]) // 2 + 1)
        after = min(_NEAR_TURN, (edges[k + 2] - turn) // 2 + 1)
        sides = [
            _line_end(readings[turn - before : turn + 1][::-1]),
            _line_end(readings[turn : turn + after + 1]),
        ]
        value, slope, spread = min(sides, key=lambda side: abs(side[1]))
        at[k], se[k] = value, np.hypot(noise * spread, 0.5 * slope)
    return at, se


def _line_end(values: Vector) -> tuple[float, float, float]:
    """Return value and slope at the first of these of a line through them, and its error over the noise."""
    count = len(values)
    if count < 3:
        return float(values[0]), float(values[-1] - values[0]), 1.0
    place = np.arange(count) - 0.5 * (count - 1)
    slope = float(place @ values) / float(place @ place)
    value = float(values.mean()) - slope * 0.5 * (count - 1)
    return value, slope, float(np.sqrt(1.0 / count + (0.5 * (count - 1)) ** 2 / (place @ place)))

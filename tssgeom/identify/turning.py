"""The drive of `calibrate`: monotone from turn to turn, each turn a level of its own with a standard error.

`drive.calmed` serves `discover`: it reads the level of a turn off a hold or a round turn, as an encoder
shows them whose noise is far below one step. A load cell that is pulled and released through a sharp turn has
a noise of about one step. There the level has to come from lines through the readings beside the turn, and
stays a parameter of the fit. On 20 triangles of 15 N with noise and steps of 0.1 N the peak of `calmed` is
0.17 N too low, that of these lines within 0.05 N, and with `calmed` the compliance moves by up to five of its
standard errors. Holds and round turns, on the other hand, are beyond such lines. So both stay; the noise, the
model of the run and the fit are the same.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from tssgeom.arrays import Vector, read_only
from tssgeom.statistics import reading_noise, turns


@dataclass(frozen=True, slots=True)
class LegSettings:
    """What counts as a turn of a tension. Chosen on the runs of `benchmarks.calibration`."""

    reversal: float = 6.0
    """Standard deviations of the noise that a reading goes back before the drive has turned [1]; chosen."""
    least_reversal: float = 0.02
    """Of the range of the drive: going back by less is ripple [1]; chosen."""
    longest_stair: int = 8
    """Readings of one value that digits and pooling make; longer ones are holds; chosen."""
    near_turn: int = 15
    """Readings beside a turn from which its level is estimated; chosen."""


LEGS = LegSettings()
_TERMS = 5  # of the polynomial through a round turn; derived: a sine bends off a parabola by x⁴
_LEAST_BESIDE = _TERMS - 1  # readings on either side; derived: more than its terms together


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
    """Make readings of a proximal tension [n] [N] monotone from turn to turn; docs/model.md (70)."""
    noise = reading_noise(readings)
    least = max(LEGS.reversal * noise, LEGS.least_reversal * float(np.ptp(readings)))
    inner = turns(readings, least)[1:-1]
    edges = np.concatenate(([0], inner, [len(readings) - 1]))
    values = np.array(readings, dtype=np.float64)
    for start, stop in itertools.pairwise(edges):
        rising = readings[stop] > readings[start]
        leg = isotonic_regression(readings[start : stop + 1], increasing=bool(rising)).x
        values[start : stop + 1] = _without_stairs(leg)
    at, se = _turn_values(readings, edges, noise)
    for k, turn in enumerate(inner):
        bound = np.minimum if readings[turn] > readings[edges[k]] else np.maximum
        near = slice(edges[k], edges[k + 2] + 1)
        values[near] = bound(values[near], at[k])
    return Legs(
        read_only(np.maximum(values, 0.0)), inner, read_only(np.maximum(at, 0.0)), read_only(se), noise
    )


def _without_stairs(leg: Vector) -> Vector:
    """Put straight lines between the middles of short stairs, which digits and pooling make; holds stay."""
    edges = np.concatenate(([0], np.flatnonzero(np.diff(leg)) + 1, [len(leg)]))
    short = np.diff(edges) <= LEGS.longest_stair
    first, last = edges[:-1], edges[1:] - 1
    middle = 0.5 * (first + last)
    start = np.where(short, middle, first)
    nodes = np.concatenate([start, np.where(short, middle, last)])
    order = np.argsort(nodes, kind="stable")
    return np.interp(np.arange(len(leg)), nodes[order], np.tile(leg[first], 2)[order])


def _turn_values(readings: Vector, edges: NDArray[np.intp], noise: float) -> tuple[Vector, Vector]:
    """Value of each turning point from a line through the readings on its flatter side."""
    at, se = np.empty(len(edges) - 2), np.empty(len(edges) - 2)
    for k in range(len(at)):
        turn = edges[k + 1]
        before = min(LEGS.near_turn, (turn - edges[k]) // 2 + 1)
        after = min(LEGS.near_turn, (edges[k + 2] - turn) // 2 + 1)
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
    x = np.arange(count) - 0.5 * (count - 1)
    slope = float(x @ values) / float(x @ x)
    value = float(values.mean()) - slope * 0.5 * (count - 1)
    return value, slope, float(np.sqrt(1.0 / count + (0.5 * (count - 1)) ** 2 / (x @ x)))


def with_round_turns(readings: Vector, drive: Legs) -> Legs:
    """Return the drive with the levels of round turns, by a polynomial through the readings beside each.

    A line through a round turn is too high; the polynomial counts where it leaves less than both lines. It is
    taken where a parabola is greatest: its own greatest value is that of its noise too.
    """
    values, errors = np.array(drive.turn_values), np.array(drive.turn_se)
    edges = np.concatenate(([0], drive.turns, [len(readings) - 1]))
    for k, turn in enumerate(drive.turns):
        half = min(LEGS.near_turn, (turn - edges[k]) // 2, (edges[k + 2] - turn) // 2)
        if half < _LEAST_BESIDE:
            continue
        near = readings[turn - half : turn + half + 1]
        peak = drive.values[turn] > drive.values[edges[k]]
        x = np.arange(-half, half + 1) / half
        terms = np.vander(x, _TERMS, increasing=True)
        fit, *_ = np.linalg.lstsq(terms, near, rcond=None)
        bend, slope, _ = np.polyfit(x, near, 2)
        top = -0.5 * slope / bend if bend != 0.0 else np.inf
        sides = sum(_off_line(x[part], near[part]) for part in (slice(half + 1), slice(half, None)))
        left = float(np.sum((near - terms @ fit) ** 2))
        if abs(top) > 1.0 or (bend > 0.0) == peak or left > sides + drive.noise**2:
            continue
        at = top ** np.arange(_TERMS)
        spread = float(at @ np.linalg.inv(terms.T @ terms) @ at)
        values[k], errors[k] = at @ fit, drive.noise * np.sqrt(spread)
    return replace(drive, turn_values=read_only(np.maximum(values, 0.0)), turn_se=read_only(errors))


def _off_line(x: Vector, y: Vector) -> float:
    """Return the squares that a line through values leaves."""
    return float(np.sum((y - np.polyval(np.polyfit(x, y, 1), x)) ** 2))


def with_turns(drive: Legs, shifts: Vector) -> Vector:
    """Return the drive with its turns between the readings [n + m] [N], their levels shifted [m] [N]."""
    at = np.maximum(drive.turn_values + shifts, 0.0)
    return np.insert(_bounded(drive, at), drive.turns, at)


def _bounded(drive: Legs, at: Vector) -> Vector:
    """Keep both legs beside each turn on its near side."""
    values = np.array(drive.values)
    edges = np.concatenate(([0], drive.turns, [len(values) - 1]))
    for k, turn in enumerate(at):
        near = slice(edges[k], edges[k + 2] + 1)
        peak = drive.turn_values[k] > values[edges[k]]
        values[near] = np.minimum(values[near], turn) if peak else np.maximum(values[near], turn)
    return values

"""The drive of `calibrate`: monotone from turn to turn, each turn a level of its own with a standard error.

`drive.calmed` serves `discover`: it writes the most probable shape of each turn into a drive, as an encoder
shows it whose noise is far below one step. A load cell that is pulled and released through a sharp turn has a
noise of about one step. There no shape is certain: the level is averaged over shapes, and stays a parameter
of the fit.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from tssgeom.arrays import Vector, read_only
from tssgeom.core.constants import CHANCE
from tssgeom.identify.turn_levels import turn_level
from tssgeom.statistics import reading_noise, turns


@dataclass(frozen=True, slots=True)
class LegSettings:
    """What counts as a turn of a tension. Chosen on the runs of `benchmarks.calibration`."""

    least_reversal: float = 0.02
    """Of the range of the drive: going back by less is ripple [1]; chosen."""
    longest_stair: int = 8
    """Readings of one value that digits and pooling make; longer ones are holds; chosen."""
    most_turns: int = 12
    """Turns whose level is fitted; chosen: each takes as long as a number of the rig."""


LEGS = LegSettings()


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
    least: float = 0.0
    """Below which the drive cannot be [N]: a tendon only pulls; a position may be anywhere."""

    @property
    def fitted_se(self) -> list[float]:
        """Standard deviations of the levels that are fitted, those of the first turns, as the levels."""
        least = 1e-9 * float(np.ptp(self.values))  # for a drive without noise
        return np.maximum(self.turn_se[: LEGS.most_turns], least).tolist()


def legs(readings: Vector, time: Vector, *, of_position: bool = False) -> Legs:
    """Make a proximal tension [n] [N], or position [m], at times [n] [s] monotone from turn to turn; (70)."""
    noise = reading_noise(readings)
    least = max(CHANCE.never * noise, LEGS.least_reversal * float(np.ptp(readings)))
    inner = turns(readings, least)[1:-1]
    edges = np.concatenate(([0], inner, [len(readings) - 1]))
    levels = [
        turn_level(time, readings, int(turn), (int(before), int(behind)), noise)
        for before, turn, behind in zip(edges, inner, edges[2:], strict=False)
    ]
    values = np.array(readings, dtype=np.float64)
    for each in levels:
        values[each.start : each.start + len(each.values)] = each.values
    for start, stop in itertools.pairwise(edges):
        rising = readings[stop] > readings[start]
        leg = isotonic_regression(values[start : stop + 1], increasing=bool(rising)).x
        values[start : stop + 1] = _without_stairs(leg)
    at, se = np.array([[each.value, each.se] for each in levels]).reshape(-1, 2).T
    for k, turn in enumerate(inner):
        bound = np.minimum if readings[turn] > readings[edges[k]] else np.maximum
        near = slice(edges[k], edges[k + 2] + 1)
        values[near] = bound(values[near], at[k])
    low = -np.inf if of_position else 0.0
    return Legs(
        read_only(np.maximum(values, low)), inner, read_only(np.maximum(at, low)), read_only(se), noise, low
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


def with_turns(drive: Legs, shifts: Vector) -> Vector:
    """Return the drive with its turns between the readings [n + m] [N], their levels shifted [m] [N]."""
    at = np.maximum(drive.turn_values + shifts, drive.least)
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

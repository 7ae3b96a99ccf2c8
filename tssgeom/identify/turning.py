"""The drive of `calibrate`: monotone from turn to turn, each turn a level of its own with a standard error.

`drive.calmed` serves `discover`: it writes the most probable shape of each turn into a drive, as an encoder
shows it whose noise is far below one step. A load cell that is pulled and released through a sharp turn has a
noise of about one step. There no shape is certain: the level is averaged over shapes, and stays a parameter
of the fit.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Vector, read_only
from tssgeom.core.constants import CHANCE
from tssgeom.identify.drive import calmed
from tssgeom.identify.turn_levels import TurnLevel, turn_level
from tssgeom.statistics import monotone, reading_noise, turns


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
    """[m] Readings before which the drive turns, without both ends."""
    turn_values: Vector
    """[m] Tension at the turning points [N]."""
    turn_se: Vector
    """[m] Their standard errors [N]."""
    noise: float
    """Standard deviation of one reading [N]."""
    least: float = 0.0
    """Below which the drive cannot be [N]: a tendon only pulls; a position may be anywhere."""
    calm: bool = False
    """Whether it is that of (66) between its turns."""

    @property
    def fitted_se(self) -> list[float]:
        """Standard deviations of the levels that are fitted, those of the first turns, as the levels."""
        least = 1e-9 * float(np.ptp(self.values))  # for a drive without noise
        return np.maximum(self.turn_se[: LEGS.most_turns], least).tolist()

    def straight(self) -> Legs:
        """Return the same drive that goes straight between its readings: it turns at the outermost; (304)."""
        before, behind = self.values[self.turns - 1], self.values[self.turns]
        nearer = np.abs(self.turn_values - before) < np.abs(self.turn_values - behind)
        at = read_only(np.where(nearer, before, behind))
        return replace(self, turn_values=at, turn_se=read_only(np.full(len(at), self.noise)))

    def differs_from(self, other: Legs) -> bool:
        """Whether one of its turns lies farther from that of another such drive than their errors; (304)."""
        off = np.abs(self.turn_values - other.turn_values)
        return bool((off > CHANCE.never * np.hypot(self.turn_se, other.turn_se)).any())

    def again(self, time: Vector, rng: np.random.Generator) -> Legs:
        """Return the drive at its times [n] [s] as it might have been read with other noise."""
        read = self.values + self.noise * rng.standard_normal(len(time))
        if not self.calm:
            return legs(read, time, of_position=self.least < 0.0)
        at = self.turn_values + self.turn_se * rng.standard_normal(len(self.turns))
        moved = replace(self, values=calmed(read, self.noise, time), turn_values=at)
        return replace(moved, values=_bounded(moved, at))


def turns_between_readings(readings: Vector, noise: float) -> bool:
    """Return whether a drive goes farther than its noise from a turn to the next reading; (277)."""
    at = _turns(readings, noise)[1:-1]
    steps = np.max([np.abs(readings[at + step] - readings[at]) for step in (-1, 1)], axis=0)
    return len(at) > 0 and float(np.median(steps)) > CHANCE.never * noise


def _turns(readings: Vector, noise: float) -> NDArray[np.intp]:
    return turns(readings, max(CHANCE.never * noise, LEGS.least_reversal * float(np.ptp(readings))))


def legs(
    readings: Vector,
    time: Vector,
    noise: float | None = None,
    *,
    of_position: bool = False,
    calm: bool = False,
) -> Legs:
    """Make a proximal tension [n] [N], or position [m], at times [n] [s] monotone from turn to turn; (70).

    Source: docs/model.md (70), with `calm` (277) for the angle of a motor [rad], (278) for where turns are.
    """
    noise = reading_noise(readings) if noise is None else noise
    inner = _turns(readings, noise)[1:-1]
    edges = np.concatenate(([0], inner, [len(readings) - 1]))
    levels = [
        turn_level(time, readings, int(turn), (int(before), int(behind)), noise)
        for before, turn, behind in zip(edges, inner, edges[2:], strict=False)
    ]
    values = calmed(readings, noise, time) if calm else _monotone(readings, edges, levels)
    at, se = np.array([[each.value, each.se] for each in levels]).reshape(-1, 2).T
    before, behind = (np.abs(readings[inner + step] - readings[inner]) for step in (-1, 1))
    low = -np.inf if of_position else 0.0
    turned = inner + (behind < before)
    values, at = (read_only(np.maximum(each, low)) for each in (values, at))
    made = Legs(values, turned, at, read_only(se), noise, low, calm)
    return replace(made, values=_bounded(made, at))


def _monotone(readings: Vector, edges: NDArray[np.intp], levels: Sequence[TurnLevel]) -> Vector:
    """Return readings monotone from edge to edge, as the levels state about turns."""
    values = np.array(readings, dtype=np.float64)
    for each in levels:
        values[each.start : each.start + len(each.values)] = each.values
    for start, stop in itertools.pairwise(edges):
        rising = readings[stop] > readings[start]
        leg = monotone(values[start : stop + 1], rising=bool(rising))
        values[start : stop + 1] = _without_stairs(leg)
    return values


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
        off = drive.turn_values[k] - drive.values[edges[[k, k + 2]]]
        peak = off[np.argmax(np.abs(off))] > 0.0  # by the side that it shows better
        values[near] = np.minimum(values[near], turn) if peak else np.maximum(values[near], turn)
    return read_only(values)

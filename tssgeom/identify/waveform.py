"""Drives of experiments: straight legs between levels, each with its rate and its dwell, some in cycles.

Several drives go together, on a straight line from one point to the next.

Source: docs/discovery.md, "Designed experiments".
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Matrix, Vector, rows_at
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE


@dataclass(frozen=True, slots=True)
class WaveformSettings:
    """Which drives are tried."""

    most_levels: int = 5
    """Levels of one cycle; chosen."""
    most_cycles: int = 4
    """Cycles of a run; chosen."""
    speeds: float = 300.0
    """Greatest over least speed that is tried [1]; chosen: beyond two decades laws of rate differ enough."""
    dwells: tuple[float, float] = (0.02, 0.5)
    """Least and longest dwell, of the longest run [1]; chosen."""
    rest: int = 6
    """Samples at rest before the first leg; chosen: positions are zeroed there."""
    least_leg: int = 4
    """Samples of a leg at least; chosen: turns and corners need straight legs about them."""
    apart: float = 0.08
    """Of the range: least difference of one level to the next [1]; chosen."""
    step: float = 0.15
    """Of the range of levels, and of the logarithms of speeds and dwells: s.d. by which one is changed [1];
    chosen."""


WAVEFORM = WaveformSettings()
_FEWEST_LEVELS = 2  # of one cycle; derived: up and down


@dataclass(frozen=True, slots=True)
class Waveform:
    """One cycle of a drive, and how often it is run through."""

    levels: tuple[float, ...]
    """Ends of the legs, 0 the lowest and 1 the highest of the range [1]."""
    speeds: tuple[float, ...]
    """Of each leg, over the greatest speed [1]."""
    dwells: tuple[float, ...]
    """At the end of each leg, over the longest run [1]."""
    cycles: int
    ways: tuple[float, ...] = ()
    """Of each leg, among the points of a `Reach`: the one to which it goes, over their number [1]."""


@dataclass(frozen=True, slots=True)
class Course:
    """What the drives do over time."""

    time: Vector
    """[n] Samples [s]."""
    drive: Matrix
    """[n, drives] [m], [N], [rad] or [N·m]."""
    corner_time: Vector
    """[k] Where legs and dwells begin and end; all are samples [s]."""
    corner: Matrix
    """[k, drives] The drives there."""


def random_waveform(rng: np.random.Generator) -> Waveform:
    """Return a waveform at random."""
    count = int(rng.integers(_FEWEST_LEVELS, WAVEFORM.most_levels + 1))
    levels = [_level(rng, k) for k in range(count)]
    speeds = [_speed(rng) for _ in range(count)]
    if rng.uniform() < 0.5:  # one speed for all legs is what most laws of rate want held against another
        speeds = [speeds[0]] * count
    dwells = [_dwell(rng) if rng.uniform() < 0.5 else 0.0 for _ in range(count)]
    cycles = int(rng.integers(1, WAVEFORM.most_cycles + 1))
    return Waveform(tuple(levels), tuple(speeds), tuple(dwells), cycles)


def _level(rng: np.random.Generator, k: int) -> float:
    if rng.uniform() < 0.5:
        return float(k % 2 == 0)
    return float(rng.uniform())


def _speed(rng: np.random.Generator) -> float:
    if rng.uniform() < 0.5:
        return 1.0
    return float(WAVEFORM.speeds ** -rng.uniform())


def _dwell(rng: np.random.Generator) -> float:
    low, high = WAVEFORM.dwells
    return float(low * (high / low) ** rng.uniform())


def with_ways(waveform: Waveform, rng: np.random.Generator) -> Waveform:
    """Return a waveform whose legs go to points at random, from leg to leg others."""
    return replace(waveform, ways=tuple(map(float, rng.uniform(size=len(waveform.levels)))))


def varied_waveform(waveform: Waveform, rng: np.random.Generator) -> Waveform:
    """Return a waveform with one thing changed: level, speed, dwell or way of a leg, or the cycles."""
    k, what = int(rng.integers(len(waveform.levels))), int(rng.integers(5 if not waveform.ways else 6))
    if what == 5:
        ways = (*waveform.ways[:k], float(rng.uniform()), *waveform.ways[k + 1 :])
        return replace(waveform, ways=ways)
    levels, speeds, dwells = list(waveform.levels), list(waveform.speeds), list(waveform.dwells)
    if what == 0:
        levels[k] = float(np.clip(levels[k] + WAVEFORM.step * rng.standard_normal(), 0.0, 1.0))
    elif what == 1:
        ratio = WAVEFORM.speeds ** (WAVEFORM.step * rng.standard_normal())
        which = range(len(speeds)) if rng.uniform() < 0.5 else (k,)
        for leg in which:
            speeds[leg] = float(np.clip(ratio * speeds[leg], 1.0 / WAVEFORM.speeds, 1.0))
    elif what == 2:
        dwells[k] = 0.0 if dwells[k] else _dwell(rng)
    elif what == 3 and dwells[k]:
        low, high = WAVEFORM.dwells
        ratio = (high / low) ** (WAVEFORM.step * rng.standard_normal())
        dwells[k] = float(np.clip(ratio * dwells[k], low, high))
    else:
        cycles = waveform.cycles + int(rng.choice([-1, 1]))
        return replace(waveform, cycles=min(max(cycles, 1), WAVEFORM.most_cycles))
    return replace(waveform, levels=tuple(levels), speeds=tuple(speeds), dwells=tuple(dwells))


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """How fast the drives of a run may go, and how long."""

    speed: float
    """Greatest of any drive, in its unit over s."""
    duration: float
    """Longest run [s]."""
    interval: float
    """Least time between two samples [s]."""
    samples: int
    """Most samples."""


@dataclass(frozen=True, slots=True)
class Range(Pace):
    """What the one drive of a run may do on one route."""

    rest: float
    """Where it begins [m] or [N]."""
    low: float
    high: float

    @property
    def span(self) -> float:
        """From the lowest to the highest."""
        return self.high - self.low

    @property
    def start(self) -> Vector:
        """Where it begins [1]."""
        return np.array([self.rest])

    def ends(self, waveform: Waveform) -> Matrix:
        """Return where the legs of one cycle end [legs, 1]."""
        return self.low + self.span * np.array(waveform.levels)[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class Reach(Pace):
    """What several drives may do together, or one by force: a level is a share of the way to a point."""

    start: Vector
    """[drives] Where they begin [m], [N] or [N·m]."""
    points: Matrix
    """[points, drives] Where they may go together."""

    @property
    def span(self) -> float:
        """The farthest that any drive goes."""
        return float(np.abs(self.points - self.start).max())

    def ends(self, waveform: Waveform) -> Matrix:
        """Return where the legs of one cycle end [legs, drives]; docs/model.md (345)."""
        which = (np.array(waveform.ways) * len(self.points)).astype(int)
        return self.start + np.array(waveform.levels)[:, None] * (self.points[which] - self.start)


def course_of(waveform: Waveform, within: Range | Reach) -> Course | None:
    """Return the drives of a waveform within limits; None where it does not fit.

    Too long a run has its dwells shortened first, then its legs made faster, then cycles left out. All legs
    and dwells begin and end at samples. A step of several drives is that of the one that goes farthest.
    """
    span = within.span
    if span <= 0.0:
        return None
    for cycles in range(waveform.cycles, 0, -1):
        levels = np.tile(within.ends(waveform), (cycles, 1))
        steps = np.abs(np.diff(levels, axis=0, prepend=within.start[None])).max(axis=1)
        if (steps < WAVEFORM.apart * span).any():
            return None
        speeds = within.speed * np.tile(waveform.speeds, cycles)
        spans = _timed(steps, speeds, within.duration * np.tile(waveform.dwells, cycles), within)
        if spans is not None:
            return _sampled(levels, *spans, within)
    return None


def _timed(
    steps: Vector, speeds: Vector, dwells: Vector, within: Range | Reach
) -> tuple[Vector, Vector] | None:
    """Return the times of legs and dwells [s]; None where they are too long at the greatest speed."""
    room = within.duration * (1.0 - 2.0 * WAVEFORM.rest / within.samples)
    least = np.maximum(steps / within.speed, WAVEFORM.least_leg * within.interval)
    legs = np.maximum(steps / speeds, least)
    if least.sum() > room:
        return None
    over = legs.sum() + dwells.sum() - room
    if over > 0.0:
        dwells = dwells * max(1.0 - over / max(dwells.sum(), 1e-12), 0.0)
    over = legs.sum() + dwells.sum() - room
    if over > 0.0 and legs.sum() > least.sum():
        legs = least + (legs - least) * (room - least.sum()) / (legs.sum() - least.sum())
    return legs, dwells


def _sampled(levels: Matrix, legs: Vector, dwells: Vector, within: Range | Reach) -> Course | None:
    """Return the drives at even samples, corners among them; None where a leg has too few."""
    total = legs.sum() + dwells.sum()
    rest = WAVEFORM.rest
    step = max(within.interval, total / (within.samples - rest - 2 * len(legs) - 1))
    moving = np.maximum(np.ceil(legs / step), 1.0).astype(int)  # never faster than was asked for
    if moving.min() < WAVEFORM.least_leg:
        return None
    still = np.rint(dwells / step).astype(int)
    at, value = [0, rest], [within.start, within.start]
    for level, leg, dwell in zip(levels, moving, still, strict=True):
        at.append(at[-1] + int(leg))
        value.append(level)
        if dwell:
            at.append(at[-1] + int(dwell))
            value.append(level)
    fits = at[-1] * step <= within.duration * (1.0 + 1e-9)
    if not (fits and PLAUSIBLE.fewest_rows <= at[-1] + 1 <= within.samples):
        return None
    time = np.asarray(step * np.arange(at[-1] + 1), dtype=np.float64)
    samples, values = np.array(at, dtype=np.float64), np.array(value, dtype=np.float64)
    return Course(time, rows_at(np.arange(at[-1] + 1), samples, values), step * samples, values)

"""A measured drive without its noise: friction keeps the highest reading of a hold and would keep its noise.

Source: docs/model.md (66).
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import ndtri

from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE
from tssgeom.identify.turn_shapes import fitted_turn
from tssgeom.statistics import monotone


@dataclass(frozen=True, slots=True)
class DriveSettings:
    """What counts as a turn, a hold, a round turn and a corner of a drive.

    Frozen on the development seeds of `benchmarks.discovery`.
    """

    turn: float = 7.0
    """S.d. that a reading goes back before the drive has turned [1]; chosen."""
    hold: float = 4.5
    """S.d. about the level of a hold in which its readings lie [1]; chosen."""
    flat: float = 3.5
    """Standard errors of slope and bend below which a plateau is a hold [1]; chosen."""
    straight: float = 0.2
    """Of a step: difference from the step before on a straight leg [1]; chosen."""
    same: float = 0.02
    """Of a step and of the noise: a corner this near to a sample is that sample [1]; chosen."""
    between: float = 0.05
    """Of a step: a sharp turn lies so far beyond where it was put [1]; chosen on development seeds."""
    level: float = 0.3
    """Of the noise of the drive: error of the level of a hold [1]; chosen on development seeds."""


DRIVE = DriveSettings()
_FEWEST = 3 + 1  # readings of a hold; derived: level, slope and bend leave one


def calmed(drive: Vector, noise: float, time: Vector | None = None) -> Vector:
    """Return the drive monotone between turns, round in round turns, and level in holds at turns and ends.

    Source: docs/model.md (66).

    Parameters
    ----------
    drive
        [m] Readings of the drive, N or m.
    noise
        Standard deviation of their white noise, in the same unit; 0 returns the readings.
    time
        [m] Increasing; left out, the readings are evenly spaced.
    """
    if noise <= 0.0 or len(drive) < 3:
        return drive
    drive = np.asarray(drive, dtype=float)
    when = np.arange(len(drive), dtype=float) if time is None else time
    turns = _turns(drive, DRIVE.turn * noise)
    ends = [_extreme(drive, turns, k, noise) for k in range(len(turns))]
    out = np.empty(len(drive))
    for (first, last), (here, there) in zip(pairwise(turns), pairwise(ends), strict=True):
        out[first : last + 1] = np.clip(
            monotone(drive[first : last + 1], rising=there >= here), min(here, there), max(here, there)
        )
    for k, turn in enumerate(turns):
        between = int(turns[max(k - 1, 0)]), int(turns[min(k + 1, len(turns) - 1)])
        fitted = fitted_turn(when, drive, int(turn), between, noise)
        if fitted is not None:
            turns[k] = _write_shape(out, between, int(turn), fitted)
            continue
        start, stop = hold(drive, int(turn), noise)
        if stop - start >= _FEWEST:
            _level(out, start, stop, float(np.mean(drive[start:stop])), noise)
    return out


def _write_shape(out: Vector, between: tuple[int, int], turn: int, shape: tuple[int, Vector]) -> int:
    """Write the shape of a turn into a drive, no leg beyond it; return where it turns then."""
    (start, values), (before, after) = shape, between
    stop = start + len(values)
    high = bool(out[turn] >= out[after if after > turn else before])
    bound = np.minimum if high else np.maximum
    out[start:stop] = values
    out[before:start] = bound(out[before:start], values[0])
    out[stop : after + 1] = bound(out[stop : after + 1], values[-1])
    return start + int(np.argmax(values if high else -values)) if before < turn < after else turn


def _level(out: Vector, start: int, stop: int, level: float, noise: float) -> None:
    """Write a hold into a drive, and keep its noise from reaching beyond it on either side."""
    out[start:stop] = level
    first, last = _around(np.abs(out - level) < DRIVE.hold * noise, start)
    outside = out[last] if last < len(out) else out[first - 1] if first > 0 else level
    bound = np.minimum if outside < level else np.maximum
    out[first:last] = bound(out[first:last], level)


def with_corners(time: Vector, drive: Vector, noise: float) -> tuple[Vector, Vector, np.ndarray]:
    """Return times and drive with points added where it turned between two samples, and which they are.

    A sharp turn lies where the straight lines before and behind it meet, a round one at the top of the
    parabola through three samples; docs/model.md (66).
    """
    where, when, what = list[int](), list[float](), list[float]()
    for turn in turning_points(drive, noise):
        start, stop = hold(drive, turn, noise)
        level = np.count_nonzero(np.abs(drive[start:stop] - drive[turn]) < DRIVE.same * noise) > 1
        if (stop - start == 1 or not level) and 2 < turn < len(drive) - 3:
            at, peak = _corner(time[turn - 2 : turn + 3], drive[turn - 2 : turn + 3], noise)
            beyond = abs(peak - drive[turn])
            if (
                time[turn - 1] < at < time[turn + 1]
                and beyond > (noise if stop - start == 1 else DRIVE.same * noise)
                and abs(at - time[turn]) > DRIVE.same * (time[turn + 1] - time[turn])
            ):
                where.append(turn + int(at > time[turn]))
                when.append(at)
                what.append(peak)
    added = np.zeros(len(drive) + len(where), dtype=bool)
    added[np.array(where, dtype=int) + np.arange(len(where))] = True
    return np.insert(time, where, when), np.insert(drive, where, what), added


def _corner(time: Vector, drive: Vector, noise: float) -> tuple[float, float]:
    """Return when and where the drive turned, from five samples of which the third is the outermost."""
    before, behind = ((drive[i + 1] - drive[i]) / (time[i + 1] - time[i]) for i in (0, 3))
    near = [(drive[i + 1] - drive[i]) / (time[i + 1] - time[i]) for i in (1, 2)]
    least = CHANCE.rare * noise / float(np.mean(np.diff(time)))
    off = min(abs(near[0] - before), abs(near[1] - behind))
    straight = off < max(DRIVE.straight * max(abs(before), abs(behind)), least)
    if straight and before * behind < 0.0:
        at = (drive[3] - drive[1] + before * time[1] - behind * time[3]) / (before - behind)
        return float(at), float(drive[1] + before * (at - time[1]))
    middle = 0.5 * (time[1] + time[2]), 0.5 * (time[2] + time[3])
    bend = (near[1] - near[0]) / (middle[1] - middle[0])
    at = middle[0] - near[0] / bend if bend != 0.0 else time[2]
    return float(at), float(drive[2] - 0.5 * bend * (time[2] - at) ** 2)


def turning_points(drive: Vector, noise: float) -> list[int]:
    """Return the samples at which the drive turns, one for each, the ends not among them."""
    result, behind = list[int](), hold(drive, 0, noise)[1]
    for turn in _turns(np.asarray(drive, dtype=float), DRIVE.turn * noise)[1:-1]:
        start, stop = hold(drive, int(turn), noise)
        if start >= behind and stop < len(drive):
            result.append(int(turn))
            behind = stop
    return result


def hold(drive: Vector, turn: int, noise: float) -> tuple[int, int]:
    """Return first sample of the hold at a turn and the one behind its last; a sharp turn holds itself."""
    sign = 1.0 if np.mean(drive[max(turn - 5, 0) : turn + 6]) <= drive[turn] else -1.0
    near = np.abs(drive[turn] - sign * 0.5 * CHANCE.never * noise - drive) < 0.5 * CHANCE.never * noise
    start, stop = _around(near | (np.arange(len(drive)) == turn), turn)
    start, stop = _around(np.abs(drive - np.median(drive[start:stop])) < DRIVE.hold * noise, turn)
    while stop - start >= _FEWEST and not _flat(drive[start:stop], noise):
        cut, middle = max((stop - start) // 10, 1), np.mean(drive[start:stop])
        if abs(np.mean(drive[start : start + cut]) - middle) > abs(
            np.mean(drive[stop - cut : stop]) - middle
        ):
            start += cut
        else:
            stop -= cut
    return (start, stop) if stop - start >= _FEWEST and start <= turn < stop else (turn, turn + 1)


def _around(inside: np.ndarray, at: int) -> tuple[int, int]:
    """Return the stretch of samples about `at` that are inside."""
    before, behind = np.flatnonzero(~inside[:at]), np.flatnonzero(~inside[at + 1 :])
    start = int(before[-1]) + 1 if len(before) else 0
    return start, at + 1 + (int(behind[0]) if len(behind) else len(inside) - at - 1)


def _flat(readings: Vector, noise: float) -> bool:
    """Whether neither a slope nor a bend shows in a plateau."""
    if len(readings) < _FEWEST:
        return False
    x = np.linspace(-1.0, 1.0, len(readings))
    shapes = np.linalg.qr(np.column_stack([np.ones_like(x), x, x**2]))[0]
    return bool(np.abs(shapes[:, 1:].T @ readings).max() < DRIVE.flat * noise)


def _extreme(drive: Vector, turns: np.ndarray, k: int, noise: float) -> float:
    """Return the turn's reading less what the largest of its plateau's noise adds."""
    here = turns[k]
    neighbour = drive[turns[k - 1] if k > 0 else turns[1]]
    sign = 1.0 if drive[here] >= neighbour else -1.0
    below = sign * (drive[here] - drive)
    if k in (0, len(turns) - 1):  # no turn, only an end: the drive may have gone farther
        return sign * math.inf
    start, stop = _around(below < CHANCE.never * noise, int(here))
    count = np.count_nonzero(below[start:stop] < 0.5 * CHANCE.never * noise)
    return float(drive[here] - sign * noise * max(ndtri((count - 0.375) / (count + 0.25)), 0.0))


def _turns(drive: Vector, back: float) -> np.ndarray:
    """Return the samples at which the drive turns by more than `back`, with both ends."""
    result, readings = [0], drive.tolist()
    low, high, sense = 0, 0, 0
    for i, here in enumerate(readings):
        if here >= readings[high]:
            high = i
        if here <= readings[low]:
            low = i
        if sense >= 0 and readings[high] - here > back:
            if high > result[-1]:
                result.append(high)
            sense, low, high = -1, i, i
        elif sense <= 0 and here - readings[low] > back:
            if low > result[-1]:
                result.append(low)
            sense, low, high = 1, i, i
    if len(readings) - 1 > result[-1]:
        result.append(len(readings) - 1)
    return np.array(result)


def turn_levels(drive: Vector, noise: float) -> Iterator[tuple[int, Vector, float]]:
    """Yield sample of each turn of a drive, [n] which samples move with it, and the s.d. of its level."""
    for sample in turning_points(drive, noise):
        yield sample, *_turn(drive, hold(drive, sample, noise), noise)


def _turn(drive: Vector, held: tuple[int, int], noise: float) -> tuple[Vector, float]:
    """Return which samples move with a turn, [n], and the standard deviation of its level."""
    start, stop = held
    plateau = np.zeros(len(drive))
    plateau[start:stop] = 1.0
    sharp = DRIVE.between * abs(_lesser_step(drive, start)) if stop - start == 1 else 0.0
    return plateau, noise * math.hypot(1.0 / math.sqrt(stop - start), DRIVE.level) + sharp


def _lesser_step(drive: Vector, sample: int) -> float:
    """Return the smaller of the steps from a sample to its neighbours; 0 at an end of the run."""
    if not 0 < sample < len(drive) - 1:
        return 0.0
    steps = drive[[sample - 1, sample + 1]] - drive[sample]
    return float(steps[np.argmin(np.abs(steps))])


def blunted(drive: Vector, holds: Sequence[tuple[int, int]]) -> Vector:
    """Return how much lower each sharp turn may be: between two samples, it may be round."""
    out = np.zeros(len(drive))
    for start, stop in holds:
        if stop - start == 1:
            out[start] = 2.0 * DRIVE.between * _lesser_step(drive, start)
    return out

"""The level at which a drive turns, averaged over the shapes that a turn may have; docs/model.md (224).

Friction keeps the highest tension of a pull, so a run is fitted with the level of each turn as a parameter.
Its prior is made here: every shape gives a level with a variance, and counts by its marginal likelihood.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import CHANCE
from tssgeom.identify.turn_shapes import SHAPE, SIDE


@dataclass(frozen=True, slots=True)
class LevelSettings:
    """Which readings the level of a turn is estimated from."""

    most: int = 40
    """Readings of a side that count at most; chosen for speed."""
    counted: float = 6.0
    """Values that count from which they are close enough [1]; chosen."""


LEVEL = LevelSettings()
_TERMS = 5  # of a polynomial; derived: a sine bends off a parabola by x⁴
_EXACT = 1e-9  # of the range: readings of a simulation have no noise [1]; derived: half of their digits
_RIDGE = 1e-9  # of the least squares [1]; derived: a side without readings has no slope
_MIDDLE, _HALF = 0.5, 0.5  # of the time about a turn, which is from 0 to 1


class TurnLevel(NamedTuple):
    """The level of a turn, and the drive about it."""

    value: float
    """[unit of the drive]"""
    se: float
    """Standard error [unit of the drive]."""
    start: int
    """First sample of `values`."""
    values: Vector
    """[m] The drive about the turn, without its noise [unit of the drive]."""


class _Estimate(NamedTuple):
    """What one shape says of the level, in standard deviations of the noise."""

    log_evidence: float
    level: float
    variance: float
    left: float
    """Least squares that the shape leaves."""
    parameters: int
    values: Vector
    """[n] The nearest curve."""


class _Shape(NamedTuple):
    """A family of curves: linear in some numbers, with `ends` that are not."""

    ends: int
    """Numbers that are not linear: 0, 1 or 2."""
    curves: Callable[[Vector, Matrix], np.ndarray]
    """Time [n] and ends [p, ends] → basis [p, n, k]."""
    level: Callable[[Matrix, Matrix], tuple[Matrix, np.ndarray]]
    """Coefficients [p, k] and ends → derivative of the level by them [p, k], and whether it is a turn [p]."""


def turn_level(time: Vector, drive: Vector, turn: int, between: tuple[int, int], noise: float) -> TurnLevel:
    """Return the level of a turn of a drive; of few readings about it, the reading itself.

    Parameters
    ----------
    time, drive
        [n] Times, and readings of the drive.
    turn
        Sample of the turn.
    between
        Samples of the turns before and after it.
    noise
        Standard deviation of the readings.
    """
    noise = max(noise, _EXACT * float(np.ptp(drive)))
    off, far = np.abs(drive - drive[turn]), SHAPE.round * noise
    way = 1.0 if drive[turn] > max(drive[between[0]], drive[between[1]]) else -1.0
    while far > noise:
        start = turn - _reach(off[between[0] : turn + 1][::-1], far)
        stop = turn + _reach(off[turn : between[1] + 1], far) + 1
        if min(turn - start, stop - 1 - turn) < 2 * SIDE:
            break
        made = _over(time[start:stop], drive[start:stop], turn - start, way, noise)
        if made is not None:
            return made._replace(start=start)
        far *= 0.5
    return _reading(drive, turn, noise)


def _over(time: Vector, drive: Vector, turn: int, way: float, noise: float) -> TurnLevel | None:
    """Return the level over some readings; None where it is far from all shapes, as by stairs."""
    when = (time - time[0]) / (time[-1] - time[0])
    what = (drive - drive[turn]) / noise
    shapes = [each for each in (_estimate(shape, when, what, way) for shape in _shapes()) if each is not None]
    if not shapes:
        return None
    evidence = np.array([each.log_evidence for each in shapes])
    weight = np.exp(evidence - evidence.max())
    weight /= weight.sum()
    levels = np.array([each.level for each in shapes])
    level = float(weight @ levels)
    variance = float(weight @ (np.array([each.variance for each in shapes]) + (levels - level) ** 2))
    best = shapes[int(np.argmax(evidence))]
    left = best.left / max(len(what) - best.parameters, 1)  # a shape that is none of these has a wider error
    if left > CHANCE.clear**2:
        return None
    values = drive[turn] + noise * (weight @ np.array([each.values for each in shapes]))
    se = noise * math.sqrt(variance * max(left, 1.0))
    return TurnLevel(float(drive[turn] + noise * level), se, 0, values)


def _reading(drive: Vector, turn: int, noise: float) -> TurnLevel:
    """Return the reading of a turn as its level."""
    step = min(abs(float(drive[turn + side] - drive[turn])) for side in (-1, 1))
    return TurnLevel(float(drive[turn]), math.hypot(noise, 0.5 * step), turn, drive[turn : turn + 1])


def _reach(off: Vector, far: float) -> int:
    """Return how many readings of a leg count; `off` is how far each lies from the turn, the turn first."""
    inside = off < min(far, 0.5 * float(off.max()))
    near = len(off) - 1 if inside.all() else int(np.argmin(inside)) - 1
    return min(max(near, 2 * SIDE), LEVEL.most, len(off) // 2)


def _shapes() -> Iterator[_Shape]:
    yield _Shape(
        0, lambda t, _: np.ones((1, len(t), 1)), lambda c, _: (np.ones_like(c), np.ones(len(c), bool))
    )
    yield _Shape(0, _polynomial, _top)
    yield _Shape(2, _rounded, _rounded_level)
    for powers in product((1, 2), repeat=2):
        yield _Shape(1, lambda t, ends, p=powers: _sides(t, ends[:, [0, 0]], p), _rest_level)
        yield _Shape(2, lambda t, ends, p=powers: _sides(t, ends, p), _rest_level)


def _polynomial(time: Vector, _: Matrix) -> np.ndarray:
    return np.vander(time - _MIDDLE, _TERMS, increasing=True)[None]


def _top(coefficients: Matrix, _: Matrix) -> tuple[Matrix, np.ndarray]:
    """Return the powers of where the polynomial is farthest from its ends."""
    x = np.linspace(-_HALF, _HALF, 10 * LEVEL.most + 1)
    values = np.polynomial.polynomial.polyval(x, coefficients[0])
    at = int(np.argmax(np.abs(values - 0.5 * (values[0] + values[-1]))))
    return x[at] ** np.arange(_TERMS)[None], np.array([0 < at < len(x) - 1])


def _sides(time: Vector, ends: Matrix, powers: tuple[int, int]) -> np.ndarray:
    """Return a rest between two sides, straight or half a parabola."""
    before = np.maximum(ends[:, :1] - time, 0.0) ** powers[0]
    behind = np.maximum(time - ends[:, 1:], 0.0) ** powers[1]
    return np.stack([np.ones_like(before), before, behind], axis=-1)


def _rest_level(coefficients: Matrix, ends: Matrix) -> tuple[Matrix, np.ndarray]:
    ordered = ends[:, 0] <= ends[:, -1]
    return np.tile([1.0, 0.0, 0.0], (len(ends), 1)), ordered & (
        coefficients[:, 1] * coefficients[:, 2] >= 0.0
    )


def _rounded(time: Vector, ends: Matrix) -> np.ndarray:
    """Return two straight sides, joined by a parabola over a width on either side of where they meet."""
    beyond, width = time - ends[:, :1], _width(ends)
    bend = np.clip(beyond + width, 0.0, 2.0 * width) ** 2 / (4.0 * width)
    return np.stack([np.ones_like(beyond), beyond, bend + np.maximum(beyond - width, 0.0)], axis=-1)


def _width(ends: Matrix) -> Matrix:
    return np.maximum(_HALF * ends[:, 1:], 1e-6)


def _rounded_level(coefficients: Matrix, ends: Matrix) -> tuple[Matrix, np.ndarray]:
    slope, change, width = coefficients[:, 1], coefficients[:, 2], _width(ends)[:, 0]
    share = -slope / np.where(change == 0.0, 1.0, change)  # of the parabola, to its top
    top = np.stack([np.ones_like(share), (2.0 * share - 1.0) * width, share**2 * width], axis=-1)
    return top, (share > 0.0) & (share < 1.0)


def _estimate(shape: _Shape, time: Vector, drive: Vector, way: float) -> _Estimate | None:
    """Return the level by one shape, over all of its ends; None where it does not turn.

    `drive` is 0 in the turn, and a level lower by six standard deviations is none: no chance puts a reading
    that far above it. `way` is −1 for a turn at the bottom.
    """
    middle, half = np.full(shape.ends, _MIDDLE), _HALF
    made = None
    for _ in range(SHAPE.closer if shape.ends else 1):
        tried = [np.clip(at + np.linspace(-half, half, SHAPE.positions), 0.0, 1.0) for at in middle]
        ends = np.array(list(product(*tried))) if shape.ends else np.zeros((1, 0))
        curves = shape.curves(time, ends)
        square = np.swapaxes(curves, 1, 2) @ curves
        inverse = np.linalg.inv(square + _RIDGE * np.eye(square.shape[-1]))
        along = drive @ curves
        coefficients = np.einsum("pij,pj->pi", inverse, along)
        top, turns = shape.level(coefficients, ends)
        levels = np.einsum("pi,pi->p", top, coefficients)
        turns = turns & (way * levels > -CHANCE.never)
        explained = np.where(turns, np.einsum("pi,pi->p", coefficients, along), -np.inf)
        most = float(explained.max())
        if not np.isfinite(most):
            break
        share = np.exp(0.5 * (explained - most))
        cells = shape.ends * math.log(2.0 * half / (SHAPE.positions - 1))
        parameters = curves.shape[2] + shape.ends
        left = float(drive @ drive) - most
        evidence = math.log(share.sum()) + cells - 0.5 * left - 0.5 * curves.shape[2] * math.log(len(time))
        share /= share.sum()
        level = float(share @ levels)
        variance = share @ (np.einsum("pi,pij,pj->p", top, inverse, top) + (levels - level) ** 2)
        at = int(np.argmax(explained))
        made = _Estimate(evidence, level, float(variance), left, parameters, curves[at] @ coefficients[at])
        if 1.0 / float(share @ share) > LEVEL.counted:
            break
        middle, half = ends[at], 2.0 * half / (SHAPE.positions - 1)
    return made

"""The shape of a drive about a turn or an end: it comes in, may rest, and leaves; docs/model.md (66).

Each side is straight or half of a parabola. All kinds are fitted, and that with the most evidence counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE

_NONE = 0  # where a side is missing
_POWERS = (1, 2)  # of a straight side, and of a round one


@dataclass(frozen=True, slots=True)
class ShapeSettings:
    """Which readings the shape of a turn is fitted to, and when it fits.

    Frozen on the development seeds of `benchmarks.discovery`.
    """

    round: float = 40.0
    """S.d. off the turn up to which the shape holds [1]; chosen."""
    positions: int = 17
    """Positions tried at a time for the end of a side; chosen."""
    closer: int = 4
    """Times that they are tried, each time between the neighbours of the best one; derived: to 1/4000 of the
    readings."""
    unlike: float = 2.0
    """Parameters that a turn with one straight and one round side counts more [1]; chosen: it is rare."""


SHAPE = ShapeSettings()
SIDE = 2
"""Readings of a side at least: its slope and where it ends."""


def fitted_turn(
    time: Vector, drive: Vector, turn: int, between: tuple[int, int], noise: float
) -> tuple[int, Vector] | None:
    """Return the first sample and the values of the shape about a turn; None where none fits.

    Parameters
    ----------
    time, drive
        [n] Times, and readings of the drive.
    turn
        Sample of the turn, or the first or last of all.
    between
        Samples of the turns before and after it.
    noise
        Standard deviation of the readings, above 0.
    """
    off = np.abs(drive - drive[turn])
    start = turn - _reach(off[between[0] : turn + 1][::-1], noise)
    stop = turn + _reach(off[turn : between[1] + 1], noise) + 1
    sloping = off[start:stop] > CHANCE.never * noise
    plain = bool(sloping[0]), bool(sloping[-1])
    sides = sum(plain)
    if sides == 0 or stop - start <= 2 * (1 + sides):
        return None
    when = (time[start:stop] - time[start]) / (time[stop - 1] - time[start])
    what = (drive[start:stop] - drive[turn]) / noise
    best = min(_shapes(when, what, plain), key=attrgetter("criterion"))
    # all of a long rest would hide a bad fit
    near = np.convolve(sloping, np.ones(2 * SIDE + 1), "same") > 0.0
    count = int(near.sum())
    freedom = max(count - count / len(when) - best.parameters + 1, 1.0)  # the rest shares the level
    left = float(np.square(what - best.values)[near].sum())
    if left > freedom + CHANCE.clear * math.sqrt(2.0 * freedom):
        return None
    return start, drive[turn] + noise * best.values


class _Shape(NamedTuple):
    """One kind of shape, the nearest to some readings."""

    criterion: float
    """Bayesian information criterion [1]."""
    parameters: int
    values: Vector
    """[n] In standard deviations of the noise."""


def _shapes(time: Vector, drive: Vector, plain: tuple[bool, bool]) -> Iterator[_Shape]:
    """Yield the nearest shape of each kind to a drive in standard deviations of its noise.

    A side that is not plain may be missing.
    """
    for powers in product(*(_POWERS if side else (_NONE, *_POWERS) for side in plain)):
        parameters = 1 + 2 * sum(power != _NONE for power in powers)
        unlike = SHAPE.unlike * (set(powers) == set(_POWERS))
        yield _scored(drive, _nearest(time, drive, powers), parameters, unlike)
    # one parabola, without a rest
    yield _scored(drive, np.polynomial.Polynomial.fit(time, drive, 2)(time), 3)


def _scored(drive: Vector, values: Vector, parameters: int, unlike: float = 0.0) -> _Shape:
    left = float(np.square(drive - values).sum())
    return _Shape(left + (parameters + unlike) * math.log(len(drive)), parameters, values)


def _reach(off: Vector, noise: float) -> int:
    """Return how many samples beyond a turn belong to its shape: where a side is short, those of the rest.

    `off` is how far each sample of the leg lies from the turn, the turn first.
    """
    sloping = off > CHANCE.never * noise
    inside = off < min(SHAPE.round * noise, 0.5 * float(off.max()))
    rest, near = (int(np.argmax(each)) if each.any() else len(off) for each in (sloping, ~inside))
    reach = max(near, rest + SIDE)
    whole = reach <= len(off) and bool(sloping[rest : rest + SIDE].all())
    return (reach if whole and off[reach - 1] < off.max() - CHANCE.never * noise else rest) - 1


class _Side(NamedTuple):
    """Sums over the readings of one side, for each position at which it may end."""

    curve: Vector
    """[positions, n] 0 in the rest."""
    whole: Vector
    """[positions] Of the curve."""
    square: Vector
    """[positions] Of its square; infinite where there is nothing of it."""
    along: Vector
    """[positions] Of its product with the readings."""


def _side(distance: Vector, drive: Vector, power: int) -> _Side:
    curve = np.maximum(distance, 0.0) ** max(power, 1)
    square = np.square(curve).sum(axis=1)
    return _Side(curve, curve.sum(axis=1), np.where(square > 0.0, square, np.inf), curve @ drive)


def _nearest(time: Vector, drive: Vector, powers: tuple[int, ...]) -> Vector:
    """Return the values [n] of the nearest shape with sides of these powers, time from 0 to 1.

    A missing side ends where the readings begin, or begins where they end: all of it is rest.
    """
    first, last = (0.5 if power else edge for power, edge in zip(powers, (0.0, 1.0), strict=True))
    half = 0.5
    values = np.full(len(time), np.inf)
    for _ in range(SHAPE.closer):
        step = np.linspace(-half, half, SHAPE.positions)
        ends, begins = (
            np.clip(at + step, 0.0, 1.0) if power else np.array([at])
            for at, power in zip((first, last), powers, strict=True)
        )
        came = _side(ends[:, None] - time, drive, powers[0])
        left = _side(time - begins[:, None], drive, powers[1])
        best = _best(came, left, ends, begins, drive)
        if best is None:
            break
        i, j, level = best
        one, other = ((each.along - each.whole * level) / each.square for each in (came, left))
        values = level + one[i] * came.curve[i] + other[j] * left.curve[j]
        first, last, half = float(ends[i]), float(begins[j]), 2.0 * half / (SHAPE.positions - 1)
    return values


def _best(
    came: _Side, left: _Side, ends: Vector, begins: Vector, drive: Vector
) -> tuple[int, int, float] | None:
    """Return the pair of ends nearest to the readings, and the level of the rest; None where no pair turns.

    The sides share no reading: normal equations of the level and both sides have a closed solution.
    """
    one, other = came.along / came.square, left.along / left.square
    count = len(drive) - (came.whole**2 / came.square)[:, None] - left.whole**2 / left.square
    total = drive.sum() - (came.whole * one)[:, None] - left.whole * other
    level = total / np.maximum(count, 1e-9)
    rise = np.sign((came.along - came.whole * level.T).T), np.sign(left.along - left.whole * level)
    present = np.isfinite(came.square)[:, None] & np.isfinite(left.square)
    turning = ~present | (rise[0] * rise[1] > 0.0)
    sound = turning & (ends[:, None] <= begins) & (count > 1e-9)
    if not sound.any():
        return None
    explained = level * total + (came.along * one)[:, None] + left.along * other
    i, j = np.unravel_index(np.argmax(np.where(sound, explained, -np.inf)), sound.shape)
    return int(i), int(j), float(level[i, j])

"""How many pieces a chain of arcs needs: they are straightened, merged, dropped and split by BIC."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import numpy as np
from numba import njit

from tssgeom.route.arcs.dense import explained, factor
from tssgeom.route.arcs.fit import (
    Chain,
    Data,
    criterion,
    curvature_columns,
    equations_of,
    first_joint_column,
    goal,
    noise_variance,
    parameter_count,
    parameter_covariance,
    settle,
    values,
)

_SPLITS = 4  # parts into which a piece is cut to see where another joint would help
_MOST_PIECES = 40
_MOST_MOVES = 120
_MOST_TRIES = 6, 12  # of simpler chains between two frames, and in a fit from nothing
_MOST_SPLITS = 3  # tried
_SHORT = 8.0  # shortest pieces: one so short may be dropped whole
_OF_A_JOINT = 3.0  # parameters: the joint and the curvature behind it
_LATEST = 3.0  # ln n by which a simpler chain may promise to be worse and still be tried

_ALL = slice(None)
_STRAIGHTENED, _MERGED, _DROPPED = 0, 1, 2
_NONE = cast(int, np.int64(-1))  # no literal, for which a kernel would be compiled once more


def fit_chain(data: Data, first: Chain, most: int = _MOST_MOVES) -> Chain:
    """Merge, straighten and split pieces as long as the Bayesian information criterion falls.

    Parameters
    ----------
    data
        The points.
    first
        Where to start, as `settle` leaves it.
    most
        How many moves to make at most.
    """
    best = first
    for _ in range(most):
        found = simpler(data, best) or finer(data, best)
        if found is None:
            break
        best = found
    return best


def simpler(data: Data, chain: Chain, unlikely: slice = _ALL) -> Chain | None:
    """Try one piece straightened, dropped or merged, those first that promise most.

    Parameters
    ----------
    data, chain
        The points, and the chain as `settle` leaves it.
    unlikely
        Which ones to try of those that straight lines do not promise to help, the likeliest first.
    """
    promise, kind, piece = _simplifications(data, chain)
    now, latest = criterion(data, chain), _LATEST * math.log(values(data))
    most = _MOST_TRIES[unlikely is _ALL]
    order = [i for i in np.argsort(promise)[:most] if promise[i] < latest]
    for i in _tried(order, [bool(promise[i] < 0.0) for i in order], unlikely):
        if tried := _improved(data, _simplified(chain, int(kind[i]), int(piece[i])), now):
            return tried
    return None


def _tried(order: Sequence[int], sure: Sequence[bool], unlikely: slice) -> list[int]:
    """Return what is sure to be worth a trial, and some of the rest; both are in order."""
    count = sum(sure)
    return [*order[:count], *order[count:][unlikely]]


def _improved(data: Data, candidate: Chain, least: float) -> Chain | None:
    """Return the candidate, fitted, if its criterion is below `least`."""
    tried = settle(data, candidate, goal(data, parameter_count(candidate.curved, data.free), least))
    # a fit that came down slowly may have stopped short of its best
    return settle(data, tried) if criterion(data, tried) < least and _seen(data, tried) else None


def _seen(data: Data, chain: Chain) -> bool:
    """Whether there is a point on every piece, or it is a kink between two points."""
    piece = np.searchsorted(chain.joints[1:], chain.stations[data.weight > 0.0], side="right")
    return all(_length(chain, j) < data.gap for j in set(range(len(chain.joints))) - set(piece.tolist()))


def finer(data: Data, chain: Chain, unlikely: slice = _ALL) -> Chain | None:
    """Try one joint more where the residuals ask for it most; parameters as in `simpler`."""
    if len(chain.bend) >= _MOST_PIECES:
        return None
    saved = _saved_by_joints(data, chain)
    best, price = saved.max(axis=1), math.log(values(data))
    now = criterion(data, chain)
    order = [j for j in np.argsort(-best)[:_MOST_SPLITS] if best[j] > price]
    for j in _tried(order, [bool(best[j] > _OF_A_JOINT * price) for j in order], unlikely):
        where = float(chain.joints[j]) + _length(chain, int(j)) * int(np.argmax(saved[j])) / _SPLITS
        if tried := _improved(data, _split(chain, int(j), where), now):
            return tried
    return None


@njit(cache=True, nogil=True)
def slopes(data: Data, chain: Chain) -> float:
    """Return what sloping curvature in every piece would save beyond chance, in noise variances.

    A staircase that stands for a smooth route wants its steps to slope; true pieces do not.
    """
    lower, unit = factor(chain.matrix, 1e-12)
    gradient, cross, own, slope = _parts(data, chain)
    m, n = len(gradient), 2 * len(chain.bend)
    ramp_cross, ramp_own, ramp_slope = np.zeros((m, n)), np.zeros((n, n)), np.zeros(n)
    for e in range(n):
        j, c = e // 2, e % 2
        for i in range(_SPLITS):
            way = i - 0.5 * (_SPLITS - 1)
            ramp_slope[e] += way * slope[j, i, c]
            for a in range(m):
                ramp_cross[a, e] += way * cross[a, j, i, c]
            for f in range(n):
                for h in range(_SPLITS):
                    ramp_own[e, f] += way * (h - 0.5 * (_SPLITS - 1)) * own[j, i, c, f // 2, h, f % 2]
    saved = explained(lower, unit, gradient, ramp_cross, ramp_own, ramp_slope)
    return saved / noise_variance(data, chain) - n


@njit(cache=True, nogil=True)
def _simplifications(data: Data, chain: Chain) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """List what could be left out: expected change of the criterion, kind and piece."""
    covariance = parameter_covariance(data, chain)
    column, price = curvature_columns(chain.curved, data.free), math.log(values(data))
    k = len(column)
    promise, kind, piece = np.empty(3 * k), np.empty(3 * k, np.int64), np.empty(3 * k, np.int64)
    count = 0
    for j in range(k):
        if column[j] >= 0:
            promise[count] = _worth(chain.bend[j], covariance, column[j], _NONE) - 2 * price
            kind[count], piece[count] = _STRAIGHTENED, j
            count += 1
        if j > 0:
            step = chain.bend[j] - chain.bend[j - 1]
            promise[count] = _worth(step, covariance, column[j], column[j - 1]) - 3 * price
            kind[count], piece[count] = _MERGED, j
            count += 1
        if k > 1 and _length(chain, j) < _SHORT * data.gap:
            promise[count], kind[count], piece[count] = -price, _DROPPED, j
            count += 1
    return promise[:count], kind[:count], piece[:count]


@njit(cache=True, nogil=True)
def _worth(step: np.ndarray, covariance: np.ndarray, plus: int, minus: int) -> float:
    """Squared size of a step [2] in its standard errors: the parameters at `plus` less those at `minus`."""
    own = np.zeros((2, 2))
    for a in range(2):
        for b in range(2):
            if plus >= 0:
                own[a, b] += covariance[plus + a, plus + b]
            if minus >= 0:
                own[a, b] += covariance[minus + a, minus + b]
            if plus >= 0 and minus >= 0:
                own[a, b] -= covariance[plus + a, minus + b] + covariance[minus + a, plus + b]
    determinant = own[0, 0] * own[1, 1] - own[0, 1] * own[1, 0]
    if determinant <= 1e-12 * own[0, 0] * own[1, 1]:
        return np.sum(step * step) / max(own[0, 0], own[1, 1]) if own[0, 0] + own[1, 1] > 0.0 else 0.0
    squares = own[1, 1] * step[0] ** 2 - 2 * own[0, 1] * step[0] * step[1] + own[0, 0] * step[1] ** 2
    return squares / determinant


def _simplified(chain: Chain, kind: int, j: int) -> Chain:
    """Piece j straightened, made one with the piece before, or left to its neighbours."""
    bend, curved = chain.bend.copy(), chain.curved.copy()
    if kind == _STRAIGHTENED:
        bend[j], curved[j] = 0.0, False
        return chain._replace(bend=bend, curved=curved)
    joints = chain.joints.copy()
    if kind == _MERGED:
        before, after = _length(chain, j - 1), _length(chain, j)
        bend[j - 1] = (before * bend[j - 1] + after * bend[j]) / max(before + after, 1e-12)
        curved[j - 1] |= curved[j]
    elif 0 < j < len(joints) - 1:
        joints[j + 1] = 0.5 * (joints[j] + joints[j + 1])
    return chain._replace(
        joints=np.delete(joints, max(j, 1)), bend=np.delete(bend, j, axis=0), curved=np.delete(curved, j)
    )


def left_out(data: Data, chain: Chain, j: int) -> Chain:
    """Return the chain without piece j, dropped or made one with a neighbour, whichever fits best."""
    ways = [(_DROPPED, j), (_MERGED, j), (_MERGED, j + 1)]
    tried = [
        settle(data, _simplified(chain, kind, i))
        for kind, i in ways
        if kind == _DROPPED or 0 < i < len(chain.bend)
    ]
    return min(tried, key=lambda one: one.cost)


def _split(chain: Chain, j: int, where: float) -> Chain:
    """Piece j cut at arc length `where`, both parts curved as it was."""
    curved = np.insert(chain.curved, j + 1, True)
    curved[j] = True
    return chain._replace(
        joints=np.insert(chain.joints, j + 1, where),
        bend=np.insert(chain.bend, j + 1, chain.bend[j], axis=0),
        curved=curved,
    )


@njit(cache=True, nogil=True)
def _length(chain: Chain, j: int) -> float:
    """Length of piece j [m]."""
    end = chain.joints[j + 1] if j + 1 < len(chain.joints) else chain.stations[-1]
    return end - chain.joints[j]


@njit(cache=True, nogil=True)
def _parts(data: Data, chain: Chain) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Cut every piece into equal parts with curvatures of their own, and write the normal equations of these.

    Returns
    -------
    gradient
        Of the parameters of the chain [m].
    cross
        Information between the parameters of the chain and the curvatures of the parts, [m, k, parts, 2].
    own
        Information of the curvatures of the parts among themselves, [k, parts, 2, k, parts, 2].
    slope
        Gradient of the curvatures of the parts, [k, parts, 2].
    """
    k, n = len(chain.bend), _SPLITS * len(chain.bend)
    at, bend, curved = np.empty(n), np.empty((n, 2)), np.ones(n, np.bool_)
    for j in range(k):
        length = _length(chain, j)
        for i in range(_SPLITS):
            at[_SPLITS * j + i] = chain.joints[j] + length * i / _SPLITS
            bend[_SPLITS * j + i, 0], bend[_SPLITS * j + i, 1] = chain.bend[j, 0], chain.bend[j, 1]
    matrix, gradient = equations_of(data, chain, at, bend, curved)
    base = first_joint_column(data.free)
    first = base + n - 1
    m = base + k - 1
    cross, mine = np.zeros((m + 2 * chain.curved.sum(), 2 * n)), np.zeros(m + 2 * chain.curved.sum())
    # the joints inside a piece have no effect, the curvature being the same; a piece's is that of its parts
    for row in range(m):
        source = row if row < base else base + _SPLITS * (row - base + 1) - 1
        mine[row] = gradient[source]
        cross[row] = matrix[source, first:]
    for j in range(k):
        if chain.curved[j]:
            for i in range(_SPLITS):
                for c in range(2):
                    part = first + 2 * (_SPLITS * j + i) + c
                    mine[m + c] += gradient[part]
                    cross[m + c] += matrix[part, first:]
            m += 2
    own = matrix[first:, first:].copy().reshape((k, _SPLITS, 2, k, _SPLITS, 2))
    slope = gradient[first:].copy().reshape((k, _SPLITS, 2))
    return mine, cross.reshape((len(mine), k, _SPLITS, 2)), own, slope


@njit(cache=True, nogil=True)
def _saved_by_joints(data: Data, chain: Chain) -> np.ndarray:
    """Return what a joint at each quarter of each piece [k, parts] would save, in noise variances."""
    long = np.empty(len(chain.joints), np.bool_)
    for j in range(len(long)):
        long[j] = _length(chain, j) >= 4 * data.gap
    lower, unit = factor(chain.matrix, 1e-12)
    gradient, cross, own, slope = _parts(data, chain)
    saved = _saved(lower, unit, gradient, cross, own, slope, chain.curved, long)
    return saved / noise_variance(data, chain)


@njit(cache=True, nogil=True)
def _saved(
    lower: np.ndarray,
    unit: np.ndarray,
    gradient: np.ndarray,
    cross: np.ndarray,
    own: np.ndarray,
    slope: np.ndarray,
    curved: np.ndarray,
    long: np.ndarray,
) -> np.ndarray:
    """Return what a joint at each quarter of the long pieces [k, parts] would save of the cost [m²]."""
    m, k = cross.shape[:2]
    saved = np.zeros((k, _SPLITS))
    for j in range(k):
        # of a curved piece the level is a parameter already: one side of the joint says all
        d = 2 if curved[j] else 4
        for cut in range(1, _SPLITS if long[j] else 1):
            side_cross, side_own, side_slope = np.zeros((m, d)), np.zeros((d, d)), np.zeros(d)
            parts = cut if curved[j] else _SPLITS
            for i in range(parts):
                here = 2 if i >= cut else 0
                for c in range(2):
                    side_slope[here + c] += slope[j, i, c]
                    for a in range(m):
                        side_cross[a, here + c] += cross[a, j, i, c]
                    for other in range(parts):
                        there = 2 if other >= cut else 0
                        for e in range(2):
                            side_own[here + c, there + e] += own[j, i, c, j, other, e]
            saved[j, cut] = explained(lower, unit, gradient, side_cross, side_own, side_slope)
    return saved

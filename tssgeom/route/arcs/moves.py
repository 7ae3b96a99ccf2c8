"""How many pieces a chain of arcs needs: they are straightened, merged, dropped and split by BIC."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.arrays import NO_INDEX
from tssgeom.route.arcs.chain import (
    Chain,
    Data,
    cost_at_criterion,
    criterion,
    curvature_columns,
    first_joint_column,
    noise_variance,
    parameter_count,
    piece_length,
    value_count,
)
from tssgeom.route.arcs.dense import factor, saved_by_more
from tssgeom.route.arcs.fit import equations_with_pieces, fit_fixed_pieces, parameter_covariance
from tssgeom.statistics import information_price


class ChainMoves(NamedTuple):
    """How other pieces of a chain are searched. Promises come from a straight line and may be wrong."""

    parts: int = 4
    """Parts into which a piece is cut to see where another joint would help [1]; chosen."""
    damping: float = 1e-12
    """Damping of the equations behind a promise, of the diagonal [1]; derived: rounding."""
    most_pieces: int = 40
    """Most pieces of a chain [1]; chosen."""
    most_moves: int = 120
    """Most moves of a fit from nothing [1]; chosen."""
    trials_between_frames: int = 6
    """Simpler chains that are tried between two frames [1]; chosen: no frame waits longer."""
    trials: int = 12
    """Simpler chains that are tried in a fit from nothing [1]; chosen."""
    splits: int = 3
    """Pieces in which another joint is tried [1]; chosen."""
    dropped_below: float = 8.0
    """Length of a piece below which it may be dropped whole [mean spacings]; chosen."""
    split_above: float = 4.0
    """Length of a piece from which on it may be split [mean spacings]; derived: a point for each part."""
    joint_parameters: float = 3.0
    """Parameters of another joint [1]; derived: the joint and the curvature behind it."""
    latest: float = 3.0
    """Rise of the criterion that a simpler chain may promise and still be tried [ln n]; chosen."""


MOVES = ChainMoves()
_ALL = slice(None)
_STRAIGHTENED, _MERGED, _DROPPED = 0, 1, 2


def fit_chain(data: Data, first: Chain, most: int = MOVES.most_moves) -> Chain:
    """Merge, straighten and split pieces as long as the Bayesian information criterion falls.

    Parameters
    ----------
    data
        The points.
    first
        Where to start, as `fit_fixed_pieces` leaves it.
    most
        How many moves to make at most.
    """
    best = first
    for _ in range(most):
        better = simpler(data, best) or finer(data, best)
        if better is None:
            break
        best = better
    return best


def simpler(data: Data, chain: Chain, unlikely: slice = _ALL) -> Chain | None:
    """Try one piece straightened, dropped or merged, those first that promise most.

    Parameters
    ----------
    data, chain
        The points, and the chain as `fit_fixed_pieces` leaves it.
    unlikely
        Which ones to try of those that straight lines do not promise to help, the likeliest first.
    """
    promise, kind, piece = _simplifications(data, chain)
    now, latest = criterion(data, chain), information_price(MOVES.latest, value_count(data))
    most = MOVES.trials if unlikely is _ALL else MOVES.trials_between_frames
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
    goal = cost_at_criterion(data, parameter_count(candidate.curved, data.free), least)
    tried = fit_fixed_pieces(data, candidate, goal)
    # a fit that came down slowly may have stopped short of its best
    better = criterion(data, tried) < least and _is_observed(data, tried)
    return fit_fixed_pieces(data, tried) if better else None


def _is_observed(data: Data, chain: Chain) -> bool:
    """Whether there is a point on every piece, or it is a kink between two points."""
    piece = np.searchsorted(chain.joints[1:], chain.stations[data.weight > 0.0], side="right")
    without_point = set(range(len(chain.joints))) - set(piece.tolist())
    return all(piece_length(chain, j) < data.spacing for j in without_point)


def finer(data: Data, chain: Chain, unlikely: slice = _ALL) -> Chain | None:
    """Try one joint more where it promises to save most; parameters as in `simpler`."""
    if len(chain.bend) >= MOVES.most_pieces:
        return None
    saved = _saved_by_joints(data, chain)
    best, price = saved.max(axis=1), information_price(1.0, value_count(data))
    now = criterion(data, chain)
    order = [j for j in np.argsort(-best)[: MOVES.splits] if best[j] > price]
    for j in _tried(order, [bool(best[j] > MOVES.joint_parameters * price) for j in order], unlikely):
        where = float(chain.joints[j]) + piece_length(chain, int(j)) * int(np.argmax(saved[j])) / MOVES.parts
        if tried := _improved(data, _split(chain, int(j), where), now):
            return tried
    return None


@njit(cache=True, nogil=True)
def saved_by_slopes(data: Data, chain: Chain) -> float:
    """Return what sloping curvature in every piece would save beyond chance, in noise variances.

    The steps of a staircase that stands for a smooth route fit better with a slope; those of true pieces do
    not.
    """
    lower, unit = factor(chain.matrix, MOVES.damping)
    gradient, cross, own, slope = _parts(data, chain)
    m, n = len(gradient), 2 * len(chain.bend)
    ramp_cross, ramp_own, ramp_slope = np.zeros((m, n)), np.zeros((n, n)), np.zeros(n)
    for e in range(n):
        j, c = e // 2, e % 2
        for i in range(MOVES.parts):
            way = i - 0.5 * (MOVES.parts - 1)
            ramp_slope[e] += way * slope[j, i, c]
            for a in range(m):
                ramp_cross[a, e] += way * cross[a, j, i, c]
            for f in range(n):
                for h in range(MOVES.parts):
                    ramp_own[e, f] += way * (h - 0.5 * (MOVES.parts - 1)) * own[j, i, c, f // 2, h, f % 2]
    saved = saved_by_more(lower, unit, gradient, ramp_cross, ramp_own, ramp_slope)
    return saved / noise_variance(data, chain) - n


@njit(cache=True, nogil=True)
def _simplifications(data: Data, chain: Chain) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """List what could be left out: expected change of the criterion, kind and piece."""
    covariance = parameter_covariance(data, chain)
    column, price = curvature_columns(chain.curved, data.free), information_price(1.0, value_count(data))
    k = len(column)
    promise, kind, piece = np.empty(3 * k), np.empty(3 * k, np.int64), np.empty(3 * k, np.int64)
    count = 0
    for j in range(k):
        if column[j] >= 0:
            promise[count] = _wald_statistic(chain.bend[j], covariance, column[j], NO_INDEX) - 2 * price
            kind[count], piece[count] = _STRAIGHTENED, j
            count += 1
        if j > 0:
            step = chain.bend[j] - chain.bend[j - 1]
            promise[count] = _wald_statistic(step, covariance, column[j], column[j - 1]) - 3 * price
            kind[count], piece[count] = _MERGED, j
            count += 1
        if k > 1 and piece_length(chain, j) < MOVES.dropped_below * data.spacing:
            promise[count], kind[count], piece[count] = -price, _DROPPED, j
            count += 1
    return promise[:count], kind[:count], piece[:count]


@njit(cache=True, nogil=True)
def _wald_statistic(step: np.ndarray, covariance: np.ndarray, plus: int, minus: int) -> float:
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
    """Piece j straightened, merged with the piece before, or dropped between its neighbours."""
    bend, curved = chain.bend.copy(), chain.curved.copy()
    if kind == _STRAIGHTENED:
        bend[j], curved[j] = 0.0, False
        return chain._replace(bend=bend, curved=curved)
    joints = chain.joints.copy()
    if kind == _MERGED:
        before, after = piece_length(chain, j - 1), piece_length(chain, j)
        bend[j - 1] = (before * bend[j - 1] + after * bend[j]) / max(before + after, 1e-12)
        curved[j - 1] |= curved[j]
    elif 0 < j < len(joints) - 1:
        joints[j + 1] = 0.5 * (joints[j] + joints[j + 1])
    return chain._replace(
        joints=np.delete(joints, max(j, 1)), bend=np.delete(bend, j, axis=0), curved=np.delete(curved, j)
    )


def without_piece(data: Data, chain: Chain, j: int) -> Chain:
    """Return the chain without piece j, dropped or merged with a neighbour, whichever fits best."""
    ways = [(_DROPPED, j), (_MERGED, j), (_MERGED, j + 1)]
    tried = [
        fit_fixed_pieces(data, _simplified(chain, kind, i))
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
    k, n = len(chain.bend), MOVES.parts * len(chain.bend)
    at, bend, curved = np.empty(n), np.empty((n, 2)), np.ones(n, np.bool_)
    for j in range(k):
        length = piece_length(chain, j)
        for i in range(MOVES.parts):
            at[MOVES.parts * j + i] = chain.joints[j] + length * i / MOVES.parts
            bend[MOVES.parts * j + i, 0], bend[MOVES.parts * j + i, 1] = chain.bend[j, 0], chain.bend[j, 1]
    matrix, gradient = equations_with_pieces(data, chain, at, bend, curved)
    base = first_joint_column(data.free)
    first = base + n - 1
    m = base + k - 1
    cross, mine = np.zeros((m + 2 * chain.curved.sum(), 2 * n)), np.zeros(m + 2 * chain.curved.sum())
    # the joints inside a piece have no effect, the curvature being the same; a piece's is that of its parts
    for row in range(m):
        source = row if row < base else base + MOVES.parts * (row - base + 1) - 1
        mine[row] = gradient[source]
        cross[row] = matrix[source, first:]
    for j in range(k):
        if chain.curved[j]:
            for i in range(MOVES.parts):
                for c in range(2):
                    part = first + 2 * (MOVES.parts * j + i) + c
                    mine[m + c] += gradient[part]
                    cross[m + c] += matrix[part, first:]
            m += 2
    own = matrix[first:, first:].copy().reshape((k, MOVES.parts, 2, k, MOVES.parts, 2))
    slope = gradient[first:].copy().reshape((k, MOVES.parts, 2))
    return mine, cross.reshape((len(mine), k, MOVES.parts, 2)), own, slope


@njit(cache=True, nogil=True)
def _saved_by_joints(data: Data, chain: Chain) -> np.ndarray:
    """Return what a joint at each quarter of each piece [k, parts] would save, in noise variances."""
    long = np.empty(len(chain.joints), np.bool_)
    for j in range(len(long)):
        long[j] = piece_length(chain, j) >= MOVES.split_above * data.spacing
    lower, unit = factor(chain.matrix, MOVES.damping)
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
    saved = np.zeros((k, MOVES.parts))
    for j in range(k):
        # the level of a curved piece is a parameter already: one side of the joint is enough
        d = 2 if curved[j] else 4
        for cut in range(1, MOVES.parts if long[j] else 1):
            side_cross, side_own, side_slope = np.zeros((m, d)), np.zeros((d, d)), np.zeros(d)
            parts = cut if curved[j] else MOVES.parts
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
            saved[j, cut] = saved_by_more(lower, unit, gradient, side_cross, side_own, side_slope)
    return saved

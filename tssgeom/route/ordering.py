"""Sensed points that stand off the curve through their neighbours, and sequences that are out of order."""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numba import njit
from scipy.spatial import KDTree

from tssgeom.arrays import Points, Vector, read_only
from tssgeom.route.stations import distance
from tssgeom.statistics import median

FEWEST = 8
"""Fewest points whose order, and whose place among their neighbours, can be judged."""
_OFF = 6.0  # typical distances from the neighbours' curve, beyond which a point may be an outlier
_END_OFF_DIRECTION = 15.0
_END_OFF = 0.1  # spacings that the parabola of the last five points must be off before one is doubted
_END_LEAP = 1.5  # spacings from an end to its neighbour that are too many
_TOO_FAR = 6.0  # spacings from an end to its neighbour that no bend explains
_LEAST_SURE = 4.0  # times the way that shows the direction, beyond which a leap counts no less
_END_BETTER = 0.3  # what must be left of that without the outlier
_LONGEST_RUN = 3
_UNEVEN = 4.0  # steps by which uneven points may lie ahead or behind
_GOING_ON = 6  # points whose line is followed beyond the end
_MOST_STRAY = 0.1  # of all points: where more are off, the trouble is another
_WILD = 0.9  # of the spread of all points: steps typically longer wander
_LEAP = (10.0, 0.4)  # typical steps, and of the spread: a longer step leaps
_MAX_LEAPS = 20
_NONE = cast(int, np.int64(-1))  # no literal, for which a kernel would be compiled once more
_NEIGHBOURS = 5  # so near in the sequence, points are near in space too


def stray(points: Points) -> np.ndarray:
    """Mark points [n] that stand off the curve through their neighbours by more than a spacing."""
    n = len(points)
    mark, index, kept = np.zeros(n, np.bool_), np.arange(n), read_only(points)
    for _ in range(max(1, n // 6)):
        off = worst(kept) if len(kept) >= FEWEST else -1
        if off < 0:
            break
        mark[index[off]] = True
        index = np.delete(index, off)
        kept = read_only(points[index])
    if mark.any():
        _unmark_long_runs(mark)
        _unmark_ends(points, mark)
    return mark if mark.sum() <= _MOST_STRAY * n else np.zeros_like(mark)


def _unmark_long_runs(mark: np.ndarray) -> None:
    """Unmark runs of many points: where many in a row are off, the sequence breaks and none is to blame."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mark, [False]))))
    for begin, end in edges.reshape(-1, 2):
        if end - begin > _LONGEST_RUN:
            mark[begin:end] = False


def _unmark_ends(points: Points, mark: np.ndarray) -> None:
    """Unmark points at an end that lie where the kept ones go on to: an outlier made them suspect."""
    for way in (slice(None), slice(None, None, -1)):
        p, off = points[way], mark[way]
        kept = np.flatnonzero(~off)[:_GOING_ON]
        if not len(kept) or not kept[0]:
            continue
        one, other = np.triu_indices(len(kept), 1)
        slope = np.median((p[kept[other]] - p[kept[one]]) / (kept[other] - kept[one])[:, None], axis=0)
        start = np.median(p[kept] - kept[:, None] * slope, axis=0)  # one outlier more does not turn the line
        step = float(np.linalg.norm(slope))
        apart = p[: kept[0]] - start - np.arange(kept[0])[:, None] * slope
        along = apart @ slope / (step + 1e-300)
        aside = np.sqrt(np.maximum(np.einsum("ij,ij->i", apart, apart) - along**2, 0.0))
        off[: kept[0]] &= (aside > step) | (np.abs(along) > _UNEVEN * step)


@njit(cache=True, nogil=True)
def worst(p: np.ndarray) -> int:
    """Return the point that is off most beyond doubt, the ends first; -1 if there is none."""
    return _worst(p, median(_lengths(p)))


@njit(cache=True, nogil=True)
def well_behaved(p: np.ndarray) -> bool:
    """Whether a few bounds tell that the points are in order and none is off; false where they do not."""
    steps = _lengths(p)
    spacing = median(steps)
    if np.max(steps) > _LEAP[0] * spacing or not _wide(p, spacing / _WILD):
        return False
    return _worst(p, spacing) < 0


@njit(cache=True, nogil=True)
def _lengths(p: np.ndarray) -> np.ndarray:
    """Measure the steps from point to point [n - 1] [m]."""
    steps = np.empty(len(p) - 1)
    for i in range(len(steps)):
        steps[i] = distance(p[i + 1], p[i])
    return steps


@njit(cache=True, nogil=True)
def _wide(p: np.ndarray, far: float) -> bool:
    """Whether more than half of the points are at least so far from their mean [m]."""
    mean, beyond = _mean(p), 0
    for i in range(len(p)):
        beyond += 1 if distance(p[i], mean) >= far else 0
    return beyond > len(p) // 2 + 1


@njit(cache=True, nogil=True)
def _mean(p: np.ndarray) -> np.ndarray:
    mean = np.zeros(3)
    for i in range(len(p)):
        for c in range(3):
            mean[c] += p[i, c] / len(p)
    return mean


@njit(cache=True, nogil=True)
def _worst(p: np.ndarray, spacing: float) -> int:
    """Return what `worst` does, of points of a known spacing [m]."""
    ends, typical = np.empty((2, 6, 3)), -1.0
    for i in range(6):
        for c in range(3):
            ends[0, i, c], ends[1, i, c] = p[i, c], p[len(p) - 1 - i, c]
    for side in range(2):
        if _smooth_end(ends[side], spacing):
            continue
        typical = _typical(p) if typical < 0.0 else typical
        off = _worst_of_end(ends[side], spacing, typical)
        if off >= 0:
            return off if side == 0 else len(p) - 1 - off
    return _worst_inside(p, spacing)


@njit(cache=True, nogil=True)
def _typical(p: np.ndarray) -> float:
    """Median over the route of how far five points lie from a parabola [m]."""
    every = 1 + len(p) // 20
    windows, window = np.empty((len(p) - 5) // every + 1), np.empty((5, 3))
    for w in range(len(windows)):
        for i in range(5):
            for c in range(3):
                window[i, c] = p[w * every + i, c]
        windows[w] = _off_parabola(window, _NONE)
    return median(windows)


@njit(cache=True, nogil=True)
def _smooth_end(p: np.ndarray, spacing: float) -> bool:
    """Whether no end point would be doubted, whatever is typical of the route."""
    return _off_parabola(p[:5], _NONE) <= _END_OFF * spacing and _off_direction(p, spacing) <= 0.0


@njit(cache=True, nogil=True)
def _worst_inside(p: np.ndarray, spacing: float) -> int:
    """Return the inner point that stands off every guess from its neighbours most, if beyond doubt, or -1.

    A good point beside an outlier still agrees with one of the guesses: halfway between the next, between the
    next but one, or straight on from either side. What leaps ahead of the next point or back behind the last
    counts as off by as much.
    """
    if not _any_off_middle(p, spacing):
        return -1
    size = np.empty(len(p) - 4)
    for i in range(2, len(p) - 2):
        far, before, after, farther = p[i - 2], p[i - 1], p[i + 1], p[i + 2]
        square = _off_line(p[i], before, 0.5, after, 0.5, before, after)
        square = min(square, _off_line(p[i], far, 0.5, farther, 0.5, far, farther))
        square = min(square, _off_line(p[i], before, 2.0, far, -1.0, far, before))
        square = min(square, _off_line(p[i], after, 2.0, farther, -1.0, farther, after))
        size[i - 2] = max(math.sqrt(square), _backwards(before, p[i], after))
    most = int(np.argmax(size))
    return most + 2 if size[most] > max(_OFF * median(size), spacing) else -1


@njit(cache=True, nogil=True)
def _any_off_middle(p: np.ndarray, spacing: float) -> bool:
    """Whether any inner point is off the middle of its neighbours by more than a spacing."""
    for i in range(2, len(p) - 2):
        before, after = p[i - 1], p[i + 1]
        if not _off_line(p[i], before, 0.5, after, 0.5, before, after) <= spacing * spacing:
            return True
        if not _backwards(before, p[i], after) <= spacing:
            return True
    return False


@njit(cache=True, nogil=True)
def _off_line(
    here: np.ndarray, a: np.ndarray, wa: float, b: np.ndarray, wb: float, begin: np.ndarray, end: np.ndarray
) -> float:
    """Squared distance of a point from wa·a + wb·b across the way from `begin` to `end`."""
    along, way2, off2 = 0.0, 1e-300, 0.0
    for c in range(3):
        off, way = here[c] - wa * a[c] - wb * b[c], end[c] - begin[c]
        along += off * way
        way2 += way * way
        off2 += off * off
    return max(off2 - along * along / way2, 0.0)


@njit(cache=True, nogil=True)
def _backwards(before: np.ndarray, here: np.ndarray, after: np.ndarray) -> float:
    """Tell how far a point lies ahead of the next one or behind the last, along the way between them."""
    ahead, behind, way2 = 0.0, 0.0, 1e-300
    for c in range(3):
        way = after[c] - before[c]
        ahead += (here[c] - before[c]) * way
        behind += (after[c] - here[c]) * way
        way2 += way * way
    return max(-min(ahead, behind) / math.sqrt(way2), 0.0)


@njit(cache=True, nogil=True)
def _worst_of_end(p: np.ndarray, spacing: float, typical: float) -> int:
    """Return which of the first three points keeps the others from lying on a parabola, or -1."""
    whole = _off_parabola(p[:5], _NONE)
    if whole > max(_OFF * typical, _END_OFF * spacing):
        best, least = -1, _END_BETTER * whole
        for i in range(3):
            off = _off_parabola(p, i)
            if off < least:
                best, least = i, off
        if best >= 0:
            return best
    return 0 if _off_direction(p, spacing) > _END_OFF_DIRECTION * typical else -1


@njit(cache=True, nogil=True)
def _off_direction(p: np.ndarray, spacing: float) -> float:
    """Tell how far the first point leaps aside from straight on from the next ones, or 0 [m].

    What the bend of these explains twice over is taken off, and the farther the leap beside the points that
    show the way, the less it counts.
    """
    far = 3  # the point that shows the way: neighbours within the noise do not
    while far < 5 and distance(p[1], p[far]) < 2 * spacing:
        far += 1
    size, length = distance(p[0], p[1]), distance(p[1], p[far]) + 1e-300
    square = 0.0
    for c in range(3):
        square += (p[0, c] - p[1, c] - size * (p[1, c] - p[far, c]) / length) ** 2
    aside = math.sqrt(square)
    if not (size > _END_LEAP * spacing and aside > 0.6 * size):
        return 0.0
    if size > _TOO_FAR * spacing:
        return aside / min(size / length, _LEAST_SURE)
    return max(aside - _bent_beyond(p, size * (size + length)), 0.0) / max(size / length, 1.0)


@njit(cache=True, nogil=True)
def _bent_beyond(p: np.ndarray, square: float) -> float:
    """Return twice what the bend of points 1, 3 and 5 moves a route aside, for way times reach [m²]."""
    first, second = distance(p[1], p[3]) + 1e-300, distance(p[3], p[5]) + 1e-300
    change = 0.0
    for c in range(3):
        change += ((p[1, c] - p[3, c]) / first - (p[3, c] - p[5, c]) / second) ** 2
    return 2.0 * math.sqrt(change) / (first + second) * square


@njit(cache=True, nogil=True)
def _off_parabola(p: np.ndarray, without: int) -> float:
    """Root mean square distance of points from their parabola over chord length [m].

    `without` is a point to leave out, or -1.
    """
    n, k, last = len(p) - (1 if without >= 0 else 0), 0, -1
    which, chord = np.empty(n, np.int64), np.zeros(n)
    for i in range(len(p)):
        if i == without:
            continue
        which[k] = i
        if k > 0:
            chord[k] = chord[k - 1] + distance(p[i], p[last])
        k, last = k + 1, i
    # orthonormal polynomials of degree 0, 1 and 2 over the chord lengths
    basis = np.ones((3, n))
    for degree in range(3):
        for i in range(n if degree > 0 else 0):
            basis[degree, i] = basis[degree - 1, i] * (chord[i] / (chord[n - 1] + 1e-300))
        for lower in range(degree):
            share = 0.0
            for i in range(n):
                share += basis[degree, i] * basis[lower, i]
            for i in range(n):
                basis[degree, i] -= share * basis[lower, i]
        square = 1e-300
        for i in range(n):
            square += basis[degree, i] * basis[degree, i]
        for i in range(n):
            basis[degree, i] /= math.sqrt(square)
    total = 0.0
    rest = np.empty(n)
    for c in range(3):
        for i in range(n):
            rest[i] = p[which[i], c] - p[which[0], c]
        for degree in range(3):
            share = 0.0
            for i in range(n):
                share += rest[i] * basis[degree, i]
            for i in range(n):
                rest[i] -= share * basis[degree, i]
        for i in range(n):
            total += rest[i] * rest[i]
    return math.sqrt(total / (3 * n))


def out_of_order(points: Points) -> bool:
    """Whether the sequence wanders at random, or leaps away from a place that it visits at another time."""
    if len(points) < FEWEST:
        return False
    steps, typical, spread = _steps(points)
    if typical <= _WILD * spread and steps.max() <= max(_LEAP[0] * typical, _LEAP[1] * spread):
        return False
    tree = KDTree(points)
    if typical > _WILD * spread and typical > 3 * np.median(tree.query(points, k=2)[0][:, 1]):
        return True
    leaps = np.flatnonzero(steps > max(_LEAP[0] * typical, _LEAP[1] * spread))[:_MAX_LEAPS]
    if len(leaps) and np.linalg.norm(points[0] - points[-1]) < 2 * typical:
        return True
    return any(_elsewhere(tree, points[j], j, 2 * typical) for i in leaps for j in (i, i + 1))


@njit(cache=True, nogil=True)
def _steps(points: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Measure steps from point to point [n - 1], their median, and the median distance from the mean [m]."""
    steps, far, mean = _lengths(points), np.empty(len(points)), _mean(points)
    for i in range(len(points)):
        far[i] = distance(points[i], mean)
    return steps, median(steps), median(far)


def _elsewhere(tree: KDTree, point: Vector, index: int, radius: float) -> bool:
    """Whether a point far off in the sequence lies within `radius` [m] of this one."""
    return any(abs(other - index) > _NEIGHBOURS for other in tree.query_ball_point(point, radius))

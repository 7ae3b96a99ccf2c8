"""Outliers among raw points in plain Python, as oracle of the core."""

from __future__ import annotations

import math

import numpy as np

from tests.core.twins.statistics import median
from tssgeom.core.constants import CHANCE
from tssgeom.core.constants_route import RAW as LIMITS

_NONE = -1


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Distance between two positions [m]."""
    return math.dist(a, b)


def worst_outlier(p: np.ndarray, spacing: float) -> int:
    """Return the greatest outlier among points of a median spacing [m], the ends first; -1 for none."""
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


def _smooth_end(p: np.ndarray, spacing: float) -> bool:
    """Whether no end point is tested, whatever is typical of the route."""
    return _off_parabola(p[:5], _NONE) <= LIMITS.end_off_curve * spacing and _off_direction(p, spacing) <= 0.0


def _worst_inside(p: np.ndarray, spacing: float) -> int:
    """Return the inner point that is farthest from every guess from its neighbours, if an outlier, or -1.

    A good point beside an outlier still agrees with one of the guesses: halfway between the next, between the
    next but one, or straight on from either side. A point beyond the next one or behind the last
    is off by as much.
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
    return most + 2 if size[most] > max(CHANCE.never * median(size), spacing) else -1


def _any_off_middle(p: np.ndarray, spacing: float) -> bool:
    """Whether any inner point is off the middle of its neighbours by more than a spacing."""
    for i in range(2, len(p) - 2):
        before, after = p[i - 1], p[i + 1]
        if not _off_line(p[i], before, 0.5, after, 0.5, before, after) <= spacing * spacing:
            return True
        if not _backwards(before, p[i], after) <= spacing:
            return True
    return False


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


def _backwards(before: np.ndarray, here: np.ndarray, after: np.ndarray) -> float:
    """Return how far a point lies beyond the next one or behind the last, along the way between them."""
    forward, behind, way2 = 0.0, 0.0, 1e-300
    for c in range(3):
        way = after[c] - before[c]
        forward += (here[c] - before[c]) * way
        behind += (after[c] - here[c]) * way
        way2 += way * way
    return max(-min(forward, behind) / math.sqrt(way2), 0.0)


def _worst_of_end(p: np.ndarray, spacing: float, typical: float) -> int:
    """Return which of the first three points keeps the others from lying on a parabola, or -1."""
    whole = _off_parabola(p[:5], _NONE)
    if whole > max(CHANCE.never * typical, LIMITS.end_off_curve * spacing):
        best, least = -1, LIMITS.end_improvement * whole
        for i in range(3):
            off = _off_parabola(p, i)
            if off < least:
                best, least = i, off
        if best >= 0:
            return best
    return 0 if _off_direction(p, spacing) > LIMITS.end_off_direction * typical else -1


def _off_direction(p: np.ndarray, spacing: float) -> float:
    """Return how far the first point leaps aside from straight on from the next ones, or 0 [m].

    Twice what the bend of these explains is taken off, and the longer the leap beside the distance of the
    points that show the direction, the less it counts.
    """
    far = 3  # the point that shows the way: neighbours within the noise do not
    while far < 5 and distance(p[1], p[far]) < 2 * spacing:
        far += 1
    size, length = distance(p[0], p[1]), distance(p[1], p[far]) + 1e-300
    square = 0.0
    for c in range(3):
        square += (p[0, c] - p[1, c] - size * (p[1, c] - p[far, c]) / length) ** 2
    aside = math.sqrt(square)
    if not (size > LIMITS.end_leap * spacing and aside > LIMITS.end_leap_aside * size):
        return 0.0
    if size > LIMITS.end_too_far * spacing:
        return aside / min(size / length, LIMITS.most_discount)
    return max(aside - _bent_beyond(p, size * (size + length)), 0.0) / max(size / length, 1.0)


def _bent_beyond(p: np.ndarray, square: float) -> float:
    """Return twice what the bend of points 1, 3 and 5 moves a route aside, for way times reach [m²]."""
    first, second = distance(p[1], p[3]) + 1e-300, distance(p[3], p[5]) + 1e-300
    change = 0.0
    for c in range(3):
        change += ((p[1, c] - p[3, c]) / first - (p[3, c] - p[5, c]) / second) ** 2
    return 2.0 * math.sqrt(change) / (first + second) * square


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

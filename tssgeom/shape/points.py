"""Sensed points, validated once: what may be fitted, what is refused, and what is worth a warning."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.spatial import KDTree

from tssgeom.arrays import Points, Vector, read_only
from tssgeom.errors import ShapeError
from tssgeom.shape.stations import across

MIN_POINTS = 4
_MIN_TO_JUDGE_ORDER = 8
_OFF = 6.0  # typical distances from the neighbours' curve, beyond which a point may be an outlier
_END_OFF_DIRECTION = 15.0
_END_OFF = 0.1  # spacings that the parabola of the last five points must be off before one is doubted
_END_LEAP = 1.5  # spacings from an end to its neighbour that are too many
_END_BETTER = 0.3  # what must be left of that without the outlier
_LONGEST_RUN = 3
_MOST_STRAY = 0.1  # of all points: where more are off, the trouble is another
_MAX_LEAPS = 20
_NEIGHBOURS = 5  # so near in the sequence, points are near in space too


@dataclass(frozen=True, slots=True)
class Shape:
    """A sensed route that can be fitted, proximal to distal."""

    points: Points
    """Places that were seen, finite and distinct from their neighbours [m]."""
    index: Vector
    """Count of each point in the sensed sequence; a gap leaves a hole."""
    stations: Vector | None
    """Known arc length at each point, from the sensor [m]."""
    warnings: tuple[str, ...]


def clean(points: Points, stations: Vector | None = None) -> Shape:
    """Check sensed points and drop what cannot be used.

    Parameters
    ----------
    points
        Places along the route; a row of NaN is a point that was not seen [m].
    stations
        Known arc length at each point, increasing [m].

    Raises
    ------
    ShapeError
        Fewer than four distinct points, infinite coordinates, no extent, stations that do not increase, or
        points that are not in order along the route.
    """
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"points have shape {points.shape}: give one row of x, y, z for each point")
    if np.isinf(points).any():
        row = int(np.argmax(np.isinf(points).any(axis=1)))
        raise ShapeError(f"point {row} is infinite: leave a point that was not seen empty or NaN")
    known = _checked_stations(points, stations)
    seen = np.asarray(~np.isnan(points).any(axis=1))
    if known is not None:
        seen &= ~np.isnan(known)
    warnings = _gap_warnings(seen)
    index = np.flatnonzero(seen)
    keep = _distinct(points[index])
    if not keep.all():
        warnings += (f"{int((~keep).sum())} repeated points merged",)
    index = index[keep]
    stray = _far_off(points[index])
    if stray.any():
        named = ", ".join(str(i) for i in index[stray])
        warnings += (f"{int(stray.sum())} outlying points left out (count from 0: {named})",)
    index = index[~stray]
    found = points[index]
    _refuse_unusable(found, ordered=known is not None)
    return Shape(
        read_only(found),
        read_only(index.astype(np.float64)),
        None if known is None else read_only(known[index] - known[index[0]]),
        warnings,
    )


def _checked_stations(points: Points, stations: Vector | None) -> Vector | None:
    if stations is None:
        return None
    known = np.asarray(stations, dtype=np.float64)
    if known.shape != (len(points),):
        raise ShapeError(f"{known.size} stations for {len(points)} points: give one station for each point")
    finite = known[np.isfinite(known)]
    wrong = np.flatnonzero(np.diff(finite) < 0)
    if wrong.size:
        i = int(wrong[0])
        raise ShapeError(
            f"stations do not increase: {finite[i + 1]:g} m follows {finite[i]:g} m; "
            "give arc length from the proximal end"
        )
    return known


def _gap_warnings(seen: np.ndarray) -> tuple[str, ...]:
    inside = np.flatnonzero(seen)
    if not inside.size:
        return ()
    missing = int((~seen[inside[0] : inside[-1] + 1]).sum())
    return (f"{missing} points not seen, bridged",) if missing else ()


def _distinct(points: Points) -> np.ndarray:
    """Mark each point that differs from the one before it."""
    if not len(points):
        return np.zeros(0, dtype=bool)
    moved = np.any(np.diff(points, axis=0) != 0.0, axis=1)
    return np.concatenate(([True], moved))


def _far_off(points: Points) -> np.ndarray:
    """Mark points that stand off the curve through their neighbours by more than a spacing, worst first."""
    kept = np.arange(len(points))
    for _ in range(max(1, len(points) // 6)):
        if len(kept) < _MIN_TO_JUDGE_ORDER:
            break
        p = points[kept]
        spacing = float(np.median(np.linalg.norm(np.diff(p, axis=0), axis=1)))
        worst = _worst_of_end(p, spacing)
        if worst is None and (worst := _worst_of_end(p[::-1], spacing)) is not None:
            worst = len(p) - 1 - worst
        if worst is None and (worst := _worst_inside(p, spacing)) is None:
            break
        kept = np.delete(kept, worst)
    stray = _short_runs(~np.isin(np.arange(len(points)), kept))
    return stray if stray.sum() <= _MOST_STRAY * len(stray) else np.zeros_like(stray)


def _short_runs(marked: np.ndarray) -> np.ndarray:
    """Unmark runs of many points: where many in a row are off, the sequence breaks and none is to blame."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], marked, [False]))))
    for begin, end in edges.reshape(-1, 2):
        if end - begin > _LONGEST_RUN:
            marked[begin:end] = False
    return marked


def _worst_inside(p: Points, spacing: float) -> int | None:
    """Return the inner point that stands off every guess from its neighbours most, if off beyond doubt.

    A good point beside an outlier still agrees with one of the guesses: halfway between the next, between the
    next but one, or straight on from either side.
    """
    here, before, after = p[2:-2], p[1:-3], p[3:-1]
    guesses = (
        (0.5 * (before + after), after - before),
        (0.5 * (p[:-4] + p[4:]), p[4:] - p[:-4]),
        (2 * before - p[:-4], before - p[:-4]),
        (2 * after - p[4:], after - p[4:]),
    )
    size = np.min([_across(here - guess, way) for guess, way in guesses], axis=0)
    size = np.maximum(size, _backwards(before, here, after))
    worst = int(np.argmax(size))
    return worst + 2 if size[worst] > max(_OFF * np.median(size), spacing) else None


def _backwards(before: Points, here: Points, after: Points) -> Vector:
    """Tell how far a point lies ahead of the next one or behind the last, along the way between them [n]."""
    way = after - before
    way = way / (np.linalg.norm(way, axis=1)[:, None] + 1e-300)
    steps = [np.einsum("ij,ij->i", step, way) for step in (here - before, after - here)]
    return np.maximum(-np.minimum(*steps), 0.0)


def _across(off: Points, way: Points) -> Vector:
    """Length of the part of `off` [n, 3] that is normal to `way` [n, 3]."""
    unit = way / (np.linalg.norm(way, axis=1)[:, None] + 1e-300)
    return np.linalg.norm(across(off, unit), axis=1)


def _worst_of_end(p: Points, spacing: float) -> int | None:
    """Return which of the first three points keeps the others from lying on a parabola, if any does."""
    windows = [_off_parabola(p, i, i + 5, -1) for i in range(0, len(p) - 4, 1 + len(p) // 20)]
    whole, typical = windows[0], float(np.median(windows))
    without = [_off_parabola(p, 0, 6, i) for i in range(3)]
    doubtful = whole > max(_OFF * typical, _END_OFF * spacing)
    if doubtful and min(without) < _END_BETTER * whole:
        return int(np.argmin(without))
    return 0 if _off_direction(p, spacing) > _END_OFF_DIRECTION * typical else None


def _off_direction(p: Points, spacing: float) -> float:
    """Distance of the first point from straight on from the next ones, where it leaps aside, else 0 [m]."""
    leap, way = p[0] - p[1], p[1] - p[3]
    size = float(np.linalg.norm(leap))
    aside = float(np.linalg.norm(leap - size * way / (np.linalg.norm(way) + 1e-300)))
    return aside if size > _END_LEAP * spacing and aside > 0.6 * size else 0.0


@njit(cache=True, nogil=True)
def _off_parabola(p: np.ndarray, begin: int, end: int, without: int) -> float:
    """Root mean square distance of points begin to end from their parabola over chord length [m].

    `without` is a point to leave out, or -1.
    """
    n = end - begin - (1 if without >= 0 else 0)
    q, chord = np.empty((n, 3)), np.zeros(n)
    k = 0
    for i in range(begin, end):
        if i == without:
            continue
        q[k] = p[i]
        if k > 0:
            chord[k] = chord[k - 1] + math.sqrt(np.sum((q[k] - q[k - 1]) ** 2))
        k += 1
    # orthonormal polynomials of degree 0, 1 and 2 over the chord lengths
    basis = np.ones((3, n))
    for degree in range(3):
        if degree > 0:
            basis[degree] = basis[degree - 1] * (chord / (chord[-1] + 1e-300))
        for lower in range(degree):
            basis[degree] -= np.sum(basis[degree] * basis[lower]) * basis[lower]
        basis[degree] /= math.sqrt(np.sum(basis[degree] ** 2)) + 1e-300
    total = 0.0
    for c in range(3):
        rest = q[:, c].copy()
        for degree in range(3):
            rest -= np.sum(rest * basis[degree]) * basis[degree]
        total += np.sum(rest * rest)
    return math.sqrt(total / (3 * n))


def _refuse_unusable(points: Points, *, ordered: bool) -> None:
    distinct = len(np.unique(points, axis=0))
    if distinct < MIN_POINTS:
        raise ShapeError(f"{distinct} distinct points: a route needs at least {MIN_POINTS}")
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    if extent < 1e-6:
        raise ShapeError(f"the points span {extent * 1e3:g} mm: check the unit of the coordinates")
    if not ordered and _shuffled(points):
        raise ShapeError(
            "the points are not in order along the route: each lies far from the next although others are "
            "near; sort them from the proximal to the distal end"
        )


def _shuffled(points: Points) -> bool:
    """Whether the sequence wanders at random, or leaps away from a place that it visits at another time."""
    if len(points) < _MIN_TO_JUDGE_ORDER:
        return False
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    typical, spread = np.median(steps), np.median(np.linalg.norm(points - points.mean(axis=0), axis=1))
    tree = KDTree(points)
    nearest = np.median(tree.query(points, k=2)[0][:, 1])
    if typical > 0.9 * spread and typical > 3 * nearest:
        return True
    leaps = np.flatnonzero(steps > max(10 * typical, 0.4 * spread))[:_MAX_LEAPS]
    if len(leaps) and np.linalg.norm(points[0] - points[-1]) < 2 * typical:
        return True
    return any(_elsewhere(tree, points[j], j, 2 * typical) for i in leaps for j in (i, i + 1))


def _elsewhere(tree: KDTree, point: Vector, index: int, radius: float) -> bool:
    """Whether a point far off in the sequence lies within `radius` [m] of this one."""
    return any(abs(other - index) > _NEIGHBOURS for other in tree.query_ball_point(point, radius))

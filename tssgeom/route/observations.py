"""Sensed points, validated once: what may be fitted, what is refused, and what is worth a warning."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numba import njit

from tssgeom.arrays import Points, Vector, read_only
from tssgeom.errors import ShapeError
from tssgeom.route.directions import checked_directions
from tssgeom.route.ordering import FEWEST, out_of_order, stray, well_behaved, worst
from tssgeom.route.stations import station_warnings

MIN_POINTS = 4
_LEAST_EXTENT = 1e-6  # [m]
_FAR_BEHIND, _BEHIND = 10.0, 1e-6  # noises, and shares of the route, by which a point may lie behind others
_USUAL = (1e-3, 100.0)  # extents beyond which the unit is doubted [m]
_FARTHEST = 1e6  # from the origin: beyond it places within a route cannot be told apart [m]


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
    directions: Points | None = None
    """Sensed unit tangents, a row of NaN where none was sensed [n, 3]."""
    direction_noise: float = 0.0
    """Standard deviation of each component of a direction across the route [rad]."""
    length: float | None = None
    """Known length of the route from the first to the last sensed point [m]."""
    length_noise: float = 0.0
    """Standard deviation of that length [m]."""


def clean(
    points: Points,
    stations: Vector | None = None,
    directions: Points | None = None,
    direction_noise: float | None = None,
    length: float | None = None,
    length_noise: float = 0.0,
) -> Shape:
    """Check sensed points and drop what cannot be used.

    Parameters
    ----------
    points
        Places along the route; a row of NaN is a point that was not seen [m].
    stations
        Known arc length at each point, increasing [m].
    directions
        Unit tangents at the points, towards the distal end; a row of NaN is one not sensed [n, 3].
    direction_noise
        Standard deviation of each of their components across the route [rad]; without it they are not used.
    length, length_noise
        Known length of the route from the first to the last point, and its standard deviation [m].

    Raises
    ------
    ShapeError
        Fewer than four distinct points, infinite coordinates, no extent, stations that do not increase, or
        points that are not in order along the route; directions that are no unit vectors or run backwards; a
        length that is not positive.
    """
    points = read_only(points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"points have shape {points.shape}: give one row of x, y, z for each point")
    known = _checked_stations(points, stations)
    warnings: tuple[str, ...] = ()
    index, counts, found = None, _counts(len(points)), points
    if not _sound(points) or (known is not None and np.isnan(known).any()):
        index, warnings = _usable(points, known)
        found, counts = points[index], read_only(index.astype(np.float64))
        known = None if known is None else known[index]
        _refuse_unusable(found, ordered=known is not None)
    begun = None if known is None else read_only(known - known[0])
    if begun is not None:
        warnings += station_warnings(found, begun)
    shape = Shape(read_only(found), counts, begun, warnings)
    if directions is not None:
        shape = _with_directions(shape, directions, direction_noise, points, index)
    if length is not None:
        shape = _with_length(shape, length, length_noise, len(points))
    return shape


def _with_directions(
    shape: Shape, directions: Points, noise: float | None, points: Points, index: np.ndarray | None
) -> Shape:
    if not noise:
        unused = "directions are not used: state their noise, [shape] direction_noise_deg"
        return replace(shape, warnings=(*shape.warnings, unused))
    unit, warnings = checked_directions(directions, points)
    unit = unit if index is None else unit[index]
    told = None if np.isnan(unit).any(axis=1).all() else read_only(unit)
    return replace(shape, directions=told, direction_noise=noise, warnings=shape.warnings + warnings)


def _with_length(shape: Shape, length: float, noise: float, sensed: int) -> Shape:
    if not (math.isfinite(length) and length > 0.0):
        raise ShapeError(f"the length is {length:g} m: give a finite value > 0 m, or leave it out")
    if shape.index[0] > 0 or shape.index[-1] < sensed - 1:
        unused = "the stated length is not used: an end of the route was not seen"
        return replace(shape, warnings=(*shape.warnings, unused))
    return replace(shape, length=length, length_noise=noise)


@lru_cache(maxsize=64)
def _counts(n: int) -> Vector:
    """Count n points from 0; the same array each time, so that two frames tell that they sensed the same."""
    return read_only(np.arange(n, dtype=np.float64))


def _sound(points: Points) -> bool:
    """Whether every point may be used as it is, at one glance."""
    if len(points) < FEWEST:
        return False
    if _beyond_doubt(points):
        return True
    return _plain(points) and not out_of_order(points) and worst(points) < 0


@njit(cache=True, nogil=True)
def _beyond_doubt(points: np.ndarray) -> bool:
    """Whether the usual points are as they should be; where they are not, others look more closely."""
    return _plain(points) and well_behaved(points)


@njit(cache=True, nogil=True)
def _plain(points: np.ndarray) -> bool:
    """Whether points are finite, differ from the one before and four from each other, and span as usual."""
    square, distinct = 0.0, 0
    others = np.empty(MIN_POINTS, np.int64)
    for c in range(3):
        least, most = points[0, c], points[0, c]
        for i in range(len(points)):
            x = points[i, c]
            if not abs(x) <= _FARTHEST:
                return False
            least, most = min(least, x), max(most, x)
        square += (most - least) ** 2
    for i in range(len(points)):
        if i > 0 and _same(points[i], points[i - 1]):
            return False
        new = distinct < MIN_POINTS
        for k in range(distinct):
            new = new and not _same(points[i], points[others[k]])
        if new:
            others[distinct] = i
            distinct += 1
    return distinct == MIN_POINTS and _USUAL[0] ** 2 <= square <= _USUAL[1] ** 2


@njit(cache=True, nogil=True)
def _same(a: np.ndarray, b: np.ndarray) -> bool:
    return a[0] == b[0] and a[1] == b[1] and a[2] == b[2]


def _usable(points: Points, known: Vector | None) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the indices of the points that can be used, and what is to be said of the others."""
    if np.isinf(points).any():
        row = int(np.argmax(np.isinf(points).any(axis=1)))
        raise ShapeError(f"point {row} is infinite: leave a point that was not seen empty or NaN")
    far = (np.abs(points) > _FARTHEST).any(axis=1)
    if far.any():
        most, row = np.nanmax(np.abs(points)), int(np.argmax(far))
        raise ShapeError(f"point {row} of {most:g} m is too far out: check the unit of the coordinates")
    seen = np.asarray(~np.isnan(points).any(axis=1))
    if known is not None:
        seen &= ~np.isnan(known)
    warnings = _gap_warnings(seen)
    index = np.flatnonzero(seen)
    keep = _distinct(points[index])
    if not keep.all():
        warnings += (f"{int((~keep).sum())} repeated points merged",)
        index = index[keep]
    off = stray(points[index])
    if off.any():
        named = ", ".join(str(i) for i in index[off])
        warnings += (f"{int(off.sum())} outlying points left out (count from 0: {named})",)
    index = index[~off]
    return index, warnings + _size_warnings(points[index])


def _size_warnings(points: Points) -> tuple[str, ...]:
    extent = _extent(points)
    if not len(points) or _USUAL[0] <= extent <= _USUAL[1]:
        return ()
    return (f"the points span {extent * 1e3:.3g} mm: check the unit of the coordinates",)


def _extent(points: Points) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0


def _checked_stations(points: Points, stations: Vector | None) -> Vector | None:
    if stations is None:
        return None
    known = read_only(stations)
    if known.shape != (len(points),):
        raise ShapeError(f"{known.size} stations for {len(points)} points: give one station for each point")
    if _increasing(known):
        return known
    finite = known[np.isfinite(known)]
    wrong = np.flatnonzero(np.diff(finite) < 0)
    if wrong.size:
        i = int(wrong[0])
        raise ShapeError(
            f"stations do not increase: {finite[i + 1]:g} m follows {finite[i]:g} m; "
            "give arc length from the proximal end"
        )
    return known


@njit(cache=True, nogil=True)
def _increasing(known: np.ndarray) -> bool:
    """Whether all stations are finite and none lies before the last."""
    for i in range(len(known)):
        if not math.isfinite(known[i]) or (i > 0 and known[i] < known[i - 1]):
            return False
    return True


def _gap_warnings(seen: np.ndarray) -> tuple[str, ...]:
    inside = np.flatnonzero(seen)
    if not inside.size:
        return ()
    missing = int((~seen[inside[0] : inside[-1] + 1]).sum())
    bridged = (f"{missing} points not seen, bridged",) if missing else ()
    ends = (("first", int(inside[0])), ("last", len(seen) - 1 - int(inside[-1])))
    lost = tuple(f"the {which} {n} points not seen: the route is told without them" for which, n in ends if n)
    return bridged + lost


def _distinct(points: Points) -> np.ndarray:
    """Mark each point that differs from the one before it."""
    moved = np.any(np.diff(points, axis=0) != 0.0, axis=1)
    return np.concatenate((np.ones(min(len(points), 1), np.bool_), moved))


def _refuse_unusable(points: Points, *, ordered: bool) -> None:
    distinct = len(np.unique(points, axis=0))
    if distinct < MIN_POINTS:
        raise ShapeError(f"{distinct} distinct points: a route needs at least {MIN_POINTS}")
    extent = _extent(points)
    if extent < _LEAST_EXTENT:
        raise ShapeError(f"the points span {extent * 1e3:g} mm: check the unit of the coordinates")
    if not ordered and out_of_order(points):
        raise ShapeError(
            "the points are not in order along the route: each lies far from the next although others are "
            "near; sort them from the proximal to the distal end"
        )


def stray_warnings(shape: Shape, weight: Vector) -> tuple[str, ...]:
    """Name the points that a fit gave no weight."""
    stray = shape.index[weight <= 0.0].astype(int)
    return (f"{len(stray)} outlying points ignored {_named(stray)}",) if len(stray) else ()


def order_warnings(shape: Shape, weight: Vector, stations: Vector, noise: float) -> tuple[str, ...]:
    """Name the points that lie behind one before them by more than the noise of both [m]."""
    used = np.flatnonzero(weight > 0.0)
    at = stations[used]
    behind = used[np.maximum.accumulate(at) - at > _FAR_BEHIND * noise + _BEHIND * (at[-1] - at[0])]
    if not len(behind):
        return ()
    named = _named(shape.index[behind].astype(int))
    return (f"{len(behind)} points run back along the route {named}: look for points out of order",)


def _named(points: np.ndarray) -> str:
    return f"(count from 0: {', '.join(str(i) for i in points[:5])}{', ...' if len(points) > 5 else ''})"

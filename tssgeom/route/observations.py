"""Sensed points, validated once: what may be fitted, what is refused, and what is worth a warning."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from tssgeom import core
from tssgeom.arrays import Points, Vector, read_only
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_route import ORDERING, POINTS, RAW, SPACING
from tssgeom.errors import ShapeError
from tssgeom.route.directions import checked_directions, counted
from tssgeom.route.outliers import raw_outliers
from tssgeom.route.route import arcs_over_chords, station_warnings, step_lengths

MIN_POINTS = 4
BACK = "back along the route"  # in the warning of points that lie behind those before them


@dataclass(frozen=True, slots=True)
class Shape:
    """A sensed route that can be fitted, proximal to distal."""

    points: Points
    """Observed points, finite and distinct from their neighbours [m]."""
    index: Vector
    """Count of each point in the sensed sequence; missing ones leave a hole."""
    stations: Vector | None
    """Known arc length at each point, from the sensor [m]."""
    warnings: tuple[str, ...]
    """What was merged, bridged or left out, a sentence each."""
    directions: Points | None = None
    """Sensed unit tangents, a row of NaN where none was sensed [n, 3]."""
    direction_noise: float = 0.0
    """Standard deviation of each component of a direction across the route [rad]."""
    length: float | None = None
    """Known length of the route from the first to the last sensed point [m]."""
    length_noise: float = 0.0
    """Standard deviation of that length [m]."""

    @property
    def is_of_few(self) -> bool:
        """Whether its points are so few that models and λ are averaged; docs/model.md (150)."""
        return are_few(self.points)


@dataclass(frozen=True, slots=True)
class NoisePrior:
    """What is known beforehand of the noise of a sensor, over the length of the route; model.md (150)."""

    typical: float = 1e-3
    """Typical noise [1]. Chosen: cameras, magnetic trackers and fibres lie on both sides of it."""
    decades: float = 0.7
    """Standard deviation of its logarithm [decades]. Chosen: 4e-5 to 2e-2 in nineteen of twenty
    sensors, and 0.004 to 2.4/m in nineteen of twenty fibres."""


NOISE_PRIOR = NoisePrior()


def noise_price(noise: float) -> float:
    """Return -2 ln of the prior of an unknown noise, over the length of the route [1], above its least."""
    return (math.log10(max(noise, 1e-300) / NOISE_PRIOR.typical) / NOISE_PRIOR.decades) ** 2


def are_few(points: np.ndarray) -> bool:
    """Whether points, or values of each, are so few that models and λ are averaged; docs/model.md (150)."""
    return len(points) <= POINTS.few


def on_chords(shape: Shape, weight: Vector | None = None) -> Shape:
    """Return a shape with the stations of arcs over the chords between its points that have a weight [n]."""
    if weight is None or weight.min() > 0.0:
        return replace(shape, stations=read_only(arcs_over_chords(shape.points)))
    used, every = np.flatnonzero(weight > 0.0), np.arange(len(weight))
    inside = np.interp(every, used, arcs_over_chords(shape.points[used]))
    # an end that is not used lies one mean step beyond
    beyond = np.minimum(every - used[0], 0) + np.maximum(every - used[-1], 0)
    stations = inside + beyond * (inside[-1] / (used[-1] - used[0]))
    return replace(shape, stations=read_only(stations - stations[0]))


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
        Points along the route; a row of NaN is a missing one [m].
    stations
        Known arc length at each point, increasing [m].
    directions
        Unit tangents at the points, towards the distal end; a row of NaN is one not sensed [n, 3].
    direction_noise
        Standard deviation of each of their components across the route [rad]; without it they are not used.
    length, length_noise
        Known length of the route from the first to the last point, and its standard deviation [m].

    Returns
    -------
    Shape
        Distinct points [n, 3] [m] in the order of the route, and what was sensed with them.

    Raises
    ------
    ShapeError
        Fewer than four distinct points, infinite coordinates, no extent, stations that do not increase, or
        points that are not in order along the route; directions that are no unit vectors or run backwards; a
        length that is not positive.

    Examples
    --------
    >>> from tssgeom import clean
    >>> import numpy as np
    >>> angle = np.linspace(0.0, np.pi, 40)  # a half circle of 0.5 m
    >>> points = 0.5 / np.pi * np.column_stack((np.sin(angle), 1 - np.cos(angle), 0 * angle))
    >>> len(clean(points).points)
    40
    """
    points = read_only(points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"points have shape {points.shape}: give one row of x, y, z for each point")
    known = _checked_stations(points, stations)
    warnings: tuple[str, ...] = ()
    index, counts, used = None, _counts(len(points)), points
    if not _sound(points) or (known is not None and np.isnan(known).any()):
        index, warnings = _usable(points, known)
        used, counts = read_only(points[index]), read_only(index.astype(np.float64))
        known = None if known is None else known[index]
        _refuse_unusable(used, ordered=known is not None)
    with np.errstate(over="ignore", invalid="ignore"):  # infinite stations are refused with their length
        begun = None if known is None else read_only(known - known[0])
    if begun is not None:
        warnings += station_warnings(used, begun)
    shape = Shape(used, counts, begun, warnings)
    if directions is not None:
        shape = _with_directions(shape, directions, direction_noise, points, index)
    if length is not None:
        shape = _with_length(shape, length, length_noise, len(points))
    return shape


def _with_directions(
    shape: Shape, directions: Points, noise: float | None, points: Points, index: np.ndarray | None
) -> Shape:
    if not noise:
        unused = "directions are not used: the rig lacks [shape] direction_noise_deg: give it, or 'estimate'"
        return replace(shape, warnings=(*shape.warnings, unused))
    unit, warnings = checked_directions(directions, points)
    unit = unit if index is None else unit[index]
    known = None if np.isnan(unit).any(axis=1).all() else read_only(unit)
    return replace(shape, directions=known, direction_noise=noise, warnings=shape.warnings + warnings)


def _with_length(shape: Shape, length: float, noise: float, sensed: int) -> Shape:
    if not (math.isfinite(length) and length > 0.0):
        raise ShapeError(f"the length is {length:g} m: give a finite value > 0 m, or leave it out")
    if shape.index[0] > 0 or shape.index[-1] < sensed - 1:
        unused = "the stated length is not used: an end of the route is missing"
        return replace(shape, warnings=(*shape.warnings, unused))
    return replace(shape, length=length, length_noise=noise)


@lru_cache(maxsize=64)
def _counts(n: int) -> Vector:
    """Count n points from 0; the same array each time, by which two frames of the same points are known."""
    return read_only(np.arange(n, dtype=np.float64))


def _checked_stations(points: Points, stations: Vector | None) -> Vector | None:
    """Return known stations [m]; raises ShapeError where they do not increase or their number is wrong."""
    if stations is None:
        return None
    known = read_only(stations)
    if known.shape != (len(points),):
        raise ShapeError(f"{known.size} stations for {len(points)} points: give one station for each point")
    _, _, increasing = core.against_stations(points, known, len(points))
    if increasing:
        return known
    finite = known[np.isfinite(known)]
    require_increasing(finite, np.diff(finite) < 0.0)
    return known


def require_increasing(stations: Vector, falls: np.ndarray) -> None:
    """Refuse stations [n] of which one falls [n - 1], with a ShapeError that names the first."""
    if falls.any():
        i = int(np.argmax(falls))
        raise ShapeError(
            f"stations do not increase: {stations[i + 1]:g} m follows {stations[i]:g} m; "
            "give arc length from the proximal end"
        )


def _sound(points: Points) -> bool:
    """Whether every point may be used as it is."""
    bounds = core.clearly_sound(points)
    if bounds >= 0:
        return bounds > 0
    return not out_of_order(points) and core.worst_outlier(points, core.median(step_lengths(points))) < 0


def out_of_order(points: Points) -> bool:
    """Whether the sequence wanders at random, or leaps away from where another part of it lies."""
    if len(points) < RAW.fewest:
        return False
    steps, off = step_lengths(points), points - points.mean(axis=0)
    typical, spread = np.median(steps), np.median(np.sqrt(np.einsum("ij,ij->i", off, off)))
    leap = max(ORDERING.leap * typical, spread)
    wandering = typical > ORDERING.wandering * spread
    if not wandering and steps.max() <= leap:
        return False
    if wandering and typical > ORDERING.nearer_neighbours * _typical_to_nearest(points):
        return True
    leaps = np.flatnonzero(steps > leap)[: POINTS.few]
    near = ORDERING.elsewhere * typical
    if len(leaps) and np.linalg.norm(points[0] - points[-1]) < near:
        return True
    return any(_passed_elsewhere(points, j, near) for i in leaps for j in (i, i + 1))


def _typical_to_nearest(points: Points) -> float:
    """Return the median distance from a point to the nearest other [m]."""
    from scipy.spatial import KDTree

    return float(np.median(KDTree(points).query(points, k=2)[0][:, 1]))


def _passed_elsewhere(points: Points, index: int, radius: float) -> bool:
    """Whether a point far off in the sequence lies within `radius` [m] of this one."""
    near = np.flatnonzero(np.linalg.norm(points - points[index], axis=1) <= radius)
    return bool((np.abs(near - index) > SPACING.uneven).any())


def _usable(points: Points, known: Vector | None) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the indices of the points that can be used, and the warnings on the others."""
    if np.isinf(points).any():
        row = int(np.argmax(np.isinf(points).any(axis=1)))
        raise ShapeError(f"point {row} is infinite: leave a missing point empty or NaN")
    far = (ROUNDING.exact * np.abs(points) > POINTS.least_extent).any(axis=1)
    if far.any():
        most, row = np.nanmax(np.abs(points)), int(np.argmax(far))
        raise ShapeError(f"point {row} of {most:g} m is too far out: check the unit of the coordinates")
    observed = np.asarray(~np.isnan(points).any(axis=1))
    if known is not None:
        observed &= ~np.isnan(known)
    warnings = _missing_warnings(observed)
    index = np.flatnonzero(observed)
    keep = _distinct(points[index])
    if not keep.all():
        warnings += (f"{_points(int((~keep).sum()), 'repeated')} merged",)
        index = index[keep]
    outlying = raw_outliers(points[index], index - np.cumsum(~keep)[keep])
    if outlying.any():
        named = ", ".join(str(i) for i in index[outlying])
        warnings += (f"{_points(int(outlying.sum()), 'outlying')} left out (count from 0: {named})",)
    index = index[~outlying]
    return index, warnings + _size_warnings(points[index])


def _size_warnings(points: Points) -> tuple[str, ...]:
    extent = _extent(points)
    if not len(points) or POINTS.usual_least <= extent <= POINTS.usual_most:
        return ()
    return (f"the points span {extent * 1e3:.3g} mm: check the unit of the coordinates",)


def _extent(points: Points) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0


def _missing_warnings(observed: np.ndarray) -> tuple[str, ...]:
    inside = np.flatnonzero(observed)
    if not inside.size:
        return ()
    missing = int((~observed[inside[0] : inside[-1] + 1]).sum())
    bridged = (f"{missing} point{'s' * (missing > 1)} missing, bridged",) if missing else ()
    ends = (("first", int(inside[0])), ("last", len(observed) - 1 - int(inside[-1])))
    return bridged + tuple(
        f"the {end} {'point is' if lost == 1 else f'{lost} points are'} missing: the route is computed "
        f"without {'it' if lost == 1 else 'them'}"
        for end, lost in ends
        if lost
    )


def _distinct(points: Points) -> np.ndarray:
    """Mark each point that differs from the one before it."""
    moved = np.any(np.diff(points, axis=0) != 0.0, axis=1)
    return np.concatenate((np.ones(min(len(points), 1), np.bool_), moved))


def _distinct_up_to(points: Points, most: int) -> int:
    """Count points that differ from each other, up to so many."""
    count = 0
    while len(points) and count < most:
        points, count = points[np.any(points != points[0], axis=1)], count + 1
    return count


def _refuse_unusable(points: Points, *, ordered: bool) -> None:
    distinct = _distinct_up_to(points, MIN_POINTS)
    if distinct < MIN_POINTS:
        raise ShapeError(
            f"{distinct} distinct points: a route needs at least {MIN_POINTS}, or base and tip, with the "
            "direction of the base and the length between both"
        )
    extent = _extent(points)
    if extent < POINTS.least_extent:
        raise ShapeError(f"the points span {extent * 1e3:g} mm: check the unit of the coordinates")
    if not ordered and out_of_order(points):
        raise ShapeError(
            "the points are not in order along the route: each lies far from the next although others are "
            "near; sort them from the proximal to the distal end, or set [shape] order = 'shortest'"
        )


def outlier_warnings(shape: Shape, weight: Vector) -> tuple[str, ...]:
    """Name the points that a fit gave no weight."""
    outliers = shape.index[weight <= 0.0].astype(int)
    return (f"{_points(len(outliers), 'outlying')} ignored {counted(outliers)}",) if len(outliers) else ()


def _points(count: int, kind: str) -> str:
    return f"{count} {kind} point" + ("" if count == 1 else "s")

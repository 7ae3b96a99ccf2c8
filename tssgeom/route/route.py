"""A fitted route on nodes, and lengths along a route: arc length, spacing of points, stations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.arrays import Points, Vector, read_only
from tssgeom.errors import ShapeError
from tssgeom.statistics import median


class SpacingRule(NamedTuple):
    """Which spacing of the points bounds the length of a piece, where points crowd in a part of a route."""

    crowd_quantile: float = 0.3
    """Quantile of the steps that represents the denser part [1]. Chosen."""
    most_over_crowd: float = 4.0
    """Most times that step which the mean spacing may count as [1]. Chosen."""


@dataclass(frozen=True, slots=True)
class StationLimits:
    """Whether known stations and points can belong to each other."""

    chords: int = 8
    """Chords into which a route is cut for the comparison. Chosen: so few that noise lengthens none."""
    warning: float = 1.05
    """Chords over their stations above which a warning is due [1]. Derived: 1, and a margin for noise."""
    refusal: float = 2.0
    """Chords over their stations above which the frame is refused [1]. Chosen: a wrong unit or column."""
    shortest_path: float = 1 / 3
    """Path from point to point over the stations [1]. Derived: below it neighbours are half a turn apart."""


SPACING = SpacingRule()
STATIONS = StationLimits()


@dataclass(frozen=True, slots=True)
class Route:
    """A route on nodes along its arc length, and how the sensed points lie about it."""

    s: Vector
    """Arc length at the nodes, from 0 [m]."""
    position: Points
    """Positions of the nodes [m]."""
    tangent: Points
    """Unit tangents [1]."""
    curvature_vector: Points
    """Change of the unit tangent with arc length, normal to it [1/m]."""
    noise: float
    """Standard deviation of one coordinate of the points, known or estimated [m]."""
    weight: Vector
    """Weight of each sensed point: 1, or 0 for an outlier."""
    station: Vector
    """Arc length of the foot of each sensed point [m]."""
    residual: Points
    """Sensed point less its foot [m]."""


def accumulated(s: Vector, rate: Vector) -> Vector:
    """Integral of `rate` over `s` up to each node: arc length from speed, angle from curvature."""
    return summed(0.5 * (rate[1:] + rate[:-1]) * np.diff(s))


def summed(step: Vector) -> Vector:
    """Sum of the steps before each node, from 0."""
    return np.concatenate(([0.0], np.cumsum(step)))


def across(off: Points, unit: Points) -> Points:
    """Part of `off` [n, 3] that is normal to the unit vectors `unit` [n, 3]."""
    return off - np.einsum("ij,ij->i", off, unit)[:, None] * unit


def insert_nodes(u: Vector, longest: float) -> tuple[Vector, np.ndarray]:
    """Split every interval longer than `longest`; returns the nodes and which of them are the given ones."""
    parts = np.maximum(np.ceil(np.diff(u) / longest - 1e-9).astype(np.int64), 1)
    where = np.concatenate(([0], np.cumsum(parts)))
    return np.interp(np.arange(where[-1] + 1), where, u), where


@njit(cache=True, nogil=True)
def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Distance between two positions [m]."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@njit(cache=True, nogil=True)
def step_lengths(points: np.ndarray) -> np.ndarray:
    """Distances from point to point [n - 1] [m]."""
    steps = np.empty(len(points) - 1)
    for i in range(len(steps)):
        steps[i] = distance(points[i + 1], points[i])
    return steps


@njit(cache=True, nogil=True)
def path_length(points: np.ndarray, weight: np.ndarray) -> tuple[int, float]:
    """Return how many points have no weight, and the length of the path through the others [m]."""
    ignored, path, last = 0, 0.0, -1
    for i in range(len(points)):
        if weight[i] <= 0.0:
            ignored += 1
            continue
        if last >= 0:
            path += distance(points[i], points[last])
        last = i
    return ignored, path


@njit(cache=True, nogil=True)
def mean_spacing(points: np.ndarray) -> float:
    """Median distance of neighbours [m], or the chord of all over their number where that is longer."""
    n = len(points) - 1
    return max(median(step_lengths(points)), distance(points[n], points[0]) / n)


@njit(cache=True, nogil=True)
def spacing_of_pieces(points: np.ndarray, length: float) -> float:
    """Return the spacing that bounds the pieces of a route of a length [m] from below [m].

    It is the mean, except for points that crowd in a part of the route: a bend may lie among them.
    """
    step = step_lengths(points)
    nearer = int(SPACING.crowd_quantile * len(step))
    return min(length / len(points), SPACING.most_over_crowd * np.partition(step, nearer)[nearer])


def checked_stations(points: Points, stations: Vector | None) -> Vector | None:
    """Return known stations [m]; raises ShapeError where they do not increase or their number is wrong."""
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


def station_warnings(points: Points, known: Vector) -> tuple[str, ...]:
    """Compare stations, from 0 [m], with the path between the points, which cannot be longer.

    Raises
    ------
    ShapeError
        Where they cannot belong to each other.
    """
    path, over = _against_stations(points, known, max(len(points) // STATIONS.chords, 1))
    if path < STATIONS.shortest_path * known[-1] or over > STATIONS.refusal:
        raise ShapeError(
            f"stations over {known[-1]:.3g} m for points along {path:.3g} m: check the unit of the stations"
        )
    if over > STATIONS.warning:
        return (f"the points lie {over - 1:.0%} farther apart than their stations: check both",)
    return ()


@njit(cache=True, nogil=True)
def _against_stations(points: np.ndarray, known: np.ndarray, every: int) -> tuple[float, float]:
    """Return the path from point to point [m], and that of chords over `every` points over their stations."""
    n = len(points)
    path, chords, last = 0.0, 0.0, 0
    for i in range(1, n):
        path += distance(points[i], points[i - 1])
        if i - last == every:
            chords += distance(points[i], points[last])
            last = i
    return path, chords / max(known[last], 1e-300)

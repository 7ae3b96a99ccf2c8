"""Stations along a route: feet of the points where no sensor tells them, checks where one does, and nodes."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tssgeom.arrays import Points, Vector
from tssgeom.errors import ShapeError
from tssgeom.statistics import median

_CHORDS = 8  # into which a route is cut to compare it with its stations: few, so that noise makes none longer
_CHORDS_TOO_LONG = (1.05, 2.0)  # over their stations: where to warn, where to refuse
_CROWD, _CROWDED = 0.3, 4.0  # share of the steps that make a crowd, and how many of theirs a spacing may be
_PATH_TOO_SHORT = 1 / 3  # of the stations: neighbours would be more than half a turn apart


def accumulated(s: Vector, rate: Vector) -> Vector:
    """Integral of `rate` over `s` up to each node: arc length from speed, angle from curvature."""
    return summed(0.5 * (rate[1:] + rate[:-1]) * np.diff(s))


def summed(step: Vector) -> Vector:
    """Sum of the steps up to each place, from 0."""
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
def mean_spacing(points: np.ndarray) -> float:
    """Median distance of neighbours [m], or the chord of all over their number where that is longer."""
    n = len(points) - 1
    step, chord = np.empty(n), 0.0
    for i in range(n):
        square = 0.0
        for c in range(3):
            square += (points[i + 1, c] - points[i, c]) ** 2
        step[i] = np.sqrt(square)
    for c in range(3):
        chord += (points[n, c] - points[0, c]) ** 2
    return max(median(step), np.sqrt(chord) / n)


@njit(cache=True, nogil=True)
def spacing_of_pieces(points: np.ndarray, length: float) -> float:
    """Return the spacing by which the pieces of a route of a length [m] are told to be short [m].

    It is the mean, but for points that crowd in a part of the route: a bend may lie among them.
    """
    n = len(points) - 1
    step = np.empty(n)
    for i in range(n):
        step[i] = distance(points[i + 1], points[i])
    nearer = int(_CROWD * n)
    return min(length / (n + 1), _CROWDED * np.partition(step, nearer)[nearer])


def station_warnings(points: Points, known: Vector) -> tuple[str, ...]:
    """Compare stations, from 0 [m], with the way between the points, which is no longer than they say.

    Raises
    ------
    ShapeError
        Where they cannot belong to each other.
    """
    path, over = _against_stations(points, known)
    if path < _PATH_TOO_SHORT * known[-1] or over > _CHORDS_TOO_LONG[1]:
        raise ShapeError(
            f"stations over {known[-1]:.3g} m for points along {path:.3g} m: check the unit of the stations"
        )
    if over > _CHORDS_TOO_LONG[0]:
        return (f"the points lie {over - 1:.0%} farther apart than their stations: check both",)
    return ()


@njit(cache=True, nogil=True)
def _against_stations(points: np.ndarray, known: np.ndarray) -> tuple[float, float]:
    """Return the way from point to point [m], and that of a few chords over their stations [1]."""
    n = len(points)
    every, path, chords, last = max(n // _CHORDS, 1), 0.0, 0.0, 0
    for i in range(1, n):
        path += distance(points[i], points[i - 1])
        if i - last == every:
            chords += distance(points[i], points[last])
            last = i
    return path, chords / max(known[last], 1e-300)


@njit(cache=True, nogil=True)
def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Distance of two places [m]."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)

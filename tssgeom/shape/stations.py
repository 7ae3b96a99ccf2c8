"""Stations along a route: feet of the points where no sensor tells them, and nodes in between."""

from __future__ import annotations

import numpy as np
from numba import njit

from tssgeom.arrays import Points, Vector
from tssgeom.shape.median import median


@njit(cache=True, nogil=True)
def isotonic(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Nearest non-decreasing sequence to `x` in weighted least squares (pool adjacent violators)."""
    n = len(x)
    level, mass, count = np.empty(n), np.empty(n), np.empty(n, dtype=np.int64)
    top = 0
    for i in range(n):
        level[top], mass[top], count[top] = x[i], weight[i], 1
        while top > 0 and level[top - 1] > level[top]:
            total = mass[top - 1] + mass[top]
            level[top - 1] = (mass[top - 1] * level[top - 1] + mass[top] * level[top]) / total
            mass[top - 1] = total
            count[top - 1] += count[top]
            top -= 1
        top += 1
    out, i = np.empty(n), 0
    for block in range(top):
        for _ in range(count[block]):
            out[i] = level[block]
            i += 1
    return out


def accumulated(s: Vector, rate: Vector) -> Vector:
    """Integral of `rate` over `s` up to each node: arc length from speed, angle from curvature."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(s))))


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

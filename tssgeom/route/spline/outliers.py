"""Points and directions that a fitted smooth curve does not explain."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.route.outliers import LIMITS, outlier_limit, residual_variance
from tssgeom.route.route import across
from tssgeom.statistics import MEDIANS, median


@njit(cache=True, nogil=True, error_model="numpy")
def outlying_points(
    u: np.ndarray,
    y: np.ndarray,
    weight: np.ndarray,
    variance: float,
    ratio: float,
    mean: np.ndarray,
    covariance: np.ndarray,
) -> tuple[np.ndarray, int]:
    """Mark and count points whose leave-one-out residual is beyond chance and a jump of curvature."""
    n = len(u)
    size, left_out = np.zeros(n), np.zeros(n)
    used, sharpest = 0, 0.0
    sizes = np.empty(n)
    for i in range(n):
        if weight[i] <= 0.0:
            continue
        m = mean[i]
        square = max(m[0, 1] ** 2 + m[1, 1] ** 2 + m[2, 1] ** 2, 1e-24)
        along, a_along = 0.0, 0.0
        for c in range(3):
            along += (y[i, c] - m[c, 0]) * m[c, 1]
            a_along += m[c, 2] * m[c, 1]
        off, bend = 0.0, 0.0
        for c in range(3):
            off += (y[i, c] - m[c, 0] - along * m[c, 1] / square) ** 2
            bend += (m[c, 2] - a_along * m[c, 1] / square) ** 2
        sharpest = max(sharpest, bend / square**2)
        free = max(1.0 - covariance[i, 0] / ratio, 1e-12)
        size[i], left_out[i] = math.sqrt(off / free), math.sqrt(off) / free
        sizes[used] = size[i]
        used += 1
    robust = (median(sizes[:used]) / MEDIANS.length_2) ** 2
    limit = math.sqrt(outlier_limit(n, residual_variance(variance, robust, 1.0)))
    sharpest = min(math.sqrt(sharpest), LIMITS.sharpest)
    outlier, count = np.zeros(n, dtype=np.bool_), 0
    for i in range(n):
        if size[i] <= limit:
            continue
        share = LIMITS.bend_share
        if i == 0 or i == n - 1:
            share = LIMITS.bend_share_at_end
        elif i == 1 or i == n - 2:
            share = LIMITS.bend_share_next_to_end
        left, right = max(i - 1, 0), min(i + 1, n - 1)
        step = (u[right] - u[left]) / (right - left)
        worst = np.max(size[max(i - LIMITS.neighbours, 0) : i + LIMITS.neighbours + 1])
        if left_out[i] > share * sharpest * step * step and size[i] >= worst:
            outlier[i] = True
            count += 1
    return outlier, count


def leaves_out_a_stretch(weight: Vector) -> bool:
    """Whether so many points side by side have no weight that they are a part of the route."""
    used = np.flatnonzero(weight)
    if len(used) < 2:
        return True
    at_end, within = max(used[0], len(weight) - 1 - used[-1]), int(np.diff(used).max()) - 1
    most_within = max(LIMITS.run_within, LIMITS.run_share * len(weight))
    return bool(at_end > LIMITS.run_at_end or within > most_within)


def outlying_tangent(tangents: Points, variance: Vector, u: Vector, mean: Matrix, spread: Vector) -> int:
    """Return the sensed direction that a fit explains least, if beyond chance and a jump of curvature, or -1.

    Parameters
    ----------
    tangents, variance
        Directions [n, 3] and their variances, 0 where none was sensed [n].
    u, mean, spread
        Stations [n] and states [n, 3, 4] of the fit, and the variance of a component of its tangents [n].
    """
    used = np.flatnonzero(variance > 0.0)
    if not used.size:
        return -1
    speed = np.maximum(np.linalg.norm(mean[:, :, 1], axis=1), 1e-12)
    fitted = mean[:, :, 1] / speed[:, None]
    bend = np.linalg.norm(across(mean[:, :, 2], fitted), axis=1) / speed**2
    turn = LIMITS.turn_share * float(np.max(bend * np.gradient(u)))
    cosine = np.einsum("ij,ij->i", tangents[used], fitted[used])
    off = np.where(cosine > 0.0, np.maximum(1.0 - cosine**2, 0.0), LIMITS.backwards)
    own = np.maximum(1.0 - spread[used] / variance[used], LIMITS.least_own)
    over_limit = off / (variance[used] * own * outlier_limit(len(used), 1.0))
    over_limit = np.where(np.sqrt(off) / own > turn, over_limit, 0.0)
    worst = int(np.argmax(over_limit))
    return int(used[worst]) if over_limit[worst] > 1.0 else -1


def may_drop_tangent(used: Points | None, sensed: Points | None) -> bool:
    """Whether one more of the sensed directions may be left out of those that are used."""
    if used is None or sensed is None:
        return False
    count = int(np.count_nonzero(~np.isnan(sensed[:, 0])))
    dropped = count - int(np.count_nonzero(~np.isnan(used[:, 0])))
    return dropped + 1 <= max(LIMITS.share * count, 1.0)

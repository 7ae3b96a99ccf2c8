"""What a fitted curve says of the prior of the next pass, and which points it does not explain."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tssgeom.arrays import Vector
from tssgeom.route.route import isotonic
from tssgeom.statistics import median

FINE = 1e-4  # of the spacing: who is off by a few of these is no outlier, however exact the rest
SHARPEST = 1.5  # turn from point to point that the prior follows [rad]
_CHANGE = 0.5  # of the curvature, or turn of its plane [rad], from point to point that the prior follows
_STRAIGHT = 1e-18  # least variance of bend and bend rate at the ends, in units of the spacing
_NOISE_SHARE = 0.375  # of the posterior variance of the curvature; docs/model.md (24)
_EXACT = 1e-6  # of the spacing: rounding, not noise
_VAGUE = 1e4  # variance of place and direction at the first station over that of the last pass
_LEAST_STEP = 1e-7  # of the mean spacing, between points whose feet coincide
_SHARPEST_BELIEVED = 1.0  # from point to point [rad]: what turns more has been led astray
_BEND_SHARE = 0.3  # of κh²: what a jump of curvature alone can move a point off its neighbours' curve
_AT_END, _NEXT_TO_END = 2.0, 1.0  # the same at the last points, which have neighbours on one side only
_MOST_AT_END = 4  # outliers side by side at an end, beyond which they are the end
_MOST_WITHIN, _SHARE_WITHIN = 8, 0.1  # the same between two points that are none, of all points the second
_REACH = 3  # points on either side among which only the worst is taken out at once


@njit(cache=True, nogil=True, error_model="numpy")
def bent_along(
    u: np.ndarray,
    y: np.ndarray,
    weight: np.ndarray,
    ratio: float,
    q: float,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Stations, coupling, variances at the ends and tangents for the next pass; docs/model.md (20) to (22).

    Returns
    -------
    u, coupling, ends, tangent
        Feet of the points where stations are not known [n], and what `filtering.transitions` [n, 3] and
        `filtering.innovations` [4], [n, 3] take.
    """
    n = len(u)
    coupling, tangent, feet = np.zeros((n, 3)), np.empty((n, 3)), np.empty(n)
    bends, rates, growth_at_end = 0.0, 0.0, 0.0
    bend_integral, rate_integral = 0.0, 0.0
    arc, speed_before = 0.0, 0.0
    before_bend, before_rate = 0.0, 0.0
    for i in range(n):
        m = mean[i]
        speed = max(math.sqrt(m[0, 1] ** 2 + m[1, 1] ** 2 + m[2, 1] ** 2), 1e-12)
        a_along, b_along, off = 0.0, 0.0, 0.0
        for c in range(3):
            tangent[i, c] = m[c, 1] / speed
            a_along += m[c, 2] * tangent[i, c]
            b_along += m[c, 3] * tangent[i, c]
            off += (y[i, c] - m[c, 0]) * tangent[i, c]
        square, rate, growth = 0.0, 0.0, 0.0
        for c in range(3):
            a = (m[c, 2] - a_along * tangent[i, c]) / speed**2
            b = (m[c, 3] - b_along * tangent[i, c]) / speed**3
            square += a * a
            rate += b * b
            growth += a * b
        p22, p23, p33 = covariance[i, 7], covariance[i, 8], covariance[i, 9]
        kept = min(max(square - 2.0 * _NOISE_SHARE * q * p22, 0.0), SHARPEST**2)
        coupling[i, 0] = kept
        coupling[i, 1] = min(max(growth / max(square, 1e-300), -_CHANGE), _CHANGE) * kept
        whole_bend, whole_rate = square + 2.0 * q * p22, rate + 2.0 * q * p33
        bends += whole_bend / n
        rates += whole_rate / n
        if i > 0:
            h = u[i] - u[i - 1]
            arc += 0.5 * (speed + speed_before) * h
            bend_integral += 0.5 * (whole_bend + before_bend) * h
            rate_integral += 0.5 * (whole_rate + before_rate) * h
        if i == 0:
            growth_at_end -= growth + 2.0 * q * p23
        elif i == n - 1:
            growth_at_end += growth + 2.0 * q * p23
        before_bend, before_rate, speed_before = whole_bend, whole_rate, speed
        feet[i] = arc + off
    sway = min(max((rate_integral - growth_at_end) / max(bend_integral, 1e-300), 0.0), _CHANGE**2)
    for i in range(n - 1, 0, -1):
        coupling[i, 0] = 0.5 * (coupling[i, 0] + coupling[i - 1, 0])
        coupling[i, 1] = 0.5 * (coupling[i, 1] + coupling[i - 1, 1])
        coupling[i, 2] = sway
    coupling[0, 2] = sway
    noise = max(ratio * q, _EXACT**2)
    ends = np.array(
        [
            _VAGUE * covariance[0, 0] / ratio,
            _VAGUE * covariance[0, 4] / ratio,
            (_STRAIGHT + 0.5 * bends) / noise,
            (_STRAIGHT + 0.5 * rates) / noise,
        ]
    )
    if known:
        return u, coupling, ends, tangent
    feet = isotonic(feet, np.maximum(weight, 1e-6))
    first = feet[0]
    for i in range(n):
        feet[i] += _LEAST_STEP * i - first
    return feet, coupling, ends, tangent


@njit(cache=True, nogil=True, error_model="numpy")
def stray_points(
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
    stray = np.zeros(n, dtype=np.bool_)
    scale = max(median(sizes[:used]) / 1.177, math.sqrt(variance), FINE)
    beyond_chance = scale * math.sqrt(16.0 + 2.0 * math.log(n))
    sharpest = min(math.sqrt(sharpest), _SHARPEST_BELIEVED)
    count = 0
    for i in range(n):
        if size[i] <= beyond_chance:
            continue
        share = _BEND_SHARE
        if i == 0 or i == n - 1:
            share = _AT_END
        elif i == 1 or i == n - 2:
            share = _NEXT_TO_END
        left, right = max(i - 1, 0), min(i + 1, n - 1)
        step = (u[right] - u[left]) / (right - left)
        worst = np.max(size[max(i - _REACH, 0) : i + _REACH + 1])
        if left_out[i] > share * sharpest * step * step and size[i] >= worst:
            stray[i] = True
            count += 1
    return stray, count


def is_stretch(weight: Vector) -> bool:
    """Whether so many points side by side are left out that a stretch of the route is, not its outliers."""
    used = np.flatnonzero(weight)
    if len(used) < 2:
        return True
    ends, within = max(used[0], len(weight) - 1 - used[-1]), int(np.diff(used).max()) - 1
    return bool(ends > _MOST_AT_END or within > max(_MOST_WITHIN, _SHARE_WITHIN * len(weight)))

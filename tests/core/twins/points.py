"""Checks of sensed points in plain Python, as oracle of the core."""

from __future__ import annotations

import math

import numpy as np

from tests.core.twins.arcs_fit import outlier_limit, residual_variance
from tests.core.twins.raw_outliers import worst_outlier
from tests.core.twins.statistics import median
from tssgeom.core.constants import MEDIANS, ROUNDING
from tssgeom.core.constants_route import ORDERING, OUTLIERS, POINTS, SPACING

MIN_POINTS = 4


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Distance between two positions [m]."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


def step_lengths(points: np.ndarray) -> np.ndarray:
    """Distances from point to point [n - 1] [m]."""
    steps = np.empty(len(points) - 1)
    for i in range(len(steps)):
        steps[i] = distance(points[i + 1], points[i])
    return steps


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


def mean_spacing(points: np.ndarray) -> float:
    """Median distance of neighbours [m], or the chord of all over their number where that is longer."""
    n = len(points) - 1
    return max(median(step_lengths(points)), distance(points[n], points[0]) / n)


def spacing_of_pieces(points: np.ndarray, length: float) -> float:
    """Return the spacing that bounds the pieces of a route of a length [m] from below [m].

    It is the mean, except for points that crowd in a part of the route: a bend may lie among them.
    """
    step = step_lengths(points)
    nearer = int(SPACING.crowd_quantile * len(step))
    return min(length / len(points), SPACING.uneven * np.partition(step, nearer)[nearer])


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


def clearly_sound(points: np.ndarray) -> bool:
    """Whether quick bounds show that points are in order and none is an outlier; False where they do not."""
    steps = step_lengths(points)
    spacing = median(steps)
    if np.max(steps) > ORDERING.leap * spacing or not _spread_out(points, spacing / ORDERING.wandering):
        return False
    return worst_outlier(points, spacing) < 0


def _spread_out(points: np.ndarray, far: float) -> bool:
    """Whether more than half of the points are at least so far from their mean [m]."""
    mean, beyond = _mean(points), 0
    for i in range(len(points)):
        beyond += 1 if distance(points[i], mean) >= far else 0
    return beyond > len(points) // 2 + 1


def _mean(points: np.ndarray) -> np.ndarray:
    mean = np.zeros(3)
    for i in range(len(points)):
        for c in range(3):
            mean[c] += points[i, c] / len(points)
    return mean


def _steps(points: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Measure steps from point to point [n - 1], their median, and the median distance from the mean [m]."""
    steps, far, mean = step_lengths(points), np.empty(len(points)), _mean(points)
    for i in range(len(points)):
        far[i] = distance(points[i], mean)
    return steps, median(steps), median(far)


def _plain(points: np.ndarray) -> bool:
    """Whether points are finite, differ from the one before and four from each other, and span as usual."""
    square, distinct = 0.0, 0
    others = np.empty(MIN_POINTS, np.int64)
    for c in range(3):
        least, most = points[0, c], points[0, c]
        for i in range(len(points)):
            x = points[i, c]
            if not ROUNDING.exact * abs(x) <= POINTS.least_extent:
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
    return distinct == MIN_POINTS and POINTS.usual_least**2 <= square <= POINTS.usual_most**2


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    return a[0] == b[0] and a[1] == b[1] and a[2] == b[2]


def outlying_points(
    u: np.ndarray,
    y: np.ndarray,
    weight: np.ndarray,
    variance: float,
    ratio: float,
    mean: np.ndarray,
    covariance: np.ndarray,
) -> tuple[np.ndarray, int]:
    """Mark points whose residual is beyond chance and a jump of curvature; count those with a weight."""
    n = len(u)
    size, left_out = np.zeros(n), np.zeros(n)
    used, sharpest = 0, 0.0
    sizes = np.empty(n)
    for i in range(n):
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
        if weight[i] <= 0.0:
            size[i], left_out[i] = math.sqrt(off / (1.0 + covariance[i, 0] / ratio)), math.sqrt(off)
            continue
        sharpest = max(sharpest, bend / square**2)
        free = max(1.0 - covariance[i, 0] / ratio, 1e-12)
        size[i], left_out[i] = math.sqrt(off / free), math.sqrt(off) / free
        sizes[used] = size[i]
        used += 1
    robust = (median(sizes[:used]) / MEDIANS.length_2) ** 2
    limit = math.sqrt(outlier_limit(n, residual_variance(variance, robust, 1.0)))
    sharpest = min(math.sqrt(sharpest), OUTLIERS.sharpest)
    outlier, count = np.zeros(n, dtype=np.bool_), 0
    for i in range(n):
        if size[i] <= limit:
            continue
        share = OUTLIERS.bend_share
        if i == 0 or i == n - 1:
            share = OUTLIERS.bend_share_at_end
        elif i == 1 or i == n - 2:
            share = 0.5 * OUTLIERS.bend_share_at_end
        left, right = max(i - 1, 0), min(i + 1, n - 1)
        step = (u[right] - u[left]) / (right - left)
        around = slice(max(i - OUTLIERS.neighbours, 0), i + OUTLIERS.neighbours + 1)
        worst = np.max(size[around] * (weight[around] > 0.0)) if weight[i] > 0.0 else 0.0
        if left_out[i] > share * sharpest * step * step and size[i] >= worst:
            outlier[i] = True
            count += weight[i] > 0.0
    return outlier, count


def _in_metres(
    u: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
    gain: np.ndarray,
    origin: np.ndarray,
    spacing: float,
    q: float,
    known: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Arc length, positions, tangents, curvature vectors, covariance and gains in SI."""
    n = len(u)
    s, position, tangent, bend = np.empty(n), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    wide, gains = np.empty((n, 10)), np.empty((n - 1, 4, 4))
    unit = np.array([spacing, 1.0, 1.0 / spacing, spacing**-2])
    pair = np.empty(10)
    k = 0
    for i in range(4):
        for j in range(i, 4):
            pair[k] = unit[i] * unit[j] * q
            k += 1
    arc, before = 0.0, 0.0
    for i in range(n):
        m = mean[i]
        square = max(m[0, 1] ** 2 + m[1, 1] ** 2 + m[2, 1] ** 2, 1e-24)
        speed = math.sqrt(square)
        along = (m[0, 1] * m[0, 2] + m[1, 1] * m[1, 2] + m[2, 1] * m[2, 2]) / square
        for c in range(3):
            position[i, c] = m[c, 0] * spacing + origin[c]
            tangent[i, c] = m[c, 1] / speed
            bend[i, c] = (m[c, 2] - along * m[c, 1]) / (square * spacing)
        if i > 0:
            arc += 0.5 * (speed + before) * (u[i] - u[i - 1])
        before = speed
        s[i] = (u[i] if known else arc) * spacing
        for k in range(10):
            wide[i, k] = covariance[i, k] * pair[k]
        if i < n - 1:
            for j in range(4):
                for k in range(4):
                    gains[i, j, k] = gain[i, j, k] * unit[j] / unit[k]
    return s, position, tangent, bend, wide, gains

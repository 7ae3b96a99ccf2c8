"""The nearest point of a wall in plain Python: what `core.nearest_on_wall` has to return."""

from __future__ import annotations

import math

import numpy as np

from tssgeom.core.constants import ROUNDING, WALL
from tssgeom.core.constants_route import POINTS

_MOST_AROUND = 256  # triangles that meet in one point


def _square_to_box(p: np.ndarray, low: np.ndarray, high: np.ndarray) -> float:
    """Square of the distance to a box, 0 inside [m²]."""
    total = 0.0
    for c in range(3):
        outside = max(low[c] - p[c], p[c] - high[c], 0.0)
        total += outside * outside
    return total


def nearest_on_wall(
    points: np.ndarray, corners: np.ndarray, order: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Nearest points, and sides by the normal there: the mean over the triangles around, by angle."""
    count = len(points)
    position, distance = np.empty((count, 3)), np.empty(count)
    side, on_rim = np.empty(count), np.zeros(count, np.bool_)
    stack, around, q = np.empty(128, np.int64), np.empty(_MOST_AROUND, np.int64), np.empty(3)
    for i in range(count):
        p, best = points[i], position[i]
        least = math.sqrt(_search(p, corners, order, low, high, stack, best))
        near = WALL.same_point * (least + POINTS.least_extent)
        held = _triangles_at(best, near, corners, order, low, high, stack, around)
        normal, angle = np.zeros(3), 0.0
        for k in around[:held]:
            q[0], q[1], q[2], _ = _foot(best, corners[k])
            same = WALL.same_point * _distance(corners[k, 0], corners[k, 1])
            part = _angle_at(corners[k], q, 10 * near + same)
            angle += part
            normal += part * _normal(corners[k])
        distance[i] = least
        side[i] = 1.0 if np.sum((p - best) * normal) >= 0.0 else -1.0
        on_rim[i] = angle < 2 * math.pi and _is_on_rim(corners, around[:held], best)
    return position, distance, side, on_rim


def _search(
    p: np.ndarray,
    corners: np.ndarray,
    order: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    stack: np.ndarray,
    best: np.ndarray,
) -> float:
    """Put the nearest point of the wall into `best` and return the square of its distance."""
    leaves = (len(low) + 1) // 2
    group = len(order) // leaves
    least, top = math.inf, 0
    stack[0] = 0
    while top >= 0:
        node = stack[top]
        top -= 1
        if _square_to_box(p, low[node], high[node]) >= least:
            continue
        if node >= leaves - 1:
            start = (node - leaves + 1) * group
            for k in order[start : start + group]:
                if k >= 0:
                    x, y, z, square = _foot(p, corners[k])
                    if square < least:
                        least = square
                        best[0], best[1], best[2] = x, y, z
            continue
        one, two = 2 * node + 1, 2 * node + 2
        if _square_to_box(p, low[one], high[one]) < _square_to_box(p, low[two], high[two]):
            one, two = two, one
        stack[top + 1], stack[top + 2] = one, two
        top += 2
    return least


def _triangles_at(
    point: np.ndarray,
    near: float,
    corners: np.ndarray,
    order: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    stack: np.ndarray,
    around: np.ndarray,
) -> int:
    """Gather the triangles on which a point lies, and return how many there are."""
    leaves = (len(low) + 1) // 2
    group = len(order) // leaves
    held, top = 0, 0
    stack[0] = 0
    while top >= 0:
        node = stack[top]
        top -= 1
        if _square_to_box(point, low[node], high[node]) > near * near:
            continue
        if node < leaves - 1:
            stack[top + 1], stack[top + 2] = 2 * node + 1, 2 * node + 2
            top += 2
            continue
        start = (node - leaves + 1) * group
        for k in order[start : start + group]:
            if k >= 0 and held < len(around) and _foot(point, corners[k])[3] <= near * near:
                around[held] = k
                held += 1
    return held


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


def _is_on_rim(corners: np.ndarray, triangles: np.ndarray, point: np.ndarray) -> bool:
    """Whether a point lies on a side that one triangle alone has."""
    for k in triangles:
        for c in range(3):
            a, b = corners[k, c], corners[k, (c + 1) % 3]
            near = 10.0 * WALL.same_point * math.sqrt(np.sum((b - a) ** 2)) + 1e-15
            if _distance_to_side(point, a, b) > near:
                continue
            shared = 0
            for other in triangles:
                if other != k and _has(corners[other], a, near) and _has(corners[other], b, near):
                    shared += 1
            if shared == 0:
                return True
    return False


def _has(t: np.ndarray, corner: np.ndarray, near: float) -> bool:
    return (
        _distance(t[0], corner) <= near or _distance(t[1], corner) <= near or _distance(t[2], corner) <= near
    )


def _distance_to_side(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    along = b - a
    x = min(max(np.sum((p - a) * along) / max(np.sum(along * along), 1e-300), 0.0), 1.0)
    return math.sqrt(np.sum((p - a - x * along) ** 2))


def _normal(t: np.ndarray) -> np.ndarray:
    n = np.cross(t[1] - t[0], t[2] - t[0])
    return n / max(math.sqrt(np.sum(n * n)), 1e-300)


def _angle_at(t: np.ndarray, q: np.ndarray, near: float) -> float:
    """Angle that a triangle takes around a point on it: 2π inside, π on a side, its own at a corner."""
    for c in range(3):
        if math.sqrt(np.sum((t[c] - q) ** 2)) <= near:
            a, b = t[(c + 1) % 3] - t[c], t[(c + 2) % 3] - t[c]
            size = max(math.sqrt(np.sum(a * a) * np.sum(b * b)), 1e-300)
            return math.acos(min(max(np.sum(a * b) / size, -1.0), 1.0))
    for c in range(3):
        if _distance_to_side(q, t[c], t[(c + 1) % 3]) <= near:
            return math.pi
    return 2 * math.pi


def _foot(p: np.ndarray, t: np.ndarray) -> tuple[float, float, float, float]:
    """Nearest point of a triangle, and the square of its distance.

    That is the foot of the perpendicular where it falls inside, else the nearest point of one of the sides.
    """
    bx, by, bz = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
    cx, cy, cz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
    dx, dy, dz = p[0] - t[0, 0], p[1] - t[0, 1], p[2] - t[0, 2]
    bb, bc, cc = bx * bx + by * by + bz * bz, bx * cx + by * cy + bz * cz, cx * cx + cy * cy + cz * cz
    db, dc = dx * bx + dy * by + dz * bz, dx * cx + dy * cy + dz * cz
    whole = bb * cc - bc * bc
    if whole > ROUNDING.exact * bb * cc:
        u, v = (cc * db - bc * dc) / whole, (bb * dc - bc * db) / whole
        if u >= 0.0 and v >= 0.0 and u + v <= 1.0:
            x, y, z = t[0, 0] + u * bx + v * cx, t[0, 1] + u * by + v * cy, t[0, 2] + u * bz + v * cz
            return x, y, z, (x - p[0]) ** 2 + (y - p[1]) ** 2 + (z - p[2]) ** 2
    best_x, best_y, best_z, least = t[0, 0], t[0, 1], t[0, 2], math.inf
    for k in range(3):
        a, b = t[k], t[(k + 1) % 3]
        ax, ay, az = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        along = (p[0] - a[0]) * ax + (p[1] - a[1]) * ay + (p[2] - a[2]) * az
        share = min(max(along / max(ax * ax + ay * ay + az * az, 1e-300), 0.0), 1.0)
        x, y, z = a[0] + share * ax, a[1] + share * ay, a[2] + share * az
        far = (x - p[0]) ** 2 + (y - p[1]) ** 2 + (z - p[2]) ** 2
        if far < least:
            best_x, best_y, best_z, least = x, y, z, far
    return best_x, best_y, best_z, least

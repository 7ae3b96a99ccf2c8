"""The wall of a lumen as triangles: the nearest place on it, on which side one is, and where it ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from tssgeom.arrays import Points, Vector, read_only
from tssgeom.lumen.boxes import Boxes, box_gap, boxed

_SAME = 1e-7  # of the distance and of the size of a triangle: places that are one
_FLAT = 1e-12  # of the squared sides: less area is none
_MOST_AROUND = 256  # triangles that meet in one place


@dataclass(frozen=True)
class Wall:
    """Triangles of a wall, closed or open at its ends; their corners run one way round."""

    corners: np.ndarray
    """[f, 3 corners, 3] [m]."""
    outward: bool | None = None
    """Whether the normals point out of the lumen; None where only a route inside can tell."""

    @cached_property
    def boxes(self) -> Boxes:
        """Boxes around groups of triangles, and around groups of boxes."""
        return boxed(self.corners.min(axis=1), self.corners.max(axis=1))


@dataclass(frozen=True, slots=True)
class Nearest:
    """The nearest places of a wall."""

    place: Points
    """[n, 3] [m]."""
    distance: Vector
    """[n] [m]."""
    side: Vector
    """+1 where the normal points towards the point, -1 where it points away [n]."""
    at_end: np.ndarray
    """Whether the place is on the rim of the wall, so that nothing tells the side [n] bool."""


def nearest(wall: Wall, points: Points) -> Nearest:
    """Find the nearest place on a wall for each point [n, 3] [m]; docs/model.md (144)."""
    points = np.ascontiguousarray(points, dtype=np.float64)
    boxes = wall.boxes
    place, distance, side, rim = _nearest(points, wall.corners, boxes.order, boxes.low, boxes.high)
    return Nearest(read_only(place), read_only(distance), read_only(side), rim)


@njit(cache=True, nogil=True)
def _nearest(
    points: np.ndarray, corners: np.ndarray, order: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Nearest places, and the normal there: the mean of all triangles that hold it, by their angle."""
    count = len(points)
    place, distance = np.empty((count, 3)), np.empty(count)
    side, rim = np.empty(count), np.zeros(count, np.bool_)
    stack, around, q = np.empty(128, np.int64), np.empty(_MOST_AROUND, np.int64), np.empty(3)
    for i in range(count):
        p, best = points[i], place[i]
        least = math.sqrt(_search(p, corners, order, low, high, stack, best))
        near = _SAME * (least + 1e-6)
        held = _holding(best, near, corners, order, low, high, stack, around)
        normal, angle = np.zeros(3), 0.0
        for k in around[:held]:
            q[0], q[1], q[2], _ = _foot(best, corners[k])
            part = _angle_at(corners[k], q, 10 * near + _SAME * _apart(corners[k, 0], corners[k, 1]))
            angle += part
            normal += part * _normal(corners[k])
        distance[i] = least
        side[i] = 1.0 if np.sum((p - best) * normal) >= 0.0 else -1.0
        rim[i] = angle < 2 * math.pi and _is_rim(corners, around[:held], best, _SAME)
    return place, distance, side, rim


@njit(cache=True, nogil=True)
def _search(
    p: np.ndarray,
    corners: np.ndarray,
    order: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    stack: np.ndarray,
    best: np.ndarray,
) -> float:
    """Put the nearest place into `best` and return the square of its distance."""
    leaves = (len(low) + 1) // 2
    group = len(order) // leaves
    least, top = math.inf, 0
    stack[0] = 0
    while top >= 0:
        node = stack[top]
        top -= 1
        if box_gap(p, low[node], high[node]) >= least:
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
        if box_gap(p, low[one], high[one]) < box_gap(p, low[two], high[two]):
            one, two = two, one
        stack[top + 1], stack[top + 2] = one, two
        top += 2
    return least


@njit(cache=True, nogil=True)
def _holding(
    place: np.ndarray,
    near: float,
    corners: np.ndarray,
    order: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    stack: np.ndarray,
    around: np.ndarray,
) -> int:
    """Gather the triangles that hold a place, and return how many there are."""
    leaves = (len(low) + 1) // 2
    group = len(order) // leaves
    held, top = 0, 0
    stack[0] = 0
    while top >= 0:
        node = stack[top]
        top -= 1
        if box_gap(place, low[node], high[node]) > near * near:
            continue
        if node < leaves - 1:
            stack[top + 1], stack[top + 2] = 2 * node + 1, 2 * node + 2
            top += 2
            continue
        start = (node - leaves + 1) * group
        for k in order[start : start + group]:
            if k >= 0 and held < len(around) and _foot(place, corners[k])[3] <= near * near:
                around[held] = k
                held += 1
    return held


@njit(cache=True, nogil=True)
def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@njit(cache=True, nogil=True)
def _is_rim(corners: np.ndarray, triangles: np.ndarray, place: np.ndarray, same: float) -> bool:
    """Whether a place lies on a side that one triangle alone has."""
    for k in triangles:
        for c in range(3):
            a, b = corners[k, c], corners[k, (c + 1) % 3]
            near = same * 10 * math.sqrt(np.sum((b - a) ** 2)) + 1e-15
            if _off_line(place, a, b) > near:
                continue
            shared = 0
            for other in triangles:
                if other != k and _has(corners[other], a, near) and _has(corners[other], b, near):
                    shared += 1
            if shared == 0:
                return True
    return False


@njit(cache=True, nogil=True)
def _has(t: np.ndarray, corner: np.ndarray, near: float) -> bool:
    return _apart(t[0], corner) <= near or _apart(t[1], corner) <= near or _apart(t[2], corner) <= near


@njit(cache=True, nogil=True)
def _off_line(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    along = b - a
    x = min(max(np.sum((p - a) * along) / max(np.sum(along * along), 1e-300), 0.0), 1.0)
    return math.sqrt(np.sum((p - a - x * along) ** 2))


@njit(cache=True, nogil=True)
def _normal(t: np.ndarray) -> np.ndarray:
    n = np.cross(t[1] - t[0], t[2] - t[0])
    return n / max(math.sqrt(np.sum(n * n)), 1e-300)


@njit(cache=True, nogil=True)
def _angle_at(t: np.ndarray, q: np.ndarray, near: float) -> float:
    """Angle that a triangle takes around a place on it: 2π inside, π on a side, its own at a corner."""
    for c in range(3):
        if math.sqrt(np.sum((t[c] - q) ** 2)) <= near:
            a, b = t[(c + 1) % 3] - t[c], t[(c + 2) % 3] - t[c]
            size = max(math.sqrt(np.sum(a * a) * np.sum(b * b)), 1e-300)
            return math.acos(min(max(np.sum(a * b) / size, -1.0), 1.0))
    for c in range(3):
        if _off_line(q, t[c], t[(c + 1) % 3]) <= near:
            return math.pi
    return 2 * math.pi


@njit(cache=True, nogil=True)
def _foot(p: np.ndarray, t: np.ndarray) -> tuple[float, float, float, float]:
    """Nearest place on a triangle, and the square of its distance.

    That is the foot of the point where it falls inside, else the nearest place on one of the sides.
    """
    bx, by, bz = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
    cx, cy, cz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
    dx, dy, dz = p[0] - t[0, 0], p[1] - t[0, 1], p[2] - t[0, 2]
    bb, bc, cc = bx * bx + by * by + bz * bz, bx * cx + by * cy + bz * cz, cx * cx + cy * cy + cz * cz
    db, dc = dx * bx + dy * by + dz * bz, dx * cx + dy * cy + dz * cz
    whole = bb * cc - bc * bc
    if whole > _FLAT * bb * cc:
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

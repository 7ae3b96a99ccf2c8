"""The wall of a lumen as triangles: the nearest point on it, on which side one is, and where it ends."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tssgeom import core
from tssgeom.arrays import Points, Vector, read_only

_GROUP = 4  # triangles in a box of the lowest row
_BITS = 21  # of each coordinate in the order along a Morton curve: three of them fill 64 bits


@dataclass(frozen=True, slots=True)
class Boxes:
    """A complete binary tree of boxes; the children of box k are 2k + 1 and 2k + 2."""

    order: np.ndarray
    """Numbers of the triangles in each box of the lowest row, one box after the other; -1 fills up."""
    low: Points
    """Lower corner of every box, infinite where it is empty [m]."""
    high: Points
    """Upper corner [m]."""


def box_tree(low: Points, high: Points) -> Boxes:
    """Build the tree of boxes around triangles, each given by the corners of its own box [n, 3] [m]."""
    count = len(low)
    leaves = 1 << max(int(np.ceil(np.log2(max(count / _GROUP, 1)))), 0)
    order = np.full(leaves * _GROUP, -1)
    along = np.argsort(_morton_codes(0.5 * (low + high)), kind="stable")
    # spread evenly over the boxes, so that none is full beside an empty one
    order[np.arange(count) * len(order) // count] = along
    filled = order >= 0
    edges = []
    for given, empty, least in ((low, np.inf, np.minimum), (high, -np.inf, np.maximum)):
        row = np.where(filled[:, None], given[order], empty).reshape(leaves, _GROUP, 3)
        rows = [least.reduce(row, axis=1)]
        while len(rows[-1]) > 1:
            rows.append(least(rows[-1][::2], rows[-1][1::2]))
        edges.append(np.ascontiguousarray(np.concatenate(rows[::-1])))
    return Boxes(order, edges[0], edges[1])


def _morton_codes(points: Points) -> np.ndarray:
    """Return the number of each point along a curve that fills space: neighbours have close numbers [n]."""
    least = points.min(axis=0)
    size = max(float(np.ptp(points, axis=0).max()), 1e-300)
    cells = ((points - least) / size * (2**_BITS - 1)).astype(np.uint64)
    x, y, z = (_spread_bits(column) for column in cells.T)
    return x | y << np.uint64(1) | z << np.uint64(2)


def _spread_bits(x: np.ndarray) -> np.ndarray:
    """Put two zeros before every bit."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        x = (x | x << np.uint64(shift)) & np.uint64(mask)
    return x


@dataclass(frozen=True)
class Wall:
    """Triangles of a wall, closed or open at its ends; their corners run one way round."""

    corners: np.ndarray
    """[f, 3 corners, 3] [m]."""
    outward: bool | None = None
    """Whether the normals point out of the lumen; None where it is not known: a route inside decides."""

    @cached_property
    def boxes(self) -> Boxes:
        """Boxes around groups of triangles, and around groups of boxes."""
        return box_tree(self.corners.min(axis=1), self.corners.max(axis=1))


@dataclass(frozen=True, slots=True)
class Nearest:
    """The nearest point of a wall for each of n points."""

    position: Points
    """[n, 3] [m]."""
    distance: Vector
    """[n] [m]."""
    side: Vector
    """+1 where the normal of the wall points towards the point, -1 where it points away [n]."""
    on_rim: np.ndarray
    """Whether the nearest point is on the rim of the wall, where the side is undefined [n] bool."""


def nearest(wall: Wall, points: Points) -> Nearest:
    """Find the nearest point of a wall for each point [n, 3] [m]; docs/model.md (144)."""
    boxes = wall.boxes
    position, distance, side, on_rim = core.nearest_on_wall(
        points, wall.corners, boxes.order, boxes.low, boxes.high
    )
    return Nearest(read_only(position), read_only(distance), read_only(side), on_rim)

"""Boxes around neighbouring things, in a tree: what is nearest is found without looking at the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from tssgeom.arrays import Points

_GROUP = 4  # things in a box of the lowest row
_BITS = 21  # of each coordinate in the order along a curve that fills space


@dataclass(frozen=True, slots=True)
class Boxes:
    """A complete binary tree of boxes; the children of box k are 2k + 1 and 2k + 2."""

    order: np.ndarray
    """Which things stand in each box of the lowest row, one box after the other; -1 fills up."""
    low: Points
    """Lower corner of every box, infinite where it is empty [m]."""
    high: Points
    """[m]."""


def boxed(low: Points, high: Points) -> Boxes:
    """Build the tree of boxes around things that each fill a box of their own [n, 3] [m]."""
    count = len(low)
    leaves = 1 << max(int(np.ceil(np.log2(max(count / _GROUP, 1)))), 0)
    order = np.full(leaves * _GROUP, -1)
    along = np.argsort(_curve(0.5 * (low + high)), kind="stable")
    # things are spread evenly over the boxes, so that none is full beside an empty one
    order[np.arange(count) * len(order) // count] = along
    there = order >= 0
    edges = []
    for given, empty, least in ((low, np.inf, np.minimum), (high, -np.inf, np.maximum)):
        row = np.where(there[:, None], given[order], empty).reshape(leaves, _GROUP, 3)
        rows = [least.reduce(row, axis=1)]
        while len(rows[-1]) > 1:
            rows.append(least(rows[-1][::2], rows[-1][1::2]))
        edges.append(np.ascontiguousarray(np.concatenate(rows[::-1])))
    return Boxes(order, edges[0], edges[1])


def _curve(places: Points) -> np.ndarray:
    """Return the number of each place along a curve that fills space: neighbours have close numbers [n]."""
    least = places.min(axis=0)
    size = max(float(np.ptp(places, axis=0).max()), 1e-300)
    cells = ((places - least) / size * (2**_BITS - 1)).astype(np.uint64)
    return _spread(cells[:, 0]) | _spread(cells[:, 1]) << np.uint64(1) | _spread(cells[:, 2]) << np.uint64(2)


def _spread(x: np.ndarray) -> np.ndarray:
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


@njit(cache=True, nogil=True)
def box_gap(p: np.ndarray, low: np.ndarray, high: np.ndarray) -> float:
    """Square of the distance to a box, 0 inside [m²]."""
    total = 0.0
    for c in range(3):
        gap = max(low[c] - p[c], p[c] - high[c], 0.0)
        total += gap * gap
    return total

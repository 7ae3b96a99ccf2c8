"""Points in clusters that share their errors, as centre lines traced in images have them."""

from __future__ import annotations

import numpy as np
from numba import njit

from tssgeom.arrays import Points, read_only
from tssgeom.route.observations import Shape

_CLOSE = 0.25  # of the median spacing
_MANY = 0.08  # of all spacings
_QUIET = 0.01  # of the median spacing: errors so small do not lie in clusters


def clustered(points: Points, noise: float) -> bool:
    """Whether many neighbours lie far closer together than the rest, as no even sensor puts them.

    Points with hardly any noise [m] lie closer together because the route bends there.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    usual = np.median(steps)
    return bool(noise > _QUIET * usual and np.mean(steps < _CLOSE * usual) > _MANY)


def merged(shape: Shape, cell: float) -> tuple[Shape, np.ndarray]:
    """Put the mean in the place of all points within `cell` [m] of the first of them.

    Returns
    -------
    shape
        One point for each cell.
    cell_of
        The cell of each given point [n].
    """
    cell_of = _cells(shape.points, cell)
    count = np.bincount(cell_of)
    sums = np.column_stack([np.bincount(cell_of, shape.points[:, c]) for c in range(3)])
    index = np.arange(len(count), dtype=np.float64)
    return Shape(read_only(sums / count[:, None]), read_only(index), None, shape.warnings), cell_of


@njit(cache=True, nogil=True)
def _cells(points: np.ndarray, cell: float) -> np.ndarray:
    out = np.zeros(len(points), dtype=np.int64)
    first = 0
    for i in range(1, len(points)):
        out[i] = out[i - 1]
        square = 0.0
        for c in range(3):
            square += (points[i, c] - points[first, c]) ** 2
        if square > cell * cell:
            out[i] += 1
            first = i
    return out

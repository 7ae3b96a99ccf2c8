"""Fill values: what a program writes for a coordinate that it has not, such as 9999 or -3.7e28."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tssgeom.arrays import Matrix
from tssgeom.io.formats.tables import Table

_FARTHEST = 3.0
"""Distance of a fill value from all other coordinates, over the diagonal of the box around these [1];
chosen: no point of a route lies so far from all others of a recording."""
_FEWEST = 4
"""Other coordinates of each axis, at least [1]; derived: fewer points are no shape."""
_MOST = 4
"""Sizes of fill values in one file [1]; chosen: a program has one, a converter adds its own."""


def without_fill_values(table: Table) -> tuple[Table, tuple[str, ...]]:
    """Return a table of points with its fill values as missing cells, and a note on them.

    A fill value is there at least twice, exactly equal, as in the three cells of one point, and lies far
    outside all other coordinates. A point that is far off by itself stays.
    """
    columns = table.columns
    if columns.bend_unit is not None:
        return table, ()
    cells = np.array([table.values[axis] for axis in columns.axes])
    known, fills = known_cells(cells)
    if not fills:
        return table, ()
    count = int((np.isnan(known) & ~np.isnan(cells)).any(axis=0).sum())
    values = {**table.values, **dict(zip(columns.axes, known, strict=True))}
    named = " and ".join(f"{value:g}" for value in fills)
    return replace(table, values=values), (f"{count} point{'s' * (count > 1)} of {named} read as missing",)


@np.errstate(over="ignore")
def known_cells(cells: Matrix) -> tuple[Matrix, list[float]]:
    """Return coordinates [3, n] with NaN for fill values, and these."""
    fills = list[float]()
    for _ in range(_MOST):
        size = np.abs(cells)
        largest = np.nanmax(size, initial=0.0)
        filled = size == largest
        rest = np.where(filled, np.nan, cells)
        if not np.isfinite(largest) or filled.sum() < 2 or np.isfinite(rest).sum(axis=1).min() < _FEWEST:
            break
        low, high = np.nanmin(rest, axis=1), np.nanmax(rest, axis=1)
        beyond = np.maximum(low[:, None] - cells, cells - high[:, None])[filled].min()
        if not beyond > _FARTHEST * np.linalg.norm(high - low):
            break
        fills += np.unique(cells[filled]).tolist()
        cells = rest
    return cells, fills

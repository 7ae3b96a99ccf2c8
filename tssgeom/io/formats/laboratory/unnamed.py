"""Names for the columns of points side by side in a table that has none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.io.formats.columns import AXES
from tssgeom.io.formats.laboratory.raw import RawTable
from tssgeom.io.formats.laboratory.wide import FEWEST_POINTS


@dataclass(frozen=True, slots=True)
class UnnamedLimits:
    """When columns are the coordinates of points."""

    nearer: float = 0.95
    """Mean difference of each coordinate from the third one after it over that from the next one, up to which
    those of a point follow each other [1]. Measured: 0.07 to 0.9 on seven recordings, markers in any order;
    1 to 3 where all x come first."""
    rows: int = 100
    """Rows that are compared [1]. Chosen."""


LIMITS = UnnamedLimits()
_BEFORE = (("frame", "time"), ("frame",), ("time",), ())  # what a row may begin with


def with_names_of_points(table: RawTable, said: Mapping[str, object], unit: str | None) -> RawTable:
    """Return a table with the names of its columns where it has none and these can only be points.

    A row is x, y, z of each of four points or more in turn, after the number of the frame, its time, or both.
    Any other table, and one without the `unit` that the user states for such files, stays as it is.
    """
    columns = table.columns
    if table.headed or unit is None or set(table.names) & {*said} or not len(table):
        return table
    for before in _BEFORE:
        count, rest = divmod(len(columns) - len(before), len(AXES))
        numbers = [column for column in columns if isinstance(column, np.ndarray)]
        if rest or count < FEWEST_POINTS or len(numbers) < len(columns) or not _begins(numbers, before):
            continue
        if not _are_points(np.column_stack(numbers[len(before) :])):
            return table
        first = f", after {' and '.join(before)}" if before else ""
        said_of_it = f"no header: x, y, z of {count} points in turn{first}"
        names = (*before, *(f"{k + 1}_{axis}" for k in range(count) for axis in AXES))
        return replace(table, names=names, headed=True, notes=(*table.notes, said_of_it))
    return table


def _begins(columns: list[Vector], before: tuple[str, ...]) -> bool:
    """Whether the first columns are what rows begin with, and the next one is no time or count."""
    frame = _counts(columns[0])
    if before == ("frame", "time"):
        return frame and _increases(columns[1]) and not _counts(columns[1])
    if before == ("frame",):
        return frame and not _increases(columns[1])
    if before == ("time",):
        return not frame and _increases(columns[0])
    return not _increases(columns[0])


def _increases(values: Vector) -> bool:
    return len(values) > 1 and bool(np.all(np.diff(values) > 0.0))


def _counts(values: Vector) -> bool:
    return len(values) > 1 and bool(np.all(np.diff(values) == 1.0)) and float(values[0]).is_integer()


def _are_points(values: np.ndarray) -> bool:
    """Whether coordinates [f, 3 n] are like the third after each, as x, y, z in turn, not like the next."""
    some = values[:: max(len(values) // LIMITS.rows, 1)]
    return _differ(some, len(AXES)) < LIMITS.nearer * _differ(some, 1)


def _differ(values: np.ndarray, by: int) -> float:
    """Mean difference of values [f, n] from those so many columns later; infinite where there is none."""
    difference = np.abs(values[:, by:] - values[:, :-by])
    known = difference[np.isfinite(difference)]
    return float(known.mean()) if known.size else np.inf

"""Tables of tracked tools with a row for each tool, `frame,tool,q0,qx,qy,qz,tx,ty,tz`, as those of points."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tssgeom.io.formats.laboratory.raw import Column, RawTable

_TOOLS = frozenset(
    (
        "tool",
        "toolid",
        "toolname",
        "port",
        "porthandle",
        "handle",
        "sensor",
        "sensorid",
        "coil",
        "coilid",
        "id",
    )
)
"""Names of the column with the tool, as `_plain` has them."""
_POSE = ("q0", "qx", "qy", "qz", "tx", "ty", "tz")
_STATES = frozenset(("state", "status", "toolstatus", "toolstate", "transformstatus"))
UNOBSERVED = frozenset(("missing", "disabled"))
"""States of a tool without a pose, in small letters."""
FARTHEST_MM = 1e6
"""Chosen: far outside the volume of a tracker; NDI writes -3.7e28 for no number."""


def has_row_a_tool(names: Sequence[str]) -> bool:
    """Whether columns are one pose as NDI's programs name it, beside one with the tool."""
    plain = [_plain(name) for name in names]
    return all(plain.count(name) == 1 for name in _POSE) and any(name in _TOOLS for name in plain)


def with_points_of_tools(table: RawTable, said: Collection[str]) -> RawTable:
    """Return a table with a row a tool as one of points in mm, missing where a tool was not tracked.

    A table with other columns, or of which the user names a coordinate, stays as it is.
    """
    plain = [_plain(name) for name in table.names]
    at = [plain.index(name) for name in _POSE[-3:]] if has_row_a_tool(table.names) else []
    if not at or any(table.names[k] in said for k in at):
        return table
    names, columns = [*table.names], [*table.columns]
    if not all(isinstance(columns[k], np.ndarray) for k in at):
        return table
    tracked = np.ones(len(table), bool)
    for name, column in zip(plain, table.columns, strict=True):
        if name in _STATES and isinstance(column, list):
            tracked &= np.array([cell.strip().lower() not in UNOBSERVED for cell in column])
    for k, axis in zip(at, "xyz", strict=True):
        names[k] = f"{axis}_mm"
        columns[k] = _known(columns[k], tracked)
    missing = int(np.isnan(np.array([columns[k] for k in at])).any(axis=0).sum())
    notes = (
        "a row for each tool, in mm; turns are not read",
        *([f"{missing} tools not tracked"] if missing else []),
    )
    return replace(table, names=tuple(names), columns=tuple(columns), notes=(*table.notes, *notes))


def _known(column: Column, tracked: NDArray[np.bool_]) -> Column:
    values = np.asarray(column, np.float64)
    return np.where(tracked & (np.abs(values) < FARTHEST_MM), values, np.nan)


def _plain(name: str) -> str:
    return re.sub(r"[\s_.#-]+", "", name).lower()

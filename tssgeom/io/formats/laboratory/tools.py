"""Tables of tracked tools with a row for each tool, `frame,tool,q0,qx,qy,qz,tx,ty,tz`, as those of points."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from tssgeom.io.formats.laboratory.raw import RawTable

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
    cells = np.array([np.where(tracked, columns[k], np.nan) for k in at], np.float64)
    for k, axis, known in zip(at, "xyz", cells, strict=True):
        names[k], columns[k] = f"{axis}_mm", known
    missing = int(np.isnan(cells).any(axis=0).sum())
    notes = (
        "a row for each tool, in mm; turns are not read",
        *([f"{missing} tool{'s' * (missing > 1)} not tracked"] if missing else []),
    )
    return replace(table, names=tuple(names), columns=tuple(columns), notes=(*table.notes, *notes))


def _plain(name: str) -> str:
    return re.sub(r"[\s_.#-]+", "", name).lower()

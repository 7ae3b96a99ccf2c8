"""Stamps of ROS in two columns, `header.stamp.sec,header.stamp.nanosec`: joined to one time."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from tssgeom.io.formats.columns import TIME
from tssgeom.io.formats.laboratory.names import stamp_part
from tssgeom.io.formats.laboratory.raw import RawTable


def with_time_of_stamps(table: RawTable, said: Collection[str]) -> RawTable:
    """Return a table with `time_s` instead of the first pair of seconds and nanoseconds of a stamp.

    A table with that column, or of which the user states what one of the two is, stays as it is.
    """
    parts = [stamp_part(name) for name in table.names]
    pair = next(
        (
            (k, parts.index((part[0], "nanosec")))
            for k, part in enumerate(parts)
            if part is not None and part[1] == "sec" and (part[0], "nanosec") in parts
        ),
        None,
    )
    if pair is None or TIME in table.names or {table.names[k] for k in pair} & {*said}:
        return table
    whole, nano = (table.columns[k] for k in pair)
    if not (isinstance(whole, np.ndarray) and isinstance(nano, np.ndarray)):
        return table
    joined = {pair[0]: (TIME, whole + 1e-9 * nano)}
    kept = [k for k in range(len(table.names)) if k != pair[1]]
    return replace(
        table,
        names=tuple(joined[k][0] if k in joined else table.names[k] for k in kept),
        columns=tuple(joined[k][1] if k in joined else table.columns[k] for k in kept),
        units=tuple("" if k in joined else table.units[k] for k in kept) if table.units else (),
        notes=(*table.notes, f"{table.names[pair[0]]} and {table.names[pair[1]]} read as {TIME}"),
    )

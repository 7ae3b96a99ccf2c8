"""Tables of a run that a rig followed; every field carries its unit and its meaning as metadata."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from tssgeom.adapt.offline import FollowedRun
from tssgeom.arrays import Vector
from tssgeom.channel_names import marked, unit_of_key
from tssgeom.io.results.tables import field, write_table

_ENDS = {
    "tension_in_N": "tension at the proximal end",
    "tension_out_N": "tension at the distal end",
    "displacement_in_m": "movement of the drive since the pretensioned state",
    "displacement_out_m": "movement of the load since the pretensioned state",
}


def _with_error(name: str, meaning: str) -> tuple[pa.Field, pa.Field]:
    return field(name, meaning), field(marked(name, "se"), f"standard error of the {meaning}")


FOLLOWED = pa.schema(
    [
        field("time_s", "time of the run"),
        *(each for name, meaning in _ENDS.items() for each in _with_error(name, meaning)),
        field("elongation_m", "elongation, of the drive less of the load"),
    ]
)
"""A row for each row of the run."""

NUMBERS = {
    "filtered": "with the readings up to that time",
    "filtered_se": "its standard error",
    "smoothed": "with all readings of the run",
    "smoothed_se": "its standard error",
}
"""Columns of each followed number, behind its key."""

ALERTS = pa.schema(
    [
        field("time_s", "when the disagreement was certain"),
        field("since_s", "when it began"),
        field("channel", "channel whose readings the model does not explain", pa.string()),
        field("phase", "what the drive did when it began: pulling, releasing or hold", pa.string()),
        field("mechanism", "what explains it best; null where nothing was compared", pa.string()),
        field("where", "on what the mechanism acts", pa.string()),
        field("probability", "of the mechanism, among those that were tried", unit="1"),
        field("sentence", "the mechanism with its size", pa.string()),
    ]
)
"""A row for each disagreement."""


def followed_table(run: FollowedRun) -> pa.Table:
    """Return both ends in each row of the run, with standard errors; see `FOLLOWED`.

    Of a machine they are all channels.
    """
    if run.channels:
        fields = [each for name in run.channels for each in _with_error(name, f"{name.replace('_', ' ')}")]
        columns = [one for pair in run.channels.values() for one in pair.T]
        return _table(pa.schema([FOLLOWED.field("time_s"), *fields]), [run.time, *columns])
    ends = [each[:, i] for i in range(len(_ENDS)) for each in (run.ends, run.ends_se)]
    return _table(FOLLOWED, [run.time, *ends, run.ends[:, 2] - run.ends[:, 3]])


def write_numbers(path: Path, run: FollowedRun) -> None:
    """Write `adapt_numbers.parquet`: each followed number at some thousand times of the run; see `NUMBERS`.

    Raises SourceError where the disk refuses.
    """
    fields = [field("time_s", "time of the run")]
    columns = [np.concatenate([one.numbers.time for one in run.stretches])]
    for key in run.keys:
        parts = list[np.ndarray]()
        for one in run.stretches:
            at, numbers = one.keys.index(key) if key in one.keys else None, one.numbers
            if at is None:
                parts.append(np.full((len(numbers.time), 4), np.nan))
                continue
            series = (numbers.filtered, numbers.filtered_se, numbers.values, numbers.se)
            parts.append(np.column_stack([each[:, at] for each in series]))
        columns += list(np.concatenate(parts).T)
        fields += [
            field(f"{key}_{ending}", meaning, unit=unit_of_key(key)) for ending, meaning in NUMBERS.items()
        ]
    write_table(path, _table(pa.schema(fields), columns))


def write_alerts(path: Path, run: FollowedRun) -> None:
    """Write `adapt_alerts.parquet`: a row for each disagreement; see `ALERTS`.

    Raises SourceError where the disk refuses.
    """
    rows = [[None if value == "" else value for value in one] for one in run.alerts]
    write_table(path, _table(ALERTS, [[row[i] for row in rows] for i in range(len(ALERTS))]))


def _table(schema: pa.Schema, columns: Sequence[Vector | list[Any]]) -> pa.Table:
    """Return columns as a table; NaN is null."""
    pairs = zip(columns, schema, strict=True)
    return pa.Table.from_arrays(
        [pa.array(each, one.type, from_pandas=True) for each, one in pairs], schema=schema
    )

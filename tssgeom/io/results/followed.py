"""Tables of a run that a rig followed; every field carries its unit and its meaning as metadata."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as papq

from tssgeom.adapt.offline import AlertRow, FollowedRun
from tssgeom.arrays import Vector
from tssgeom.atomic import replacing

_ENDS = (
    ("tension_in", "N", "tension at the proximal end"),
    ("tension_out", "N", "tension at the distal end"),
    ("displacement_in", "m", "movement of the drive since the pretensioned state"),
    ("displacement_out", "m", "movement of the load since the pretensioned state"),
)
_ALERTS = {
    "time": ("time_s", "s", "when the disagreement was certain"),
    "since": ("since_s", "s", "when it began"),
    "channel": ("channel", "", "channel whose readings the model does not explain"),
    "phase": ("phase", "", "what the drive did when it began: pulling, releasing or hold"),
    "mechanism": ("mechanism", "", "what explains it best; null where nothing was compared"),
    "where": ("where", "", "on what the mechanism acts"),
    "probability": ("probability", "1", "of the mechanism, among those that were tried"),
    "sentence": ("sentence", "", "the mechanism with its size"),
}
_TEXTS = ("channel", "phase", "mechanism", "where", "sentence")


class _Columns:
    """Columns of a table with unit and meaning."""

    def __init__(self) -> None:
        self._fields, self._columns = list[pa.Field](), list[pa.Array]()

    def add(self, name: str, unit: str, meaning: str, column: Vector | pa.Array) -> None:
        array = (
            pa.array(column, from_pandas=True) if isinstance(column, np.ndarray) else column
        )  # NaN is null
        self._fields.append(pa.field(name, array.type, metadata={"unit": unit, "meaning": meaning}))
        self._columns.append(array)

    def table(self) -> pa.Table:
        return pa.Table.from_arrays(self._columns, schema=pa.schema(self._fields))

    def write(self, path: Path) -> None:
        with replacing(path) as draft:
            papq.write_table(self.table(), draft)


def write_followed(path: Path, run: FollowedRun) -> None:
    """Write `adapt.parquet`: both ends in each row of the run, with standard errors.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    _followed(run).write(path)


def followed_table(run: FollowedRun) -> pa.Table:
    """Return both ends in each row of the run, with standard errors."""
    return _followed(run).table()


def _followed(run: FollowedRun) -> _Columns:
    columns = _Columns()
    columns.add("time_s", "s", "time of the run", run.time)
    for i, (name, unit, meaning) in enumerate(_ENDS):
        columns.add(f"{name}_{unit}", unit, meaning, run.ends[:, i])
        columns.add(f"{name}_se_{unit}", unit, f"standard error of the {meaning}", run.ends_se[:, i])
    columns.add(
        "elongation_m", "m", "elongation, of the drive less of the load", run.ends[:, 2] - run.ends[:, 3]
    )
    return columns


def write_numbers(path: Path, run: FollowedRun) -> None:
    """Write `adapt_numbers.parquet`: each followed number at some thousand times of the run.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    columns = _Columns()
    columns.add("time_s", "s", "time of the run", np.concatenate([one.numbers.time for one in run.stretches]))
    for key in run.keys:
        parts = list[np.ndarray]()
        for one in run.stretches:
            at, numbers = one.keys.index(key) if key in one.keys else None, one.numbers
            if at is None:
                parts.append(np.full((len(numbers.time), 4), np.nan))
                continue
            series = (numbers.filtered, numbers.filtered_se, numbers.values, numbers.se)
            parts.append(np.column_stack([each[:, at] for each in series]))
        table, unit = np.concatenate(parts), _unit(key)
        for i, (ending, meaning) in enumerate(
            (
                ("filtered", "with the readings up to that time"),
                ("filtered_se", "its standard error"),
                ("smoothed", "with all readings of the run"),
                ("smoothed_se", "its standard error"),
            )
        ):
            columns.add(f"{key}_{ending}", unit, meaning, table[:, i])
    columns.write(path)


def write_alerts(path: Path, run: FollowedRun) -> None:
    """Write `adapt_alerts.parquet`: a row for each disagreement.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    columns = _Columns()
    for name in AlertRow._fields:
        column, unit, meaning = _ALERTS[name]
        values = [getattr(one, name) for one in run.alerts]
        if name in _TEXTS:
            columns.add(column, unit, meaning, pa.array([value or None for value in values], pa.string()))
        else:
            columns.add(column, unit, meaning, pa.array(np.array(values, dtype=np.float64), from_pandas=True))
    columns.write(path)


def _unit(key: str) -> str:
    """Return the unit at the end of a key, 1 where there is none."""
    name = key.partition(".")[2]
    for ending, unit in (("_N_per_m", "N/m"), ("_per_N", "1/N"), ("_N", "N"), ("_m", "m"), ("_rad", "rad")):
        if name.endswith(ending):
            return unit
    return "1"

"""Frames from a long-form table: a row for each point, the rows of one time being one frame."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Points, Vector, read_only
from tssgeom.errors import ShapeError, TssgeomError
from tssgeom.io.formats.columns import AXES, MEASURED, POINT, TIME, columns_of
from tssgeom.io.formats.laboratory.mapping import NO_MAP, ColumnMap
from tssgeom.io.formats.laboratory.names import EXACT, RECORDING, is_inert, meaning_of
from tssgeom.io.formats.laboratory.table import laboratory_table
from tssgeom.io.formats.paths import PACKED, bytes_of, ending, reading, require_lines, split, stem
from tssgeom.io.formats.recording import PER_METRE, Frames, Recording
from tssgeom.io.formats.tables import (
    NO_ROW,
    Table,
    parquet_file,
    parquet_names,
    parquet_size,
    plain_names,
    read_csv,
    read_parquet,
)
from tssgeom.stream import Frame, Rejected

MOST_AT_ONCE = 64 << 20
"""Files up to this size are read at once [B]; a larger one is read twice, in blocks. Chosen."""
_HEADER_BYTES = 1 << 16
"""Bytes of a CSV file in which its header ends; chosen."""
MOST_POINTS = 100_000
"""The highest point number within a frame; chosen: a column with a higher one holds something else."""

Rows = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class LongFrames(Frames):
    """The frames of a table."""

    table: Table
    runs: tuple[Rows, ...]
    """Rows of each frame."""
    lowest: float
    """The lowest point number of the file."""

    def read(self) -> Iterator[Frame | Rejected]:
        """Yield the frames as the table holds them."""
        return map(self._frame_or_rejected, self.runs)

    def _frame_or_rejected(self, rows: Rows) -> Frame | Rejected:
        try:
            return self._frame(rows)
        except ShapeError as error:
            return Rejected(0, self._time(rows), str(error))

    def _frame(self, rows: Rows) -> Frame:
        for row in rows if self.table.faults else ():
            if row in self.table.faults:
                raise ShapeError(self.table.faults[row])
        columns = self.table.columns
        if columns.timed and np.isnan(self.table.values[TIME][rows]).any():
            missing = rows[np.isnan(self.table.values[TIME][rows])][0]
            raise ShapeError(f"{self._where(missing)}: {TIME} is empty: write the time of the frame in s")
        index = self._index_of_points(rows)
        per_metre = PER_METRE[columns.unit]
        sensed = np.column_stack([self.table.values[axis][rows] for axis in columns.axes])
        sensed[np.isnan(sensed).any(axis=1)] = np.nan
        stations = None
        if columns.station:
            stations = _spread(self.table.values[columns.station][rows] / per_metre, index)
        measured = self._measured(rows)
        if columns.bend_unit is None:
            points = _spread(sensed / per_metre, index)
            directions = self._directions(rows, index)
            return Frame(points, self._time(rows), stations, directions=directions, **measured)
        bends = _spread(sensed * PER_METRE[columns.bend_unit], index)
        unknown = read_only(np.full((len(bends), 3), np.nan))
        return Frame(unknown, self._time(rows), stations, curvatures=bends, **measured)

    def _directions(self, rows: Rows, index: Rows) -> Points | None:
        if not self.table.columns.directions:
            return None
        sensed = np.column_stack([self.table.values[name][rows] for name in self.table.columns.directions])
        sensed[np.isnan(sensed).any(axis=1)] = np.nan
        return _spread(sensed, index)

    def _time(self, rows: Rows) -> float:
        return float(self.table.values[TIME][rows[0]]) if self.table.columns.timed else 0.0

    def _index_of_points(self, rows: Rows) -> Rows:
        """Return the index of each row in its frame; missing numbers are points that were not observed."""
        if not self.table.columns.numbered:
            return np.arange(len(rows))
        numbers = self.table.values[POINT][rows] - self.lowest
        good = (numbers >= 0) & (numbers <= MOST_POINTS) & (numbers == np.floor(numbers))
        if not good.all():
            where = self._where(rows[int(np.argmin(good))])
            raise ShapeError(f"{where}: point is no whole number from 0 to {MOST_POINTS}: number the points")
        again = np.flatnonzero(np.diff(numbers) == 0)
        if len(again):
            where = self._where(rows[int(again[0]) + 1])
            raise ShapeError(f"{where}: point {numbers[again[0]] + self.lowest:g} is there twice: keep one")
        return numbers.astype(np.int64)

    def _measured(self, rows: Rows) -> dict[str, Any]:
        """Return the measurements of the frame, in SI; a column of empty cells is none."""
        measured: dict[str, Any] = {}
        for name in self.table.columns.measured:
            values = self.table.values[name][rows]
            known = values[~np.isnan(values)]
            if len(known) and (known != known[0]).any():
                other = float(known[known != known[0]][0])
                raise ShapeError(
                    f"{self._where(rows[0])}: {name} is {known[0]:g} and {other:g} in one frame: give one"
                )
            if len(known):
                field, per_unit = MEASURED[name]
                measured[field] = float(known[0]) / per_unit
        return measured

    def _where(self, row: int) -> str:
        return f"{self.table.number_name} {self.table.number[row]}"


def open_table(path: Path, unit: str | None, columns: ColumnMap = NO_MAP) -> Recording:
    """Open a table of points; one that is no plain table is read as laboratories write them.

    Raises
    ------
    ShapeError
        Where columns are missing or unclear, or where there is no row.
    SourceError
        Where the file cannot be read.
    """
    kind = ending(path)
    if split(path)[1] is None and kind in _PLAIN:
        names = _head_names(path, kind)
        if names is not None and is_plain(names, unit, columns.of(path)):
            columns.use(names)
            return _PLAIN[kind](path, names, unit)
    return _open_laboratory(path, unit, columns)


def _head_names(path: Path, kind: str) -> list[str] | None:
    """Return the names of a file's columns, None where they are to be recognised."""
    if kind == ".parquet":
        return parquet_names(path)
    with reading(path), path.open("rb") as file:
        return plain_names(file.read(_HEADER_BYTES))


def names_recordings(path: Path, columns: ColumnMap) -> bool:
    """Whether a table may hold several recordings: by its names, or because these are not plain."""
    names = _head_names(path, ending(path))
    said = columns.of(path)
    return names is None or any(
        name in said or ((meaning := meaning_of(name)) is not None and meaning.channel == RECORDING)
        for name in names
    )


def is_plain(names: Sequence[str], unit: str | None, said: Collection[str]) -> bool:
    """Whether the readers know these names as they stand, and nothing beside them resembles what is read."""
    if unit is None and any(axis in names for axis in AXES):
        return False  # a row of units may follow
    known = any(name in EXACT for name in names)
    return known and not set(names) & set(said) and all(name in EXACT or is_inert(name) for name in names)


def _open_csv(path: Path, names: list[str], unit: str | None) -> Recording:
    if _size(path) > MOST_AT_ONCE:
        from tssgeom.io.formats.blocks import csv_blocks, open_large

        return open_large(path, "csv", csv_blocks(path, names, unit))
    table = read_csv(path, require_lines(path, bytes_of(path)), names, unit)
    if table.faults:  # a row of units, comments and the like are none to a caller that expects them
        try:
            return _open_laboratory(path, unit, NO_MAP, clean=True)
        except TssgeomError:
            pass
    return _recording(path, "csv", table)


def _open_parquet(path: Path, names: list[str], unit: str | None) -> Recording:
    with parquet_file(path) as file:
        size = max(_size(path), parquet_size(file, columns_of(path, names, unit).names))
    if size <= MOST_AT_ONCE:
        return _recording(path, "parquet", read_parquet(path, unit))
    from tssgeom.io.formats.blocks import open_large, parquet_blocks

    return open_large(path, "parquet", parquet_blocks(path, unit))


_PLAIN = {".csv": _open_csv, ".parquet": _open_parquet}


def _open_laboratory(path: Path, unit: str | None, said: ColumnMap, *, clean: bool = False) -> Recording:
    """Open a table whose form and names are recognised; a `clean` one only if no row has a fault."""
    read = laboratory_table(path, said, unit)
    if clean and read.faults:
        raise ShapeError(f"{path}: {next(iter(read.faults.values()))}")
    columns = columns_of(path, [*read.values] if read.is_points else [*read.values, *read.unread], unit)
    if not read.is_points:
        raise ShapeError(f"{path}: the cells of {', '.join(columns.axes)} are no numbers: mend the file")
    values = {name: read.values[name] for name in columns.names}
    table = Table(columns, values, read.number, read.number_name, read.faults)
    if not len(table):
        raise ShapeError(f"{path}: {NO_ROW}")
    recording = _recording(path, ending(path).removesuffix(PACKED)[1:], table)
    warnings = (*recording.warnings, *read.warnings)
    return replace(recording, warnings=warnings, notes=(*read.notes, *recording.notes))


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0


def _recording(path: Path, kind: str, table: Table) -> Recording:
    if table.faults and not table.columns.timed:
        raise ShapeError(f"{path}: {next(iter(table.faults.values()))}{_more(len(table.faults) - 1)}")
    table, notes = _without_doubled(table)
    columns = table.columns
    frames = LongFrames(table, runs_of(table), lowest_point(table))
    return Recording(
        *(stem(path), path, columns.unit, kind, columns.timed, len(frames.runs), frames, columns.warnings),
        notes=notes,
    )


def _without_doubled(table: Table) -> tuple[Table, tuple[str, ...]]:
    """Leave out rows that repeat the one before them to the last digit, where the points are numbered."""
    if not table.columns.numbered or table.faults or len(table) < 2:
        return table, ()
    same = np.all([values[1:] == values[:-1] for values in table.values.values()], axis=0)
    if not same.any():
        return table, ()
    kept = np.concatenate(([True], ~same))
    values = {name: column[kept] for name, column in table.values.items()}
    return replace(table, values=values, number=table.number[kept]), (
        f"{int(same.sum())} doubled rows left out",
    )


def lowest_point(table: Table) -> float:
    """Return the lowest point number of a table; infinity where points are not numbered."""
    numbers = table.values[POINT] if table.columns.numbered else np.zeros(0)
    return float(np.min(numbers[np.isfinite(numbers)], initial=np.inf))


def _more(count: int) -> str:
    return f" (and {count} more such lines)" if count else ""


def runs_of(table: Table) -> tuple[Rows, ...]:
    """Return the rows of each frame: of one time each, sorted where the points are numbered."""
    time = filled(table.values[TIME]) if table.columns.timed else np.zeros(len(table))
    order = np.arange(len(table))
    if table.columns.numbered:
        order = np.lexsort((table.values[POINT], time))
    # NaN times left over (the first rows) differ from each other: one run is made of them.
    step = np.nan_to_num(time[order], nan=-np.inf)
    return tuple(np.split(order, np.flatnonzero(step[1:] != step[:-1]) + 1))


def filled(time: Vector) -> Vector:
    """Give each row without a time the time of the row before it, so that its frame stays one."""
    known = np.where(np.isnan(time), -1, np.arange(len(time)))
    latest = np.maximum.accumulate(known)
    return np.where(latest < 0, np.nan, time[latest])


def _spread(values: Points | Vector, index: Rows) -> Points | Vector:
    """Return an array with the values at their indices and NaN at the others."""
    if index[-1] == len(index) - 1:
        return read_only(values)
    spread = np.full((int(index[-1]) + 1, *values.shape[1:]), np.nan)
    spread[index] = values
    return read_only(spread)

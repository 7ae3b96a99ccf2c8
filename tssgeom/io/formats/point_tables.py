"""Opening of tables of points: plain ones at once or in blocks, others as laboratories write them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import ShapeError, TssgeomError
from tssgeom.io.formats.columns import AXES, POINT, TIME, columns_of
from tssgeom.io.formats.laboratory.mapping import NO_MAP, ColumnMap
from tssgeom.io.formats.laboratory.names import EXACT, RECORDING, is_inert, meaning_of
from tssgeom.io.formats.laboratory.table import LaboratoryTable, laboratory_table
from tssgeom.io.formats.laboratory.units import UNITS
from tssgeom.io.formats.laboratory.wide import has_size, point_columns
from tssgeom.io.formats.longform import MOST_AT_ONCE, LongFrames
from tssgeom.io.formats.paths import PACKED, bytes_of, ending, reading, require_lines, size_of, split, stem
from tssgeom.io.formats.recording import PER_METRE, Recording
from tssgeom.io.formats.tables import (
    NO_ROW,
    Rows,
    Table,
    lowest_point,
    parquet_file,
    parquet_names,
    parquet_size,
    plain_names,
    read_csv,
    read_parquet,
    runs_of,
)

_AS_COUNTED = 0.5
"""Difference of the mean spacing of points from 1, in the unit of the file, up to which their stations may
count them too [1]; chosen: stations of half or twice the way are refused."""
_HEADER_BYTES = 1 << 16
"""Bytes of a CSV file in which its header ends; chosen."""
_FARTHEST = 3.0
"""Distance of a fill value from all other coordinates, over the diagonal of the box around these [1];
chosen: no point of a route lies so far from all others of a recording."""
_FEWEST_BESIDE = 4
"""Other coordinates of each axis, at least [1]; derived: fewer points are no shape."""
_MOST_FILLS = 4
"""Sizes of fill values in one file [1]; chosen: a program has one, a converter adds its own."""


def open_table(path: Path, unit: str | None, columns: ColumnMap = NO_MAP) -> Recording:
    """Open a table of points; one that is no plain table is read as laboratories write them.

    Raises ShapeError where columns are missing or unclear, or where there is no row; SourceError where the
    file cannot be read.
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
    if (unit is None and any(axis in names for axis in AXES)) or point_columns(names) or has_size(names):
        return False  # a row of units may follow, or a row holds several points, or no components
    known = any(name in EXACT for name in names)
    return known and not set(names) & set(said) and all(name in EXACT or is_inert(name) for name in names)


def _open_csv(path: Path, names: list[str], unit: str | None) -> Recording:
    if size_of(path) > MOST_AT_ONCE:
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
        size = max(size_of(path), parquet_size(file, columns_of(path, names, unit).names))
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
    names = [*read.values] if read.is_points else [*read.values, *read.unread]
    unit = _unit_beside_own(path, read, unit)
    if unit is None and "s" in read.values and "s" in read.names:
        _require_no_unitless_station(path, read)
    columns = columns_of(path, names, unit, [*read.names.values(), *read.unread])
    if not read.is_points:
        raise ShapeError(f"{path}: the cells of {', '.join(columns.axes)} are no numbers: mend the file")
    values = {name: read.values[name] for name in columns.names}
    table = Table(columns, values, read.number, read.number_name, read.faults)
    if not len(table):
        raise ShapeError(f"{path}: {NO_ROW}")
    recording = _recording(path, ending(path).removesuffix(PACKED)[1:], table, read.names)
    warnings = (*recording.warnings, *read.warnings)
    return replace(recording, warnings=warnings, notes=(*read.notes, *recording.notes))


def _unit_beside_own(path: Path, read: LaboratoryTable, given: str | None) -> str | None:
    """Return the unit of `--unit`; None where the columns state the same: what is read of them is in mm."""
    own = read.units.get("x_mm")
    if given is None or given in ("mm", "m") or given not in PER_METRE:
        return given
    if own is None or own.symbol in ("mm", "m"):
        return given
    if UNITS[given].factor != own.factor:
        raise ShapeError(f"{path}: the file is in {own.symbol}, --unit says {given}: read it without --unit")
    return None


def _require_no_unitless_station(path: Path, read: LaboratoryTable) -> None:
    """Refuse stations without a unit beside coordinates that have one, by their own name in the file."""
    if all(axis in read.values for axis in AXES):
        return
    name, station = read.names["s"], read.values["s"]
    hint = f'state it: --map "{name}=s_mm"'
    if _are_numbers_of_points(station, read.values.get(TIME, np.zeros(len(station)))):
        hint = f'if it numbers the points, give --map "{name}=point", else {hint}'
    raise ShapeError(f"{path}: column {name!r}, read as arc length, has no unit: {hint}")


def _are_numbers_of_points(numbers: Vector, time: Vector) -> bool:
    """Whether numbers are 0 or 1 to the highest, each of them there, and ascend within each time."""
    distinct = np.unique(numbers)
    low = distinct[0]
    if low not in (0.0, 1.0) or not np.array_equal(distinct, low + np.arange(len(distinct))):
        return False
    return bool((np.diff(numbers)[np.diff(time) == 0.0] > 0.0).all())


def _recording(path: Path, kind: str, table: Table, names: Mapping[str, str] | None = None) -> Recording:
    if table.faults and not table.columns.timed:
        raise ShapeError(f"{path}: {next(iter(table.faults.values()))}{_more(len(table.faults) - 1)}")
    table, filled = _without_fill_values(table)
    table, doubled = _without_doubled(table)
    table, clock = _with_each_time_once(table)
    columns = table.columns
    frames = LongFrames(table, runs_of(table), lowest_point(table))
    warnings = (*columns.warnings, *clock, *_counted_stations(table, frames.runs[0], names or {}))
    return Recording(
        *(stem(path), path, columns.unit, kind, columns.timed, len(frames.runs), frames, warnings),
        notes=(*filled, *doubled),
    )


@np.errstate(over="ignore", invalid="ignore")
def _counted_stations(table: Table, rows: Rows, names: Mapping[str, str]) -> tuple[str, ...]:
    """Warn where stations without a unit count the points 1 apart, which the points themselves are not."""
    station = table.columns.station
    if station != "s" or table.columns.bend_unit or (np.diff(table.values[station][rows]) != 1.0).any():
        return ()
    points = np.column_stack([table.values[axis][rows] for axis in table.columns.axes])
    apart = np.linalg.norm(np.diff(points[np.isfinite(points).all(axis=1)], axis=0), axis=1)
    if not len(apart) or abs(np.mean(apart) - 1.0) < _AS_COUNTED:
        return ()
    name = names.get(station, station)
    return (f'column {name!r} is read as arc length: if it numbers the points, give --map "{name}=point"',)


def _without_fill_values(table: Table) -> tuple[Table, tuple[str, ...]]:
    """Return a table of points with its fill values as missing cells, and a note on them.

    A fill value is there at least twice, exactly equal, as in the three cells of one point, and lies far
    outside all other coordinates. A point that is far off by itself stays.
    """
    columns = table.columns
    if columns.bend_unit is not None:
        return table, ()
    cells = np.array([table.values[axis] for axis in columns.axes])
    known, fills = _known_cells(cells)
    if not fills:
        return table, ()
    count = int((np.isnan(known) & ~np.isnan(cells)).any(axis=0).sum())
    values = {**table.values, **dict(zip(columns.axes, known, strict=True))}
    named = " and ".join(f"{value:g}" for value in fills)
    return replace(table, values=values), (f"{count} point{'s' * (count > 1)} of {named} read as missing",)


@np.errstate(over="ignore")
def _known_cells(cells: Matrix) -> tuple[Matrix, list[float]]:
    """Return coordinates [3, n] with NaN for fill values, and these."""
    fills = list[float]()
    for _ in range(_MOST_FILLS):
        size = np.abs(cells)
        largest = np.nanmax(size, initial=0.0)
        filled = size == largest
        rest = np.where(filled, np.nan, cells)
        beside = np.isfinite(rest).sum(axis=1).min()
        if not np.isfinite(largest) or filled.sum() < 2 or beside < _FEWEST_BESIDE:
            break
        low, high = np.nanmin(rest, axis=1), np.nanmax(rest, axis=1)
        beyond = np.maximum(low[:, None] - cells, cells - high[:, None])[filled].min()
        if not beyond > _FARTHEST * np.linalg.norm(high - low):
            break
        fills += np.unique(cells[filled]).tolist()
        cells = rest
    return cells, fills


def _without_doubled(table: Table) -> tuple[Table, tuple[str, ...]]:
    """Leave out rows that repeat another to the last digit: where points are numbered, or of whole frames."""
    columns = table.columns
    if table.faults or len(table) < 2 or not (columns.numbered or columns.timed):
        return table, ()
    kept = np.ones(len(table), bool)
    if columns.numbered:
        time = [table.values[TIME]] if columns.timed else []
        order = np.lexsort((table.values[POINT], *time))  # a row and its double follow each other
        kept[order[1:][_same(table, order[:-1], order[1:])]] = False
    else:
        for rows in runs_of(table):
            half = len(rows) // 2
            if half > 1 and half * 2 == len(rows) and _same(table, rows[:half], rows[half:]).all():
                kept[rows[half:]] = False
    if kept.all():
        return table, ()
    values = {name: column[kept] for name, column in table.values.items()}
    return replace(table, values=values, number=table.number[kept]), (
        f"{int((~kept).sum())} doubled rows left out",
    )


def _with_each_time_once(table: Table) -> tuple[Table, tuple[str, ...]]:
    """Keep the first of the rows that have one time, in a table whose rows hold a frame each; warn of it."""
    if not (table.columns.timed and table.columns.numbered):
        return table, ()
    begins = np.flatnonzero(np.diff(table.number, prepend=table.number[0] - 1))
    if len(begins) == len(table):  # each row holds a point
        return table, ()
    time = table.values[TIME][begins]
    known = np.flatnonzero(~np.isnan(time))
    again = np.setdiff1d(known, known[np.unique(time[known], return_index=True)[1]])
    back = np.flatnonzero(np.diff(time[known]) < 0.0)
    if not len(again) and not len(back):
        return table, ()
    if len(back):
        at, before = known[back[0] + 1], time[known[back[0]]]
        warning = f"the clock jumps back from {before:.15g} s to {time[at]:.15g} s"
    else:
        at = again[0]
        warning = f"time {time[at]:.15g} s is there twice"
    what = "the frames are sorted by time"
    if len(again):
        rows = "1 row of a time that was" if len(again) == 1 else f"{len(again)} rows of times that were"
        what = f"{rows} there before left out"
    where = f"{table.number_name} {table.number[begins[at]]}"
    kept = ~np.isin(np.repeat(np.arange(len(begins)), np.diff(begins, append=len(table))), again)
    index = np.cumsum(kept) - 1
    table = replace(
        table,
        values={name: column[kept] for name, column in table.values.items()},
        number=table.number[kept],
        faults={int(index[row]): fault for row, fault in table.faults.items() if kept[row]},
    )
    return table, (f"{where}: {warning}: {what}",)


def _same(table: Table, rows: Rows, others: Rows) -> NDArray[np.bool_]:
    """Mark rows that hold the same as others; what is missing in both is the same."""
    same = np.ones(len(rows), bool)
    for column in table.values.values():
        one, other = column[rows], column[others]
        same &= (one == other) | (np.isnan(one) & np.isnan(other))
    return same


def _more(count: int) -> str:
    return f" (and {count} more such lines)" if count else ""

"""One table of a laboratory file, ready for the readers of points and of runs.

Columns of points side by side have names where the table has none.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Vector
from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.formats.columns import AXES, POINT, TIME
from tssgeom.io.formats.laboratory.channels import Resolved
from tssgeom.io.formats.laboratory.files import raw_tables
from tssgeom.io.formats.laboratory.mapping import NO_MAP, ColumnMap, Mapped
from tssgeom.io.formats.laboratory.names import FLAG, stamp_part
from tssgeom.io.formats.laboratory.raw import RawTable
from tssgeom.io.formats.laboratory.resolve import marker_numbers, resolved
from tssgeom.io.formats.laboratory.units import Unit
from tssgeom.io.formats.laboratory.wide import (
    FEWEST_POINTS,
    with_components,
    with_points_of_tools,
    with_row_a_point,
)
from tssgeom.io.formats.paths import kept_while_unchanged, selected, split
from tssgeom.io.formats.recording import UNTIMED


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


_MOST_WHOLE = 2  # unclear columns whose sentence is printed whole [1]; chosen: more make a wall of text
_LONGER = 1.2
"""Length of the polygon by labels over that by rows, up to which labels are the order; chosen: a wrong order
is several times as long."""


@dataclass(frozen=True, slots=True)
class LaboratoryTable:
    """Columns under the names that the readers know."""

    values: Mapping[str, Vector]
    number: NDArray[np.int64]
    """Number of each row in the file, from 1."""
    number_name: str
    faults: Mapping[int, str]
    """Fault of a row, by its index."""
    notes: tuple[str, ...]
    """How the file was read: a phrase each."""
    warnings: tuple[str, ...]
    is_points: bool
    unread: tuple[str, ...]
    """Names of the columns that are not read, as the file has them."""
    names: Mapping[str, str]
    """Name in the file of each column that is no exact name, by the name that the readers know."""
    units: Mapping[str, Unit]
    """Unit in the file of each of these that has one."""


def laboratory_table(path: Path, columns: ColumnMap = NO_MAP, unit: str | None = None) -> LaboratoryTable:
    """Read the table that a path names, `FILE` or `FILE#PART`.

    Raises ShapeError where no table can be read, where a column is not clear without `--map`, or where the
    file holds several recordings and the path names none; SourceError where the file cannot be read.
    """
    file, part = split(path)
    tables = tables_of(file, columns, unit)
    names = [table.title for table, _ in tables]
    table, result = tables[selected(path, names) if len(tables) > 1 else 0]
    columns.use(table.names)
    if result.unclear:
        raise ShapeError(f"{file}: {_in_a_line(result.unclear)}")
    notes = [*table.notes, *result.notes]
    rows = np.arange(len(table))
    if part is not None and len(tables) == 1 and result.recordings is None:
        raise SourceError(f"{file}: it holds one recording, there is no #{part} in it: leave that out")
    if result.recordings is not None and len(tables) == 1:
        name, parts = result.recordings[0], _rows_of_parts(file, _key(columns.of(file)), unit)
        rows = parts[list(parts)[selected(path, list(parts))]]
        notes.append(f"one of {len(parts)} recordings by {name}")
    values = {name: column[rows] for name, column in result.values.items()}
    faults = {k: table.faults[row] for k, row in enumerate(rows.tolist()) if row in table.faults}
    warnings = [*result.warnings]
    if result.is_points:
        warnings += _not_tracked(table)
        values = _numbered(file, values, result, rows, notes, warnings)
    taken = {*result.suggested, *result.values}
    return LaboratoryTable(
        values,
        table.number[rows],
        table.number_name,
        faults,
        tuple(notes),
        tuple(warnings),
        result.is_points,
        tuple(name for name in table.names if name not in taken),
        result.names,
        result.units,
    )


def tables_of(file: Path, columns: ColumnMap, unit: str | None) -> list[tuple[RawTable, Resolved]]:
    """Return the tables of a file that hold points or channels; where none does, all.

    Raises ShapeError where there is none, or one without header cannot be points; SourceError where the file
    cannot be read.
    """
    return _tables(file, _key(columns.of(file)), unit)


def _key(said: Mapping[str, Mapped]) -> tuple[tuple[str, Mapped], ...]:
    return tuple(sorted(said.items(), key=lambda each: each[0]))


@kept_while_unchanged
def _tables(
    file: Path, said: tuple[tuple[str, Mapped], ...], unit: str | None
) -> list[tuple[RawTable, Resolved]]:
    stated = dict(said)
    named = [with_names_of_points(table, stated, unit) for table in raw_tables(file)]
    timed = [with_time_of_stamps(table, stated) for table in named]
    tools = [with_points_of_tools(with_components(table, stated), stated) for table in timed]
    tables = [with_row_a_point(file, table, stated, unit) for table in tools]
    every = [(table, resolved(file, table, stated, unit)) for table in tables]
    return [each for each in every if each[1].values or each[1].unclear] or every


@kept_while_unchanged
def _rows_of_parts(
    file: Path, said: tuple[tuple[str, Mapped], ...], unit: str | None
) -> dict[str, NDArray[np.int64]]:
    """Return the rows of each recording in the one table of a file, by its name."""
    recordings = _tables(file, said, unit)[0][1].recordings
    words = () if recordings is None else recordings[1]
    rows = dict[str, list[int]]()
    for row, word in enumerate(words):
        rows.setdefault(word, []).append(row)
    return {word: np.array(each, np.int64) for word, each in rows.items()}


def parts_of(file: Path, columns: ColumnMap, unit: str | None) -> list[str]:
    """Return the names of the sheets or recordings in a file; one name where it holds one table."""
    tables = tables_of(file, columns, unit)
    if len(tables) > 1:
        return [table.title for table, _ in tables]
    recordings = tables[0][1].recordings
    return [file.name] if recordings is None else list(dict.fromkeys(recordings[1]))


def _numbered(
    file: Path,
    values: Mapping[str, Vector],
    result: Resolved,
    rows: NDArray[np.int64],
    notes: list[str],
    warnings: list[str],
) -> dict[str, Vector]:
    """Return columns of points with times and numbers by the columns that name frames and markers."""
    values = dict(values)
    if result.frames is not None:
        name, frames = result.frames
        frames = frames[rows]
        distinct = len(np.unique(frames[np.isfinite(frames)]))
        if TIME not in values and 1 < distinct <= len(rows) / FEWEST_POINTS:
            values[TIME] = frames
            warnings.append(f"{UNTIMED}, by {name}")
        elif TIME not in values and distinct == len(rows) and POINT not in values:
            values[POINT] = frames
            notes.append(f"{name} read as {POINT}")
    if result.labels is not None and POINT not in values:
        name, labels = result.labels
        numbers = marker_numbers(labels)
        if numbers is not None and _is_an_order(numbers[rows], values):
            values[POINT] = numbers[rows]
            notes.append(f"markers in the order of {name}")
        elif len({*map(str, labels)}) > 1:
            _require_one_route(file, name, [*map(_word, np.asarray(labels)[rows].tolist())], values)
            notes.append(f"markers in the order of the rows, not of {name}")
    return values


def _not_tracked(table: RawTable) -> Iterator[str]:
    """Warn of rows with points that were not tracked, by columns that no reader reads."""
    for name, column in zip(table.names, table.columns, strict=True):
        if not FLAG.fullmatch(name):
            continue
        words = isinstance(column, list)
        lost = np.array([cell.strip().lower() == "false" for cell in column]) if words else column == 0.0
        if count := len(np.unique(table.number[lost])):
            rows = f"{count} {table.number_name}{'s' * (count > 1)}"
            yield (
                f"{name} is {'false' if words else '0'} in {rows}, whose points are read all the same: "
                "empty the coordinates of points that were not tracked"
            )


def _word(label: str | float) -> str:
    return label if isinstance(label, str) else f"{label:g}"


def _require_one_route(file: Path, name: str, labels: Sequence[str], values: Mapping[str, Vector]) -> None:
    """Refuse a recording whose frames have each marker several times: they hold several routes."""
    if TIME not in values:
        return
    time = values[TIME]
    first = np.flatnonzero(time == time[0])
    own = [labels[row] for row in first.tolist()]
    number = len(set(own))
    if number < FEWEST_POINTS or len(own) % number or any(own.count(label) == 1 for label in own):
        return
    raise ShapeError(
        f"{file}: {len(own) // number} rows of {name} {own[0]} at {time[0]:g} s: the column that "
        'distinguishes the routes is stated by --map "NAME=recording"'
    )


def _is_an_order(numbers: Vector, values: Mapping[str, Vector]) -> bool:
    """Whether numbers of markers can be their order: whole, each once in a frame, and no longer a way."""
    time = values.get(TIME, np.zeros(len(numbers)))
    first = np.flatnonzero(time == time[0])
    own = numbers[first]
    if not len(own) or not np.isfinite(own).all() or (own != np.floor(own)).any():
        return False
    pairs = np.column_stack([time, numbers])
    if len(np.unique(pairs, axis=0)) < len(
        np.unique(np.nan_to_num(np.column_stack([pairs, *values.values()])), axis=0)
    ):
        return False
    axes = [name for name in values if name.partition("_")[0] in AXES]
    points = np.column_stack([values[name][first] for name in axes])
    return _length(points[np.argsort(own, kind="stable")]) <= _LONGER * _length(points)


@np.errstate(over="ignore")
def _length(points: NDArray[np.float64]) -> float:
    whole = points[np.isfinite(points).all(axis=1)]
    return float(np.sum(np.linalg.norm(np.diff(whole, axis=0), axis=1)))


def _in_a_line(unclear: Sequence[str]) -> str:
    """Return what is unclear in one line: the first sentences whole, of the others the columns."""
    if len(unclear) <= _MOST_WHOLE:
        return "; ".join(unclear)
    others = ", ".join(each.partition(f"{each[0]} ")[0] + each[0] for each in unclear[_MOST_WHOLE:])
    return f"{'; '.join(unclear[:_MOST_WHOLE])}; likewise of {others}"


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

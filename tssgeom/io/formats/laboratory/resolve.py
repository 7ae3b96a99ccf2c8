"""A table of a laboratory to columns in SI, each under the name that the readers know."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tssgeom import channel_names
from tssgeom.arrays import Vector
from tssgeom.errors import ShapeError
from tssgeom.io.formats.columns import AXES, BENDS, POINT
from tssgeom.io.formats.laboratory.channels import Column, Resolved, take, take_channels, values_of
from tssgeom.io.formats.laboratory.headers import repeated
from tssgeom.io.formats.laboratory.mapping import IGNORE, Mapped, same_name
from tssgeom.io.formats.laboratory.names import (
    EXACT,
    FRAME,
    LABEL,
    QUANTITIES,
    RECORDING,
    Meaning,
    meaning_of,
    split_unit,
)
from tssgeom.io.formats.laboratory.raw import MISSING, RawTable, is_number, numbers_of
from tssgeom.io.formats.laboratory.text import EXPECTED
from tssgeom.io.formats.laboratory.times import take_time
from tssgeom.io.formats.laboratory.units import LENGTH, SI, UNITS, unit_of


def resolved(path: Path, table: RawTable, said: Mapping[str, Mapped], given_unit: str | None) -> Resolved:
    """Recognise the columns of a table.

    Raises ShapeError where a table without header cannot be points, a channel is there twice, or its numbers
    have both decimal marks.
    """
    table = _headed(path, table, said, given_unit)
    result = Resolved()
    rest = list[Column]()
    for k, name in enumerate(table.names):
        each = next((each for known, each in said.items() if same_name(known, name)), None)
        meaning = meaning_of(name, table.units[k] if table.units else "")
        if meaning is not None if each is None else each.channel != IGNORE:
            _require_one_mark(path, table, k)
        if each is not None:
            _take_mapped(path, table, k, each, meaning, result)
        elif name in EXACT and (_states_unit(name) or meaning is None or meaning.unit is None):
            _take_exact(path, table, k, meaning, result)
        elif meaning is not None:
            rest.append(Column(k, name, meaning))
    if twice := repeated([column.name for column in rest]):
        raise _twice(path, table, twice, "name them differently")
    _take_rest(table, rest, result)
    return result


def _twice(path: Path, table: RawTable, name: str, hint: str) -> ShapeError:
    """Return the error of a name that is there twice; with what to do about it."""
    if table.header_rows < 2:
        return ShapeError(f"{path}: column {name!r} is there twice: {hint}")
    return ShapeError(
        f"{path}: {table.header_rows} header rows, and {name!r} is there twice: write one row of names, "
        "of points side by side such as S1_x_mm,S1_y_mm,S1_z_mm,S2_x_mm"
    )


def _require_one_mark(path: Path, table: RawTable, k: int) -> None:
    """Refuse a column of numbers of which most lack the decimal mark of the table."""
    cells = table.columns[k]
    if isinstance(cells, np.ndarray):
        return
    filled = [(row, cell.strip()) for row, cell in enumerate(cells) if cell.strip().lower() not in MISSING]
    if not all(is_number(cell) for _, cell in filled):
        return
    marked = {mark: (row, cell) for row, cell in reversed(filled) for mark in ",." if mark in cell}
    if not marked:
        return
    cited = " and ".join(
        f"{cell!r} ({table.number_name} {table.number[row]})" for row, cell in sorted(marked.values())
    )
    raise ShapeError(
        f"{path}: column {table.names[k]!r} has {cited}, the table both decimal marks: write one of them"
    )


def _headed(path: Path, table: RawTable, said: Mapping[str, Mapped], given_unit: str | None) -> RawTable:
    """Return the table with names: three columns without any are the coordinates of points."""
    if table.headed or set(table.names) & set(said):
        return table
    if len(table.names) == len(AXES) and given_unit is not None:
        return replace(table, names=AXES, headed=True)
    first = f"{table.number_name} {table.number[0] if len(table.number) else 1}"
    raise ShapeError(
        f"{path}: {first} holds numbers, no header: {EXPECTED}; or name each column by its number: "
        '--map "1=time_s" --map "2=tension_in_N"; x, y, z in a row, of a point or of four and more in turn, '
        "need only --unit mm|m|cm|in|…, other points side by side a header such as "
        "S1_x_mm,S1_y_mm,S1_z_mm,S2_x_mm"
    )


def _states_unit(name: str) -> bool:
    return name not in (*AXES, "s")


def _take_exact(path: Path, table: RawTable, k: int, meaning: Meaning | None, result: Resolved) -> None:
    name, values = table.names[k], values_of(table, k)
    if name in result.values:
        raise _twice(path, table, name, "keep one")
    stated = unit_of(table.units[k]) if table.units else None
    own = unit_of(channel_names.unit_of(name)) if meaning is not None else None
    if stated is not None and own is not None and stated.factor != own.factor:
        result.unclear.append(f"{name!r} stands over the unit {table.units[k]!r}: mend one of them")
    if values is None:
        raise ShapeError(f"{path}: column {name!r} holds no numbers: write numbers, or leave cells empty")
    result.values[name] = values


def _take_mapped(
    path: Path, table: RawTable, k: int, each: Mapped, meaning: Meaning | None, result: Resolved
) -> None:
    name = table.names[k]
    if each.channel == IGNORE:
        return
    if each.channel in (LABEL, FRAME, RECORDING):
        _take_numbering(table, Column(k, name, Meaning(each.channel, None, "")), result)
        return
    quantity = QUANTITIES[each.channel]
    own = meaning.unit if meaning is not None else split_unit(name)[1]
    own = own if own is not None and own.quantity == quantity else None
    unit = (
        each.unit
        or own
        or each.named
        or (UNITS.get(SI[quantity]) if quantity in SI and quantity != LENGTH else None)
    )
    if unit is None and quantity == LENGTH and each.channel not in (*AXES, "s"):
        unit = UNITS["m"]
    if values_of(table, k) is None:
        raise ShapeError(
            f"{path}: column {name!r} holds no numbers: {each.origin} cannot make it {each.channel}"
        )
    take(table, Column(k, name, Meaning(each.channel, unit, quantity)), result, path)
    stated = re.search(r"[\[(]\s*([^\])]+?)\s*[\])]", name)
    if stated is not None and not (each.unit or own or each.named):
        known = unit.symbol if unit else "1"
        result.warnings.append(
            f"{name}: {stated[1]!r} is no known unit, and {known} is assumed; {each.channel}:UNIT states one"
        )


def _take_rest(table: RawTable, columns: list[Column], result: Resolved) -> None:
    """Recognise the columns that are neither named by the user nor exact."""
    held = {axis for axis in AXES for name in result.values if name.partition("_")[0] == axis}
    axes = [column for column in columns if column.meaning.channel in AXES]
    points = len(held | {column.meaning.channel for column in axes}) == len(AXES)
    for column in columns:
        channel = column.meaning.channel
        if channel in (LABEL, FRAME, RECORDING, POINT):
            _take_numbering(table, column, result)
            continue
        geometric = channel.startswith((*BENDS, "s")) or (channel in AXES and points)
        if geometric and values_of(table, column.at) is not None:
            take(table, column, result)
    measured = [
        column
        for column in columns
        if column.meaning.quantity and column.meaning.channel not in (*AXES, "s", *BENDS)
    ]
    if not points:
        measured += [column._replace(meaning=column.meaning._replace(channel="")) for column in axes]
    take_time(table, [column for column in measured if column.meaning.channel == "time"], result)
    take_channels(
        table, [column for column in measured if column.meaning.channel != "time"], result, points=points
    )


def _take_numbering(table: RawTable, column: Column, result: Resolved) -> None:
    """Take the column of recordings, frames, points or labels."""
    k, name, (channel, *_) = column
    values = table.columns[k]
    if channel == RECORDING and result.recordings is None:
        words = [f"{value:g}" for value in values] if isinstance(values, np.ndarray) else list(values)
        if 1 < len(set(words)) <= len(words) / 4:
            result.recordings = name, words
            result.suggested[name] = RECORDING
    elif channel == LABEL and result.labels is None:
        result.labels = name, values
    elif channel == FRAME and result.frames is None and isinstance(values, np.ndarray):
        result.frames = name, values
    elif channel == POINT and POINT not in result.values and isinstance(values, np.ndarray):
        take(table, column, result)


def marker_numbers(labels: Sequence[str] | Vector) -> Vector | None:
    """Return the number of each marker, alone or at the end of its label; None where one has none."""
    if isinstance(labels, np.ndarray):
        return labels
    digits = ["".join(c if c.isdigit() else " " for c in label).split() for label in labels]
    if not all(digits):
        return None
    values, _ = numbers_of([each[-1] for each in digits])
    return values

"""Tables with a row a frame, the points side by side, `S1_x,S1_y,S1_z,S2_x,…`: turned to a row a point."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from tssgeom.errors import ShapeError
from tssgeom.io.formats.columns import AXES, POINT
from tssgeom.io.formats.laboratory.names import EXACT, FRAME, meaning_of, split_unit
from tssgeom.io.formats.laboratory.raw import MISSING, Column, RawTable
from tssgeom.io.formats.laboratory.rows import is_number
from tssgeom.io.formats.laboratory.units import LENGTH, Unit, unit_of
from tssgeom.io.formats.recording import agreed_unit

FEWEST_POINTS = 4
"""Least points of a frame; derived: fewer are no shape."""
_AXIS_LAST = re.compile(r"(|.*[\d\s_.:/-])p?([wxyz])", re.IGNORECASE)
_AXIS_FIRST = re.compile(r"([wxyz])([\d\s_.:/-].*)", re.IGNORECASE)
_NUMBERED = re.compile(r"(\D+\d+)_([1-9])")
"""A column of a variable with columns of its own, as MATLAB writes them: `P1_1`, `P1_2`, `P1_3`."""
_NO_POSITION = re.compile(
    r"(?:^|.*[\d\s_.:/-])(?:q|r|t|n|v|a|quat\w*|rot\w*|orient\w*|euler|vel\w*|acc\w*|dir\w*|normal)"
)
"""Name of a vector that is no position: a turn, a direction, a speed."""


def point_columns(
    names: Sequence[str], units: Sequence[str] = (), besides: Collection[str] = ()
) -> dict[str, tuple[int, int, int]]:
    """Return the columns of x, y and z of each point, by its name and in the order of the route.

    That is the order of the table, and that of numbers where the table has their names sorted as words.

    Parameters
    ----------
    names
        Names of the columns.
    units
        Units of a unit row, where there is one.
    besides
        Names whose meaning the user states.
    """
    vectors = dict[str, dict[str, int]]()
    numbered = _numbered(names)
    for k, name in enumerate(names):
        if name in EXACT or name in besides:
            continue
        stem, unit = _stem_and_unit(name, units[k] if units else "")
        point_axis = numbered.get(name) or _axis(stem)
        if point_axis is not None and (unit is None or unit.quantity == LENGTH):
            vectors.setdefault(point_axis[0], {}).setdefault(point_axis[1], k)
    points = {
        point: (columns["x"], columns["y"], columns["z"])
        for point, columns in vectors.items()
        if {*columns} == {*AXES} and not _NO_POSITION.fullmatch(point.lower())
    }
    return _by_number(points) if len(points) >= FEWEST_POINTS else {}


def _by_number(points: dict[str, tuple[int, int, int]]) -> dict[str, tuple[int, int, int]]:
    """Return points by their numbers where a program sorted the names as words: S1, S10, S2."""
    matches = [re.fullmatch(r"(.*?)(\d+)(\D*)", name) for name in points]
    alike = {(match[1], match[3]) if match else None for match in matches}
    if None in alike or len(alike) > 1 or [*points] != sorted(points):
        return points
    return dict(sorted(points.items(), key=lambda point: int(re.findall(r"\d+", point[0])[-1])))


def _numbered(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return point and axis of the columns of variables that have three columns each."""
    columns = dict[str, dict[str, str]]()
    for name in names:
        if match := _NUMBERED.fullmatch(split_unit(name)[0]):
            columns.setdefault(match[1], {})[match[2]] = name
    three = {point: of for point, of in columns.items() if {*of} == {"1", "2", "3"}}
    return {of[n]: (point, axis) for point, of in three.items() for n, axis in zip("123", AXES, strict=True)}


def _stem_and_unit(name: str, unit_row: str) -> tuple[str, Unit | None]:
    stem, unit = split_unit(name)
    return stem, unit_of(unit_row) or unit


def _axis(stem: str) -> tuple[str, str] | None:
    """Split a name into that of a point and its axis; w is the fourth component of a quaternion."""
    if match := _AXIS_LAST.fullmatch(stem):
        point, axis = match[1], match[2]
    elif match := _AXIS_FIRST.fullmatch(stem):
        point, axis = match[2], match[1]
    else:
        return None
    return point.strip(" _.:/-"), axis.lower()


def with_row_a_point(
    file: Path, table: RawTable, said: Mapping[str, object], given_unit: str | None
) -> RawTable:
    """Return a table with a row a point; one that has no points side by side stays as it is.

    Raises ShapeError where the points have different units, or none at all.
    """
    points = point_columns(table.names, table.units, said)
    if sum(all(_is_numbers(table, k) for k in at) for at in points.values()) < FEWEST_POINTS:
        return table
    _require_numbers(file, table, list(chain(*points.values())))
    unit = _one_unit(file, table, list(chain(*points.values())))
    if not unit:
        some = table.names[points[next(iter(points))][0]]
        agreed_unit(file, None, given_unit, f"name the columns {some}_mm and so on")
    taken, count = {*chain(*points.values())}, len(points)
    kept = [k for k in range(len(table.names)) if k not in taken]
    columns = {table.names[k]: _repeated(table.columns[k], count) for k in kept}
    units = {table.names[k]: table.units[k] if table.units else "" for k in kept}
    if not any(_counts_frames(name, units[name]) for name in columns):
        columns[FRAME] = np.repeat(np.arange(float(len(table))), count)
    columns[POINT] = np.tile(np.arange(float(count)), len(table))
    for axis, at in zip(AXES, zip(*points.values(), strict=True), strict=True):
        columns[axis] = np.column_stack([table.columns[k] for k in at]).ravel()  # type: ignore[arg-type]
        units[axis] = unit
    first, *_, last = points
    return replace(
        table,
        names=tuple(columns),
        columns=tuple(columns.values()),
        units=tuple(units.get(name, "") for name in columns),
        number=np.repeat(table.number, count),
        faults={count * row: fault for row, fault in table.faults.items()},
        notes=(*table.notes, f"each row read as the {count} points of a frame, {first!r} to {last!r}"),
    )


def _is_numbers(table: RawTable, k: int) -> bool:
    return isinstance(table.columns[k], np.ndarray)


def _require_numbers(file: Path, table: RawTable, columns: Sequence[int]) -> None:
    """Refuse a table in which most cells of a coordinate are words: the route would lack that point."""
    for k in columns:
        cells = table.columns[k]
        if isinstance(cells, np.ndarray):
            continue
        filled = [row for row, cell in enumerate(cells) if cell.strip().lower() not in MISSING]
        row = next((row for row in filled if not is_number(cells[row].strip())), filled[0])
        where, name = f"{table.number_name} {table.number[row]}", table.names[k]
        raise ShapeError(
            f"{file}: {where}: {name} is {cells[row]!r}, most of its cells no numbers of this table: "
            f'leave those of a lost point empty, or the column out by --map "{name}=ignore"'
        )


def _repeated(column: Column, count: int) -> Column:
    if isinstance(column, np.ndarray):
        return np.repeat(column, count)
    return [cell for cell in column for _ in range(count)]


def _counts_frames(name: str, unit_row: str) -> bool:
    meaning = meaning_of(name, unit_row)
    return meaning is not None and meaning.channel in ("time", FRAME)


def _one_unit(file: Path, table: RawTable, columns: Sequence[int]) -> str:
    """Return the symbol of the one unit of some columns; empty where they have none."""
    stated = dict[str, str]()
    for k in columns:
        unit = _stem_and_unit(table.names[k], table.units[k] if table.units else "")[1]
        stated.setdefault(unit.symbol if unit else "", table.names[k])
    if len(stated) > 1:
        (one, name), (other, another) = list(stated.items())[:2]
        raise ShapeError(
            f"{file}: column {name!r} is in {one or 'no unit'}, {another!r} in {other or 'no unit'}: "
            "write one unit for all points"
        )
    return next(iter(stated))

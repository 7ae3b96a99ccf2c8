"""Tables turned to a row a point: of points side by side, tracked tools, curvatures by size and direction."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from tssgeom.errors import ShapeError
from tssgeom.io.formats.columns import AXES, BENDS, POINT
from tssgeom.io.formats.laboratory.names import EXACT, FRAME, meaning_of, split_unit
from tssgeom.io.formats.laboratory.raw import MISSING, Column, RawTable, is_number
from tssgeom.io.formats.laboratory.units import ANGLE, CURVATURE, LENGTH, Unit, unit_of
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


_WORDS = {
    CURVATURE: ("kappa", "κ", "curvature", "curv", "bend", "magnitude"),
    ANGLE: ("theta", "θ", "phi", "φ", "angle", "direction", "orientation", "bendangle", "bendingangle"),
}


def with_components(table: RawTable, said: Mapping[str, object]) -> RawTable:
    """Return a table whose curvature has two components instead of size and direction.

    One that has not exactly one column of each, with the unit of each, stays as it is.
    """
    sizes, directions = _columns(table.names, table.units, said)
    if len(sizes) != 1 or len(directions) != 1:
        return table
    (size, unit), (direction, angle) = sizes[0], directions[0]
    kappa, theta = table.columns[size], table.columns[direction]
    if not (isinstance(kappa, np.ndarray) and isinstance(theta, np.ndarray)):
        return table
    turned = unit.factor * kappa, angle.factor * theta
    columns, names, units = list(table.columns), list(table.names), list(table.units)
    columns[size], columns[direction] = turned[0] * np.cos(turned[1]), turned[0] * np.sin(turned[1])
    old = names[size], names[direction]
    names[size], names[direction] = (f"{bend}_per_m" for bend in BENDS)
    if units:
        units[size] = units[direction] = ""
    note = (
        f"{old[0]} and {old[1]} read as size and direction of curvature: kappa_x = κ cos θ, kappa_y = κ sin θ"
    )
    return replace(
        table, names=tuple(names), columns=tuple(columns), units=tuple(units), notes=(*table.notes, note)
    )


def has_size(names: Sequence[str]) -> bool:
    """Whether a name is that of the size of a curvature, with its unit."""
    return bool(_columns(names, (), ())[0])


def _columns(
    names: Sequence[str], units: Sequence[str], said: Collection[str]
) -> tuple[list[tuple[int, Unit]], list[tuple[int, Unit]]]:
    """Return the columns of sizes and of directions, by word and unit, which nobody states otherwise.

    None where there are coordinates: what a shape turns may be written beside its points.
    """
    columns: dict[str, list[tuple[int, Unit]]] = {quantity: [] for quantity in _WORDS}
    split = [] if any(split_unit(name)[0].lower() in AXES for name in names) else map(split_unit, names)
    for k, (stem, unit) in enumerate(split):
        unit = unit_of(units[k] if units else "") or unit
        plain = "".join(letter for letter in stem.lower() if letter.isalpha())
        if unit is not None and plain in _WORDS.get(unit.quantity, ()) and names[k] not in said:
            columns[unit.quantity].append((k, unit))
    return columns[CURVATURE], columns[ANGLE]

"""Exports of optical trackers' programs, whose headers have several rows: Motive, Vicon Nexus and QTM."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tssgeom.errors import ShapeError
from tssgeom.io.formats.laboratory.raw import Column, RawTable
from tssgeom.io.formats.laboratory.units import LENGTH, unit_of
from tssgeom.io.formats.laboratory.wide import FEWEST_POINTS

_AXES = ("X", "Y", "Z")
_MOTIVE, _VICON = "Format Version", "Trajectories"
_FRAME, _MARKERS, _BODIES = "Frame", "MARKER_NAMES", "BODY_NAMES"
_FRAMES_OF_VICON = (["Frame", "Sub Frame"], ["Frame", "Subframe"])
_ROWS_OF_VICON = 5
_MOST_ROWS = 64
"""Rows in which a header of keys and values ends; chosen: QTM writes one for each event."""
_QTM = ("FILE_VERSION", "NO_OF_FRAMES")
_UNLABELLED = "Unlabeled"


@dataclass(slots=True)
class Export:
    """What is read of the columns of one file."""

    names: list[str]
    """A name for each column; empty for those that are not read."""
    units: list[str]
    notes: tuple[str, ...]
    rate_Hz: float = 0.0
    """Frames in a second, where no column has the time; else 0."""
    lost_is_zero: bool = False
    """Whether a lost marker is written as 0,0,0."""
    points: list[tuple[int, int, int]] = field(default_factory=list[tuple[int, int, int]])
    """Columns of x, y and z of each marker."""


def exported_lines(lines: Sequence[tuple[int, str]]) -> tuple[Sequence[tuple[int, str]], int]:
    """Return the numbered lines that belong to the table, and how many of them are its header for certain.

    Nexus writes several tables into one file, a blank line between them: that of trajectories is read.
    """
    words = [re.split(r"[\t,;]", line) for _, line in lines]
    for begin, cells in enumerate(words):
        if cells[0] == _VICON and (certain := rows_of_header(words[begin:])):
            last = (k for k in range(begin + 1, len(lines)) if lines[k][0] != lines[k - 1][0] + 1)
            return lines[begin : next(last, len(lines))], certain
    return lines, rows_of_header(words)


def rows_of_header(rows: Sequence[Sequence[str]]) -> int:
    """Return how many rows are the header of an export for certain, as its first cells show; else 0."""
    keys = ["".join(row[:1]) for row in rows[:_MOST_ROWS]]
    title = keys[0]
    if title == _MOTIVE and _FRAME in keys:
        return 1 + keys.index(_FRAME)
    if title == _VICON and len(keys) >= _ROWS_OF_VICON and rows[3][:2] in _FRAMES_OF_VICON:
        return _ROWS_OF_VICON
    if title in _QTM and (named := [key for key in (_MARKERS, _BODIES, "TRAJECTORY_TYPES") if key in keys]):
        return 1 + max(map(keys.index, named))
    return 0


def export_of(path: Path, head: Sequence[list[str]], count: int) -> Export | None:
    """Return what the rows above the data say, where one of the programs wrote them; else None.

    Raises ShapeError where the file has no points that are read.
    """
    if not head or not rows_of_header(head):
        return None
    of = {_MOTIVE: _of_motive, _VICON: _of_vicon}.get(head[0][0], _of_qtm)
    return of(path, head, count)


def _of_motive(path: Path, head: Sequence[list[str]], count: int) -> Export | None:
    """Rows: keys and values; kinds, names and identifiers of what is tracked; Rotation or Position; axes."""
    axes, what = head[-1], head[-2]
    named = [row for row in head[1:-2] if len(row) == count]
    if not axes[1].startswith("Time") or len(named) < 2 or len(axes) != count or len(what) != count:
        return None
    titled = {row[1]: row for row in reversed(named)}
    kinds, names = titled.get("Type", named[0]), titled.get("Name", named[1])
    stated = dict(zip(head[0][::2], head[0][1::2], strict=False)).get("Length Units", "")
    if stated and (unit_of(stated) is None or unit_of(stated).quantity != LENGTH):  # type: ignore[union-attr]
        raise ShapeError(f"{path}: Length Units is {stated!r}: export from Motive in metres or millimetres")
    positions = [k for k in range(2, count) if what[k] == "Position" and axes[k] in _AXES]
    markers = [k for k in positions if kinds[k] == "Marker"]
    labelled = [k for k in markers if not names[k].startswith(_UNLABELLED)]
    bodies = [k for k in positions if kinds[k] == "Rigid Body"]
    for name, taken in (("rigid bodies", bodies), ("markers", labelled), ("unlabelled markers", markers)):
        if len(taken) >= FEWEST_POINTS * len(_AXES):
            export = _with_points(count, [(names[k], axes[k], k) for k in taken], stated)
            export.names[:2] = [_FRAME, "Time (Seconds)"]
            export.notes = (f"Motive's export: positions of {name}",)
            return export
    held = f"{len(markers) // 3} markers and {len(bodies) // 3} rigid bodies"
    raise ShapeError(
        f"{path}: Motive exported the positions of {held}: export those of at least {FEWEST_POINTS} markers, "
        "or rigid bodies, along the route"
    )


def _of_vicon(path: Path, head: Sequence[list[str]], count: int) -> Export:
    """Rows: the title, frames in a second, names over the first column of each marker, axes, units."""
    (rate, *_), named, axes, units = head[1], *(padded(row, count) for row in head[2:])
    names = [*named[:2], *filled(named[2:])]
    export = _with_points(
        count, [(names[k], axes[k], k) for k in range(2, count) if axes[k] in _AXES], units[2]
    )
    if len(export.points) < FEWEST_POINTS or {units[k] for at in export.points for k in at} != {units[2]}:
        raise ShapeError(
            f"{path}: Nexus exported {len(export.points)} trajectories, or not all in one unit: "
            f"export those of at least {FEWEST_POINTS} markers along the route"
        )
    export.names[0] = _FRAME
    export.rate_Hz = _rate(rate)
    export.notes = ("Vicon Nexus' export of trajectories",)
    return export


def _of_qtm(path: Path, head: Sequence[list[str]], count: int) -> Export:
    """Rows: a key and its values each; below them, as the user chose, the names of the columns."""
    held = {row[0]: [cell for cell in row[1:] if cell] for row in head}
    if (included := held.get("DATA_INCLUDED", ["3D"])) != ["3D"] or _MARKERS not in held:
        raise ShapeError(f"{path}: QTM exported {' '.join(included)}: export 3D data as TSV, with its header")
    markers = held[_MARKERS]
    wanted = [(name, axis) for name in markers for axis in _AXES]
    named = head[-1] if len(head[-1]) == count and " ".join(wanted[0]) in head[-1] else None
    before = count - len(wanted)
    if named is None and before not in (0, 2):
        raise ShapeError(
            f"{path}: {count} columns, {len(markers)} markers: export from QTM with the names of the columns"
        )
    columns = named or [*("Frame", "Time")[:before], *map(" ".join, wanted)]
    at = {name: k for k, name in reversed([*enumerate(columns)])}
    taken = [(name, axis, at[f"{name} {axis}"]) for name, axis in wanted if f"{name} {axis}" in at]
    export = _with_points(count, taken, "mm")
    for name, unit in (("Frame", ""), ("Time", "s")):
        if name in at:
            export.names[at[name]], export.units[at[name]] = name, unit
    export.rate_Hz = 0.0 if "Time" in at else _rate(*held.get("FREQUENCY", [""])[:1])
    export.lost_is_zero = True
    export.notes = ("QTM's export, in mm",)
    return export


def _with_points(count: int, taken: Sequence[tuple[str, str, int]], unit: str) -> Export:
    """Return an export of points alone; a name that is there again is that of another marker."""
    export = Export([""] * count, [""] * count, ())
    held = list[dict[str, int]]()
    last = ""
    for name, axis, k in taken:
        if not held or name != last or axis in held[-1]:
            held.append({})
        held[-1][axis], last = k, name
    names = dict.fromkeys((name for name, _, _ in taken), 0)
    for columns in held:
        if len(columns) < len(_AXES):
            continue
        name = next(name for name, _, k in taken if k == columns["X"])
        names[name] += 1
        again = f" ({names[name]})" if names[name] > 1 else ""
        for axis, k in columns.items():
            export.names[k], export.units[k] = f"{name}{again} {axis}", unit
        export.points.append((columns["X"], columns["Y"], columns["Z"]))
    return export


def padded(row: Sequence[str], count: int) -> list[str]:
    """Return a row of so many cells, empty ones at its end."""
    return [*row, *[""] * (count - len(row))][:count]


def filled(row: Sequence[str]) -> list[str]:
    """Return a row in which an empty cell has the name left of it, as merged ones do."""
    return list(itertools.accumulate(row, lambda left, cell: cell or left))


def _rate(text: str) -> float:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return 0.0


def only_read(table: RawTable, export: Export) -> RawTable:
    """Return the columns of a table that are read, with times, and with empty cells for lost markers."""
    columns, notes = [*table.columns], [*table.notes]
    if export.lost_is_zero:
        lost = _empty_zeros(columns, export.points)
        notes += [f"{lost} points at exactly 0,0,0 taken as missing"] if lost else []
    kept = [k for k, name in enumerate(table.names) if name]
    names, units = [table.names[k] for k in kept], [export.units[k] for k in kept]
    columns = [columns[k] for k in kept]
    frames = columns[names.index(_FRAME)] if _FRAME in names else None
    if export.rate_Hz > 0 and isinstance(frames, np.ndarray):
        names, units = [*names, "time_s"], [*units, ""]
        columns.append((frames - 1.0) / export.rate_Hz)
        notes.append(f"time from the frames, {export.rate_Hz:g} a second")
    return replace(table, names=tuple(names), columns=tuple(columns), units=tuple(units), notes=tuple(notes))


def _empty_zeros(columns: list[Column], points: Sequence[tuple[int, int, int]]) -> int:
    """Empty the cells of markers at exactly 0,0,0 in place, and return how many there are."""
    lost = 0
    for at in points:
        held = [columns[k] for k in at]
        if not all(isinstance(column, np.ndarray) for column in held):
            continue
        zero = np.all([column == 0.0 for column in held], axis=0)
        lost += int(zero.sum())
        for k in at:
            columns[k] = np.where(zero, np.nan, columns[k])
    return lost

"""Header of a table: one row of names, one with units below it, or several that name columns together."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from tssgeom.errors import listed
from tssgeom.io.formats.laboratory.names import meaning_of
from tssgeom.io.formats.laboratory.raw import Row, is_data
from tssgeom.io.formats.laboratory.trackers import Export, export_of, filled, padded, rows_of_header
from tssgeom.io.formats.laboratory.units import LENGTH, unit_of

_UNITLESS = frozenset(("", "-", "1", "--", "none"))
_UNNAMED = re.compile(r"Unnamed: \d+(_level_\d+)?")
"""What pandas writes for a name that is not there."""


class Header(NamedTuple):
    """Names and units of the columns, and where the data begin."""

    names: list[str]
    units: list[str]
    """Units of a unit row; empty where there is none."""
    first: int
    """Index of the first row of data."""
    rows: frozenset[int] = frozenset()
    """Indices of the rows that were read."""
    naming: int = 1
    """Number of rows that may name the columns."""
    notes: tuple[str, ...] = ()
    """How it was read."""
    export: Export | None = None
    """The columns that are read, of a file that the program of a tracker wrote."""
    length: str = ""
    """Unit of length that a comment states; empty where none does."""


_STATED = re.compile(
    r"(?:\bunits?\b(?: of length)?|\b(?:coordinates|positions|points) in\b)[\s:=(\[]*(\S+?)[)\].;]*", re.I
)


def header_of(path: Path, rows: Sequence[Row], count: int) -> Header:
    """Return the header of rows, of which those of data have `count` cells.

    Raises ShapeError where the program of a tracker wrote the file and no points are in it.
    """
    header = _header_of(path, rows, count)
    comments = (" ".join(row.cells) for row in rows[: header.first] if row.comment)
    stated = (match[1] for text in comments if (match := _STATED.fullmatch(text)))
    lengths = (word for word in stated if (unit := unit_of(word)) is not None and unit.quantity == LENGTH)
    return header._replace(length=next(lengths, ""))


def _header_of(path: Path, rows: Sequence[Row], count: int) -> Header:
    certain = rows_of_header([row.cells for row in rows])
    first = next(
        (
            k
            for k, row in enumerate(rows)
            if k >= certain and len(row.cells) == count and not row.comment and is_data(row.cells)
        ),
        len(rows),
    )
    if export := export_of(path, [row.cells for row in rows[:first]], count):
        every = frozenset(range(first))
        return Header(export.names, export.units, first, every, notes=export.notes, export=export)
    above = [k for k, row in enumerate(rows[:first]) if len(row.cells) == count and any(row.cells)]
    if not above:
        return Header([], [], first)
    cells = [rows[k].cells for k in above]
    has_units = len(above) > 1 and _is_unit_row(cells[-1]) and not _is_unit_row(cells[-2])
    own = above.pop(-2 if has_units else -1)
    units = cells[-1] if has_units else []
    read = {own, *above[-1:]} if has_units else {own}
    if not _needs_others(rows[own].cells):
        named, over = _named_above(rows, own, count)
        notes = (f"{listed([*map(repr, over)])} named one row above the others",) if over else ()
        return Header(named, units, first, frozenset({*read, own - bool(over)}), notes=notes)
    upper = [k for k in range(own) if 2 * len(rows[k].cells) > count and not rows[k].comment]
    upper = [k for k in upper if sum(map(bool, rows[k].cells)) > 1]
    names, used = _joined(rows, own, upper, count)
    if not used:
        return Header(rows[own].cells, units, first, frozenset(read), 1 + len(upper))
    notes = (f"names joined from {len(used) + 1} header rows",)
    return Header(names, units, first, frozenset({*read, *used}), 1 + len(upper), notes)


def _needs_others(names: Sequence[str]) -> bool:
    """Whether a row alone does not name the columns: a name is there twice, or the first one alone is."""
    filled = [name.lower() for name in names if name]
    return len(set(filled)) < len(filled) or (len(names) > 2 and [k for k, n in enumerate(names) if n] == [0])


def _named_above(rows: Sequence[Row], own: int, count: int) -> tuple[list[str], list[str]]:
    """Return the names of a row, and in its empty cells those one row above that a reader may know."""
    names = list(rows[own].cells)
    over = rows[own - 1].cells if own and not rows[own - 1].comment and "" in names else []
    taken = [k for k, name in enumerate(padded(over, count)) if not names[k] and meaning_of(name)]
    for k in taken:
        names[k] = over[k]
    return names, [names[k] for k in taken]


def _joined(rows: Sequence[Row], own: int, upper: list[int], count: int) -> tuple[list[str], list[int]]:
    """Return names with those of the rows above that make columns differ; no rows where none do."""
    parts, used = [_filled(rows[own].cells, count)], list[int]()
    names = _names(parts)
    for k in reversed(upper):
        more = [_filled(rows[k].cells, count), *parts]
        joined = _names(more)
        if len(set(joined)) > len(set(names)):
            parts, names = more, joined
            used.append(k)
        if len(set(names)) == count:
            return names, used
    return [], []


def _filled(cells: Sequence[str], count: int) -> list[str]:
    """Return a row of so many cells, filled where it names more than one column."""
    cells = padded(["" if _UNNAMED.fullmatch(cell) else cell for cell in cells], count)
    return filled(cells) if sum(map(bool, cells)) > 1 else cells


def _names(parts: Sequence[Sequence[str]]) -> list[str]:
    return [" ".join(filter(None, each)) for each in zip(*parts, strict=True)]


def _is_unit_row(cells: Sequence[str]) -> bool:
    """Whether each cell is a unit, or a mark that there is none."""
    units = [cell for cell in cells if cell.strip("[](){} ").lower() not in _UNITLESS]
    return bool(units) and all(unit_of(cell) for cell in units)


def repeated(names: Sequence[str]) -> str | None:
    """Return the first name that is there twice."""
    return next((name for name, count in Counter(names).items() if count > 1), None)

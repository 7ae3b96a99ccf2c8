"""Rows of cells to a table: its header, its unit row, and columns of numbers or of words."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tssgeom.io.formats.laboratory.raw import MISSING, Column, RawTable, is_moment, moments_of, numbers_of
from tssgeom.io.formats.laboratory.units import unit_of

_NUMBER = re.compile(r"[-+]?(\d[\d.]*(,\d*)?|[.,]\d+|\d+(,\d{3})*\.\d*)([eE][-+]?\d+)?")
_UNITLESS = frozenset(("", "-", "1", "--", "none"))


class RowLimits(NamedTuple):
    """What makes a row one of data; chosen."""

    numeric_share: float = 0.5
    """Share of numbers in its cells, at least; a label beside a few numbers is usual."""
    sample: int = 400
    """Rows from which the form of a table is recognised: a longer preamble hides it."""


LIMITS = RowLimits()


class Row(NamedTuple):
    """One row of a file."""

    number: int
    """From 1."""
    cells: list[str]
    comment: bool = False


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal point or comma, or a time."""
    return bool(_NUMBER.fullmatch(cell)) or cell.lower() in ("inf", "-inf") or is_moment(cell)


def is_data(cells: Sequence[str]) -> bool:
    """Whether a row holds numbers, and is no header."""
    filled = [cell for cell in cells if cell.lower() not in MISSING]
    numbers = sum(map(is_number, filled))
    return len(cells) > 1 and numbers > 0 and numbers >= LIMITS.numeric_share * len(filled)


def decimal_of(data: Sequence[Sequence[str]]) -> str:
    """Return the decimal mark of rows of data."""
    cells = [cell for row in data for cell in row if is_number(cell) and not is_moment(cell)]
    commas, points = (sum(mark in cell for cell in cells) for mark in ",.")
    last = sum(cell.rfind(",") > cell.rfind(".") > -1 for cell in cells)
    grouped = sum(cell.rfind(".") > cell.rfind(",") > -1 for cell in cells)  # by commas: 1,234.5
    return "," if commas and not grouped and (commas > points or last) else "."


def table_of(
    rows: Sequence[Row], count: int, decimal: str, number_name: str, notes: Sequence[str], title: str = ""
) -> RawTable:
    """Return the table in some rows, of which one at least is data of `count` cells."""
    names, units, first = header_of(rows, count)
    before = [row for row in rows[:first] if row.cells not in (names, units) and not row.comment]
    every = [*notes, *([f"{len(before)} lines before the table are not read"] if before else [])]
    kept, number, faults, repeated = list[list[str]](), list[int](), dict[int, str](), 0
    for row in rows[first:]:
        cells = row.cells
        if row.comment and not (len(cells) == count and is_data(cells)):
            continue
        if cells == names:
            repeated += 1
            continue
        if len(cells) != count:
            faults[len(kept)] = (
                f"{number_name} {row.number}: {len(cells)} columns, the header has {count}: mend the line"
            )
            cells = (cells + [""] * count)[:count]
        kept.append(cells)
        number.append(row.number)
    if repeated:
        every.append(f"{repeated} repeated headers are not read")
    columns = list[Column]()
    named = names or [str(k + 1) for k in range(count)]
    for k, name in enumerate(named):
        column, wrong = column_of([cells[k] for cells in kept], decimal)
        for row in wrong:
            where = f"{number_name} {number[row]}"
            faults.setdefault(row, f"{where}: {name} is {kept[row][k]!r}: write a number or leave it empty")
        columns.append(column)
    numbers = np.array(number, np.int64)
    return RawTable(
        *(tuple(named), tuple(columns), tuple(units), numbers, number_name, faults, tuple(every), title),
        headed=bool(names),
    )


def header_of(rows: Sequence[Row], count: int) -> tuple[list[str], list[str], int]:
    """Return names, units of a unit row, and the index of the first row of data."""
    first = next(
        (
            k
            for k, row in enumerate(rows)
            if len(row.cells) == count and not row.comment and is_data(row.cells)
        ),
        len(rows),
    )
    above = [row.cells for row in rows[:first] if len(row.cells) == count and any(row.cells)]
    if not above:
        return [], [], first
    if len(above) > 1 and _is_unit_row(above[-1]) and not _is_unit_row(above[-2]):
        return above[-2], above[-1], first
    return above[-1], [], first


def _is_unit_row(cells: Sequence[str]) -> bool:
    """Whether each cell is a unit, or a mark that there is none."""
    units = [cell for cell in cells if cell.strip("[](){} ").lower() not in _UNITLESS]
    return bool(units) and all(unit_of(cell) for cell in units)


def column_of(cells: list[str], decimal: str = ".") -> tuple[Column, list[int]]:
    """Return a column as numbers where most cells are, else as words, and the rows that are no number."""
    filled = sum(cell.strip().lower() not in MISSING for cell in cells)
    values, wrong = numbers_of(cells, decimal)
    if wrong and 2 * len(wrong) >= filled:
        values, wrong = moments_of(cells)
    if wrong and 2 * len(wrong) >= filled:
        return cells, []
    return values, wrong

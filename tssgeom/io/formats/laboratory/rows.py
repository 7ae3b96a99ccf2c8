"""Rows of cells: which hold data, with which decimal mark, and columns of numbers or of words."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from tssgeom.io.formats.laboratory.raw import MISSING, Column, is_moment, may_be_group, moments_of, numbers_of

_NUMBER = re.compile(r"[-+]?(\d[\d.]*(,\d*)?|[.,]\d+|\d+(,\d{3})*\.\d*)([eE][-+]?\d+)?")


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
    if all(may_be_group(cell) for cell in cells if "," in cell):  # 1,234 beside 0.5, but not beside 1.234
        grouped += sum("." in cell and not may_be_group(cell.replace(".", ",")) for cell in cells)
    return "," if commas and not grouped and (commas > points or last) else "."


def column_of(cells: list[str], decimal: str = ".") -> tuple[Column, list[int]]:
    """Return a column as numbers where most cells are, else as words, and the rows that are no number."""
    filled = sum(cell.strip().lower() not in MISSING for cell in cells)
    values, wrong = numbers_of(cells, decimal)
    if wrong and 2 * len(wrong) >= filled:
        values, wrong = moments_of(cells)
    if wrong and 2 * len(wrong) >= filled:
        return cells, []
    return values, wrong

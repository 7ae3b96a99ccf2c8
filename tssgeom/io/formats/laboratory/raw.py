"""A table as a file holds it: rows of cells, names, units of a unit row, columns of numbers or of words."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Vector

Column: TypeAlias = "Vector | list[str]"
ERRORS = ("#n/a", "#nv", "#div/0!", "#num!", "#zahl!", "#value!", "#wert!", "#ref!", "#bezug!")
"""What spreadsheets write where a formula has no value, in English and German."""
MISSING = frozenset(("", "-", "--", "nan", "null", "na", "n/a", "none", "nil", *ERRORS))
"""Cells that hold no value, in small letters."""
DAY = 86400.0
"""[s]"""
_CLOCK = re.compile(r"(\d{1,2}):(\d{2}):(\d{2}(?:[.,]\d+)?)")
_DAY_FIRST = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})([ T].*)?")
_THOUSANDS = re.compile(r"[-+]?\d{1,3}(,\d{3})+\.\d+")
_GROUPED = re.compile(r"[-+]?\d{1,3}(,\d{3})+(\.\d*)?")
_HUNDREDS = re.compile(r"[-+]?[1-9]\d\d")
_ISO = re.compile(r"\d{4}[-/]\d{2}[-/]\d{2}[T ]\d{2}:\d{2}.*")


@dataclass(frozen=True, slots=True)
class RawTable:
    """One table of a file."""

    names: tuple[str, ...]
    columns: tuple[Column, ...]
    units: tuple[str, ...] = ()
    """Units in a row of their own; empty where the file has none."""
    number: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """Number of each row in the file, from 1: of its line or of its row."""
    number_name: str = "row"
    faults: Mapping[int, str] = field(default_factory=dict)
    """Fault of a row, by its index."""
    notes: tuple[str, ...] = ()
    """How the file was read, apart from its columns."""
    title: str = ""
    """Name of the sheet, where the file has several."""
    headed: bool = True
    """False where the columns are named by their numbers."""
    header_rows: int = 1
    """Number of rows that may name the columns."""

    def __len__(self) -> int:
        return len(self.columns[0]) if self.columns else 0


def numbers_of(cells: Sequence[str], decimal: str = ".") -> tuple[Vector, list[int]]:
    """Return the numbers in some cells, NaN for missing ones, and the indices of those that are none."""
    if decimal == "." and _has_groups(cells):
        cells = [cell.replace(",", "") if _GROUPED.fullmatch(cell.strip()) else cell for cell in cells]
    return _parsed(cells, lambda text: float(_point(text) if decimal == "," else text))


def _has_groups(cells: Sequence[str]) -> bool:
    """Whether commas group digits: beside a point, or of integers some of which have three digits."""
    filled = [cell.strip() for cell in cells if "," in cell or "." in cell]
    return any(map(_THOUSANDS.fullmatch, filled)) or (
        all(map(may_be_group, filled)) and any(_HUNDREDS.fullmatch(cell.strip()) for cell in cells)
    )


def may_be_group(cell: str) -> bool:
    """Whether a comma in a cell may group the digits of an integer, or be its decimal mark: 1,234."""
    return "." not in cell and bool(_GROUPED.fullmatch(cell))


def _parsed(cells: Sequence[str], parse: Callable[[str], float]) -> tuple[Vector, list[int]]:
    values = np.full(len(cells), np.nan)
    wrong = list[int]()
    for k, cell in enumerate(cells):
        text = cell.strip()
        if text.lower() in MISSING:
            continue
        try:
            values[k] = parse(text)
        except ValueError:
            wrong.append(k)
    return values, wrong


def _point(text: str) -> str:
    """Return a number with a decimal comma as one with a point; text with a point and no comma is none."""
    if "," not in text:
        return text if "." not in text else "no number"
    whole, _, rest = text.partition(",")
    if re.fullmatch(r"[-+]?\d{1,3}(\.\d{3})+", whole):
        whole = whole.replace(".", "")
    return f"{whole}.{rest}"


def is_moment(cell: str) -> bool:
    """Whether a cell holds a date with a time, or a time of the day."""
    text = cell.strip()
    return bool(_CLOCK.fullmatch(text) or _ISO.fullmatch(text) or _DAY_FIRST.fullmatch(text))


def moments_of(cells: Sequence[str]) -> tuple[Vector, list[int]]:
    """Return dates as seconds since 1970 (UTC where no zone is given) and times of the day as seconds."""
    values, wrong = _parsed(cells, _moment)
    if all(_CLOCK.fullmatch(cell.strip()) for cell in cells):  # over midnight the clock begins anew
        values = np.unwrap(values, period=DAY)
    return values, wrong


def _moment(text: str) -> float:
    if match := _CLOCK.fullmatch(text):
        return 3600.0 * int(match[1]) + 60.0 * int(match[2]) + float(match[3].replace(",", "."))
    if match := _DAY_FIRST.fullmatch(text):
        text = f"{match[3]}-{int(match[2]):02d}-{int(match[1]):02d}{match[4] or ' 00:00:00'}"
    text, fraction = _without_fraction(text.replace("/", "-").replace(",", "."))
    moment = datetime.fromisoformat(text)
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return moment.timestamp() + fraction


def _without_fraction(text: str) -> tuple[str, float]:
    """Split the fraction of a second off: Python takes 3 or 6 digits, loggers write any number."""
    match = re.search(r"(?<=:\d{2})\.\d+", text)
    if match is None:
        return text, 0.0
    return text[: match.start()] + text[match.end() :], float(match[0])


_NUMBER = re.compile(r"[-+]?(\d[\d.]*(,\d*)?|[.,]\d+|\d+(,\d{3})*\.\d*)([eE][-+]?\d+)?")


class RowLimits(NamedTuple):
    """How much of a table is read before its form is known; chosen."""

    sample: int = 400
    """Rows from which the form of a table is recognised: a longer preamble hides it."""


ROWS = RowLimits()


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
    """Whether a row holds numbers, no fewer than labels, and is no header."""
    filled = [cell for cell in cells if cell.lower() not in MISSING]
    numbers = sum(map(is_number, filled))
    return len(cells) > 1 and numbers > 0 and 2 * numbers >= len(filled)


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

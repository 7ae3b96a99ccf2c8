"""The column of times of a table: which it is, and in which unit where its name states none."""

from __future__ import annotations

import re

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.io.formats.columns import TIME
from tssgeom.io.formats.laboratory.channels import PLAUSIBLE, Column, Resolved, option_of, take, values_of
from tssgeom.io.formats.laboratory.mapping import IGNORE
from tssgeom.io.formats.laboratory.names import split_unit
from tssgeom.io.formats.laboratory.raw import DAY, MISSING, RawTable
from tssgeom.io.formats.laboratory.units import UNITS, Unit

_EPOCHS = {"s": 3e8, "ms": 3e11, "us": 3e14, "ns": 3e17}
"""Least number of each unit since 1970 that is a date; derived: 3e8 s is 1979, 3e11 s the far future."""
_DAYS = ((25_569.0, 73_051.0), (719_529.0, 767_011.0))
"""Days from 1970 to 2100 as spreadsheets and as MATLAB count them [d]; derived from either calendar."""


def take_time(table: RawTable, columns: list[Column], result: Resolved) -> None:
    """Take the best of the columns that hold times."""
    words = [column for column in columns if values_of(table, column.at) is None]
    columns = [column for column in columns if column not in words]
    if TIME in result.values:
        return
    if not columns:
        result.warnings += [_of_words(table, column) for column in words]
        return
    best = min(columns, key=lambda each: (_is_date(table, each), each.meaning.unit is None, each.at))
    values = values_of(table, best.at)
    assert values is not None
    others = [f"{each.name} is not read beside {best.name}" for each in columns if each is not best]
    unit, note = best.meaning.unit, ""
    if unit is None:
        unit, note = _unit_of_times(values)
    if unit is None:
        days = _may_be_days(values)
        meant = "time_s:86400s" if days else "time_s:ms"
        counted = " if it counts days, as spreadsheets do," if days else ""
        result.unclear.append(f"{best.name!r} has no unit: give {option_of(best.name, meant)}{counted} or :s")
        result.suggested[best.name] = meant
        return
    take(table, best._replace(meaning=best.meaning._replace(unit=unit)), result, note=note)
    result.notes += others
    result.unclear += [_of_two_clocks(each, best) for each in columns if _differs(table, each, best)]


def _of_words(table: RawTable, column: Column) -> str:
    cells = map(str, table.columns[column.at])
    first = next((cell for cell in cells if cell.strip().lower() not in MISSING), "")
    return (
        f"column {column.name!r} is not read: {first[:40]!r} is no time that is known: "
        "write 2024-03-01T09:30:00.050, 09:30:00.050 or seconds"
    )


def _differs(table: RawTable, other: Column, best: Column) -> bool:
    """Whether a clock has the name of another one but for its number, and not its times to half a step."""
    if other is best or _unnumbered(other) != _unnumbered(best):
        return False
    units = [each.meaning.unit for each in (other, best)]
    there, here = (
        values_of(table, each.at) * (unit.factor if unit else 1.0)  # type: ignore[operator]
        for each, unit in zip((other, best), units, strict=True)
    )
    steps = np.abs(np.diff(here[np.isfinite(here)]))
    slight = 0.5 * float(np.median(steps)) if len(steps) else 0.0
    return not np.allclose(there, here, rtol=0.0, atol=slight, equal_nan=True)


def _unnumbered(column: Column) -> str:
    return re.sub(r"\d+", "", split_unit(column.name)[0])


def _of_two_clocks(other: Column, best: Column) -> str:
    return (
        f"{other.name!r} has other times than {best.name!r}, whose rows it shares: write the channels at one "
        f"time in a row, or give {option_of(other.name, IGNORE)} where all are at {best.name!r}"
    )


def _is_date(table: RawTable, column: Column) -> bool:
    """Whether a column holds days alone, beside which another one has the time of the day."""
    values = values_of(table, column.at)
    return values is not None and bool(np.nanmin(values) >= _EPOCHS["s"] and not (values % DAY).any())


def _unit_of_times(values: Vector) -> tuple[Unit | None, str]:
    """Return the unit of times without one by their size, or by the step between them."""
    known = values[np.isfinite(values)]
    if not len(known):
        return None, ""
    least = float(np.min(known))
    for symbol in reversed(_EPOCHS):
        if least >= _EPOCHS[symbol]:
            return UNITS[symbol], " (since 1970)"
    if _usual_step(known) > PLAUSIBLE.interval or _may_be_days(known):
        return None, ""
    return UNITS["s"], " (no unit: taken as s)"


def _may_be_days(values: Vector) -> bool:
    """Whether times are days of a calendar: as seconds they are more than 17 000 samples a second."""
    known = values[np.isfinite(values)]
    step = _usual_step(known)
    dated = step > 0.0 and any(least <= known.min() and known.max() < most for least, most in _DAYS)
    return dated and DAY * step <= PLAUSIBLE.interval


def _usual_step(known: Vector) -> float:
    """Return the median of what times go on by where they go on; 0 where they do not."""
    steps = np.abs(np.diff(known))
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else 0.0

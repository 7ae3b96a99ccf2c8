"""The measured columns of a table: which channel each is, in which unit, and what is not certain."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.channel_names import quantity_of
from tssgeom.errors import ShapeError
from tssgeom.io.formats.columns import AXES, BENDS, CHANNELS, MEASURED, MOST_TENDONS, TIME
from tssgeom.io.formats.laboratory.mapping import IGNORE
from tssgeom.io.formats.laboratory.names import QUANTITIES, Meaning, canonical, channel_text
from tssgeom.io.formats.laboratory.raw import RawTable
from tssgeom.io.formats.laboratory.units import FORCE, LENGTH, SI, TEMPERATURE, UNITS, Unit
from tssgeom.plausibility.limits import LIMITS


class Plausible(NamedTuple):
    """Chosen: what a tendon on a bench can have. Up to these a column without a unit is taken as SI."""

    tension: float = 200.0
    """Greatest tension [N]; readings in mN or g are beyond it."""
    interval: float = 5.0
    """Greatest time between two samples [s]; ms are beyond it."""
    stroke: float = 0.2
    """Displacement above which mm are suggested [m]."""


PLAUSIBLE = Plausible()


@dataclass(slots=True)
class Resolved:
    """The columns of a table by the names of the readers."""

    values: dict[str, Vector] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    """How each column was read."""
    warnings: list[str] = field(default_factory=list)
    """Columns that resemble channels and are not read."""
    unclear: list[str] = field(default_factory=list)
    """What cannot be read without `--map`, a sentence with the option each."""
    suggested: dict[str, str] = field(default_factory=dict)
    """Name and `channel[:unit]` of each column that is no exact name, as `columns.toml` takes them."""
    names: dict[str, str] = field(default_factory=dict)
    """Name in the file of each column that is no exact name, by the name that the readers know."""
    units: dict[str, Unit] = field(default_factory=dict)
    """Unit in the file of each of these that has one."""
    labels: tuple[str, Sequence[str] | Vector] | None = None
    """Column of the markers' names or numbers."""
    frames: tuple[str, Vector] | None = None
    """Column of the numbers of frames."""
    recordings: tuple[str, list[str]] | None = None
    """Column that names the recording of each row, where there are several."""

    @property
    def is_points(self) -> bool:
        """Whether the table holds points or gratings."""
        axes = {name.partition("_")[0] for name in self.values}
        return {*AXES} <= axes or any(name.startswith(BENDS) for name in self.values)

    @property
    def drives(self) -> bool:
        """Whether a channel is that of a drive."""
        return any(
            name.startswith(("tension_in_", "displacement_in_")) or "_target_" in name for name in self.values
        )


class Column(NamedTuple):
    """One column of a table and what it seems to be."""

    at: int
    name: str
    meaning: Meaning


def values_of(table: RawTable, k: int) -> Vector | None:
    """Return a column of numbers; None where most cells are words."""
    column = table.columns[k]
    return column if isinstance(column, np.ndarray) else None


def take(table: RawTable, column: Column, result: Resolved, path: Path | None = None, note: str = "") -> None:
    """Put one column among those that are read."""
    channel, unit, quantity, _ = column.meaning
    values = values_of(table, column.at)
    assert values is not None
    known, factor, offset = _known_name(channel, unit)
    if known in result.values:
        if path is not None:
            raise ShapeError(f"{path}: {column.name!r} is to be {known}, which is there already: keep one")
        result.warnings.append(f"column {column.name!r} is not read: {known} is there already")
        return
    result.values[known] = values if (factor, offset) == (1.0, 0.0) else factor * values + offset
    conversion = Unit("", quantity, factor, offset).conversion
    result.notes.append(f"{column.name} read as {known}{conversion}{note}")
    result.suggested[column.name] = channel_text(channel, unit)
    result.names[known] = column.name
    if unit is not None:
        result.units[known] = unit


def _known_name(channel: str, unit: Unit | None) -> tuple[str, float, float]:
    """Return the name that the readers know, and factor and offset to its unit; points are in mm or m."""
    if channel not in (*AXES, "s"):
        return canonical(channel), unit.factor if unit else 1.0, unit.offset if unit else 0.0
    if unit is None:
        return channel, 1.0, 0.0
    return (f"{channel}_m", 1.0, 0.0) if unit.factor == 1.0 else (f"{channel}_mm", _exact(unit.factor), 0.0)


def _exact(factor: float) -> float:
    """Return how many mm a unit has, without the error of its factor to m."""
    return round(1e3 * factor, 12)


def take_channels(table: RawTable, columns: list[Column], result: Resolved, *, points: bool) -> None:
    """Take tensions, displacements and temperature; what is not certain becomes unclear."""
    if points:  # a position beside coordinates may be anything; what varies along the route is no channel
        columns = [_renamed(each, "") if each.meaning.channel == "displacement" else each for each in columns]
        columns = [column for column in columns if not _varies(table, column, result)]
    held = {quantity_of(name) for name in result.values}
    counts = Counter(column.meaning.channel for column in columns)
    for sort, channel_in, channel_out in (
        ("force", "tension_in", "tension_out"),
        ("displacement", "displacement_in", "displacement_out"),
    ):
        alone = counts[sort] == 1 and not {channel_in, channel_out} & (held | set(counts))
        if alone:
            columns = [
                _renamed(column, channel_in) if column.meaning.channel == sort else column
                for column in columns
            ]
    unread = list[Column]()
    for column in columns:
        channel, unit, quantity, target = column.meaning
        options = _options(column)
        if channel in held and quantity == TEMPERATURE:
            result.warnings.append(
                f"column {column.name!r} is not read: {canonical(channel)} is there already"
            )
        elif channel in held:
            result.unclear.append(
                f"{column.name!r} is {canonical(channel)} too, which is there already: "
                f"give {option_of(column.name, IGNORE)}"
            )
            result.suggested[column.name] = IGNORE
        elif values_of(table, column.at) is None or not channel or (target and not points):
            unread.append(column)
        elif channel in ("force", "displacement") or counts[channel] > 1:
            result.unclear.append(
                f"{column.name!r} may be {' or '.join(options)}: give {_either(column.name, options)}"
            )
            result.suggested[column.name] = _likely(table, column, columns, held)
        elif unit is None:
            _take_unitless(table, column, result)
        else:
            take(table, column, result)
    for column in unread:
        _leave(column, result, (FORCE,) if points else (FORCE, LENGTH))


def _varies(table: RawTable, column: Column, result: Resolved) -> bool:
    """Whether a force that names no end differs within a frame."""
    values = values_of(table, column.at)
    if column.meaning.channel != "force" or values is None:
        return False
    time = result.values.get(TIME, np.zeros(len(values)))
    known = np.isfinite(values) & np.isfinite(time)
    pairs = np.unique(np.column_stack([time, values])[known], axis=0)
    return len(pairs) > len(np.unique(time[known]))


def _renamed(column: Column, channel: str) -> Column:
    return column._replace(meaning=column.meaning._replace(channel=channel))


def _options(column: Column) -> list[str]:
    channel, _, quantity, _ = column.meaning
    pair = {FORCE: ("tension_in", "tension_out"), LENGTH: ("displacement_in", "displacement_out")}.get(
        quantity, ()
    )
    known = ":mm" if quantity == LENGTH and column.meaning.unit is None else ""
    return [canonical(each) + known for each in pair] or [channel]


def _likely(table: RawTable, column: Column, columns: Sequence[Column], held: set[str]) -> str:
    """Return the channel that a column of an open end likely is: friction makes the distal end the lesser."""
    options = _options(column)
    same = [
        each
        for each in columns
        if each.meaning.quantity == column.meaning.quantity and values_of(table, each.at) is not None
    ]
    if len(same) > 2 and (numbered := _numbered(column.name, options)):
        return numbered
    pair = [quantity_of(option.partition(":")[0]) for option in options]
    present = held | {each.meaning.channel for each in columns}
    if len(pair) == 2 and (pair[0] in present) != (pair[1] in present):
        return options[pair[0] in present]
    sizes = [float(np.nanmax(np.abs(values_of(table, each.at)), initial=0.0)) for each in same]  # type: ignore[arg-type]
    return options[0 if sizes.index(max(sizes)) == same.index(column) else -1]


def option_of(name: str, meant: str) -> str:
    """Return the option that states what a column is."""
    return f'--map "{name}={meant}"'


def _either(name: str, options: Sequence[str]) -> str:
    """Offer each option; where the name has the number of a tendon, those of a rig with several too."""
    offered = " or ".join(option_of(name, option) for option in options)
    numbered = _numbered(name, options)
    return f"{offered}; of several tendons {option_of(name, numbered)} or _out_" if numbered else offered


def _numbered(name: str, options: Sequence[str]) -> str:
    """Return the first option for the tendon whose number is in a name; empty where there is none."""
    number = next((digits for digits in re.findall(r"\d+", name) if 1 <= int(digits) <= MOST_TENDONS), None)
    if number is None or len(options) < 2:
        return ""
    stem, mark, rest = options[0].rpartition("_")
    return f"{stem}_{int(number)}{mark}{rest}"


def _take_unitless(table: RawTable, column: Column, result: Resolved) -> None:
    """Take a column without unit where its size makes that certain; a length never does."""
    channel, _, quantity, _ = column.meaning
    values = np.abs(table.columns[column.at])  # type: ignore[arg-type]
    most = float(np.nanmax(values)) if np.isfinite(values).any() else 0.0
    bounds = {FORCE: PLAUSIBLE.tension, TEMPERATURE: LIMITS.hottest_C}
    if quantity in bounds and most <= bounds[quantity]:
        unit = UNITS[SI[quantity]]
        note = f" (no unit: taken as {'°C' if quantity == TEMPERATURE else unit.symbol})"
        take(table, Column(column.at, column.name, column.meaning._replace(unit=unit)), result, note=note)
        return
    guess = {FORCE: "mN", TEMPERATURE: "K"}.get(quantity, "mm" if most > PLAUSIBLE.stroke else "m")
    meant = f"{canonical(channel)}:{guess}"
    other = {"mm": "m", "m": "mm", "mN": "gf"}.get(guess)
    result.unclear.append(
        f"{column.name!r} has no unit: give {option_of(column.name, meant)}"
        + (f" or :{other}" if other else "")
    )
    result.suggested[column.name] = meant


_OF_COUNTS = "motor_angle:0.001rad"

COMPUTED = {
    *("displacement_reached_m", "tension_reached_N", "displacement_out_se_m", "tension_out_se_N"),
    *("displacement_out_se_by_tension_m", "tension_out_se_by_tension_N"),
}
"""Columns of `compensate.parquet` that are results: such a file is the drive of `simulate` as it is."""


def _leave(column: Column, result: Resolved, drives: tuple[str, ...]) -> None:
    """Leave out a column that resembles a channel; one that may be the only drive is unclear."""
    like = [
        name for name in MEASURED | CHANNELS if QUANTITIES.get(quantity_of(name)) == column.meaning.quantity
    ]
    nearest = difflib.get_close_matches(column.name, like, 1, 0.0)[0] if like else TIME
    if column.name in COMPUTED:
        return
    if column.meaning.target or column.meaning.quantity not in drives or result.drives:
        result.warnings.append(not_read(column.name, nearest))
        return
    options, counted = _options(column), re.search(r"\bcounts?\b", column.name, re.IGNORECASE)
    result.unclear.append(
        f"{column.name!r} may be a drive, and there is no other: give {_either(column.name, options)}, "
        f"or {option_of(column.name, IGNORE)}"
        + (f"; of counts with what one is, {option_of(column.name, _OF_COUNTS)}" if counted else "")
    )
    result.suggested[column.name] = options[0]


def not_read(name: str, nearest: str) -> str:
    """Return the warning of a column that is not read."""
    hint = f"the nearest name is {nearest}; if it is that, give {option_of(name, nearest)}"
    return f"column {name!r} is not read: {hint}"

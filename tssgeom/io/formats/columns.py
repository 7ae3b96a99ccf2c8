"""Columns of a table of points: which are there, in which unit, and what each one means."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tssgeom.errors import ShapeError
from tssgeom.io.formats.units import agreed_unit

AXES = ("x", "y", "z")
BENDS = ("kappa_x", "kappa_y")
DIRECTIONS = ("tx", "ty", "tz")
TIME, POINT = "time_s", "point"

MEASURED = {
    "tension_in_N": ("tension_in", 1.0),
    "tension_out_N": ("tension_out", 1.0),
    "displacement_in_m": ("displacement_in", 1.0),
    "elongation_m": ("elongation", 1.0),
    "elongation_mm": ("elongation", 1000.0),
    "temperature_C": ("temperature", 1.0),
    "noise_m": ("noise", 1.0),
}
"""Measured columns: the field of `Frame` that each one fills, and how many of its unit make one in SI."""

_OF_RUNS = {"displacement_out_m"}
_LOOK_MEASURED = ("tension", "displacement", "elongation", "temperature", "time")
_EXPECTED = "the first line must be a header such as x_mm,y_mm,z_mm"


@dataclass(frozen=True, slots=True)
class Columns:
    """The columns of one table that are read."""

    unit: str
    axes: tuple[str, ...]
    """Coordinates, or the two curvature components of a fibre."""
    station: str | None
    timed: bool
    numbered: bool
    """True where a column tells the number of each point."""
    measured: tuple[str, ...]
    warnings: tuple[str, ...]
    bend_unit: str | None = None
    """Unit of length in the curvatures of a fibre, "m" or "mm"; None for points."""
    directions: tuple[str, ...] = ()
    """Components of sensed unit tangents, or none."""

    @property
    def names(self) -> tuple[str, ...]:
        """Every column that is read."""
        numbers = ((TIME,) if self.timed else ()) + ((POINT,) if self.numbered else ())
        station = (self.station,) if self.station else ()
        return numbers + self.axes + station + self.directions + self.measured


def columns_of(path: Path, names: Sequence[str], given_unit: str | None) -> Columns:
    """Recognise the columns of a table.

    Raises
    ------
    ShapeError
        Where a coordinate is missing or there twice, where units are missing or mixed, where two columns
        tell the same measurement, or where a name cannot be read.
    """
    odd = [name for name in names if not name.isprintable()]
    if odd:
        raise ShapeError(f"{path}: column {_shown(odd[:1])} has unseen characters: write plain names")
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ShapeError(f"{path}: column {_shown(twice[:1])} is there twice: keep one")
    fibre = any(name.startswith(BENDS) for name in names)
    axes = () if fibre else tuple(_only(path, names, axis) for axis in AXES)
    stations = [name for name in names if _split(name)[0] == "s"]
    if fibre and not stations:
        raise ShapeError(f"{path}: curvatures without stations: add a column s_mm or s_m, the arc length")
    station = _only(path, names, "s") if stations else None
    unit = _one_unit(path, [*axes, *([station] if station else [])], given_unit)
    bends, bend_unit = _bends(path, names) if fibre else ((), None)
    measured = tuple(name for name in names if name in MEASURED)
    if {"elongation_m", "elongation_mm"} <= set(measured):
        raise ShapeError(f"{path}: columns elongation_m and elongation_mm are both there: keep one")
    return Columns(
        unit,
        axes or bends,
        station,
        TIME in names,
        POINT in names,
        measured,
        _unread(names),
        bend_unit,
        () if fibre else _directions(path, names),
    )


def _directions(path: Path, names: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of sensed directions: all three or none."""
    found = tuple(name for name in DIRECTIONS if name in names)
    if found and found != DIRECTIONS:
        missing = next(name for name in DIRECTIONS if name not in names)
        raise ShapeError(
            f"{path}: no column {missing} beside {found[0]}: directions need tx,ty,tz, or none of them"
        )
    return found


def _bends(path: Path, names: Sequence[str]) -> tuple[tuple[str, ...], str]:
    """Return the columns of a fibre's curvature components, and the unit of length in them."""
    stated = {unit: [name for name in names if name in _bend_names(unit)] for unit in ("m", "mm")}
    for unit, other in (("m", "mm"), ("mm", "m")):
        if len(stated[unit]) == len(BENDS) and not stated[other]:
            return _bend_names(unit), unit
    there = ", ".join(name for name in names if name.startswith(BENDS))
    raise ShapeError(
        f"{path}: curvature columns {there}: name them kappa_x_per_m,kappa_y_per_m "
        "or kappa_x_per_mm,kappa_y_per_mm, both in one unit"
    )


def _bend_names(unit: str) -> tuple[str, ...]:
    return tuple(f"{name}_per_{unit}" for name in BENDS)


def _split(name: str) -> tuple[str, str | None]:
    """Split a column name into quantity and unit: "x_mm" into "x" and "mm"."""
    quantity, bar, unit = name.partition("_")
    return quantity, unit if bar else None


def _only(path: Path, names: Sequence[str], quantity: str) -> str:
    found = [name for name in names if _split(name)[0] == quantity and _split(name)[1] in {None, "m", "mm"}]
    if len(found) > 1:
        raise ShapeError(f"{path}: mixed units: columns {' and '.join(found)} are both there: keep one")
    if not found:
        raise ShapeError(f"{path}: no column {quantity}_mm or {quantity}_m in {_shown(names)}: {_EXPECTED}")
    return found[0]


def _one_unit(path: Path, names: Sequence[str], given: str | None) -> str:
    found = {_split(name)[1] for name in names}
    stated = found - {None}
    if len(stated) > 1:
        raise ShapeError(
            f"{path}: mixed units in columns {', '.join(names)}: write all of them in mm or all in m"
        )
    if stated and None in found and given is None:
        bare = next(name for name in names if _split(name)[1] is None)
        raise ShapeError(
            f"{path}: column {bare!r} has no unit: name it {bare}_{stated.pop()}, or give --unit mm|m"
        )
    return agreed_unit(
        path,
        next(iter(stated), None),
        given,
        f"name the columns {_with_unit(names, 'mm')} or {_with_unit(names, 'm')}",
    )


def _with_unit(names: Sequence[str], unit: str) -> str:
    return ",".join(f"{_split(name)[0]}_{unit}" for name in names)


def _unread(names: Sequence[str]) -> tuple[str, ...]:
    """Warn of columns that look like a measurement and are none that is known."""
    known = {TIME, *MEASURED, *_OF_RUNS}
    return tuple(
        f"column {name!r} is not read: known are {', '.join(sorted(known))}"
        for name in names
        if name not in known and name.startswith(_LOOK_MEASURED)
    )


def _shown(names: Sequence[str]) -> str:
    line = ",".join(names)
    return repr(line if len(line) <= 60 else line[:57] + "...")

"""Columns of a table of points: which are there, in which unit, and what each one means."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from tssgeom.channel_names import marked, unit_of
from tssgeom.errors import ShapeError
from tssgeom.io.formats.recording import agreed_unit
from tssgeom.mechanism import all_channels
from tssgeom.stream import Frame

AXES = ("x", "y", "z")
BENDS = ("kappa_x", "kappa_y")
DIRECTIONS = ("tx", "ty", "tz")
TIME, POINT = "time_s", "point"

CHANNELS = {
    "tension_in_N": ("tension_in", 1.0),
    "tension_out_N": ("tension_out", 1.0),
    "elongation_m": ("elongation", 1.0),
    "elongation_mm": ("elongation", 1000.0),
    "displacement_in_m": ("displacement_in", 1.0),
    "displacement_out_m": ("displacement_out", 1.0),
    "temperature_C": ("temperature", 1.0),
}
"""Columns of measurements: the field that each one fills, and how many of its unit make one in SI."""
MOST_TENDONS = 12
"""Chosen: a rig of four segments with three tendons each. Greatest number in the name of a channel."""


def _machine_channels(*, with_targets: bool) -> dict[str, tuple[str, float]]:
    small = {"rad": ("deg", 180.0 / math.pi), "Nm": ("mNm", 1e3), "A": ("mA", 1e3), "m": ("mm", 1e3)}
    channels = dict[str, tuple[str, float]]()
    for name in all_channels(MOST_TENDONS):
        may_be_target = with_targets and name.startswith(("joint_angle", "bending", "tension_out"))
        for each in (name, marked(name, "target")) if may_be_target else (name,):
            channels[each] = (each, 1.0)
            if (unit := unit_of(name)) in small:
                smaller, per_si = small[unit]
                channels[each.removesuffix(unit) + smaller] = (each, per_si)
    return channels


MACHINE_CHANNELS = _machine_channels(with_targets=False)
"""Columns of a rig with several tendons, a joint or a segment: the name in SI, and how many of the unit make
one in SI."""
_OF_FRAMES_ALONE = {
    "noise_m": ("noise", 1.0),
    "curvature_noise_per_m": ("curvature_noise", 1.0),
    "curvature_noise_per_mm": ("curvature_noise", 1e-3),
    "displacement_target_m": ("displacement_target", 1.0),
    "tension_out_target_N": ("tension_out_target", 1.0),
}
_OF_FRAMES = {field.name for field in fields(Frame)}
MEASURED = {
    name: (field, per_si)
    for name, (field, per_si) in {**CHANNELS, **_OF_FRAMES_ALONE}.items()
    if field in _OF_FRAMES
}
"""Those that a frame can hold."""

OF_MACHINE = _machine_channels(with_targets=True)
"""Columns of a machine that a frame can hold, as `MACHINE_CHANNELS`."""

_MEASUREMENTS = ("tension", "displacement", "elongation", "temperature", "time", "noise", "curvature_noise")
_EXPECTED = "the first line must be a header such as x_mm,y_mm,z_mm"
_GRATINGS = "curvatures of a fibre need a row for each grating, under s_mm,kappa_x_per_m,kappa_y_per_m"


@dataclass(frozen=True, slots=True)
class Columns:
    """The columns of one table that are read."""

    unit: str
    axes: tuple[str, ...]
    """Coordinates, or the two curvature components of a fibre."""
    station: str | None
    timed: bool
    numbered: bool
    """True where a column holds the number of each point."""
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


def columns_of(
    path: Path, names: Sequence[str], given_unit: str | None, others: Sequence[str] = ()
) -> Columns:
    """Recognise the columns of a table; `others` are names in its file that no station has.

    Raises ShapeError where a coordinate is missing or there twice, where units are missing or mixed, where
    two columns hold the same measurement, or where a name cannot be read.
    """
    unprintable = [name for name in names if not name.isprintable()]
    if unprintable:
        raise ShapeError(
            f"{path}: column {_quoted(unprintable[:1])} has unprintable characters: write plain names"
        )
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ShapeError(f"{path}: column {_quoted(twice[:1])} is there twice: keep one")
    fibre = any(name.startswith(BENDS) for name in names)
    axes = () if fibre else tuple(_only(path, names, axis) for axis in AXES)
    stations = [name for name in names if _split(name)[0] == "s"]
    if fibre and not stations:
        raise ShapeError(f"{path}: curvatures without stations: {_with_stations([*names, *others])}")
    station = _only(path, names, "s") if stations else None
    unit = _one_unit(path, [*axes, *([station] if station else [])], given_unit)
    bends, bend_unit = _bends(path, names) if fibre else ((), None)
    unused = "noise" if fibre else "curvature_noise"
    read = {name for name, (field, _) in MEASURED.items() if field != unused}
    measured = tuple(name for name in names if name in read or name in OF_MACHINE)
    for pair in (("elongation_m", "elongation_mm"), ("curvature_noise_per_m", "curvature_noise_per_mm")):
        if set(pair) <= set(measured):
            raise ShapeError(f"{path}: columns {' and '.join(pair)} are both there: keep one")
    return Columns(
        unit,
        axes or bends,
        station,
        TIME in names,
        POINT in names,
        measured,
        unread(names, {TIME, *read, *CHANNELS}),
        bend_unit,
        () if fibre else _directions(path, names),
    )


def _with_stations(names: Sequence[str]) -> str:
    """Return how the stations of a fibre are stated, with a column that may hold them."""
    known = {TIME, POINT, *MEASURED, *OF_MACHINE}
    others = [name for name in names if name not in known and not name.startswith(BENDS)]
    lengths = [name for name in others if re.search(r"[\[(_ ][cm]?m[\])]?$", name)]
    if not lengths:
        return "add a column s_mm or s_m, the arc length"
    unit = "mm" if re.search("[cm]m", lengths[0]) else "m"
    return f'add a column s_mm or s_m, the arc length, or state which it is: --map "{lengths[0]}=s_{unit}"'


def _directions(path: Path, names: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of sensed directions: all three or none."""
    present = tuple(name for name in DIRECTIONS if name in names)
    if present and present != DIRECTIONS:
        missing = next(name for name in DIRECTIONS if name not in names)
        raise ShapeError(
            f"{path}: no column {missing} beside {present[0]}: directions need tx,ty,tz, or none of them"
        )
    return present


def _bends(path: Path, names: Sequence[str]) -> tuple[tuple[str, ...], str]:
    """Return the columns of a fibre's curvature components, and the unit of length in them."""
    stated = {unit: [name for name in names if name in _bend_names(unit)] for unit in ("m", "mm")}
    for unit, other in (("m", "mm"), ("mm", "m")):
        if len(stated[unit]) == len(BENDS) and not stated[other]:
            return _bend_names(unit), unit
    present = ", ".join(name for name in names if name.startswith(BENDS))
    raise ShapeError(
        f"{path}: curvature columns {present}: name them kappa_x_per_m,kappa_y_per_m "
        "or kappa_x_per_mm,kappa_y_per_mm, both in one unit"
    )


def _bend_names(unit: str) -> tuple[str, ...]:
    return tuple(f"{name}_per_{unit}" for name in BENDS)


def _split(name: str) -> tuple[str, str | None]:
    """Split a column name into quantity and unit: "x_mm" into "x" and "mm"."""
    quantity, bar, unit = name.partition("_")
    return quantity, unit if bar else None


def _only(path: Path, names: Sequence[str], quantity: str) -> str:
    fitting = [name for name in names if _split(name)[0] == quantity and _split(name)[1] in {None, "m", "mm"}]
    if len(fitting) > 1:
        raise ShapeError(f"{path}: mixed units: columns {' and '.join(fitting)} are both there: keep one")
    if not fitting:
        bends = sum("curv" in name.lower() or "kappa" in name.lower() for name in names) > 1
        expected = _GRATINGS if bends else _EXPECTED
        raise ShapeError(f"{path}: no column {quantity}_mm or {quantity}_m in {_quoted(names)}: {expected}")
    return fitting[0]


def _one_unit(path: Path, names: Sequence[str], given: str | None) -> str:
    units = {_split(name)[1] for name in names}
    stated = units - {None}
    if len(stated) > 1:
        raise ShapeError(
            f"{path}: mixed units in columns {', '.join(names)}: write all of them in mm or all in m"
        )
    if stated and None in units and given is None:
        unitless = next(name for name in names if _split(name)[1] is None)
        unit = stated.pop()
        raise ShapeError(
            f"{path}: column {unitless!r} has no unit: name it {unitless}_{unit}, or give --unit {unit}"
        )
    return agreed_unit(
        path,
        next(iter(stated), None),
        given,
        f"name the columns {_with_unit(names, 'mm')} or {_with_unit(names, 'm')}",
    )


def _with_unit(names: Sequence[str], unit: str) -> str:
    return ",".join(f"{_split(name)[0]}_{unit}" for name in names)


def of_machine(measured: Mapping[str, float]) -> dict[str, float] | None:
    """Return what columns say of a machine, by channel in SI; None where they say nothing.

    Raises ShapeError where a channel is there in two units.
    """
    given = dict[str, float]()
    for name in measured.keys() & OF_MACHINE.keys():
        channel, per_si = OF_MACHINE[name]
        if channel in given:
            raise ShapeError(f"{channel} is there in two units: keep one")
        given[channel] = measured[name] / per_si
    return dict(sorted(given.items())) or None


def unread(names: Sequence[str], known: Collection[str]) -> tuple[str, ...]:
    """Warn of columns whose name begins like that of a measurement and is unknown."""
    return tuple(
        f"column {name!r} is not read: known are {', '.join(sorted(known))}"
        for name in names
        if name not in known and name not in OF_MACHINE and name.startswith(_MEASUREMENTS)
    )


def _quoted(names: Sequence[str]) -> str:
    line = ",".join(names)
    return repr(line if len(line) <= 60 else line[:57] + "...")

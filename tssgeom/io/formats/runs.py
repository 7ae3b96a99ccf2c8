"""Measured runs: drive and response of a tendon against time, from CSV or Parquet."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tssgeom.arrays import Vector, read_only
from tssgeom.channel_names import quantity_of
from tssgeom.errors import SettingsError, SourceError, TssgeomError, first_line, listed
from tssgeom.io.formats.columns import AXES, BENDS, CHANNELS, MACHINE_CHANNELS, MEASURED, TIME
from tssgeom.io.formats.laboratory.files import ENDINGS
from tssgeom.io.formats.laboratory.mapping import NO_MAP, ColumnMap
from tssgeom.io.formats.laboratory.table import laboratory_table
from tssgeom.io.formats.paths import bytes_of, ending, require_lines, split, stem
from tssgeom.io.formats.point_tables import is_plain
from tssgeom.io.formats.tables import (
    as_numbers,
    parquet_columns,
    parquet_file,
    parquet_names,
    plain_names,
    slow_columns,
)
from tssgeom.result import Result

IN_SI = {field: name for name, (field, per_si) in CHANNELS.items() if per_si == 1.0}
"""The column in SI of each field of `MeasuredRun`."""
_CHANNELS = CHANNELS | MACHINE_CHANNELS
_QUANTITIES = tuple({quantity_of(name) for name in _CHANNELS})
_OF_MACHINE = sorted({in_si for in_si, _ in MACHINE_CHANNELS.values()})
_ONCE = ", ".join(name for name in _OF_MACHINE if not any(map(str.isdigit, name)))
_OF_TENDON = ", ".join(name for name in _OF_MACHINE if "_1_" in name)
_KNOWN = f"{', '.join((TIME, *CHANNELS))}; of a machine {_ONCE}, and of each tendon {_OF_TENDON}"


@dataclass(frozen=True, slots=True, repr=False)
class MeasuredRun(Result):
    """Channels against time; NaN is a missing sample, None a missing channel."""

    name: str
    """Stem of the file."""
    path: Path
    """The file."""
    time: Vector
    """[n] Times of the samples, increasing [s]."""
    tension_in: Vector | None = None
    """[n] Total tension at the proximal end [N]."""
    tension_out: Vector | None = None
    """[n] Total tension at the distal end [N]."""
    elongation: Vector | None = None
    """[n] Elongation of the tendon in the sheath [m]."""
    displacement_in: Vector | None = None
    """[n] Position of the drive [m]."""
    displacement_out: Vector | None = None
    """[n] Position of the load, towards the tendon positive [m]."""
    temperature: Vector | None = None
    """[n] Temperature [°C]."""
    of_machine: Mapping[str, Vector] = field(default_factory=dict)
    """Channels of a rig with several tendons, a joint or a segment, by their names in SI."""
    warnings: tuple[str, ...] = ()
    """Columns that are not read though they resemble channels, a sentence each."""
    notes: tuple[str, ...] = ()
    """How a file of a laboratory was read, a phrase each."""

    @property
    def columns(self) -> dict[str, Vector]:
        """Time and the channels that are there, by their names in SI."""
        channels = {name: getattr(self, field) for field, name in IN_SI.items()}
        alone = {name: values for name, values in channels.items() if values is not None}
        return {TIME: self.time, **alone, **self.of_machine}

    def channel(self, names: Sequence[str]) -> tuple[str, Vector]:
        """Return name and values of the first of these columns that the run has; every sample is finite.

        Raises
        ------
        SettingsError
            Where the run has none of them, or where a sample of the first one is missing.
        """
        for name in names:
            values = getattr(self, CHANNELS[name][0])
            if values is None:
                continue
            missing = np.flatnonzero(~np.isfinite(values))
            if len(missing):
                raise SettingsError(
                    f"{self.path}: {name} has no value at {TIME} = {self.time[missing[0]]:g}: fill every row"
                )
            return name, values
        raise SettingsError(f"{self.path}: no column {' or '.join(names)}: add one")


def read_run(path: str | Path, columns: ColumnMap = NO_MAP) -> MeasuredRun:
    """Read a measured run.

    Parameters
    ----------
    path
        A table, or one recording of a table as `FILE#PART`.
    columns
        The user's statements on its columns.

    Returns
    -------
    MeasuredRun
        Its channels [n] in SI, NaN where a sample is missing.

    Raises
    ------
    SourceError
        Where the file cannot be read, or has another ending than those of tables.
    ShapeError
        Where the form of the table cannot be recognised, or a column is not clear.
    SettingsError
        Where a column is missing or there twice, a cell is no number, or time does not increase.

    Examples
    --------
    >>> from tssgeom import read_run
    >>> run = read_run("sample_shapes/campaign_clean/chain.csv")
    >>> len(run.time), float(run.tension_in.max()) > 10.0  # [N]
    (240, True)
    """
    path = Path(path)
    kind = ending(path)
    if kind not in ENDINGS:
        raise SourceError(f"{path}: a run is a table: use {', '.join(ENDINGS)}")
    read = _plain(path, kind, columns) or _laboratory(path, columns)
    if TIME not in read.values:
        others = "".join(f"; {warning}" for warning in read.warnings)
        others += f"; columns are {', '.join(read.unread)}" if read.unread and not others else ""
        raise SettingsError(f"{path}: no column {TIME} in the header: known are {_KNOWN}{others}")
    values, doubled = _without_doubled(read.values)
    targets = [name for name in (*read.values, *read.unread) if name in MEASURED and name not in _CHANNELS]
    unused = tuple(f"column {name!r} is not read: a run has no such channel" for name in targets)
    channels, time = _channels(path, values), _times(path, values[TIME])
    warnings = (*read.warnings, *unused)
    notes = (*read.notes, *doubled, *_unknown(read.unread, warnings))
    return MeasuredRun(stem(path), path, time, **channels, warnings=warnings, notes=notes)


def _unknown(unread: Sequence[str], warnings: Sequence[str]) -> Iterator[str]:
    """Say which columns are none that a reader knows, but for those that warnings name."""
    unknown = [repr(name) for name in unread if not any(repr(name) in each for each in warnings)]
    if unknown:
        yield f"not read: {listed(unknown)}; --map states what a column is"


def run_of_columns(columns: Mapping[str, Any]) -> MeasuredRun:
    """Take a run from columns by their names, as `read_run` takes it from a file.

    Parameters
    ----------
    columns
        `time_s` and channels, [n] each; columns of other names are left out.

    Raises
    ------
    SettingsError
        Where a column is missing, is no list of numbers or of another length, or time does not increase.
    """
    name = "run"
    path = Path(name)
    if TIME not in columns:
        raise SettingsError(f"{name}: no column {TIME}: known are {_KNOWN}")
    try:
        known = {
            each: np.array(values, dtype=np.float64)
            for each, values in columns.items()
            if each == TIME or each in _CHANNELS
        }
    except (TypeError, ValueError) as error:
        raise SettingsError(f"{name}: a column holds no numbers ({first_line(error)}): mend it") from error
    time = known[TIME]
    for each, values in known.items():
        if values.shape != time.shape or values.ndim != 1:
            raise SettingsError(
                f"{name}: {each} has size {values.shape}, {TIME} {time.shape}: make them equal"
            )
    return MeasuredRun(name, path, _times(path, time), **_channels(path, known))


def holds_run(path: Path, columns: ColumnMap = NO_MAP) -> bool:
    """Whether a table has measured columns and no points, and so is a run."""
    kind = ending(path)
    if kind not in ENDINGS:
        return False
    try:
        names = _head_names(path, kind, columns)
        if names is None:
            read = laboratory_table(path, columns)
            return not read.is_points and any(name in _CHANNELS for name in read.values)
    except TssgeomError:
        return False  # the reader of the file reports the reason
    points = any(name.partition("_")[0] in AXES or name.startswith(BENDS) for name in names)
    return not points and any(name.startswith(_QUANTITIES) for name in names)


class _Read(NamedTuple):
    values: Mapping[str, Vector]
    """The columns that are read."""
    unread: Sequence[str]
    warnings: tuple[str, ...]
    notes: tuple[str, ...]


def _head_names(path: Path, kind: str, columns: ColumnMap) -> list[str] | None:
    """Return the names of the columns where the readers know them as they stand."""
    if kind not in _READERS or split(path)[1] is not None:
        return None
    names = parquet_names(path) if kind == ".parquet" else plain_names(bytes_of(path))
    return names if names is not None and is_plain(names, None, columns.of(path)) else None


def _plain(path: Path, kind: str, columns: ColumnMap) -> _Read | None:
    """Read a table of known names; None for another one, or where it can only be read as another one."""
    names = _head_names(path, kind, columns)
    if names is None:
        return None
    columns.use(names)
    try:
        values = _READERS[kind](path, names)
    except SettingsError:
        try:  # a row of units, comments and the like are no fault to a caller that expects them
            return _laboratory(path, columns)
        except TssgeomError:
            pass
        raise
    return _Read(values, [name for name in names if name not in values], (), ())


def _laboratory(path: Path, columns: ColumnMap) -> _Read:
    read = laboratory_table(path, columns)
    if read.faults:
        raise SettingsError(f"{path}: {next(iter(read.faults.values()))}")
    return _Read(read.values, read.unread, read.warnings, read.notes)


def _without_doubled(values: Mapping[str, Vector]) -> tuple[Mapping[str, Vector], tuple[str, ...]]:
    """Leave out rows that repeat the one before them to the last digit."""
    pairs = [(column[1:], column[:-1]) for column in values.values()]
    same = np.all([(one == other) | (np.isnan(one) & np.isnan(other)) for one, other in pairs], axis=0)
    if not same.any():
        return values, ()
    kept = np.concatenate(([True], ~same))
    return {name: column[kept] for name, column in values.items()}, (
        f"{int(same.sum())} doubled rows left out",
    )


def _channels(path: Path, columns: Mapping[str, Vector]) -> dict[str, Any]:
    channels: dict[str, Any] = {}
    for name in CHANNELS:
        if name not in columns:
            continue
        field, per_unit = CHANNELS[name]
        if field in channels:
            raise SettingsError(f"{path}: columns {field}_m and {field}_mm are both there: keep one")
        channels[field] = read_only(columns[name] / per_unit)
    of_machine = dict[str, Vector]()
    for name in columns.keys() & MACHINE_CHANNELS.keys():
        in_si, per_unit = MACHINE_CHANNELS[name]
        if in_si in of_machine:
            raise SettingsError(f"{path}: {in_si} is there in two units: keep one column")
        of_machine[in_si] = read_only(columns[name] / per_unit)
    if of_machine:
        channels["of_machine"] = dict(sorted(of_machine.items()))
    if not channels:
        raise SettingsError(f"{path}: no measured column: known are {_KNOWN}")
    return channels


def _times(path: Path, time: Vector) -> Vector:
    if len(time) == 0:
        raise SettingsError(f"{path}: no row below the header: write one for each sample")
    late = np.flatnonzero(~(np.diff(time) > 0))
    if not np.isfinite(time).all() or len(late):
        row = int(late[0]) + 1 if len(late) else int(np.argmin(np.isfinite(time)))
        back = time[row - 1] - time[row] if len(late) else math.nan
        before = f", {back:g} s before the row above" if back > 0.0 else ", as above" if back == 0.0 else ""
        raise SettingsError(
            f"{path}: row {row + 1}: {TIME} is {time[row]:g}{before}: times must be finite and increase"
        )
    return read_only(time)


def _csv(path: Path, names: Sequence[str]) -> dict[str, Vector]:
    """Return the columns that are read."""
    lines = require_lines(path, bytes_of(path)).decode(errors="replace").splitlines()
    values, _, faults = slow_columns(enumerate(lines[1:], 2), names, _wanted(path, names))
    if faults:
        raise SettingsError(f"{path}: {next(iter(faults.values()))}")
    return values


def _wanted(path: Path, names: Sequence[str]) -> list[str]:
    """Return the columns that are read."""
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise SettingsError(f"{path}: column {twice[0]!r} is there twice: keep one")
    return [name for name in names if name == TIME or name in _CHANNELS]


def _parquet(path: Path, names: Sequence[str]) -> dict[str, Vector]:
    with parquet_file(path) as file:
        numbers = as_numbers(path, parquet_columns(path, file, _wanted(path, names)))
    return {name: np.asarray(numbers[name].to_numpy(), np.float64) for name in numbers.column_names}


_READERS = {".csv": _csv, ".parquet": _parquet}

"""Measured runs: drive and response of a tendon against time, from CSV or Parquet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tssgeom.arrays import Vector, read_only
from tssgeom.errors import SettingsError, SourceError, TssgeomError, first_line
from tssgeom.io.formats.columns import AXES, BENDS, CHANNELS, TIME, unread
from tssgeom.io.formats.paths import bytes_of
from tssgeom.io.formats.tables import cells_of, header_of, parquet_names

IN_SI = {field: name for name, (field, per_si) in CHANNELS.items() if per_si == 1.0}
"""The column in SI of each field of `MeasuredRun`."""
_HEADER = "time_s,tension_in_N,tension_out_N"
_QUANTITIES = tuple({name.rpartition("_")[0] for name in CHANNELS})
_MISSING = {"", "nan", "null", "na"}
_KNOWN = ", ".join((TIME, *CHANNELS))


@dataclass(frozen=True, slots=True)
class MeasuredRun:
    """Channels against time; NaN is a missing sample, None a missing channel."""

    name: str
    path: Path
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
    warnings: tuple[str, ...] = ()
    """Columns that are not read though they resemble channels, a sentence each."""

    @property
    def columns(self) -> dict[str, Vector]:
        """Time and the channels that are there, by their names in SI."""
        channels = {name: getattr(self, field) for field, name in IN_SI.items()}
        return {TIME: self.time} | {name: values for name, values in channels.items() if values is not None}

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


def read_run(path: Path) -> MeasuredRun:
    """Read a measured run.

    Raises
    ------
    SourceError
        Where the file cannot be read, or has another ending than .csv or .parquet.
    ShapeError
        Where a CSV file has no header, or one whose names are not separated by commas.
    SettingsError
        Where a column is missing or there twice, a cell is no number, or time does not increase.
    """
    readers = {".csv": _csv, ".parquet": _parquet}
    if path.suffix.lower() not in readers:
        raise SourceError(f"{path}: a run is a table: use {' or '.join(readers)}")
    names, columns = readers[path.suffix.lower()](path)
    channels, warnings = _channels(path, columns), unread(names, (TIME, *CHANNELS))
    return MeasuredRun(path.stem, path, _times(path, columns[TIME]), **channels, warnings=warnings)


def holds_run(path: Path) -> bool:
    """Whether a table has measured columns and no points, and so is a run."""
    try:
        if path.suffix.lower() == ".parquet":
            names = parquet_names(path)
        else:
            names = header_of(path, bytes_of(path), _HEADER) if path.suffix.lower() == ".csv" else []
    except TssgeomError:
        return False  # the reader of the file reports the reason
    points = any(name.partition("_")[0] in AXES or name.startswith(BENDS) for name in names)
    return not points and any(name.startswith(_QUANTITIES) for name in names)


def _channels(path: Path, columns: Mapping[str, Vector]) -> dict[str, Vector]:
    channels: dict[str, Vector] = {}
    for name in CHANNELS:
        if name not in columns:
            continue
        field, per_unit = CHANNELS[name]
        if field in channels:
            raise SettingsError(f"{path}: columns {field}_m and {field}_mm are both there: keep one")
        channels[field] = read_only(columns[name] / per_unit)
    if not channels:
        raise SettingsError(f"{path}: no measured column: known are {_KNOWN}")
    return channels


def _times(path: Path, time: Vector) -> Vector:
    if len(time) == 0:
        raise SettingsError(f"{path}: no row below the header: write one for each sample")
    late = np.flatnonzero(~(np.diff(time) > 0))
    if not np.isfinite(time).all() or len(late):
        row = int(late[0]) + 1 if len(late) else int(np.argmin(np.isfinite(time)))
        raise SettingsError(
            f"{path}: row {row + 1}: {TIME} is {time[row]:g}: times must be finite and increase"
        )
    return read_only(time)


def _csv(path: Path) -> tuple[Sequence[str], dict[str, Vector]]:
    """Return the names of all columns, and the columns that are read."""
    raw = bytes_of(path)
    names = header_of(path, raw, _HEADER)
    lines = raw.decode(errors="replace").splitlines()
    wanted = _wanted(path, names)
    rows = [
        _numbers(path, line, text, names, wanted) for line, text in enumerate(lines[1:], 2) if text.strip()
    ]
    table = np.array(rows, dtype=np.float64).reshape(-1, len(wanted))
    return names, {names[k]: table[:, i] for i, k in enumerate(wanted)}


def _wanted(path: Path, names: Sequence[str]) -> list[int]:
    """Return the indices of the columns that are read."""
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise SettingsError(f"{path}: column {twice[0]!r} is there twice: keep one")
    if TIME not in names:
        raise SettingsError(f"{path}: no column {TIME} in the header: known are {_KNOWN}")
    for name in names:
        _refuse_other_unit(path, name)
    return [k for k, name in enumerate(names) if name == TIME or name in CHANNELS]


def _refuse_other_unit(path: Path, name: str) -> None:
    """Refuse a column that is a channel but for its unit: ignoring it would hide a measurement."""
    if name in CHANNELS:
        return
    quantity, _, unit = name.rpartition("_")
    meant = [known for known in CHANNELS if known.rpartition("_")[0] in (quantity, name)]
    if meant:
        what = f"the unit {unit!r}" if quantity == meant[0].rpartition("_")[0] else "no unit"
        raise SettingsError(f"{path}: column {name!r} has {what}: give {' or '.join(meant)}")


def _numbers(path: Path, line: int, text: str, names: Sequence[str], wanted: Sequence[int]) -> list[float]:
    cells = cells_of(text)
    if len(cells) != len(names):
        raise SettingsError(
            f"{path}: line {line}: {len(cells)} columns, the header has {len(names)}: mend the line"
        )
    return [_number(path, line, names[k], cells[k].strip()) for k in wanted]


def _number(path: Path, line: int, name: str, cell: str) -> float:
    if cell.lower() in _MISSING:
        return np.nan
    try:
        return float(cell)
    except ValueError as error:
        raise SettingsError(
            f"{path}: line {line}: {name} is {cell!r}: write a number or leave it empty"
        ) from error


def _parquet(path: Path) -> tuple[Sequence[str], dict[str, Vector]]:
    import pyarrow as pa
    import pyarrow.parquet as papq

    try:
        with papq.ParquetFile(path) as file:
            names = file.schema_arrow.names
            table = file.read(columns=[names[k] for k in _wanted(path, names)])
        numbers = table.cast(pa.schema([(name, pa.float64()) for name in table.column_names]))
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise SourceError(
            f"{path}: cannot be read as a table of numbers ({first_line(error)}): write float64"
        ) from error
    columns = {name: np.asarray(numbers[name].to_numpy(), np.float64) for name in numbers.column_names}
    return names, columns

"""NumPy archives: `points[F,N,3]`, `time_s[F]` and `unit`, or one shape `points[N,3]`."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from tssgeom.arrays import Vector, read_only
from tssgeom.errors import ShapeError, SourceError, TssgeomError, first_line
from tssgeom.io.formats.axes import any_header, note_of_axes, order_of_axes, require_frames_first
from tssgeom.io.formats.columns import MEASURED, OF_MACHINE, TIME, of_machine
from tssgeom.io.formats.laboratory.unknown import unknown_names
from tssgeom.io.formats.paths import require_room, stem
from tssgeom.io.formats.recording import PER_METRE, UNTIMED, Frames, Recording, agreed_unit
from tssgeom.stream import Frame

_BLOCK = 1 << 22
"""Bytes of an array that are read at a time; chosen."""
_LARGE = ("points", "s")
_SMALL = (TIME, "unit", *MEASURED, *OF_MACHINE)
_DRIVES = ("tension_in", "displacement_in", "displacement_target", "tension_out_target", "motor_")
_NUMBERS = "fiub"
"""Kinds of arrays that are read as numbers: complex ones and dates would lose what they are."""
_ARRAY = b"\x93NUMPY"
_LENGTHS = 26
"""Bytes of the local header of a member of an archive before the lengths of its name and extra field; APPNOTE
of PKWARE, 4.3.7."""


@dataclass(frozen=True, slots=True)
class ArrayFrames(Frames):
    """The frames of an archive, in SI; of the points a block is in memory at a time."""

    path: Path
    per_metre: float
    points: Stored
    """[F,N,3], in the unit of the file."""
    time: Vector
    """[F] [s]."""
    stations: Stored | Vector | None
    """[F,N], or [N] for all [m]; stored ones in the unit of the file."""
    measured: Mapping[str, Vector]
    """[F] each, by field of `Frame`; NaN where nothing was measured."""
    of_machine: Mapping[str, Vector]
    """[F] each, by name of the array."""

    def read(self) -> Iterator[Frame]:
        """Yield the frames as the archive holds them."""
        stations: Iterator[Vector] | None = None
        if isinstance(self.stations, Stored):
            stations = (read_only(row / self.per_metre) for row in rows_of(self.path, self.stations))
        fixed = self.stations if isinstance(self.stations, np.ndarray) else None
        for k, points in enumerate(rows_of(self.path, self.points)):
            measured: dict[str, Any] = {
                field: float(values[k]) for field, values in self.measured.items() if not np.isnan(values[k])
            }
            machine = {name: float(values[k]) for name, values in self.of_machine.items()}
            known = of_machine({name: value for name, value in machine.items() if not np.isnan(value)})
            scaled = points / self.per_metre
            scaled[np.isnan(scaled).any(axis=1)] = np.nan
            s = fixed if stations is None else next(stations)
            yield Frame(read_only(scaled), float(self.time[k]), s, **measured, of_machine=known)


@dataclass(frozen=True, slots=True)
class Stored:
    """An array in the archive, which is read when its rows are."""

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype
    columns_first: bool
    """Stored with the first axis running fastest; such an array is read at once."""
    begin: int
    """Length of its header [B]."""
    order: tuple[int, ...] = ()
    """Stored axes in the order of `shape`, where that is another; such an array is read at once, too."""

    @property
    def size(self) -> int:
        """Of its numbers [B]."""
        return math.prod(self.shape) * self.dtype.itemsize


def rows_of(path: Path, array: Stored) -> Iterator[np.ndarray]:
    """Yield an array along its first axis, as float64.

    Raises SourceError where the archive ends early or is corrupt.
    """
    if array.columns_first or array.order:
        require_room(path, 2 * array.size)
        with _archive(path) as archive, any_header():
            whole = np.asarray(archive[array.name], dtype=np.float64)
        yield from whole.transpose(array.order or range(whole.ndim)).reshape(array.shape)
        return
    inner = array.shape[1:]
    width = int(np.prod(inner)) * array.dtype.itemsize
    most = max(1, _BLOCK // max(width, 1))
    with _member(path, array.name) as file:
        file.read(array.begin)
        for first in range(0, array.shape[0], most):
            count = min(most, array.shape[0] - first)
            raw = file.read(count * width)
            if len(raw) < count * width:
                raise EOFError(f"{array.name} ends early")
            yield from np.frombuffer(raw, array.dtype).reshape(count, *inner).astype(np.float64)


def _end_rows(path: Path, array: Stored) -> tuple[np.ndarray, np.ndarray]:
    """Return the first row of an array and the last one, as float64; those between are passed over."""
    if array.columns_first or array.order:
        rows = list(rows_of(path, array))
        return rows[0], rows[-1]
    width = array.size // array.shape[0]
    with _read(path), zipfile.ZipFile(path) as archive:
        member = archive.getinfo(f"{array.name}.npy")
        plain = member.compress_type == zipfile.ZIP_STORED
        with path.open("rb") if plain else archive.open(member) as file:
            begin = array.begin + (_begin_of(file, member) if plain else 0)
            ends = list[np.ndarray]()
            for row in (0, array.shape[0] - 1):
                file.seek(begin + row * width)
                cells = np.frombuffer(file.read(width), array.dtype)
                ends.append(cells.reshape(array.shape[1:]).astype(np.float64))
    return ends[0], ends[1]


def _begin_of(file: IO[bytes], member: zipfile.ZipInfo) -> int:
    """Return where the bytes of a member begin: behind its local header, name and extra field."""
    file.seek(member.header_offset + _LENGTHS)
    name, extra = (int.from_bytes(file.read(2), "little") for _ in range(2))
    return file.tell() + name + extra


def open_npz(path: Path, unit: str | None) -> Recording:
    """Open a NumPy archive; nothing in it is ever unpickled.

    Raises ShapeError where arrays are missing, have the wrong size or hold no numbers, or where the unit is
    missing; SourceError where the file cannot be read.
    """
    stored = {name: array for name in _LARGE if (array := _stored(path, name)) is not None}
    arrays, names = _arrays(path)
    if "points" not in stored:
        stored["points"] = _only_points(path, names)
    stated = _text(arrays["unit"]) if "unit" in arrays else None
    agreed = agreed_unit(path, stated, unit, 'save unit="mm" or unit="m" with the points')
    points = _of_numbers(path, stored["points"])
    count = np.size(arrays[TIME]) if TIME in arrays else None
    order = order_of_axes(path, points.name, points.shape, count)
    if order != (*range(len(order)),):
        points = replace(points, shape=tuple(points.shape[k] for k in order), order=order)
    stored["points"] = points
    timed = len(points.shape) == 3
    if timed and count is None:
        require_frames_first(path, points.name, *_end_rows(path, points))
    frames = _frames(path, arrays, stored, PER_METRE[agreed])
    known = (*MEASURED, *OF_MACHINE)
    driven = any(name in arrays for name in known if name.startswith(_DRIVES))
    unknown = names - {*_SMALL, *_LARGE, points.name, "covariance_mm2"}
    try:
        warnings = unknown_names(unknown, (TIME, *known), driven=driven)
    except ShapeError as error:
        raise ShapeError(f"{path}: {error}") from error
    warnings += (UNTIMED,) if timed and TIME not in arrays else ()
    notes = (f"{points.name} read as points",) if points.name != "points" else ()
    notes += note_of_axes(points.name, order)
    return Recording(stem(path), path, agreed, "npz", timed, len(frames.time), frames, warnings, notes)


def _can_be_points(shape: tuple[int, ...]) -> bool:
    return (len(shape) == 2 and shape[-1] == 3) or (len(shape) == 3 and 3 in shape)


def _only_points(path: Path, names: Collection[str]) -> Stored:
    """Return the one array that can be points, whatever its name.

    Raises ShapeError where there is none, or several.
    """
    every = (_stored(path, name) for name in names if name not in _SMALL)
    able = [array for array in every if array and _can_be_points(array.shape)]
    if len(able) != 1:
        among = [f"{array.name}{[*array.shape]}" for array in able] or sorted(names)
        raise ShapeError(
            f"{path}: no array 'points' among {', '.join(sorted(among))}: save points[F,N,3] or points[N,3], "
            "of F frames and N points"
        )
    return able[0]


def _frames(
    path: Path, arrays: Mapping[str, Any], stored: Mapping[str, Stored], per_metre: float
) -> ArrayFrames:
    points = stored["points"]
    if len(points.shape) == 2:
        points = replace(points, shape=(1, *points.shape))
    count = points.shape[0]
    require_room(path, points.size // count)
    require_room(path, count * np.dtype(np.float64).itemsize)
    time = _per_frame(path, arrays, TIME, count) if TIME in arrays else np.arange(count, dtype=np.float64)
    measured = {
        field: read_only(_per_frame(path, arrays, name, count) / per_unit)
        for name, (field, per_unit) in MEASURED.items()
        if name in arrays
    }
    machine = {name: _per_frame(path, arrays, name, count) for name in OF_MACHINE if name in arrays}
    stations = _stations(path, stored, points, per_metre)
    return ArrayFrames(path, per_metre, points, time, stations, measured, machine)


def _stations(
    path: Path, stored: Mapping[str, Stored], points: Stored, per_metre: float
) -> Stored | Vector | None:
    if "s" not in stored:
        return None
    stations = _of_numbers(path, stored["s"])
    if stations.shape == points.shape[1:2]:
        require_room(path, stations.size)
        return read_only(np.array(list(rows_of(path, stations))) / per_metre)
    if stations.shape != points.shape[:2]:
        raise ShapeError(
            f"{path}: s has the size {stations.shape} for points {points.shape}: save s[N] or s[F,N]"
        )
    return stations


@contextmanager
def _read(path: Path) -> Iterator[None]:
    """Turn a failure to read the archive into an error of the source."""
    try:
        yield
    except (TssgeomError, MemoryError):
        raise
    except Exception as error:  # ZIP, its packers and the headers of NumPy raise what they like
        raise SourceError(
            f"{path}: cannot be read as NPZ ({first_line(error)}): write it with numpy.savez"
        ) from error


@contextmanager
def _archive(path: Path) -> Iterator[np.lib.npyio.NpzFile]:
    with _read(path), path.open("rb") as file:
        if file.read(len(_ARRAY)) == _ARRAY:
            raise ShapeError(
                f"{path}: one array without a name: save points, time_s and unit with numpy.savez"
            )
        if not zipfile.is_zipfile(file):
            raise ValueError("it is no ZIP archive, or not all of it")
        file.seek(0)
        with np.load(file, allow_pickle=False) as archive:
            yield archive


@contextmanager
def _member(path: Path, name: str) -> Iterator[IO[bytes]]:
    with _read(path), zipfile.ZipFile(path) as archive, archive.open(f"{name}.npy") as file:
        yield file


def _stored(path: Path, name: str) -> Stored | None:
    """Read the header of an array; None where the archive has none of this name."""
    with _archive(path) as archive:
        if name not in archive.files:
            return None
    with _read(path), zipfile.ZipFile(path) as opened:
        stored = opened.getinfo(f"{name}.npy").file_size
    with _member(path, name) as file:
        version = np.lib.format.read_magic(file)
        read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        if version not in read:
            raise ValueError(f"{name} has the array format {version}")
        with any_header():
            shape, columns_first, dtype = read[version](file)
        if dtype.hasobject:
            raise ValueError(f"{name} holds Python objects, which are never unpickled")
        array = Stored(name, shape, dtype, columns_first and len(shape) > 1, file.tell())
        if array.size > stored - array.begin:
            raise ValueError(f"{name} ends early, its size is {shape}")
        return array


def _arrays(path: Path) -> tuple[dict[str, Any], set[str]]:
    """Return the arrays that are read at once, and the names of all."""
    with _archive(path) as archive:
        names = set(archive.files)
    small = {name: array for name in _SMALL if (array := _stored(path, name)) is not None}
    for array in small.values():
        require_room(path, array.size)
    with _archive(path) as archive, any_header():
        return {name: archive[name] for name in small}, names


def _of_numbers(path: Path, array: Stored) -> Stored:
    _require_numbers(path, array.name, array.dtype)
    return array


def _require_numbers(path: Path, name: str, kind: np.dtype[Any]) -> None:
    if kind.kind not in _NUMBERS:
        raise ShapeError(f"{path}: {name} holds no numbers but {kind}: save float64")


def _text(unit: Any) -> str:
    value = np.asarray(unit).reshape(-1)[0] if np.size(unit) else ""
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _numbers(path: Path, arrays: Mapping[str, Any], name: str) -> np.ndarray:
    array = np.asarray(arrays[name])
    _require_numbers(path, name, array.dtype)
    return np.array(array, dtype=np.float64)


def _per_frame(path: Path, arrays: Mapping[str, Any], name: str, count: int) -> Vector:
    values = np.atleast_1d(_numbers(path, arrays, name))
    if values.shape != (count,):
        raise ShapeError(
            f"{path}: {name} has the size {values.shape} for {count} frames: save one value a frame"
        )
    return values

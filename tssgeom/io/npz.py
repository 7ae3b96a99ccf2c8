"""NumPy archives: `points[F,N,3]`, `time_s[F]` and `unit`, or one shape `points[N,3]`."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector, read_only
from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.columns import MEASURED, TIME
from tssgeom.io.recording import UNTIMED, Recording, in_order
from tssgeom.io.units import PER_METRE, agreed_unit
from tssgeom.stream import Frame, Rejected


@dataclass(frozen=True, slots=True)
class ArrayFrames:
    """The frames of an archive, in SI."""

    points: Points
    """[F,N,3] [m]."""
    time: Vector
    """[F] [s]."""
    stations: Matrix | None
    """[F,N] [m]."""
    measured: Mapping[str, Vector]
    """[F] each, by field of `Frame`; NaN where nothing was measured."""

    def __iter__(self) -> Iterator[Frame | Rejected]:
        """Yield the frames in order."""
        return in_order(self._frame(k) for k in range(len(self.points)))

    def _frame(self, k: int) -> Frame:
        stations = None if self.stations is None else self.stations[k]
        seen: dict[str, Any] = {
            field: float(values[k]) for field, values in self.measured.items() if not np.isnan(values[k])
        }
        return Frame(self.points[k], float(self.time[k]), stations, **seen)


def open_npz(path: Path, unit: str | None) -> Recording:
    """Open a NumPy archive; nothing in it is ever unpickled.

    Raises
    ------
    ShapeError
        Where arrays are missing, have the wrong size or hold no numbers, or where the unit is missing.
    SourceError
        Where the file cannot be read.
    """
    arrays = _arrays(path)
    if "points" not in arrays:
        raise ShapeError(
            f"{path}: no array 'points' among {sorted(arrays)}: save points[F,N,3] or points[N,3]"
        )
    found = str(_text(arrays["unit"])) if "unit" in arrays else None
    agreed = agreed_unit(path, found, unit, 'save unit="mm" or unit="m" with the points')
    points = _numbers(path, arrays, "points")
    if points.ndim not in (2, 3) or points.shape[-1] != 3 or points.size == 0:
        raise ShapeError(f"{path}: points has the size {points.shape}: save points[F,N,3] or points[N,3]")
    timed = points.ndim == 3
    frames = _frames(path, arrays, points.reshape(-1, *points.shape[-2:]), PER_METRE[agreed])
    warnings = (UNTIMED,) if timed and TIME not in arrays else ()
    return Recording(path.stem, path, agreed, "npz", timed, len(frames.points), frames, warnings)


def _frames(path: Path, arrays: Mapping[str, Any], points: Points, per_metre: float) -> ArrayFrames:
    count = len(points)
    time = _per_frame(path, arrays, TIME, count) if TIME in arrays else np.arange(count, dtype=np.float64)
    measured = {
        field: read_only(_per_frame(path, arrays, name, count) / per_unit)
        for name, (field, per_unit) in MEASURED.items()
        if name in arrays
    }
    scaled = points / per_metre
    scaled[np.isnan(scaled).any(axis=2)] = np.nan
    return ArrayFrames(read_only(scaled), time, _stations(path, arrays, points, per_metre), measured)


def _arrays(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise ShapeError(f"{path}: one bare array: save points, time_s and unit with numpy.savez")
            return {name: archive[name] for name in archive.files}
    except ShapeError:
        raise
    except (OSError, ValueError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        reason = str(error).partition("\n")[0]
        raise SourceError(f"{path}: cannot be read as NPZ ({reason}): write it with numpy.savez") from error


def _text(unit: Any) -> str:
    value = np.asarray(unit).reshape(-1)[0] if np.size(unit) else ""
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _numbers(path: Path, arrays: Mapping[str, Any], name: str) -> np.ndarray:
    try:
        return np.array(arrays[name], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"{path}: {name} holds no numbers but {arrays[name].dtype}: save float64") from error


def _per_frame(path: Path, arrays: Mapping[str, Any], name: str, count: int) -> Vector:
    values = np.atleast_1d(_numbers(path, arrays, name))
    if values.shape != (count,):
        raise ShapeError(
            f"{path}: {name} has the size {values.shape} for {count} frames: save one value a frame"
        )
    return values


def _stations(path: Path, arrays: Mapping[str, Any], points: Points, per_metre: float) -> Matrix | None:
    if "s" not in arrays:
        return None
    stations = _numbers(path, arrays, "s") / per_metre
    if stations.shape not in (points.shape[:2], points.shape[1:2]):
        raise ShapeError(
            f"{path}: s has the size {stations.shape} for points {points.shape}: save s[N] or s[F,N]"
        )
    return read_only(np.broadcast_to(stations, points.shape[:2]))

"""Recordings as files that every command reads: JSON lines or NPZ, in mm, with covariances."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tssgeom.atomic import replacing, write_text
from tssgeom.errors import SourceError, require_replaceable
from tssgeom.io.formats.recording import PER_METRE
from tssgeom.stream import Frame

_MM = PER_METRE["mm"]
_DIGITS = 6  # of a coordinate in mm
_TRIANGLE = np.triu_indices(3)


Writer = Callable[[Path, Sequence[Frame], Sequence[np.ndarray]], None]


def recording_writer(path: Path) -> Writer:
    """Return the function that writes a recording to a file with this ending.

    Raises SourceError where no writer has this ending, or the path is no regular file.
    """
    writer = {".jsonl": _write_lines, ".ndjson": _write_lines, ".npz": _write_arrays}.get(path.suffix.lower())
    if writer is None:
        raise SourceError(f"{path}: a recording is written as .jsonl, .ndjson or .npz: name --out so")
    require_replaceable(path)
    return writer


def _write_lines(path: Path, frames: Sequence[Frame], covariance: Sequence[np.ndarray]) -> None:
    lines = (_line(frame, spread) for frame, spread in zip(frames, covariance, strict=True))
    write_text(path, "".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines))


def _line(frame: Frame, spread: np.ndarray) -> dict[str, Any]:
    line: dict[str, Any] = {"t": round(frame.time, 9), "unit": "mm"}
    if frame.noise is not None:
        line["noise_m"] = float(f"{frame.noise:.6g}")
    line["points"] = _rows(np.round(_MM * frame.points, _DIGITS))
    triangles = _MM**2 * spread[:, _TRIANGLE[0], _TRIANGLE[1]]
    line["covariance_mm2"] = [
        None if row is None else [float(f"{value:.5g}") for value in row] for row in _rows(triangles)
    ]
    return line


def _rows(values: np.ndarray) -> list[list[float] | None]:
    known = np.asarray(np.isfinite(values).all(axis=1))
    return [row if known[k] else None for k, row in enumerate((values + 0.0).tolist())]


def _write_arrays(path: Path, frames: Sequence[Frame], covariance: Sequence[np.ndarray]) -> None:
    with replacing(path) as draft:
        np.savez_compressed(
            draft,
            points=_MM * np.array([frame.points for frame in frames]),
            covariance_mm2=_MM**2 * np.array(covariance),
            time_s=np.array([frame.time for frame in frames]),
            noise_m=np.array([np.nan if frame.noise is None else frame.noise for frame in frames]),
            unit=np.array("mm"),
        )

"""Many frames of uneven length as columns for Rerun, without a Python object for each number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from tssgeom.arrays import Vector
from tssgeom.view.quantities import COUNT, TIMELINE


@dataclass(frozen=True, slots=True)
class Sender:
    """Sends the rows of a run to one recording: a row a frame, or one row without time for a static shape."""

    recording: rr.RecordingStream
    time: NDArray[np.float64] | None
    """Time of each row [s], or its number on the timeline `COUNT`; None for a static shape."""
    timeline: str = TIMELINE
    since: float | None = None
    """Time from which on the constants hold [s]; None: always."""
    repeats: bool = True
    """Whether constants are sent at all; otherwise they were sent before, and still hold."""
    below: str = ""
    """Path below which all entities stand, with a slash at its end."""

    def send(
        self, entity: str, columns: rr.ComponentColumnList, lengths: Sequence[int] | None = None
    ) -> None:
        """Send `columns`, of which each row takes the next of `lengths` (by default one) instances."""
        rows = columns if lengths is None else columns.partition(lengths)
        self.recording.send_columns(self.below + entity, indexes=self._indexes(), columns=rows, strict=True)

    def constant(self, entity: str, archetype: rr.AsComponents) -> None:
        """Send a value that is the same in every frame."""
        if not self.repeats:
            return
        if self.since is not None:
            self.recording.set_time(TIMELINE, duration=self.since)
        self.recording.log(self.below + entity, archetype, static=self.since is None, strict=True)

    def line(
        self, entity: str, name: str, colour: tuple[int, int, int], values: Vector, width: float = 2.0
    ) -> None:
        """Send a line over time; its name, its colour and its width hold for all of it."""
        self.constant(entity, rr.SeriesLines(names=name, colors=[colour], widths=[width]))
        self.send(entity, rr.Scalars.columns(scalars=np.asarray(values, np.float64)))

    def always(self, entity: str, archetype: rr.AsComponents) -> None:
        """Send a value that holds for the whole recording, also before `since`; the last one counts."""
        if self.repeats:
            self.recording.log(self.below + entity, archetype, static=True, strict=True)

    def constant_text(self, entity: str, markdown: str) -> None:
        """Send a text that is the same in every frame."""
        self.constant(entity, rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN))

    def _indexes(self) -> list[rr.TimeColumn]:
        if self.time is None:
            return []
        if self.timeline == COUNT:
            return [rr.TimeColumn(COUNT, sequence=self.time.astype(np.int64))]
        return [rr.TimeColumn(self.timeline, duration=self.time)]


def segments_3d(polylines: Sequence[NDArray[np.float64]]) -> pa.Array:
    """Two-point strips [Σ(n−1), 2, 3] of polylines [n, 3], ready for `LineStrips3D`."""
    return _strips(_pairs(polylines), rr.components.LineStrip3DBatch._ARROW_DATATYPE)


def segments_2d(polylines: Sequence[NDArray[np.float64]]) -> pa.Array:
    """Two-point strips [Σ(n−1), 2, 2] of polylines [n, 2], ready for `LineStrips2D`."""
    return _strips(_pairs(polylines), rr.components.LineStrip2DBatch._ARROW_DATATYPE)


def strips_2d(pairs: NDArray[np.float64]) -> pa.Array:
    """Two-point strips from points [m, 2, 2], ready for `LineStrips2D`."""
    return _strips(pairs, rr.components.LineStrip2DBatch._ARROW_DATATYPE)


def lines_2d(polylines: Sequence[NDArray[np.float64]]) -> pa.Array:
    """One strip of one colour from each polyline [n, 2], ready for `LineStrips2D`."""
    ends = np.cumsum([0, *(len(line) for line in polylines)])
    return _cut(np.concatenate(polylines), ends, rr.components.LineStrip2DBatch._ARROW_DATATYPE)


def _pairs(polylines: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in polylines])


def _strips(pairs: NDArray[np.float64], arrow_type: pa.DataType) -> pa.Array:
    return _cut(pairs, np.arange(0, 2 * len(pairs) + 1, 2), arrow_type)


def _cut(points: NDArray[np.float64], ends: NDArray[np.intp], arrow_type: pa.DataType) -> pa.Array:
    """Cut points into strips that end at the indices `ends`."""
    numbers = pa.array(np.ascontiguousarray(points, dtype=np.float32).ravel())
    inner = pa.FixedSizeListArray.from_arrays(numbers, type=arrow_type.value_type)
    return pa.ListArray.from_arrays(pa.array(ends.astype(np.int32)), inner, type=arrow_type)

"""A recording of a route, read back from its file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from rerun.chunk import Chunk

from tssgeom.arrays import Points, Vector
from tssgeom.errors import SourceError
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.history import last_peak
from tssgeom.view.quantities import TIMELINE
from tssgeom.view.samples import RouteSamples
from tssgeom.view.scene.run import NUMBERS, ON_JOINTS, ON_ROUTE, SEQUENCE
from tssgeom.view.scene.viewer import parts_of, require_recording

COPIED = ("/sensed", "/joints", "/lumen")
"""Entities that a comparison copies, with those below them."""
_READ = ("/route", "/joints", "/summary")
_NS = 1e-9  # s


@dataclass(frozen=True, slots=True)
class Side:
    """One of two recordings."""

    name: str
    time: Vector | None
    """Time of each frame [s]; None for a static shape."""
    frames: Sequence[RouteSamples]
    pieces: Sequence[Arcs]
    numbers: Mapping[str, Vector]
    """`NUMBERS` of each frame [SI]."""
    parts: Sequence[Chunk]
    """Entities that are copied."""
    count: int
    """Number of frames that were sensed; a long recording shows only some of them."""
    since: float = 0.0
    """Time that was subtracted from all times [s]."""

    @property
    def peak(self) -> int:
        """Frame at the last of the highest peaks of T_in, as in the summary and in the picture."""
        return last_peak(self.numbers["tension_in_N"])

    @property
    def fronts(self) -> Sequence[float]:
        """Arc length up to which the tendon slid in each frame [m]."""
        return self.numbers["slip_front_m"].tolist()

    def begun_at_zero(self) -> Side:
        """Return the same with its first frame at 0 s."""
        if self.time is None:
            return self
        since = float(self.time[0])
        return replace(
            self,
            time=self.time - since,
            parts=[chunk for part in self.parts for chunk in _shifted(part, since)],
            since=since,
        )


def read_side(path: Path) -> Side:
    """Read a recording that `analyse`, `batch`, `simulate` or `live` wrote.

    Raises SourceError where the file is no recording, or holds no route with its numbers.
    """
    require_recording(path)
    chunks = [chunk for chunk in parts_of(path) if not chunk.is_empty]
    frames = {entity: _rows(chunks, entity) for entity in _READ}
    route, joints, summary = frames.values()
    if not {*ON_ROUTE, "LineStrips3D:strips"} <= route.keys() or not {*NUMBERS} <= summary.keys():
        raise SourceError(
            f"{path}: no numbers of a route to compare: give recordings of analyse, batch, simulate or live"
        )
    static = route["tension_N"].times is None
    return Side(
        name=path.stem,
        time=None if static else route["tension_N"].times,
        frames=_route_samples(route),
        pieces=[
            Arcs.exact(np.asarray(length, np.float64), np.asarray(angle, np.float64))
            for length, angle in zip(*(joints[name].values for name in ON_JOINTS), strict=True)
        ],
        numbers={name: np.concatenate(summary[name].values).astype(np.float64) for name in NUMBERS},
        parts=[chunk for chunk in chunks if _is_copied(str(chunk.entity_path))],
        count=_count(summary, len(route["tension_N"].values)),
    )


def _count(summary: Mapping[str, _Column], displayed: int) -> int:
    """Return how many frames were sensed; recordings of earlier versions have only those on display."""
    if SEQUENCE not in summary:
        return displayed
    numbers = np.concatenate(summary[SEQUENCE].values)
    return max(displayed, int(numbers.max() - numbers.min()) + 1)


def _is_copied(entity: str) -> bool:
    return any(entity == copied or entity.startswith(f"{copied}/") for copied in COPIED)


@dataclass(frozen=True, slots=True)
class _Column:
    times: Vector | None
    values: Sequence[np.ndarray]


def _rows(chunks: Sequence[Chunk], entity: str) -> dict[str, _Column]:
    """Return every column of an entity in order of time; static rows only where there are no others."""
    columns = dict[str, _Column]()
    for timed in (False, True):
        rows = dict[str, list[tuple[float, np.ndarray]]]()
        for chunk in chunks:
            if str(chunk.entity_path) == entity and (TIMELINE in chunk.timeline_names) == timed:
                _take(rows, chunk.to_record_batch(), timed=timed)
        for name, cells in rows.items():
            cells.sort(key=lambda row: row[0])
            times = np.array([time for time, _ in cells]) if timed else None
            columns[name] = _Column(times, [values for _, values in cells])
    return columns


def _take(rows: dict[str, list[tuple[float, np.ndarray]]], batch: pa.RecordBatch, *, timed: bool) -> None:
    count = batch.num_rows
    times = _NS * batch.column(TIMELINE).cast(pa.int64()).to_numpy() if timed else np.zeros(count)
    for name in batch.schema.names:
        column = batch.column(name)
        if not pa.types.is_list(column.type):
            continue
        for time, row in zip(times.tolist(), column, strict=True):
            if row.is_valid:
                rows.setdefault(name, []).append((time, _flat(row.values)))


def _flat(values: pa.Array) -> np.ndarray:
    """Return the numbers of a row, whatever the depth of its lists."""
    while pa.types.is_list(values.type) or pa.types.is_fixed_size_list(values.type):
        values = values.flatten()
    return values.to_numpy(zero_copy_only=False)


def _route_samples(route: Mapping[str, _Column]) -> list[RouteSamples]:
    columns = (route[name].values for name in (*ON_ROUTE, "LineStrips3D:strips"))
    return [
        RouteSamples(
            s=s.astype(np.float64),
            position=_nodes(strips),
            tension=tension.astype(np.float64),
            phi=phi.astype(np.float64),
            kappa=kappa.astype(np.float64),
            kappa_se=kappa_se.astype(np.float64),
            phi_se=phi_se.astype(np.float64),
        )
        for s, tension, phi, kappa, kappa_se, phi_se, strips in zip(*columns, strict=True)
    ]


def _nodes(strips: np.ndarray) -> Points:
    """Return the positions of the nodes from two-point strips between neighbours [m]."""
    pairs = strips.astype(np.float64).reshape(-1, 2, 3)
    return np.concatenate([pairs[:, 0], pairs[-1:, 1]])


def _shifted(chunk: Chunk, since: float) -> list[Chunk]:
    """Return a chunk whose times are earlier by `since` [s]."""
    if TIMELINE not in chunk.timeline_names:
        return [chunk]
    batch = chunk.to_record_batch()
    index = batch.schema.get_field_index(TIMELINE)
    field = batch.schema.field(index)
    moved = pa.array(batch.column(index).cast(pa.int64()).to_numpy() - round(since / _NS), pa.int64())
    return Chunk.from_record_batch(batch.set_column(index, field, moved.cast(field.type)))

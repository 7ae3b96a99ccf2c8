"""Results as Parquet: every field carries its unit and its meaning as metadata."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as papq

from tssgeom.io.results.shapes import frame_row
from tssgeom.route.pieces import Arcs
from tssgeom.stream import FrameResult, Rejected
from tssgeom.summary import Account

_NUMBER, _COUNT, _TEXT, _FLAG = pa.float64(), pa.int64(), pa.string(), pa.bool_()
_TEXTS = pa.list_(pa.field("element", _TEXT))


def _field(name: str, kind: pa.DataType, unit: str, meaning: str) -> pa.Field:
    return pa.field(name, kind, metadata={"unit": unit, "meaning": meaning})


_GEOMETRY = [
    _field("points", _COUNT, "1", "points that were used"),
    _field("noise_m", _NUMBER, "m", "standard deviation of a coordinate of the points"),
    _field("length_m", _NUMBER, "m", "arc length L"),
    _field("total_angle_rad", _NUMBER, "rad", "accumulated curve angle Φ"),
    _field("total_angle_se_rad", _NUMBER, "rad", "standard error of Φ"),
    _field("method", _TEXT, "", "estimator behind the pieces"),
    _field("pieces", _COUNT, "1", "number of constant-curvature pieces"),
]

_TENDON = [
    _field("tension_in_N", _NUMBER, "N", "tension at the proximal end"),
    _field("tension_out_N", _NUMBER, "N", "tension at the distal end"),
    _field("tension_out_se_N", _NUMBER, "N", "standard error of the distal tension"),
    _field("elongation_m", _NUMBER, "m", "elongation δ above the pretensioned state"),
    _field("elongation_se_m", _NUMBER, "m", "standard error of δ"),
]

_RANGES = [
    _field(f"{quantity}_{end}_{unit}", _NUMBER, unit, f"{word} over the good frames")
    for quantity, unit in (
        ("length", "m"),
        ("total_angle", "rad"),
        ("tension_in", "N"),
        ("tension_out", "N"),
        ("elongation", "m"),
    )
    for end, word in (("min", "smallest"), ("max", "largest"))
]

SUMMARY = pa.schema(
    [
        _field("name", _TEXT, "", "name of the outputs"),
        _field("source", _TEXT, "", "the input, as seen from the working folder"),
        _field("timed", _FLAG, "", "true for a recording, false for one static shape"),
        _field("frames", _COUNT, "1", "frames of the input"),
        _field("rejected", _COUNT, "1", "frames that could not be used"),
        _field("warned", _COUNT, "1", "good frames with a warning"),
        _field("duration_s", _NUMBER, "s", "time from the first to the last good frame"),
        _field("time_s", _NUMBER, "s", "time of the frame that is told"),
        *_GEOMETRY,
        *_TENDON,
        *_RANGES,
        _field("noise_rms_m", _NUMBER, "m", "root mean square of the noise over the good frames"),
        _field("clearance_m", _NUMBER, "m", "least clearance of the tube to the lumen; null without one"),
        _field("clearance_at_m", _NUMBER, "m", "arc length of the least clearance"),
        _field("contact_length_m", _NUMBER, "m", "length of the route on which the tube touches the lumen"),
        _field("outside_length_m", _NUMBER, "m", "length of the route outside the lumen"),
        _field("warnings", _TEXTS, "", "what is worth knowing about the input"),
    ]
)
"""A row for each input; values without min or max are those of the frame that is told: `Account.told`."""

FRAMES = pa.schema(
    [
        _field("name", _TEXT, "", "the input, as in the summary"),
        _field("seq", _COUNT, "1", "count of the frame, from 0"),
        _field("time_s", _NUMBER, "s", "time of the frame"),
        _field("id", _TEXT, "", "the sender's own name of the frame"),
        _field("rejected", _TEXT, "", "why the frame could not be used; empty where it was"),
        *_GEOMETRY,
        *_TENDON,
        _field("direction_index", _COUNT, "1", "+1 pulling, -1 releasing"),
        _field("dead_zone", _FLAG, "", "true where the distal end has not yet answered"),
        _field("dead_zone_width_N", _NUMBER, "N", "change of tension until the distal end answers"),
        _field("measured_tension_out_N", _NUMBER, "N", "distal tension as measured, where it was"),
        _field("measured_displacement_in_m", _NUMBER, "m", "proximal displacement as measured, where it was"),
        _field("measured_elongation_m", _NUMBER, "m", "elongation as measured, where it was"),
        _field("warnings", _TEXTS, "", "what is worth knowing about the frame"),
    ]
)
"""A row for each frame; a rejected frame has its reason and no numbers."""


SEGMENTS = pa.schema(
    [
        _field("name", _TEXT, "", "the input, as in the summary"),
        _field("seq", _COUNT, "1", "count of the frame, from 0"),
        _field("piece", _COUNT, "1", "number of the piece, from 0 at the proximal end"),
        _field("s_start_m", _NUMBER, "m", "arc length at which the piece begins"),
        _field("length_m", _NUMBER, "m", "arc length of the piece"),
        _field("kappa_per_m", _NUMBER, "1/m", "curvature of the piece"),
        _field("angle_rad", _NUMBER, "rad", "accumulated curve angle of the piece"),
    ]
)
"""A row for each constant-curvature piece of each good frame."""

CHUNK = 512
"""Frames that are turned into rows at once."""
_ROW_GROUP = 32  # chunks


class Part(NamedTuple):
    """Frames in a row: their rows, their pieces, and what the summary needs of them."""

    frames: pa.RecordBatch
    segments: pa.RecordBatch
    account: Account


def parts(name: str, items: Iterable[FrameResult | Rejected], stride: int) -> Iterator[Part]:
    """Turn results into rows, chunk by chunk; of an input without frames comes nothing."""
    upcoming = iter(items)
    while (part := part_of(name, islice(upcoming, CHUNK), stride)).account.frames:
        yield part


def part_of(name: str, items: Iterable[FrameResult | Rejected], stride: int) -> Part:
    """Turn the results of some frames into rows."""
    account = Account(stride)
    rows, pieces = list[dict[str, Any]](), list[tuple[int, Arcs]]()
    for item in items:
        row = frame_row(item)
        rows.append(row)
        account.add(item, row)
        if not isinstance(item, Rejected):
            pieces.append((item.seq, item.arcs))
    return Part(_batch(FRAMES, name, rows), _segments(name, pieces), account.close())


def _batch(schema: pa.Schema, name: str, rows: Sequence[Mapping[str, Any]]) -> pa.RecordBatch:
    columns = [[row.get(column.name) for row in rows] for column in list(schema)[1:]]
    given = zip(columns, list(schema)[1:], strict=True)
    arrays = [pa.array(values, type=column.type) for values, column in given]
    return pa.RecordBatch.from_arrays([_named(name, len(rows)), *arrays], schema=schema)


def _segments(name: str, pieces: Sequence[tuple[int, Arcs]]) -> pa.RecordBatch:
    counts = [len(arcs.length) for _, arcs in pieces]
    columns = [
        np.repeat(np.array([seq for seq, _ in pieces], dtype=np.int64), counts),
        _joined([np.arange(count) for count in counts], np.int64),
        *(
            _joined([getattr(arcs, quantity) for _, arcs in pieces], np.float64)
            for quantity in ("s_start", "length", "kappa", "angle")
        ),
    ]
    arrays = [pa.array(column) for column in columns]
    return pa.RecordBatch.from_arrays([_named(name, sum(counts)), *arrays], schema=SEGMENTS)


def _joined(arrays: Sequence[np.ndarray], kind: type) -> np.ndarray:
    return np.concatenate([np.zeros(0, kind), *arrays])


def _named(name: str, count: int) -> pa.Array:
    return pa.repeat(pa.scalar(name, _TEXT), count)


def write_parts(frames: Path, segments: Path, upcoming: Iterable[Part], account: Account) -> None:
    """Write the tables of frames and segments of one input, and add up its account.

    Memory holds a row group at a time. Where the iterable ends in an error, both files are unfinished.
    """
    with papq.ParquetWriter(frames, FRAMES) as rows, papq.ParquetWriter(segments, SEGMENTS) as pieces:
        chunks = iter(upcoming)
        while group := list(islice(chunks, _ROW_GROUP)):
            for part in group:
                account.join(part.account)
            rows.write_table(pa.Table.from_batches([part.frames for part in group]))
            pieces.write_table(pa.Table.from_batches([part.segments for part in group]))


def write_summary(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write `summary.parquet` from rows of `summary_row`."""
    papq.write_table(pa.Table.from_pylist([dict(row) for row in rows], schema=SUMMARY), path)

"""Results as Parquet: every field carries its unit and its meaning as metadata."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as papq

from tssgeom.io.atomic import replacing
from tssgeom.io.results import Analysis, frame_row

_NUMBER, _COUNT, _TEXT, _FLAG = pa.float64(), pa.int64(), pa.string(), pa.bool_()


def _field(name: str, kind: pa.DataType, unit: str, meaning: str) -> pa.Field:
    return pa.field(name, kind, metadata={"unit": unit, "meaning": meaning})


_SEGMENT = pa.struct(
    [
        _field("length_m", _NUMBER, "m", "arc length of the piece"),
        _field("kappa_per_m", _NUMBER, "1/m", "curvature of the piece"),
        _field("angle_rad", _NUMBER, "rad", "accumulated curve angle of the piece"),
        _field("s_start_m", _NUMBER, "m", "arc length at which the piece begins"),
    ]
)

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
        _field("duration_s", _NUMBER, "s", "time from the first to the last good frame"),
        *_GEOMETRY,
        *_TENDON,
        *_RANGES,
        _field("warnings", pa.list_(_TEXT), "", "what is worth knowing about the input"),
    ]
)
"""A row for each input; of a recording, values without min or max are those of the last good frame."""

FRAMES = pa.schema(
    [
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
        _field("segments", pa.list_(_SEGMENT), "", "constant-curvature pieces, proximal to distal"),
        _field("warnings", pa.list_(_TEXT), "", "what is worth knowing about the frame"),
    ]
)
"""A row for each frame; a rejected frame has its reason and no numbers."""


def write_frames(path: Path, analysis: Analysis) -> None:
    """Write `frames/NAME.parquet`, whole or not at all.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    _write(path, FRAMES, (frame_row(item) for item in analysis.items))


def write_summary(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write `summary.parquet` from rows of `summary_row`, whole or not at all.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    _write(path, SUMMARY, rows)


def _write(path: Path, schema: pa.Schema, rows: Iterable[Mapping[str, Any]]) -> None:
    table = pa.Table.from_pylist([dict(row) for row in rows], schema=schema)
    with replacing(path) as draft:
        papq.write_table(table, draft)

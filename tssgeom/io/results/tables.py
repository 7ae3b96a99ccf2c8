"""Results as Parquet tables: every field carries its unit and its meaning as metadata."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as papq

from tssgeom.atomic import replacing
from tssgeom.channel_names import unit_of, words_of
from tssgeom.io.results.shapes import frame_row
from tssgeom.route.pieces import Arcs
from tssgeom.stream import FrameResult, Rejected
from tssgeom.summary import RunningSummary
from tssgeom.tendon.capstan import Transmission
from tssgeom.tendon.command import Command
from tssgeom.tendon.simulation import Moment

_NUMBER, _COUNT, _TEXT, _FLAG = pa.float64(), pa.int64(), pa.string(), pa.bool_()
_TEXTS = pa.list_(pa.field("element", _TEXT))


def field(name: str, meaning: str, kind: pa.DataType = _NUMBER, unit: str | None = None) -> pa.Field:
    """Return a field; the unit of a number is the end of its name, that of a count is 1."""
    if unit is None:
        unit = {_NUMBER: unit_of(name), _COUNT: "1"}.get(kind, "")
    return pa.field(name, kind, metadata={"unit": unit, "meaning": meaning})


_GEOMETRY = [
    field("points", "points that were used", _COUNT),
    field("noise_m", "standard deviation of a coordinate of the points"),
    field("length_m", "arc length L"),
    field("total_angle_rad", "accumulated curve angle Φ"),
    field("total_angle_se_rad", "standard error of Φ"),
    field("method", "estimator behind the pieces", _TEXT),
    field("pieces", "number of constant-curvature pieces", _COUNT),
]

_TENDON = [
    field("tension_in_N", "tension at the proximal end"),
    field("tension_out_N", "tension at the distal end"),
    field("tension_out_se_N", "standard error of the distal tension"),
    field("elongation_m", "elongation δ above the pretensioned state"),
    field("elongation_se_m", "standard error of δ"),
]

_RANGES = [
    field(f"{quantity}_{end}_{unit}", f"{word} over the good frames")
    for quantity, unit in (
        ("length", "m"),
        ("total_angle", "rad"),
        ("total_angle_se", "rad"),
        ("tension_in", "N"),
        ("tension_out", "N"),
        ("tension_out_se", "N"),
        ("elongation", "m"),
        ("elongation_se", "m"),
    )
    for end, word in (("min", "smallest"), ("max", "largest"))
]

SUMMARY = pa.schema(
    [
        field("name", "name of the outputs", _TEXT),
        field("source", "the input, relative to the working folder", _TEXT),
        field("timed", "true for a recording, false for one static shape", _FLAG),
        field("frames", "frames of the input", _COUNT),
        field("rejected", "frames that could not be used", _COUNT),
        field("warned", "good frames with a warning", _COUNT),
        field("duration_s", "time from the first to the last good frame"),
        field("time_s", "time of the frame that represents the input"),
        *_GEOMETRY,
        *_TENDON,
        *_RANGES,
        field("noise_rms_m", "root mean square of the noise over the good frames"),
        field("clearance_m", "least clearance of the tube to the lumen; null without one"),
        field("clearance_at_m", "arc length of the least clearance"),
        field("contact_length_m", "length of the route on which the tube touches the lumen"),
        field("outside_length_m", "length of the route outside the lumen"),
        field("warnings", "what is worth knowing about the input", _TEXTS),
    ]
)
"""A row for each input; values without min or max are those of `RunningSummary.representative`."""

FRAMES = pa.schema(
    [
        field("name", "the input, as in the summary", _TEXT),
        field("seq", "count of the frame, from 0", _COUNT),
        field("time_s", "time of the frame"),
        field("id", "the sender's own name of the frame", _TEXT),
        field("rejected", "why the frame could not be used; empty where it was", _TEXT),
        *_GEOMETRY,
        *_TENDON,
        field("direction_index", "+1 pulling, -1 releasing", _COUNT),
        field("dead_zone", "true where the distal end does not yet respond", _FLAG),
        field("dead_zone_width_N", "change of tension until the distal end responds"),
        field("measured_tension_out_N", "distal tension as measured, where it was"),
        field("measured_displacement_in_m", "proximal displacement as measured, where it was"),
        field("measured_elongation_m", "elongation as measured, where it was"),
        field("warnings", "what is worth knowing about the frame", _TEXTS),
    ]
)
"""A row for each frame; a rejected frame has its reason and no numbers."""


def frames_schema(of_machine: Sequence[str] = ()) -> pa.Schema:
    """Return `FRAMES`, with the columns of a machine before its warnings."""
    names = [each for each in of_machine if each not in FRAMES.names]
    more = [field(each, f"{words_of(each)} of the machine") for each in names]
    return pa.schema([*list(FRAMES)[:-1], *more, FRAMES.field("warnings")])


SEGMENTS = pa.schema(
    [
        field("name", "the input, as in the summary", _TEXT),
        field("seq", "count of the frame, from 0", _COUNT),
        field("piece", "number of the piece, from 0 at the proximal end", _COUNT),
        field("s_start_m", "arc length at which the piece begins"),
        field("length_m", "arc length of the piece"),
        field("kappa_per_m", "curvature of the piece"),
        field("angle_rad", "accumulated curve angle of the piece"),
        field("angle_se_rad", "standard error of the angle of the piece"),
    ]
)
"""A row for each constant-curvature piece of each good frame."""

CHUNK = 512
"""Frames that become rows at once; chosen."""
_ROW_GROUP = 32  # chunks in a row group, which memory holds at once; chosen


class Part(NamedTuple):
    """Consecutive frames: their rows, their pieces, and their running summary."""

    frames: pa.RecordBatch
    segments: pa.RecordBatch
    summary: RunningSummary


def parts(
    name: str, items: Iterable[FrameResult | Rejected], stride: int, of_machine: Sequence[str] = ()
) -> Iterator[Part]:
    """Turn results into rows, chunk by chunk; an input without frames gives no chunk."""
    upcoming = iter(items)
    while (part := part_of(name, islice(upcoming, CHUNK), stride, of_machine)).summary.frames:
        yield part


def part_of(
    name: str, items: Iterable[FrameResult | Rejected], stride: int, of_machine: Sequence[str] = ()
) -> Part:
    """Turn the results of some frames into rows, with the columns `of_machine`."""
    summary = RunningSummary(stride)
    rows, pieces = list[dict[str, Any]](), list[tuple[int, Arcs]]()
    for item in items:
        row = frame_row(item)
        rows.append(row)
        summary.add(item, row)
        if not isinstance(item, Rejected):
            pieces.append((item.seq, item.arcs))
    return Part(_batch(frames_schema(of_machine), name, rows), _segments(name, pieces), summary.close())


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
            for quantity in ("s_start", "length", "kappa", "angle", "angle_se")
        ),
    ]
    arrays = [pa.array(column) for column in columns]
    return pa.RecordBatch.from_arrays([_named(name, sum(counts)), *arrays], schema=SEGMENTS)


def _joined(arrays: Sequence[np.ndarray], kind: type) -> np.ndarray:
    return np.concatenate([np.zeros(0, kind), *arrays])


def _named(name: str, count: int) -> pa.Array:
    return pa.repeat(pa.scalar(name, _TEXT), count)


def write_parts(
    frames: Path,
    segments: Path,
    upcoming: Iterable[Part],
    summary: RunningSummary,
    of_machine: Sequence[str] = (),
) -> None:
    """Write the tables of frames and segments of one input, and add up the running summary.

    Memory holds a row group at a time. Where the iterable ends in an error, both files are incomplete.
    """
    of_frames = frames_schema(of_machine)
    with (
        frames.open("wb") as first,
        segments.open("wb") as second,
        papq.ParquetWriter(first, of_frames) as rows,
        papq.ParquetWriter(second, SEGMENTS) as pieces,
    ):
        chunks = iter(upcoming)
        while group := list(islice(chunks, _ROW_GROUP)):
            for part in group:
                summary.join(part.summary)
            rows.write_table(pa.Table.from_batches([part.frames for part in group]))
            pieces.write_table(pa.Table.from_batches([part.segments for part in group]))


def write_summary(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write `summary.parquet` from rows of `summary_row`."""
    write_parquet(path, _table(SUMMARY, [*rows]))


_PHASES = "pull, pull_to_release (dead zone), release, release_to_pull (dead zone), or hold"

SIMULATE = pa.schema(
    [
        field("time_s", "time of the run"),
        field("tension_in_N", "total tension at the proximal end"),
        field("tension_out_N", "total tension at the distal end"),
        field("elongation_m", "elongation of the tendon in the sheath above the pretensioned state"),
        field("displacement_in_m", "movement of the drive since the pretensioned state"),
        field("displacement_out_m", "movement of the load since the pretensioned state"),
        field("phase", _PHASES, _TEXT),
        field("direction_index", "+1 pulling, -1 releasing", _COUNT, unit=""),
        field("dead_zone_N", "change of the proximal tension until the distal end answers, 0 where it does"),
    ]
)
"""A row for each row of the run; where effects distort sensors, `read_` columns hold their readings."""
ERRORS = (
    field("tension_out_se_N", "standard error of the distal tension, by route and rig"),
    field("elongation_se_m", "standard error of the elongation, by route and rig"),
)
"""Where the rig states errors of its own."""

COMPENSATE = pa.schema(
    [
        field("time_s", "time of the run"),
        field("displacement_in_m", "position of the drive at which the distal end is on target"),
        field("tension_in_N", "total tension at the proximal end at which it is"),
        field("displacement_reached_m", "movement of the load then: the target, unless it is cut or waits"),
        field("tension_reached_N", "distal tension then, likewise"),
        field("displacement_out_se_m", "standard error of that movement, the drive at the position"),
        field("tension_out_se_N", "standard error of that tension, the drive at the position"),
        field("displacement_out_se_by_tension_m", "standard error of the movement, the drive at the tension"),
        field("tension_out_se_by_tension_N", "standard error of distal tension, the drive at the tension"),
        field("limited", "limits of the drive that cut the command", _TEXT),
        field("waits", "1 where the drive is held inside the dead zone", _COUNT, unit=""),
        field("out_of_tolerance", "probability of a miss by more than the tolerance", unit="1"),
    ]
)
"""A row for each row of the run."""
READING = field("read_tension_in_N", "reading of the sensor of that tension, where effects distort it")


def simulation_table(moments: Sequence[Moment]) -> pa.Table:
    """Return the rows of a simulation, with the readings of distorted sensors; see `SIMULATE`."""
    readings = moments[0].readings if moments else {}
    fields = [*ERRORS] if moments and moments[0].counts_rig else []
    fields += [field(f"read_{name}", f"{name} as its sensor reads it") for name in readings]
    return _table(pa.schema([*SIMULATE, *fields]), [simulation_row(moment) for moment in moments])


def simulation_row(moment: Moment) -> dict[str, Any]:
    """Return the row of one moment; see `SIMULATE`."""
    transmission = moment.transmission
    return {
        "time_s": moment.time,
        "tension_in_N": transmission.tension_in,
        "tension_out_N": transmission.tension_out,
        "elongation_m": transmission.elongation,
        "displacement_in_m": transmission.displacement_in,
        "displacement_out_m": transmission.displacement_out,
        "phase": moment.phase,
        "direction_index": transmission.direction_index,
        "dead_zone_N": transmission.dead_zone_width,
        **(_errors(transmission) if moment.counts_rig else {}),
        **{f"read_{name}": value for name, value in moment.readings.items()},
    }


def _errors(transmission: Transmission) -> dict[str, float]:
    return {"tension_out_se_N": transmission.tension_out_se, "elongation_se_m": transmission.elongation_se}


def commands_table(time: Sequence[float | None], commands: Sequence[Command]) -> pa.Table:
    """Return the rows of commands, with the reading of a distorted sensor; see `COMPENSATE`."""
    rows = [
        {
            "time_s": moment,
            "displacement_in_m": one.displacement_in,
            "tension_in_N": one.tension_in,
            "displacement_reached_m": one.displacement_reached,
            "tension_reached_N": one.tension_reached,
            "displacement_out_se_m": one.errors.displacement_out,
            "tension_out_se_N": one.errors.tension_out,
            "displacement_out_se_by_tension_m": one.errors.displacement_out_by_tension,
            "tension_out_se_by_tension_N": one.errors.tension_out_by_tension,
            "limited": one.limited,
            "waits": int(one.waits),
            "out_of_tolerance": one.out_of_tolerance,
            READING.name: one.reading_in,
        }
        for moment, one in zip(time, commands, strict=True)
    ]
    distorted = any(one.reading_in != one.tension_in for one in commands)
    return _table(COMPENSATE.append(READING) if distorted else COMPENSATE, rows)


def _table(schema: pa.Schema, rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    return pa.Table.from_pylist([dict(row) for row in rows], schema=schema)


def write_table(path: Path, table: pa.Table) -> None:
    """Write a table, whole or not at all."""
    with replacing(path) as draft:
        write_parquet(draft, table)


def write_parquet(path: Path, table: pa.Table) -> None:
    """Write a table to a new file, which Python opens: Arrow takes every name of a file as UTF-8."""
    with path.open("wb") as file:
        papq.write_table(table, file)

"""Simulated runs and commands as Parquet: every field carries its unit and its meaning as metadata."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as papq

from tssgeom.atomic import replacing
from tssgeom.tendon.command import Command
from tssgeom.tendon.simulation import Moment

_UNITS = {"s": "s", "N": "N", "m": "m"}


def _field(name: str, meaning: str, kind: pa.DataType | None = None) -> pa.Field:
    unit = "" if kind is not None else _UNITS[name.rpartition("_")[2]]
    return pa.field(name, kind or pa.float64(), metadata={"unit": unit, "meaning": meaning})


_PHASES = "pull, pull_to_release (dead zone), release, release_to_pull (dead zone), or hold"

SIMULATE = pa.schema(
    [
        _field("time_s", "time of the run"),
        _field("tension_in_N", "total tension at the proximal end"),
        _field("tension_out_N", "total tension at the distal end"),
        _field("elongation_m", "elongation of the tendon in the sheath above the pretensioned state"),
        _field("displacement_in_m", "movement of the drive since the pretensioned state"),
        _field("displacement_out_m", "movement of the load since the pretensioned state"),
        _field("phase", _PHASES, pa.string()),
        _field("direction_index", "+1 pulling, -1 releasing", pa.int64()),
        _field("dead_zone_N", "change of the proximal tension until the distal end answers, 0 where it does"),
    ]
)
"""A row for each row of the run; where effects spoil sensors, `read_` columns tell what they read."""

COMPENSATE = pa.schema(
    [
        _field("time_s", "time of the run"),
        _field("displacement_in_m", "position of the drive at which the distal end is on target"),
        _field("tension_in_N", "total tension at the proximal end at which it is"),
    ]
)
"""A row for each row of the run."""
_READING = _field("read_tension_in_N", "what the sensor of that tension reads, where effects spoil it")


def write_simulation(path: Path, moments: Sequence[Moment]) -> None:
    """Write `simulate.parquet`, whole or not at all.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    read = moments[0].readings if moments else {}
    fields = [_field(f"read_{name}", f"{name} as its sensor reads it") for name in read]
    _write(path, pa.schema([*SIMULATE, *fields]), [simulation_row(moment) for moment in moments])


def simulation_row(moment: Moment) -> dict[str, Any]:
    """Return the row of one moment; see `SIMULATE`."""
    seen = moment.transmission
    return {
        "time_s": moment.time,
        "tension_in_N": seen.tension_in,
        "tension_out_N": seen.tension_out,
        "elongation_m": seen.elongation,
        "displacement_in_m": seen.displacement_in,
        "displacement_out_m": seen.displacement_out,
        "phase": moment.phase,
        "direction_index": seen.direction_index,
        "dead_zone_N": seen.dead_zone_width,
        **{f"read_{name}": value for name, value in moment.readings.items()},
    }


def write_commands(path: Path, time: Sequence[float], commands: Sequence[Command]) -> None:
    """Write `compensate.parquet`, whole or not at all.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    rows = [
        {
            "time_s": moment,
            "displacement_in_m": one.displacement_in,
            "tension_in_N": one.tension_in,
            _READING.name: one.reading_in,
        }
        for moment, one in zip(time, commands, strict=True)
    ]
    spoilt = any(one.reading_in != one.tension_in for one in commands)
    _write(path, COMPENSATE.append(_READING) if spoilt else COMPENSATE, rows)


def _write(path: Path, schema: pa.Schema, rows: Sequence[Mapping[str, Any]]) -> None:
    table = pa.Table.from_pylist([dict(row) for row in rows], schema=schema)
    with replacing(path) as draft:
        papq.write_table(table, draft)

"""`tssgeom simulate`: a measured or planned drive through the model, on a route that stands or moves."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from pipelines.console import say, show, tracking
from pipelines.runs import (
    SensedRoute,
    draw,
    draw_figures,
    naming,
    sensed_route,
    temperature_of,
    warn_of_doubts,
)
from pipelines.summary_table import acting
from pipelines.work import Options
from tssgeom.io.formats.runs import MeasuredRun, read_run
from tssgeom.io.results.tables import write_simulation
from tssgeom.tendon.simulation import Moment, Phase, simulate

TABLE, PICTURE = "simulate.parquet", "simulate.rrd"
_DRIVES = ("tension_in_N", "displacement_in_m")
_COLUMNS = ("phase", "rows", "T_in\n[N]", "T_out\n[N]", "δ\n[mm]", "dead zone\n[N]")


def run(
    shapes: Path,
    drive: Path,
    chosen: Options,
    *,
    out: Path,
    figures: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Simulate a run and return the exit status.

    Raises
    ------
    SettingsError, ShapeError, SourceError, FitError
        Where an input cannot be used or the disk refuses.
    """
    measured = read_run(drive)
    name, values = measured.channel(_DRIVES)
    sensed = sensed_route(shapes, chosen)
    moments = list[Moment]()
    with tracking(1, quiet=quiet or as_json) as tracker:
        tracker.begin(f"{sensed.name} driven by {measured.name}")
        by_force = name == _DRIVES[0]
        driven = simulate(
            measured.time,
            sensed.route,
            chosen.rig,
            tension_in=values if by_force else None,
            displacement_in=None if by_force else values,
            temperature=temperature_of(measured, chosen),
        )
        with naming(drive, shapes):
            for moment in driven:
                moments.append(moment)
                tracker.frame(len(values))
        tracker.end(str(drive))
    warn_of_doubts(drive, sensed, chosen.rig, max(one.transmission.tension_in for one in moments))
    write_simulation(out / TABLE, moments)
    draw(out / PICTURE, sensed, measured, moments)
    if figures is not None:
        draw_figures(figures, sensed, measured, moments)
    _tell(sensed, measured, name, moments, chosen, out, as_json=as_json, quiet=quiet)
    return 1 if sensed.rejected else 0


def _tell(
    sensed: SensedRoute,
    measured: MeasuredRun,
    drive: str,
    moments: Sequence[Moment],
    chosen: Options,
    out: Path,
    *,
    as_json: bool,
    quiet: bool,
) -> None:
    if as_json:
        say(json.dumps(summary(sensed, measured, drive, moments, out), indent=1, ensure_ascii=False))
    elif not quiet:
        title = f"{sensed.name} driven by {drive} of {measured.name}: {len(moments)} rows" + acting(chosen)
        show(title, _COLUMNS, _rows(moments))
        say(f"table: {out / TABLE}   picture: tssgeom view {out / PICTURE}")


def summary(
    sensed: SensedRoute, measured: MeasuredRun, drive: str, moments: Sequence[Moment], out: Path
) -> dict[str, Any]:
    """Return the object that `--json` prints: ranges over the run, rows in each phase, files."""
    seen = [moment.transmission for moment in moments]
    return {
        "shape": sensed.name,
        "frames": len(sensed.results),
        "rejected": sensed.rejected,
        "run": measured.name,
        "drive": drive,
        "rows": len(moments),
        "phases": dict(Counter(moment.phase for moment in moments)),
        "range": {
            "tension_in_N": _range([one.tension_in for one in seen]),
            "tension_out_N": _range([one.tension_out for one in seen]),
            "elongation_m": _range([one.elongation for one in seen]),
            "displacement_in_m": _range([one.displacement_in for one in seen]),
            "displacement_out_m": _range([one.displacement_out for one in seen]),
        },
        "files": [(out / TABLE).as_posix(), (out / PICTURE).as_posix()],
    }


def _range(values: Sequence[float]) -> list[float]:
    return [min(values), max(values)]


def _rows(moments: Sequence[Moment]) -> list[tuple[str, ...]]:
    rows = []
    for phase in get_args(Phase):
        seen = [moment.transmission for moment in moments if moment.phase == phase]
        if seen:
            rows.append(
                (
                    phase,
                    str(len(seen)),
                    _span([one.tension_in for one in seen], 2),
                    _span([one.tension_out for one in seen], 2),
                    _span([1e3 * one.elongation for one in seen], 3),
                    _span([one.dead_zone_width for one in seen], 2),
                )
            )
    return rows


def _span(values: Sequence[float], digits: int) -> str:
    low, high = (f"{round(value, digits) + 0.0:.{digits}f}" for value in _range(values))
    return low if low == high else f"{low}–{high}"

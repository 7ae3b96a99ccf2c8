"""`tssgeom simulate`: a measured or planned drive through the model, on a route that stands or moves.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from pipelines.options import Figures, FigureStyle, Json, Map, Quiet, RigFile, Shapes, Unit
from pipelines.terminal import print_json, print_line, print_table
from tssgeom.view.figures.style import choose

if TYPE_CHECKING:
    from tssgeom.api.inputs import SensedFrames
    from tssgeom.io.formats.runs import MeasuredRun
    from tssgeom.io.results.keys.runs import Simulated
    from tssgeom.tendon.capstan import Transmission
    from tssgeom.tendon.simulation import Moment

TABLE, PICTURE = "simulate.parquet", "simulate.rrd"
_DRIVES = ("tension_in_N", "displacement_in_m")
_COLUMNS = ("phase", "rows", "T_in\n[N]", "T_out\n[N]", "δ\n[mm]", "x_out\n[mm]", "dead zone\n[N]")


def simulate(
    drive: Annotated[
        Path,
        typer.Option(
            "--drive",
            help="Run (CSV, Parquet): time_s and tension_in_N or displacement_in_m; of a machine, its drive.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for simulate.parquet and simulate.rrd.")],
    shapes: Shapes = None,
    rig: RigFile = None,
    unit: Unit = None,
    columns: Map = None,
    figures: Figures = None,
    style: FigureStyle = "light",
    adapt: Annotated[
        bool,
        typer.Option(
            "--adapt",
            help="Follow the drifting numbers of the rig (its table adapt) through the readings of the run.",
        ),
    ] = False,
    write_rig: Annotated[
        Path | None,
        typer.Option("--write-rig", help="With --adapt: rig file (TOML) to write, as it is at the end."),
    ] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Compute tension, elongation and phase over time on a fixed or moving route, driven by a run."""
    from pipelines.inputs import run_settings
    from pipelines.runs import (
        check_run,
        computed_rows,
        measured_run,
        outputs,
        sensed_route,
        temperature_of,
        warn_about_strain,
        write_run_figures,
        write_run_recording,
    )
    from pipelines.summary_table import with_effects
    from tssgeom.atomic import replacing_all
    from tssgeom.errors import SettingsError
    from tssgeom.io.results.tables import simulation_table, write_table
    from tssgeom.tendon import simulation

    choose(style)
    settings = run_settings(rig, None, unit, columns=columns, takes_machines=True)
    if write_rig is not None and not adapt:
        raise SettingsError("--write-rig needs --adapt: give both")
    with outputs(out, TABLE, PICTURE):
        if adapt:
            from pipelines.simulate_adapt import simulate_adapt

            status = simulate_adapt(
                shapes,
                drive,
                out,
                settings,
                write_rig=write_rig,
                figures=figures,
                as_json=as_json,
                quiet=quiet,
            )
            raise typer.Exit(status)
        if settings.rig.is_machine:
            from pipelines.machines import simulate_machine

            status = simulate_machine(shapes, drive, out, settings, figures, as_json=as_json, quiet=quiet)
            raise typer.Exit(status)
        run = measured_run(drive, settings)
        channel, values = run.channel(_DRIVES)
        sensed = sensed_route(shapes, settings)
        check_run(run, sensed, settings.rig)
        by_tension = channel == _DRIVES[0]
        rows = simulation.simulate(
            run.time,
            sensed.route,
            settings.rig,
            tension_in=values if by_tension else None,
            displacement_in=None if by_tension else values,
            temperature=temperature_of(run, settings),
            uncertain=settings.uncertain,
        )
        title = f"{sensed.name} driven by {run.name}"
        moments = computed_rows(rows, run, shapes, title, quiet=quiet or as_json)
        warn_about_strain(drive, sensed, settings.rig, max(one.transmission.tension_in for one in moments))
        with replacing_all(out) as draft:  # no table without its pictures
            write_table(draft / TABLE, simulation_table(moments))
            write_run_recording(draft / PICTURE, sensed, run, moments)
            if figures is not None:
                write_run_figures(figures, sensed, run, moments)
        if as_json:
            print_json(summary(sensed, run, channel, moments, out))
        elif not quiet:
            title = f"{sensed.name} driven by {channel} of {run.name}: {len(moments)} rows"
            print_table(title + with_effects(settings), _COLUMNS, _rows(moments))
            if moments[0].counts_rig:
                print_line(_errors([moment.transmission for moment in moments]))
            print_line(f"table: {out / TABLE}   picture: tssgeom view {out / PICTURE}")
        raise typer.Exit(1 if sensed.rejected else 0)


def _errors(ends: Sequence[Transmission]) -> str:
    most = (max(each.tension_out_se for each in ends), 1e3 * max(each.elongation_se for each in ends))
    return f"standard errors by route and rig: T_out up to {most[0]:.2g} N, δ up to {most[1]:.2g} mm"


def summary(
    sensed: SensedFrames, run: MeasuredRun, drive: str, moments: Sequence[Moment], out: Path
) -> Simulated:
    """Return the object that `--json` prints: ranges over the run, rows in each phase, files."""
    from pipelines.runs import value_range

    transmissions = [moment.transmission for moment in moments]
    return {
        "shape": sensed.name,
        "frames": len(sensed.results),
        "rejected": len(sensed.rejected),
        "run": run.name,
        "drive": drive,
        "rows": len(moments),
        "phases": dict(Counter(moment.phase for moment in moments)),
        "range": {
            "tension_in_N": value_range([one.tension_in for one in transmissions]),
            "tension_out_N": value_range([one.tension_out for one in transmissions]),
            "elongation_m": value_range([one.elongation for one in transmissions]),
            "displacement_in_m": value_range([one.displacement_in for one in transmissions]),
            "displacement_out_m": value_range([one.displacement_out for one in transmissions]),
        },
        "files": [(out / TABLE).as_posix(), (out / PICTURE).as_posix()],
    }


def _rows(moments: Sequence[Moment]) -> list[tuple[str, ...]]:
    from tssgeom.tendon.simulation import Phase

    rows = []
    for phase in get_args(Phase):
        transmissions = [moment.transmission for moment in moments if moment.phase == phase]
        if transmissions:
            rows.append(
                (
                    phase,
                    str(len(transmissions)),
                    _span([one.tension_in for one in transmissions], 2),
                    _span([one.tension_out for one in transmissions], 2),
                    _span([1e3 * one.elongation for one in transmissions], 3),
                    _span([1e3 * one.displacement_out for one in transmissions], 3),
                    _span([one.dead_zone_width for one in transmissions], 2),
                )
            )
    return rows


def _span(values: Sequence[float], digits: int) -> str:
    low, high = (f"{round(value, digits) + 0.0:.{digits}f}" for value in (min(values), max(values)))
    return low if low == high else f"{low}–{high}"

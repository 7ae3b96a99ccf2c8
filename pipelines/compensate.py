"""`tssgeom compensate`: the proximal command that makes the distal end follow a target.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipelines.options import TENSION_IN, Json, Map, Quiet, RigFile, Shapes, Unit
from pipelines.terminal import print_json, print_line, print_table

TABLE = "compensate.parquet"
_TARGETS = ("displacement_out_m", "tension_out_N")


def compensate(
    shapes: Shapes,
    target: Annotated[
        Path,
        typer.Option(
            "--target",
            help="Run (CSV, Parquet): time_s and displacement_out_m, tension_out_N or joint_angle_rad.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for compensate.parquet.")],
    rig: RigFile = None,
    unit: Unit = None,
    columns: Map = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Compute the proximal command that makes the distal end follow a target."""
    from pipelines.inputs import run_settings
    from pipelines.runs import (
        check_run,
        computed_rows,
        measured_run,
        sensed_route,
        temperature_of,
        value_range,
        warn_about_strain,
        warn_about_unused,
    )
    from pipelines.summary_table import with_effects
    from tssgeom.io.formats.columns import CHANNELS
    from tssgeom.io.results.tables import write_commands
    from tssgeom.tendon import simulation

    settings = run_settings(rig, TENSION_IN, unit, columns=columns, takes_machines=True)
    if settings.rig.is_machine:
        from pipelines.machines import compensate_machine

        raise typer.Exit(compensate_machine(shapes, target, out, settings, as_json=as_json, quiet=quiet))
    run = measured_run(target, settings)
    channel, values = run.channel(_TARGETS)
    warn_about_unused(run, channel, _TARGETS)
    sensed = sensed_route(shapes, settings)
    check_run(run, sensed, settings.rig)
    rows = simulation.commands(
        run.time,
        sensed.route,
        settings.rig,
        temperature=temperature_of(run, settings),
        **{CHANNELS[channel][0]: values},
    )
    title = f"{sensed.name} follows {run.name}"
    commands = computed_rows(rows, run, shapes, title, quiet=quiet or as_json)
    warn_about_strain(target, sensed, settings.rig, max(one.tension_in for one in commands))
    write_commands(out / TABLE, run.time.tolist(), commands)
    drive = value_range([one.displacement_in for one in commands])
    tension = value_range([one.tension_in for one in commands])
    if as_json:
        print_json(
            {
                "shape": sensed.name,
                "rejected": sensed.rejected,
                "run": run.name,
                "target": channel,
                "rows": len(commands),
                "range": {"displacement_in_m": drive, "tension_in_N": tension},
                "files": [(out / TABLE).as_posix()],
            }
        )
    elif not quiet:
        title = f"{sensed.name} follows {channel} of {run.name}: {len(commands)} commands"
        cells = (channel, f"{1e3 * drive[0]:.3f}–{1e3 * drive[1]:.3f}", f"{tension[0]:.2f}–{tension[1]:.2f}")
        print_table(title + with_effects(settings), ("target", "drive [mm]", "T_in [N]"), [cells])
        print_line(f"table: {out / TABLE}")
    raise typer.Exit(1 if sensed.rejected else 0)

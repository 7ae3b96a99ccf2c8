"""Options of the commands on measured runs: `simulate`, `compensate`, `calibrate` and `discover`.

What a command needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipelines.common_options import TENSION_IN, Figures, Json, Quiet, RigFile, Shapes, Unit


def simulate(
    shapes: Shapes,
    drive: Annotated[
        Path,
        typer.Option("--drive", help="Run (CSV, Parquet): time_s and tension_in_N or displacement_in_m."),
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for simulate.parquet and simulate.rrd.")],
    rig: RigFile = None,
    unit: Unit = None,
    figures: Figures = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Tell tension, elongation and phase over time on a fixed or moving route, driven by a run."""
    from pipelines import simulate as command
    from pipelines.work import options

    chosen = options(rig, TENSION_IN, unit, None)
    raise typer.Exit(command.run(shapes, drive, chosen, out=out, figures=figures, as_json=json, quiet=quiet))


def compensate(
    shapes: Shapes,
    target: Annotated[
        Path,
        typer.Option("--target", help="Run (CSV, Parquet): time_s and displacement_out_m or tension_out_N."),
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for compensate.parquet.")],
    rig: RigFile = None,
    unit: Unit = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find the proximal command that makes the distal end follow a target."""
    from pipelines import compensate as command
    from pipelines.work import options

    chosen = options(rig, TENSION_IN, unit, None)
    raise typer.Exit(command.run(shapes, target, chosen, out=out, as_json=json, quiet=quiet))


def calibrate(
    run: Annotated[Path, typer.Argument(help="Measured pull and release (CSV or Parquet).")],
    shape: Annotated[Path, typer.Option("--shape", help="Shape of the route during the run.")],
    out: Annotated[Path, typer.Option("--out", help="Rig file (TOML) to write.")],
    rig: RigFile = None,
    from_tension: Annotated[
        float,
        typer.Option(
            "--from-tension", min=0.0, help="Proximal tension below which elongation does not count [N]."
        ),
    ] = 4.0,
    unit: Unit = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find friction, compliance and sensor zeros, with 95 % intervals, from a run; write them as a rig.

    RUN has a column time_s, a drive (tension_in_N, or else displacement_in_m) and responses (tension_out_N,
    elongation_m or _mm, or displacement_in_m with displacement_out_m). Friction and compliance go into the
    rig; zeros are told only.
    """
    from pipelines import calibrate as command
    from pipelines.work import options

    chosen = options(rig, TENSION_IN, unit, None)
    raise typer.Exit(
        command.run(run, shape, chosen, out=out, from_tension=from_tension, as_json=json, quiet=quiet)
    )


def discover(
    campaign: Annotated[
        Path, typer.Argument(help="Folder with campaign.toml: measured runs and their shapes.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for report, updated rig and recording.")],
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the simulated clean campaigns.")] = 0,
    unit: Unit = None,
    figures: Figures = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find what the model lacks on measured runs, name it, put it into the rig, and show the gap shrink."""
    from pipelines import discover as command

    raise typer.Exit(
        command.run(campaign, out=out, seed=seed, unit=unit, figures=figures, as_json=json, quiet=quiet)
    )

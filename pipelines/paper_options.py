"""Options of `paper` and `remedy`, which the paper asks for.

What a command needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipelines.common_options import TENSION_IN, Json, Quiet, RigFile, Unit


def paper(
    out: Annotated[Path, typer.Option("--out", help="Folder for figures, table and recording.")],
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Draw figures 4 to 8 of the paper from the model, and set its numbers beside ours."""
    from pipelines import paper as command

    raise typer.Exit(command.run(out, as_json=json, quiet=quiet))


def remedy(
    shape: Annotated[Path, typer.Option("--shape", help="Shape of the route behind the added curve.")],
    rig: RigFile = None,
    tension_in: Annotated[
        float, typer.Option("--tension-in", min=0.0, help="Proximal tension at the end of the pull [N].")
    ] = TENSION_IN,
    release_to: Annotated[
        float | None,
        typer.Option(
            "--release-to", min=0.0, help="Proximal tension at the end of the release [N]; a third."
        ),
    ] = None,
    beta_deg: Annotated[
        float, typer.Option("--beta-deg", min=0.0, help="Angle β of the curve in the table [°].")
    ] = 360.0,
    curvature_per_m: Annotated[
        float,
        typer.Option(
            "--curvature-per-m", min=1e-3, help="Its curvature K; the sharpest that the sheath allows [1/m]."
        ),
    ] = 40.0,
    tolerance_mm: Annotated[
        float | None,
        typer.Option(
            "--tolerance-mm",
            "--tolerance",
            min=0.0,
            help="Change of δ to stay below, in mm; recommends a curve.",
        ),
    ] = None,
    tolerance_percent: Annotated[
        float | None,
        typer.Option(
            "--tolerance-percent", min=0.0, help="The same in per cent of δ at the end of the pull."
        ),
    ] = None,
    bends: Annotated[int, typer.Option("--bends", min=1, help="Unknown bends in each perturbation.")] = 2,
    bend_sd_deg: Annotated[
        float, typer.Option("--bend-sd-deg", min=0.0, help="Standard deviation of their angles [°].")
    ] = 20.0,
    bend_width_mm: Annotated[
        float, typer.Option("--bend-width-mm", min=0.0, help="Length of sheath that each takes, in mm.")
    ] = 20.0,
    percentile: Annotated[
        float, typer.Option("--percentile", min=1.0, max=100.0, help="Of the changes over all perturbations.")
    ] = 95.0,
    trials: Annotated[int, typer.Option("--trials", min=10, help="Perturbations that are drawn.")] = 500,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the random draws.")] = 1,
    most_beta_deg: Annotated[
        float, typer.Option("--most-beta-deg", min=45.0, max=3600.0, help="Largest angle to recommend [°].")
    ] = 1080.0,
    unit: Unit = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for figure and table.")] = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Design the added curve of Theorem 3: what it scales down, what it costs, what it does on release.

    Unknown bends are drawn on the route itself; the change of T_out and δ that they make is told without the
    curve, with it at the same T_in, and with it at the same T_out.
    """
    from math import radians

    from pipelines import remedy as command
    from pipelines.work import options
    from tssgeom.tendon.design import Curve, Cycle, Perturbation

    design = command.Design(
        curve=Curve(radians(beta_deg), curvature_per_m),
        cycle=Cycle(tension_in, tension_in / 3 if release_to is None else release_to),
        perturbation=Perturbation(bends, radians(bend_sd_deg), 1e-3 * bend_width_mm),
        trials=trials,
        seed=seed,
        percentile=percentile,
        most=radians(most_beta_deg),
        tolerance=None if tolerance_mm is None else 1e-3 * tolerance_mm,
        tolerance_share=None if tolerance_percent is None else 1e-2 * tolerance_percent,
    )
    chosen = options(rig, tension_in, unit, None)
    raise typer.Exit(command.run(shape, chosen, design, out=out, as_json=json, quiet=quiet))

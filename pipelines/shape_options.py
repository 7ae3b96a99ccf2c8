"""Options of `analyse`, `batch`, `check`, `samples` and `view`.

What a command needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipelines.common_options import (
    TENSION_IN,
    Figures,
    Inputs,
    Json,
    Quiet,
    RigFile,
    TensionIn,
    TubeMm,
    Unit,
)


def analyse(
    shapes: Inputs,
    rig: RigFile = None,
    tension_in: TensionIn = TENSION_IN,
    unit: Unit = None,
    json: Json = False,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for result.json, .rrd and tube .glb.")
    ] = None,
    export: Annotated[
        str, typer.Option("--export", help="For other programs, in DIR: any of mrk.json,vtp,ply,csv.")
    ] = "",
    lumen: Annotated[
        Path | None, typer.Option("--lumen", help="Mesh around the route; NAME_lumen.* beside it by default.")
    ] = None,
    tube_mm: TubeMm = None,
    figures: Figures = None,
    quiet: Quiet = False,
) -> None:
    """Tell length, angle, pieces, distal tension and elongation of each shape."""
    from pipelines import analyse as command
    from pipelines.work import options

    chosen = options(rig, tension_in, unit, lumen, tube_mm=tube_mm)
    raise typer.Exit(
        command.run(shapes, chosen, out=out, export=export, figures=figures, as_json=json, quiet=quiet)
    )


def batch(
    inputs: Annotated[
        list[str], typer.Argument(help="Files or folders of shapes and recordings; paths, or addresses.")
    ],
    out: Annotated[
        str, typer.Option("--out", help="Folder for tables, report and recordings; a path or an address.")
    ],
    rig: RigFile = None,
    tension_in: TensionIn = TENSION_IN,
    unit: Unit = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="Processes; as many as are worth it by default.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", help="Dask scheduler, tcp://HOST:PORT, instead of processes.")
    ] = None,
    geometry_only: Annotated[
        bool,
        typer.Option("--geometry-only", help="Each frame is a first pull; frames spread over the workers."),
    ] = False,
    pictures: Annotated[
        bool, typer.Option("--pictures/--no-pictures", help="Write recordings and figures.")
    ] = True,
    figures: Annotated[
        str | None,
        typer.Option("--figures", help="Folder for figures of each input for print, as PDF and SVG."),
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="First remove an earlier batch from DIR.")] = False,
    tube_mm: TubeMm = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Analyse every shape and recording in files and folders, and write tables, report and recordings.

    What was done before with the same settings is not done again, so a batch that was stopped goes on.
    """
    from pipelines import batch as command
    from pipelines.work import options

    if workers is not None and scheduler is not None:
        raise typer.BadParameter("give --workers or --scheduler: a scheduler has workers of its own")
    chosen = options(rig, tension_in, unit, None, geometry_only=geometry_only, tube_mm=tube_mm)
    how = command.How(workers, scheduler, fresh, pictures, figures)
    raise typer.Exit(command.run(inputs, chosen, how, out=out, as_json=json, quiet=quiet))


def check(
    files: Annotated[
        list[Path],
        typer.Argument(help="Shapes, recordings, meshes or rig files, or folders.", readable=False),
    ],
    unit: Unit = None,
    json: Json = False,
) -> None:
    """Say what a file holds, in which units, and what is wrong with it."""
    from pipelines import check as command

    raise typer.Exit(command.run(files, unit, as_json=json))


def samples(
    out: Annotated[Path, typer.Option("--out", help="Folder to write to.")] = Path("sample_shapes"),
) -> None:
    """Write the sample shapes anew, bit for bit."""
    from pipelines import samples as command

    raise typer.Exit(command.run(out))


def view(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="PATH [PATH]",
            help="What a command wrote, a recording or a folder; two are compared side by side.",
        ),
    ],
    screenshot: Annotated[
        Path | None, typer.Option("--screenshot", help="Write a PNG instead; works with no display.")
    ] = None,
    web: Annotated[bool, typer.Option("--web", help="Open in the web browser.")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", help="Write the recording of a comparison into DIR instead.")
    ] = None,
) -> None:
    """Open the Rerun viewer on what a command wrote, or on two of them side by side."""
    from pipelines import view as command

    raise typer.Exit(command.run(paths, screenshot_to=screenshot, web=web, out=out))

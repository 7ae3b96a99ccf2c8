"""`tssgeom batch`: its options here; `run` is the batch, `task` one input, `workers` the pool that does it.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from typing import Annotated

import typer

from pipelines.options import FigureStyle, GeometryOnly, Json, Map, Quiet, RigFile, TensionIn, TubeMm, Unit


def batch(
    inputs: Annotated[
        list[str], typer.Argument(help="Files or folders of shapes and recordings; paths, or addresses.")
    ],
    out: Annotated[
        str, typer.Option("--out", help="Folder for tables, report and recordings; a path or an address.")
    ],
    rig: RigFile = None,
    tension_in: TensionIn = None,
    unit: Unit = None,
    columns: Map = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="Processes; as many as cores and input justify.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", help="Dask scheduler, tcp://HOST:PORT, instead of processes.")
    ] = None,
    geometry_only: GeometryOnly = False,
    pictures: Annotated[
        bool, typer.Option("--pictures/--no-pictures", help="Write recordings and figures.")
    ] = True,
    figures: Annotated[
        str | None,
        typer.Option("--figures", help="Folder for figures of each input for print, as PDF and SVG."),
    ] = None,
    style: FigureStyle = "light",
    csv: Annotated[bool, typer.Option("--csv", help="Write every table as CSV too.")] = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="First remove an earlier batch from DIR.")] = False,
    tube_mm: TubeMm = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Analyse every shape and recording in files and folders, and write tables, report and recordings.

    Inputs that an earlier batch finished with the same settings are skipped, so a stopped batch goes on.
    """
    from pipelines.batch.run import BatchOptions, run
    from pipelines.inputs import run_settings

    if workers is not None and scheduler is not None:
        raise typer.BadParameter("give --workers or --scheduler: a scheduler has workers of its own")
    settings = run_settings(
        *(rig, tension_in, unit),
        geometry_only=geometry_only,
        tube_mm=tube_mm,
        columns=columns,
        takes_machines=True,
    )
    options = BatchOptions(workers, scheduler, fresh, pictures, figures, csv, style)
    raise typer.Exit(run(inputs, settings, options, out=out, as_json=as_json, quiet=quiet))

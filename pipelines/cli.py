"""The console script `tssgeom`: options of every command, and one funnel for errors.

What a command needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from pipelines.track_options import track
from pipelines.version import tssgeom_version

TENSION_IN = 15.0
"""Tension at the proximal end where neither the file nor the user tells it [N]."""

_INTERRUPTED = 130  # what shells and typer call the end by Ctrl-C

app = typer.Typer(
    name="tssgeom",
    help="Tension and elongation of tendon-sheath transmissions on sensed three-dimensional routes.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

app.command()(track)

Inputs = Annotated[list[Path], typer.Argument(help="Files or folders of shapes and recordings.")]
RigFile = Annotated[Path | None, typer.Option("--rig", help="Rig file (TOML); the paper's rig by default.")]
TensionIn = Annotated[
    float, typer.Option("--tension-in", min=0.0, help="Proximal tension for frames that bring none [N].")
]
Unit = Annotated[
    Literal["mm", "m"] | None, typer.Option("--unit", help="Unit of files that state none in their header.")
]
TubeMm = Annotated[
    float | None,
    typer.Option("--tube-mm", help="Outer diameter of the tube in mm, for its clearance and its mesh."),
]
Figures = Annotated[
    Path | None, typer.Option("--figures", help="Folder for figures for print, as PDF and SVG.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON on stdout instead of a table.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing on stdout and no progress.")]


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"tssgeom {tssgeom_version()}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Hold the options that come before a command."""


@app.command()
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


@app.command()
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


@app.command()
def check(
    files: Annotated[list[Path], typer.Argument(help="Shapes, recordings, meshes or rig files, or folders.")],
    unit: Unit = None,
    json: Json = False,
) -> None:
    """Say what a file holds, in which units, and what is wrong with it."""
    from pipelines import check as command

    raise typer.Exit(command.run(files, unit, as_json=json))


@app.command()
def live(
    source: Annotated[
        list[str] | None,
        typer.Option(
            "--source", help="-, tcp://127.0.0.1:PORT, udp://…, igtl://HOST:18944, replay:FILE[?speed=2]."
        ),
    ] = None,
    sink: Annotated[
        list[str] | None,
        typer.Option("--sink", help="-, tcp://127.0.0.1:PORT, udp://…, igtl://127.0.0.1:PORT, none."),
    ] = None,
    rig: RigFile = None,
    tension_in: TensionIn = TENSION_IN,
    unit: Unit = None,
    stale_after: Annotated[
        float, typer.Option("--stale-after", min=0.001, help="Silence after which a stale line is sent [s].")
    ] = 0.2,
    stats: Annotated[
        bool, typer.Option("--stats", help="Tell the numbers each second as JSON on stderr.")
    ] = False,
    state: Annotated[
        Path | None, typer.Option("--state", help="Where the tendon's state is kept from start to start.")
    ] = None,
    record: Annotated[Path | None, typer.Option("--record", help="Rerun recording (.rrd) to write.")] = None,
    view: Annotated[bool, typer.Option("--view", help="Host the picture for Rerun viewers.")] = False,
    view_port: Annotated[int, typer.Option("--view-port", min=1, max=65535, help="Port for viewers.")] = 9876,
    allow_remote: Annotated[
        bool, typer.Option("--allow-remote", help="Let sockets take other addresses than loopback.")
    ] = False,
    token_file: Annotated[
        Path | None, typer.Option("--token-file", help="File with the token that clients have to show first.")
    ] = None,
) -> None:
    """Answer each shape as it is sensed with tension, elongation and the command that reaches its target.

    --source and --sink may be given more than once; both are - (standard input and output) by default.
    """
    from pipelines import live as command
    from pipelines.work import options
    from tssgeom.io.network.addresses import access, sink_of, source_of

    stream = command.Stream(
        sources=[source_of(one) for one in source or ["-"]],
        sinks=[sink_of(one) for one in sink or ["-"]],
        access=access(allow_remote=allow_remote, token_file=token_file),
        stale_after=stale_after,
        stats=stats,
        state=state,
        record=record,
        view_port=view_port if view else None,
    )
    raise typer.Exit(command.run(stream, options(rig, tension_in, unit, None)))


@app.command()
def samples(
    out: Annotated[Path, typer.Option("--out", help="Folder to write to.")] = Path("sample_shapes"),
) -> None:
    """Write the sample shapes anew, bit for bit."""
    from pipelines import samples as command

    raise typer.Exit(command.run(out))


@app.command()
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


Shapes = Annotated[Path, typer.Argument(help="A shape, or a recording of a route that moves.")]


@app.command()
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


@app.command()
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


@app.command()
def paper(
    out: Annotated[Path, typer.Option("--out", help="Folder for figures, table and recording.")],
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Draw figures 4 to 8 of the paper from the model, and set its numbers beside ours."""
    from pipelines import paper as command

    raise typer.Exit(command.run(out, as_json=json, quiet=quiet))


@app.command()
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
    elongation_m or _mm, displacement_out_m). Friction and compliance go into the rig; zeros are told only.
    """
    from pipelines import calibrate as command
    from pipelines.work import options

    chosen = options(rig, TENSION_IN, unit, None)
    raise typer.Exit(
        command.run(run, shape, chosen, out=out, from_tension=from_tension, as_json=json, quiet=quiet)
    )


@app.command()
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
            help="Change of δ to stay below [mm]; recommends a curve.",
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
        float, typer.Option("--bend-width-mm", min=0.0, help="Length of sheath that each takes [mm].")
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
    from tssgeom.tendon.remedy import Curve, Cycle, Perturbation

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


@app.command()
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


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the console script; each error is one line on stderr, and the exit status says how it went."""
    sys.exit(_status(arguments))


def _status(arguments: Sequence[str] | None) -> int:
    try:
        status = app(args=arguments, prog_name="tssgeom", standalone_mode=False) or 0
    except typer.TyperException as error:
        return _complain(f"{error.format_message().rstrip('.')}: see tssgeom --help", 2) if str(error) else 2
    except KeyboardInterrupt:
        status = _INTERRUPTED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        return _foreseen(error)
    if status == _INTERRUPTED:
        return _complain("interrupted: the files that were finished are whole", status)
    return status


def _foreseen(error: Exception) -> int:
    """Tell an error that was raised on purpose; raise any other again."""
    from tssgeom.errors import TssgeomError  # here, since it brings the whole package

    if not isinstance(error, TssgeomError):
        raise error
    return _complain(str(error), 2)


def _complain(text: str, status: int) -> int:
    typer.echo("tssgeom: " + " ".join(text.split()), err=True)
    return status

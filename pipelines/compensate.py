"""`tssgeom compensate`: the proximal command that makes the distal end follow a target.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipelines.options import (
    Figures,
    FigureStyle,
    Json,
    Map,
    PolicyChoice,
    Quiet,
    RigFile,
    Shapes,
    ToleranceMm,
    Unit,
)
from pipelines.terminal import print_json, print_line, print_message, print_table
from tssgeom.view.figures.style import choose

if TYPE_CHECKING:
    from tssgeom.io.formats.runs import MeasuredRun
    from tssgeom.io.results.keys.runs import CommandFacts, Compensated, CutCommand
    from tssgeom.tendon.command import Command

TABLE = "compensate.parquet"
_TARGETS = ("displacement_out_m", "tension_out_N")


def compensate(
    target: Annotated[
        Path,
        typer.Option(
            "--target",
            help="Run (CSV, Parquet): time_s and displacement_out_m, tension_out_N or joint_angle_rad, or "
            "bending_x_rad and bending_y_rad.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for compensate.parquet.")],
    shapes: Shapes = None,
    rig: RigFile = None,
    tolerance_mm: ToleranceMm = None,
    policy: PolicyChoice = "cross",
    figures: Figures = None,
    style: FigureStyle = "light",
    unit: Unit = None,
    columns: Map = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Compute the proximal command that makes the distal end follow a target, and its error."""
    from pipelines.inputs import run_settings
    from pipelines.runs import (
        check_run,
        computed_rows,
        measured_run,
        outputs,
        sensed_route,
        temperature_of,
        value_range,
        warn_about_strain,
        warn_about_unused,
    )
    from pipelines.summary_table import with_effects
    from tssgeom.io.formats.columns import CHANNELS
    from tssgeom.io.results.tables import commands_table, write_table
    from tssgeom.tendon import simulation
    from tssgeom.tendon.commander import commander_of

    choose(style)
    settings = run_settings(rig, None, unit, columns=columns, takes_machines=True)
    tolerance = None if tolerance_mm is None else 1e-3 * tolerance_mm
    with outputs(out, TABLE):
        if settings.rig.is_machine:
            from pipelines.machines import compensate_machine

            status = compensate_machine(
                *(shapes, target, out, settings, figures),
                tolerance=tolerance,
                policy=policy,
                as_json=as_json,
                quiet=quiet,
            )
            raise typer.Exit(status)
        commander = commander_of(settings.rig, settings.uncertain, tolerance=tolerance, policy=policy)
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
            commander=commander,
            **{CHANNELS[channel][0]: values},
        )
        title = f"{sensed.name} follows {run.name}"
        commands = computed_rows(rows, run, shapes, title, quiet=quiet or as_json)
        warn_about_strain(target, sensed, settings.rig, max(one.tension_in for one in commands))
        write_table(out / TABLE, commands_table(run.time.tolist(), commands))
        files = [(out / TABLE).as_posix()]
        if figures is not None:
            files += [(figures / file).as_posix() for file in _write_figure(figures, run, channel, commands)]
        facts = _facts(run, commands)
        for line in _lines(facts, commands, tolerance_mm):
            print_message(f"{target}: warning: {line}")
        drive = value_range([one.displacement_in for one in commands])
        tension = value_range([one.tension_in for one in commands])
        if as_json:
            summary: Compensated = {
                "shape": sensed.name,
                "rejected": len(sensed.rejected),
                "run": run.name,
                "target": channel,
                "rows": len(commands),
                "range": {"displacement_in_m": drive, "tension_in_N": tension},
                **facts,
                "files": files,
            }
            print_json(summary)
        elif not quiet:
            title = f"{sensed.name} follows {channel} of {run.name}: {len(commands)} commands"
            cells = (
                channel,
                f"{1e3 * drive[0]:.3f}–{1e3 * drive[1]:.3f}",
                f"{tension[0]:.2f}–{tension[1]:.2f}",
                f"{1e3 * facts['displacement_out_se_m']:.3f}",
                f"{1e3 * facts['displacement_out_se_by_tension_m']:.3f}",
            )
            header = ("target", "drive [mm]", "T_in [N]", "x_out ± by drive [mm]", "by T_in [mm]")
            print_table(title + with_effects(settings), header, [cells])
            print_line(f"table: {out / TABLE}")
        raise typer.Exit(1 if sensed.rejected or facts["limited"] else 0)


def _facts(run: MeasuredRun, commands: Sequence[Command]) -> CommandFacts:
    """Return the part of `--json` on errors, limits and tolerance; errors are the greatest of the run."""
    from tssgeom.tendon.command_error import MOST_OUTSIDE

    risks = [each.out_of_tolerance or 0.0 for each in commands]
    worst = max(range(len(risks)), key=risks.__getitem__)
    cut = [row for row, each in enumerate(commands) if each.limited]
    flagged = sum(risk > MOST_OUTSIDE for risk in risks)
    return {
        "displacement_out_se_m": max(each.errors.displacement_out for each in commands),
        "tension_out_se_N": max(each.errors.tension_out for each in commands),
        "displacement_out_se_by_tension_m": max(each.errors.displacement_out_by_tension for each in commands),
        "tension_out_se_by_tension_N": max(each.errors.tension_out_by_tension for each in commands),
        "limited": [
            {
                "time_s": float(run.time[row]),
                "limits": commands[row].limited,
                "displacement_reached_m": commands[row].displacement_reached,
                "tension_reached_N": commands[row].tension_reached,
            }
            for row in cut
        ],
        "waits": sum(each.waits for each in commands),
        "out_of_tolerance": None
        if commands[0].out_of_tolerance is None
        else {"targets": flagged, "worst": risks[worst], "time_s": float(run.time[worst])},
    }


def _lines(facts: CommandFacts, commands: Sequence[Command], tolerance_mm: float | None) -> Iterator[str]:
    """Say which commands are cut, where the drive lets go, and which targets are out of tolerance."""
    count = len(commands)
    limited = list(zip(facts["limited"], (each for each in commands if each.limited), strict=True))
    cut = [one for one, command in limited if not command.lets_go]
    let_go = [one for one, command in limited if command.lets_go]
    if cut:
        first = cut[0]
        yield (
            f"{len(cut)} of {count} commands are cut by drive.limits, the first at "
            f"{first['time_s']:g} s by {first['limits']}: {_reached(first)}"
        )
    if let_go:
        first = let_go[0]
        yield (
            f"{len(let_go)} of {count} targets are below what friction holds without any pull, so that the "
            f"drive lets go, first at {first['time_s']:g} s: {_reached(first)}; ask for more, or give it "
            "more time"
        )
    if (risk := facts["out_of_tolerance"]) and risk["targets"]:
        yield (
            f"{risk['targets']} of {count} targets may be missed by more than {tolerance_mm:g} mm with a "
            f"probability above 5 %, the worst at {risk['time_s']:g} s with {risk['worst']:.0%}"
        )


def _reached(cut: CutCommand) -> str:
    return f"{1e3 * cut['displacement_reached_m']:.4g} mm and {cut['tension_reached_N']:.4g} N are reached"


def _write_figure(folder: Path, run: MeasuredRun, channel: str, commands: Sequence[Command]) -> list[str]:
    from pipelines.figures import write_figures
    from tssgeom.view.figures.commands import command_figure

    values, by_tension = run.channel((channel,))[1], channel == _TARGETS[1]
    figure = partial(command_figure, run.time, values, commands, by_tension=by_tension)
    return write_figures(folder, run.name, {"commands": figure})

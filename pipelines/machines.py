"""`tssgeom simulate` and `compensate` of rigs with several tendons, a joint or a segment."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines.terminal import print_json, print_line, print_message, print_table
from tssgeom.arrays import Vector

if TYPE_CHECKING:
    from pipelines.inputs import RunSettings
    from tssgeom.api.inputs import SensedFrames
    from tssgeom.api.machine_calls import MachineChannels
    from tssgeom.io.formats.runs import MeasuredRun
    from tssgeom.route.pieces import Arcs
    from tssgeom.tendon.commander import Policy
    from tssgeom.tendon.machine import Machine


def simulate_machine(
    shapes: Path | None,
    drive: Path,
    out: Path,
    settings: RunSettings,
    figures: Path | None,
    *,
    as_json: bool,
    quiet: bool,
) -> int:
    """Take a machine through the run of a drive, and write table and pictures; return the exit status."""
    from pipelines.runs import errors_naming, measured_run, sensed_route
    from tssgeom.api.machine_calls import simulated_machine
    from tssgeom.io.results.csv_table import write_channels

    run = measured_run(drive, settings)
    sensed = sensed_route(shapes, settings)
    with errors_naming(drive, shapes):
        done = simulated_machine(run, _machine(shapes, sensed, settings))
    table, picture = out / "simulate.parquet", out / "simulate.rrd"
    write_channels(table, done.channels)
    _write_picture(picture, f"{sensed.name} driven by {run.name}", sensed, done)
    title = f"{sensed.name} driven by {done.drive} of {run.name}"
    pictures = _write_figures(figures, title, run, done)
    _print_channels(
        f"{title}: {len(run.time)} rows",
        done.channels,
        {"shape": sensed.name, "run": run.name, "drive": done.drive, "rows": len(run.time)},
        [table, picture, *pictures],
        as_json=as_json,
        quiet=quiet,
    )
    return 1 if sensed.rejected else 0


def compensate_machine(
    shapes: Path | None,
    target: Path,
    out: Path,
    settings: RunSettings,
    figures: Path | None,
    *,
    tolerance: float | None,
    policy: Policy,
    as_json: bool,
    quiet: bool,
) -> int:
    """Compute what the drives have to do so that the end follows a target; returns the exit status."""
    from pipelines.runs import errors_naming, measured_run, sensed_route
    from tssgeom.api.machine_calls import commanded_machine
    from tssgeom.io.results.csv_table import write_channels

    run = measured_run(target, settings)
    sensed = sensed_route(shapes, settings)
    with errors_naming(target, shapes):
        arcs = _first_route(shapes, sensed)
        done = commanded_machine(
            run, arcs, settings.rig, settings.uncertain, tolerance=tolerance, policy=policy
        )
    for warning in done.warnings:
        print_message(f"{target}: warning: {warning}")
    table = out / "compensate.parquet"
    write_channels(table, done.channels)
    title = f"{sensed.name} follows {done.drive} of {run.name}"
    pictures = _write_figures(figures, title, run, done)
    _print_channels(
        f"{title}: {len(run.time)} commands",
        done.channels,
        {"shape": sensed.name, "run": run.name, "target": done.drive, "rows": len(run.time)},
        [table, *pictures],
        as_json=as_json,
        quiet=quiet,
    )
    return 1 if sensed.rejected or done.warnings else 0


def _machine(shapes: Path | None, sensed: SensedFrames, settings: RunSettings) -> Machine:
    """Return the rig on a shape, the same for all tendons; of a recording on its first one."""
    from tssgeom.api.machine_calls import machine_on

    return machine_on(_first_route(shapes, sensed), settings.rig)


def _first_route(shapes: Path | None, sensed: SensedFrames) -> list[Arcs]:
    first, *others = sensed.results
    if others:
        print_message(f"{shapes}: warning: a machine stands on one route: the first frame is used")
    return [first.arcs]


def _write_figures(folder: Path | None, title: str, run: MeasuredRun, done: MachineChannels) -> list[Path]:
    """Write the figure of a run where a folder is given, and return its files."""
    if folder is None:
        return []
    from pipelines.figures import write_figures
    from tssgeom.view.figures.machine import computed_figure

    given = "of the run" if done.reached is None else "target"
    draw = partial(computed_figure, title, done.channels, run.columns, given)
    return [folder / file for file in write_figures(folder, run.name, {"machine": draw})]


def _write_picture(path: Path, name: str, sensed: SensedFrames, done: MachineChannels) -> None:
    from tssgeom.summary import LIMITS as SUMMARY
    from tssgeom.view.samples import evenly, route_samples
    from tssgeom.view.scene.machine import write_machine_recording

    path.parent.mkdir(parents=True, exist_ok=True)
    assert done.tension is not None
    at = evenly(len(done), SUMMARY.kept)
    routes = [route_samples(sensed.results[0])] * done.machine.count
    channels = {channel: values[at] for channel, values in done.channels.items()}
    time = channels.pop("time_s")
    write_machine_recording(path, name, done.machine, routes, time, channels, done.tension[at])


def _print_channels(
    title: str,
    channels: Mapping[str, Vector],
    facts: Mapping[str, Any],
    files: list[Path],
    *,
    as_json: bool,
    quiet: bool,
) -> None:
    computed = {name: values for name, values in channels.items() if name != "time_s"}
    ranges = {name: [float(values.min()), float(values.max())] for name, values in computed.items()}
    if as_json:
        print_json({**facts, "range": ranges, "files": [file.as_posix() for file in files]})
    elif not quiet:
        rows = [[name, f"{low:.5g}", f"{high:.5g}"] for name, (low, high) in ranges.items()]
        print_table(title, ("channel", "least", "greatest"), rows)
        scene = next((f"   picture: tssgeom view {file}" for file in files if file.suffix == ".rrd"), "")
        print_line(f"table: {files[0]}{scene}")

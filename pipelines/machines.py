"""`tssgeom simulate` and `compensate` of rigs with several tendons, a joint or a segment."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipelines.terminal import print_json, print_line, print_message, print_table
from tssgeom.arrays import Vector
from tssgeom.errors import SettingsError
from tssgeom.mechanism import NO_LIMITS

if TYPE_CHECKING:
    from pipelines.inputs import RunSettings
    from pipelines.runs import SensedRoute
    from tssgeom.tendon.machine import Machine

MOST_PLOTTED = 400
"""Moments of a run in its picture; chosen: as many as of one tendon."""
_TARGET = "joint_angle_rad"


def simulate_machine(
    shapes: Path, drive: Path, out: Path, settings: RunSettings, *, as_json: bool, quiet: bool
) -> int:
    """Take a machine through the run of a drive, and write its table and picture; returns the exit status."""
    from pipelines.runs import errors_naming, measured_run, sensed_route
    from tssgeom.io.results.tables import write_channels
    from tssgeom.tendon.machine_simulation import drive_of, simulated

    run = measured_run(drive, settings)
    sensed = sensed_route(shapes, settings)
    machine = _machine(shapes, sensed, settings)
    columns = _complete(drive, run.columns)
    name = drive_of(columns, machine.count)
    with errors_naming(drive, shapes):
        end_given = settings.rig.end.given == "angle" and _TARGET in columns
        done = simulated(machine, columns, drive=name, end_given=end_given, profile=True)
    table, picture = out / "simulate.parquet", out / "simulate.rrd"
    write_channels(table, {"time_s": run.time, **done.channels})
    _write_picture(picture, f"{sensed.name} driven by {run.name}", machine, sensed, run.time, done)
    _print_channels(
        f"{sensed.name} driven by {name} of {run.name}: {len(run.time)} rows",
        done.channels,
        {"shape": sensed.name, "run": run.name, "drive": name, "rows": len(run.time)},
        [table, picture],
        as_json=as_json,
        quiet=quiet,
    )
    return 1 if sensed.rejected else 0


def compensate_machine(
    shapes: Path, target: Path, out: Path, settings: RunSettings, *, as_json: bool, quiet: bool
) -> int:
    """Compute the angle of the motor that turns the joint as wanted; returns the exit status."""
    from pipelines.runs import errors_naming, measured_run, sensed_route
    from tssgeom.io.results.tables import write_channels
    from tssgeom.tendon.machine_command import command_machine

    run = measured_run(target, settings)
    if _TARGET not in run.columns:
        raise SettingsError(f"{target}: no column {_TARGET}: a joint follows the angle in it; add one")
    if settings.rig.drive.limits != NO_LIMITS:
        print_message(
            f"{target}: warning: drive.limits cut the commands of one tendon on a spring, not these"
        )
    sensed = sensed_route(shapes, settings)
    machine = _machine(shapes, sensed, settings)
    columns = _complete(target, run.columns)
    with errors_naming(target, shapes):
        commands = command_machine(machine, run.time, columns[_TARGET], columns.get("joint_torque_Nm"))
    for row in np.flatnonzero(~commands.reached)[:1]:
        wanted, reached = columns[_TARGET][row], commands.joint_angle[row]
        print_message(
            f"{target}: warning: {int((~commands.reached).sum())} targets are out of reach, the first at "
            f"{run.time[row]:g} s: {wanted:.4g} rad is wanted, {reached:.4g} reached"
        )
    channels = {"motor_angle_rad": commands.motor_angle, _TARGET: commands.joint_angle}
    for which in range(machine.count):
        channels[f"tension_in_{which + 1}_N"] = commands.ends[:, which, 0]
        channels[f"displacement_in_{which + 1}_m"] = commands.ends[:, which, 2]
    table = out / "compensate.parquet"
    write_channels(table, {"time_s": run.time, **channels})
    _print_channels(
        f"{sensed.name} follows {_TARGET} of {run.name}: {len(run.time)} commands",
        channels,
        {"shape": sensed.name, "run": run.name, "target": _TARGET, "rows": len(run.time)},
        [table],
        as_json=as_json,
        quiet=quiet,
    )
    return 1 if sensed.rejected or not commands.reached.all() else 0


def _machine(shapes: Path, sensed: SensedRoute, settings: RunSettings) -> Machine:
    """Return the rig on a shape, the same for all tendons; of a recording on its first one."""
    from tssgeom.identify.machine_run import routed
    from tssgeom.tendon.machine import machine_of

    if len(sensed.results) > 1:
        print_message(f"{shapes}: warning: a machine stands on one route: the first frame is used")
    return machine_of(settings.rig, [routed(sensed.results[0].arcs, settings.rig)])


def _complete(path: Path, columns: Mapping[str, Vector]) -> Mapping[str, Vector]:
    for name, values in columns.items():
        missing = np.flatnonzero(~np.isfinite(values))
        if len(missing):
            time = columns["time_s"][missing[0]]
            raise SettingsError(f"{path}: {name} has no value at time_s = {time:g}: fill every row")
    return columns


def _write_picture(
    path: Path, name: str, machine: Machine, sensed: SensedRoute, time: Vector, done: Any
) -> None:
    from tssgeom.view.samples import evenly, route_samples
    from tssgeom.view.scene.machine import write_machine_recording

    path.parent.mkdir(parents=True, exist_ok=True)
    at = evenly(len(time), MOST_PLOTTED)
    routes = [route_samples(sensed.results[0])] * machine.count
    channels = {channel: values[at] for channel, values in done.channels.items()}
    write_machine_recording(path, name, machine, routes, time[at], channels, done.tension[at])


def _print_channels(
    title: str,
    channels: Mapping[str, Vector],
    facts: Mapping[str, Any],
    files: list[Path],
    *,
    as_json: bool,
    quiet: bool,
) -> None:
    ranges = {name: [float(values.min()), float(values.max())] for name, values in channels.items()}
    if as_json:
        print_json({**facts, "range": ranges, "files": [file.as_posix() for file in files]})
    elif not quiet:
        rows = [[name, f"{low:.5g}", f"{high:.5g}"] for name, (low, high) in ranges.items()]
        print_table(title, ("channel", "least", "greatest"), rows)
        picture = f"   picture: tssgeom view {files[1]}" if len(files) > 1 else ""
        print_line(f"table: {files[0]}{picture}")

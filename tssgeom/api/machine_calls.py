"""`simulate`, `compensate` and `calibrate` of rigs with several tendons, a joint or unknown numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.channel_names import numbered, unit_of
from tssgeom.errors import SettingsError, TssgeomError
from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_estimates import MachineCalibration
from tssgeom.identify.machine_run import MachineRun, machine_run
from tssgeom.io.formats.runs import MeasuredRun
from tssgeom.mechanism import tendon_count
from tssgeom.result import Result
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.command_error import MOST_OUTSIDE
from tssgeom.tendon.commander import Policy
from tssgeom.tendon.machine import Machine, machine_of, route_of_rig, routed
from tssgeom.tendon.machine_channels import as_read, without_zero
from tssgeom.tendon.machine_command import MayWait, command_machine
from tssgeom.tendon.machine_commander import machine_commander_of, output_errors, risk_of
from tssgeom.tendon.machine_simulation import drive_of, simulated
from tssgeom.tendon.machine_target import Following, following, lever, name_of
from tssgeom.uncertain import Uncertain


@dataclass(frozen=True, slots=True, repr=False)
class MachineChannels(Result):
    """Channels of a machine over a run, as `simulate` and `compensate` compute them.

    As a table it has the columns of `simulate.parquet` or `compensate.parquet` (docs/machines.md).
    """

    channels: Mapping[str, Vector]
    """Columns by their names in files, `time_s` first; each [n] in the unit of its name."""
    drive: str
    """Name of the drive of the run, or of the target."""
    machine: Machine
    """The machine on its routes."""
    tension: Vector | None = None
    """Tension along each tendon at each time [N]; None of commands."""
    reached: Vector | None = None
    """[n] Whether the end gets where it is wanted; None of a simulation."""
    warnings: tuple[str, ...] = ()
    """What to know of the run, a sentence each."""

    def __len__(self) -> int:
        return len(self.channels["time_s"])


def machine_on(arcs: Sequence[Arcs], rig: Rig) -> Machine:
    """Return the rig on its routes, one for all tendons or one for each."""
    return machine_of(rig, [routed(each, rig) for each in arcs])


def simulated_machine(run: MeasuredRun, machine: Machine) -> MachineChannels:
    """Take a machine through the drive of a run.

    Raises
    ------
    SettingsError
        Where the run has no drive for the machine, or a sample is missing.
    FitError
        Where the machine has no equilibrium.
    """
    columns = _complete(run)
    name = drive_of(columns, machine.count)
    end_given = machine.rig.end.given == "angle" and "joint_angle_rad" in columns
    done = simulated(machine, columns, drive=name, end_given=end_given, profile=True)
    return MachineChannels({"time_s": run.time, **done.channels}, name, machine, done.tension)


def commanded_machine(
    run: MeasuredRun,
    arcs: Sequence[Arcs],
    rig: Rig,
    uncertain: Sequence[Uncertain] = (),
    *,
    tolerance: float | None = None,
    policy: Policy = "cross",
) -> MachineChannels:
    """Return what the drives have to do, as their sensors read it, so that the end follows targets of a run.

    The targets are `joint_angle_rad` of a joint, `bending_x_rad` and `bending_y_rad` of a segment, one
    `tension_out_k_N` of a blocked end for each motor. With the policy `wait` the drives are held inside the
    dead zone while the end misses its target by no more than the tolerance [m]. A drive that follows its
    command later gets it earlier. Where a tolerance is given, or numbers of the rig are `uncertain`, what
    follows has standard errors too.

    Raises
    ------
    SettingsError
        Where the run has no target, a sample is missing, or nothing of the machine follows one.
    FitError
        Where the machine has no equilibrium.
    """
    if tolerance is not None and not 0.0 < tolerance < math.inf:
        raise SettingsError(f"--tolerance-mm is {1e3 * tolerance:g} mm: give a finite value > 0 mm")
    follows = _followed(run, rig)
    columns, machine = _complete(run), machine_on(arcs, rig)
    commander = machine_commander_of(rig, tolerance=tolerance, waits=policy == "wait")
    targets = {name: columns[name] for name in follows.outputs if name in columns}
    wanted = np.column_stack([targets.get(name, 0.0 * run.time) for name in follows.outputs])
    load = without_zero(columns, "joint_torque_Nm", rig)

    def near_enough(of_end: Matrix) -> MayWait:
        return lambda miss, _: float(np.linalg.norm(of_end @ miss)) <= (tolerance or 0.0)

    wait = [near_enough(lever(rig, each)) for each in wanted] if commander.waits else ()
    commands = command_machine(machine, run.time, targets, load, wait)
    channels = dict[str, Vector]()
    for name, values in zip(follows.inputs, commands.inputs.T, strict=True):
        sent = np.interp(run.time - rig.drive.lag_s, run.time, values)
        channels[name] = as_read(sent, name, rig)
    driven = {"time_s": run.time, **channels}
    channels |= dict(zip(follows.outputs, commands.outputs.T, strict=True))
    for row, name in ((0, "tension_in_N"), (2, "displacement_in_m")):
        for which, channel in enumerate(numbered(name, machine.count)):
            channels.setdefault(channel, commands.ends[:, which, row])
    cut = [name for name in dict.fromkeys(commands.limited) if name]
    causes = {
        "targets are out of reach": ~commands.reached,
        **{
            f"commands are cut by drive.limits.{name}": [each == name for each in commands.limited]
            for name in cut
        },
    }
    if tolerance is not None or any(each.stated for each in uncertain) or rig.unexplained:
        driven |= {name: columns[name] for name in columns.keys() & {"joint_torque_Nm"}}
        covariance = output_errors(arcs, rig, driven, uncertain, follows.outputs)
        errors = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        channels |= {name_of(name, "se"): errors[:, k] for k, name in enumerate(follows.outputs)}
        if tolerance is not None:
            each = zip(wanted, commands.outputs, covariance, strict=True)
            risk = np.array([risk_of(rig, *one, tolerance) for one in each])
            channels["out_of_tolerance"] = risk
            where = _WHERE.get(rig.end.kind, "")
            beyond = f"targets may be missed by more than {1e3 * tolerance:g} mm{where}"
            causes[f"{beyond} with a probability above {100.0 * MOST_OUTSIDE:g} %"] = risk > MOST_OUTSIDE
    rows = [(said, np.flatnonzero(are)) for said, are in causes.items()]
    warnings = tuple(
        f"{len(at)} {said}, the first at {run.time[at[0]]:g} s: {_values(wanted[at[0]], follows)} is wanted, "
        f"{', '.join(f'{each:.4g}' for each in commands.outputs[at[0]])} reached"
        for said, at in rows
        if len(at)
    )
    of = {"reached": commands.reached, "warnings": warnings}
    return MachineChannels({"time_s": run.time, **channels}, ", ".join(follows.outputs), machine, **of)


_WHERE = {"joint": " at the lever arm of the joint", "segment": " by the end of the segment"}


def _followed(run: MeasuredRun, rig: Rig) -> Following:
    try:
        return following(rig, run.columns)
    except SettingsError as error:
        raise SettingsError(f"{run.path}: {error}") from error


def _values(wanted: Vector, follows: Following) -> str:
    unit = unit_of(follows.outputs[0])
    return ", ".join(f"{each:.4g}" for each in wanted) + f" {unit}"


def _complete(run: MeasuredRun) -> Mapping[str, Vector]:
    for name, values in run.columns.items():
        missing = np.flatnonzero(~np.isfinite(values))
        if len(missing):
            time = run.time[missing[0]]
            raise SettingsError(f"{run.path}: {name} has no value at time_s = {time:g}: fill every row")
    return run.columns


def fitted_machine(
    runs: Sequence[MeasuredRun],
    arcs: Sequence[Arcs],
    rig: Rig,
    uncertain: Sequence[Uncertain],
    progress: Callable[[str, float], Any] = lambda step, share: None,
) -> MachineCalibration:
    """Fit a machine, or the unknown numbers of a rig, to runs; `arcs` as `routes_of_runs` takes them.

    Raises
    ------
    SettingsError
        Where a run or the number of routes cannot be used.
    FitError
        Where nothing can be fitted.
    """
    pairs = zip(runs, routes_of_runs(len(runs), arcs, rig), strict=True)
    on_routes = [_on_routes(run, each, rig) for run, each in pairs]
    return calibrate_machine(on_routes, rig, uncertain, progress=progress)


def _on_routes(run: MeasuredRun, arcs: Sequence[Arcs], rig: Rig) -> MachineRun:
    try:
        return machine_run(run.name, run.columns, list(arcs), rig)
    except TssgeomError as error:
        raise type(error)(f"{run.path}: {str(error).removeprefix(f'{run.name}: ')}") from error


def routes_of_runs(runs: int, arcs: Sequence[Arcs], rig: Rig) -> list[list[Arcs]]:
    """Return the routes of each run: of the rig where none is given, one for all, one a run, or one a tendon.

    Raises
    ------
    SettingsError
        Where the number of routes fits neither runs nor tendons.
    """
    tendons = tendon_count(rig.drive, rig.end)
    if not arcs:
        return [[route_of_rig(rig)]] * runs
    if len(arcs) == 1:
        return [list(arcs)] * runs
    if len(arcs) == runs:
        return [[each] for each in arcs]
    if len(arcs) == tendons:
        return [list(arcs)] * runs
    if len(arcs) == runs * tendons:
        return [list(arcs[k * tendons : (k + 1) * tendons]) for k in range(runs)]
    raise SettingsError(
        f"{len(arcs)} shapes for {_counted(runs, 'run')} of {_counted(tendons, 'tendon')}: give one for all, "
        "one a run, one a tendon, or those of each run one after the other"
    )


def _counted(count: int, thing: str) -> str:
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"

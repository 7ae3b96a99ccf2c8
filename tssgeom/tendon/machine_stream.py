"""A machine of which one frame comes at a time: its route, its drive, and the command for its target.

Source: docs/model.md (171)-(178), (184), (218).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.channel_names import numbered
from tssgeom.errors import SettingsError
from tssgeom.mechanism import channels_of, tendon_count
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.route.route_fit import NO_ERRORS, SharedErrors
from tssgeom.tendon.bars import base
from tssgeom.tendon.bars.bar_state import BarState
from tssgeom.tendon.bars.plant import Memory
from tssgeom.tendon.capstan import MOST_TENSION, Transmission
from tssgeom.tendon.machine import Machine, machine_of, on_routes, routed
from tssgeom.tendon.machine_channels import as_read, without_zero
from tssgeom.tendon.machine_command import MayWait, next_command
from tssgeom.tendon.machine_history import GIVEN_DRIVES, DriveName, MachineHistory
from tssgeom.tendon.machine_simulation import (
    begun,
    drive_channels,
    drive_of,
    simulated,
    with_pending,
    with_torque,
)
from tssgeom.tendon.machine_target import (
    Following,
    following,
    name_of,
    possible_inputs,
    possible_outputs,
    wanted_of,
    without_targets,
)
from tssgeom.tendon.moving import unmoved
from tssgeom.tendon.state import SHARPER, TendonState


@dataclass(frozen=True, slots=True)
class CarriedMachine:
    """A machine between two frames: the route on which it lies, and its history; neither before the first."""

    machine: Machine | None = None
    route: Arcs | None = None
    """As sensed; that of the machine has what the rig says of it."""
    history: MachineHistory | None = None
    way: int = 1
    """Way of the first tendon: +1 pulling, −1 releasing."""

    @property
    def time(self) -> float:
        """Time of the last frame [s]; NaN before the first."""
        return math.nan if self.history is None else self.history.time


class MachineCommand(NamedTuple):
    """What the drives have to do for the target of a frame."""

    inputs: Mapping[str, float]
    """Angle of the motor [rad], or position of each drive [m], as sensors read it, by channel."""
    outputs: Mapping[str, float]
    """What the end gets to, by the channel that follows."""
    reached: bool
    """Whether that is the target."""
    limited: str = ""
    """Limits of the drive that cut it, by their keys in `[drive] limits`."""
    waits: bool = False
    """Whether the drives are held inside the dead zone."""
    errors: Mapping[str, float] = {}
    """Standard errors of the outputs; none where none is computed."""
    out_of_tolerance: float | None = None
    """Probability that the end misses its target by more than the tolerance [1]; None without one."""

    @property
    def numbers(self) -> dict[str, float]:
        """It by the names of answers and tables: what it gets to only where that is not the target."""
        misses = not self.reached or bool(self.limited) or self.waits
        return {
            **{name_of(each, "command"): value for each, value in self.inputs.items()},
            **({name_of(each, "reached"): value for each, value in self.outputs.items()} if misses else {}),
            **{name_of(each, "se"): value for each, value in self.errors.items()},
        }


class MachineMoment(NamedTuple):
    """What a machine does in a frame."""

    state: CarriedMachine
    channels: Mapping[str, float]
    """What every channel reads, by name."""
    command: MachineCommand | None
    """What the motor has to do for the target, where the frame has one."""
    tendon: TendonState
    """The first tendon, as pictures draw it."""
    transmission: Transmission
    """Both ends of the first tendon."""
    driven: bool
    """Whether the frame brings a drive or a target."""

    @property
    def numbers(self) -> dict[str, float]:
        """Channels, and the command where there is one, by the names of answers and tables."""
        return {**self.channels, **({} if self.command is None else self.command.numbers)}


def moved_machine(
    state: CarriedMachine,
    arcs: Arcs,
    rig: Rig,
    readings: Mapping[str, float],
    *,
    time: float,
    tension_in: float,
    shared: SharedErrors = NO_ERRORS,
    may_wait: MayWait | None = None,
) -> MachineMoment:
    """Take a machine through one frame.

    Parameters
    ----------
    state
        The machine before it.
    arcs
        Its route as sensed, that of all tendons.
    rig
        The machine.
    readings
        What the frame measures, by channel, and its targets. The first frame decides what drives.
    time
        Time of the frame [s].
    tension_in
        Tension of each tendon before a frame has brought a drive or a target [N].
    shared
        Errors of the route that all frames share, of which the standard errors hold the effect.
    may_wait
        Says whether a motor inside the dead zone may be held there; left out, it crosses at once.

    Raises
    ------
    SettingsError
        Where the frame lacks the drive, or the rig what it needs.
    FitError
        Where the machine has no equilibrium.
    """
    machine, route, before = _on_route(state, arcs, rig)
    measured, targets = without_targets(readings, rig)
    run = dict(with_torque({name: np.array([value]) for name, value in measured.items()}, rig))
    run["time_s"] = np.array([time])
    drive, is_driven = driven_by(run, before, rig, machine.count, targets)
    if before is None:
        before = begun(machine, drive, run["time_s"])
    if not is_driven and not targets:
        run |= held_drive(drive, machine, tension_in)
    end_given = rig.end.given == "angle" and "joint_angle_rad" in run
    elapsed = 0.0 if state.history is None else max(time - state.time, 0.0)
    command = None
    if not is_driven and targets:
        command = command_of(machine, before, run, targets, elapsed, may_wait)
        run |= {name: np.array([value]) for name, value in command.inputs.items()}
    done = simulated(machine, run, end_given=end_given, before=before)
    if is_driven and targets:
        command = command_of(machine, done.history, run, targets, elapsed, may_wait)
    channels = {name: float(values[0]) for name, values in done.channels.items()}
    _check(done.history, drive)
    after = CarriedMachine(machine, route, done.history, state.way)
    tendon, ends = first_tendon(after, machine, done.history, channels, shared)
    after = replace(after, way=ends.direction_index)
    return MachineMoment(after, channels, command, tendon, ends, is_driven or bool(targets))


def _on_route(state: CarriedMachine, arcs: Arcs, rig: Rig) -> tuple[Machine, Arcs, MachineHistory | None]:
    """Return the machine on the route of a frame: on another one only where it has moved; (80), (218)."""
    known, history = state.route, state.history
    if known is None or history is None:
        return machine_of(rig, [routed(arcs, rig)]), arcs, None
    machine = state.machine or machine_of(rig, [routed(known, rig)])
    if arcs is known or (unmoved(known, arcs) and arcs.total_angle_se >= SHARPER * known.total_angle_se):
        return machine, known, history
    machine, tendons = on_routes(machine, history.state, [routed(arcs, rig)])
    return machine, arcs, history._replace(state=tendons)


def driven_by(
    run: Mapping[str, Any], before: MachineHistory | None, rig: Rig, count: int, targets: Mapping[str, float]
) -> tuple[DriveName, bool]:
    """Return what drives, and whether the frame brings it.

    Raises
    ------
    SettingsError
        Where an earlier frame brought it and this one does not.
    """
    brought = brings_drive(run, rig)
    if before is None and brought:
        return drive_of(run, count), True
    if before is None:
        if targets:
            return following(rig, targets).drive, False
        return ("displacement_in" if rig.end.kind == "carried" else "tension_in"), False
    names = drive_channels(before.drive, count)
    if all(name in run for name in names):
        return before.drive, True
    if brought or (targets and before.drive != following(rig, targets).drive):
        raise SettingsError(f"no {names[0]}, which drove before: give it in each frame, or begin anew")
    return before.drive, False


def brings_drive(readings: Mapping[str, Any], rig: Rig) -> bool:
    """Whether readings have every channel of some drive."""
    if "motor_current_A" in readings and rig.drive.torque_constant_Nm_per_A > 0.0:
        return True
    count = tendon_count(rig.drive, rig.end)
    return any(all(each in readings for each in drive_channels(name, count)) for name in GIVEN_DRIVES)


def _check(history: MachineHistory, drive: str) -> None:
    """Refuse a drive that no tendon could bear, with a SettingsError."""
    most = max(float(Memory(row).tension.max()) for row in history.state.memory)
    if not most <= MOST_TENSION:
        raise SettingsError(f"{drive} makes a tension of {most:.3g} N: check its unit")


def held_drive(drive: DriveName, machine: Machine, tension_in: float) -> dict[str, Vector]:
    """Return the drive of a frame that brings none: `tension_in` [N] of all tendons, or a drive at rest.

    Raises
    ------
    SettingsError
        Where another drive drove before.
    """
    names = drive_channels(drive, machine.count)
    if drive == "tension_in":
        return {name: np.array([tension_in]) for name in names}
    if drive == "displacement_in" and machine.rig.end.kind == "carried":
        return {name: np.zeros(1) for name in names}
    raise SettingsError(f"no {names[0]}, which drove before: give it in each frame, or begin anew")


def command_of(
    machine: Machine,
    history: MachineHistory,
    run: Mapping[str, Vector],
    targets: Mapping[str, float],
    elapsed: float,
    may_wait: MayWait | None,
) -> MachineCommand:
    """Return what the drives have to do for the targets of a frame from where the machine stands."""
    rig, follows = machine.rig, following(machine.rig, targets)
    history = with_pending(machine, history, float(run["time_s"][0]))
    span = max(float(run["time_s"][0]) - history.time, 0.0)
    load = float(without_zero(run, "joint_torque_Nm", rig)[0])
    target = wanted_of(follows, targets)
    done = next_command(machine, history, follows, span, load, target, elapsed, may_wait)
    outputs = dict(zip(follows.outputs, done.outputs.tolist(), strict=True))
    inputs = as_inputs(follows, done.inputs, rig)
    return MachineCommand(inputs, outputs, done.reached, done.limited, done.waits)


def as_inputs(follows: Following, inputs: Vector, rig: Rig) -> dict[str, float]:
    """Return inputs [c] as their sensors read them, by channel."""
    pairs = zip(follows.inputs, inputs.tolist(), strict=True)
    return {name: as_read(value, name, rig) for name, value in pairs}


def first_tendon(
    after: CarriedMachine,
    machine: Machine,
    history: MachineHistory,
    channels: Mapping[str, float],
    shared: SharedErrors,
) -> tuple[TendonState, Transmission]:
    """Return the first tendon as if it were the only one, and both its ends; docs/model.md (49)."""
    route, rig = after.route, machine.rig
    assert route is not None
    memory = Memory(history.state.memory[0])
    way = int(memory.slip[0]) or after.way
    names = ("displacement_in_m", "displacement_out_m")
    moved_in, moved_out = (channels[next(numbered(name, machine.count))] for name in names)
    along = BarState(
        edge=machine.edge,
        memory=memory,
        displacement_in=moved_in,
        displacement_out=moved_out,
        elongation=moved_in - moved_out,
        direction_index=way,
        length=route.total_length,
    )
    ends = base.transmit(along, routed(shared.on(route), rig), rig)
    return TendonState(along, route, history.time, ends.tension_out_se), ends


def greatest_pull(channels: Mapping[str, float]) -> float:
    """Return the greatest proximal tension among channels of a machine [N]."""
    return max((value for name, value in channels.items() if name.startswith("tension_in")), default=0.0)


def columns_of(rig: Rig) -> tuple[str, ...]:
    """Return the columns that frames of a machine may have in tables; none of one tendon on a spring.

    They are the names of `MachineMoment.numbers`, then the targets and what was measured.
    """
    if not rig.is_machine:
        return ()
    channels, outputs = channels_of(rig.drive, rig.end), possible_outputs(rig)
    names = [name_of(each, "command") for each in (possible_inputs(rig) if outputs else ())]
    names += [name_of(each, role) for each in outputs for role in ("reached", "se", "target")]
    return (*channels, *names, *(f"measured_{each}" for each in channels))

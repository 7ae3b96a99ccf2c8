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
from tssgeom.errors import SettingsError
from tssgeom.mechanism import numbered, tendon_count
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.route.resolution import NO_ERRORS, SharedErrors
from tssgeom.tendon import transmission
from tssgeom.tendon.bars.bar_state import BarState
from tssgeom.tendon.bars.plant import Memory
from tssgeom.tendon.capstan import MOST_TENSION
from tssgeom.tendon.machine import Machine, machine_of, on_routes, routed
from tssgeom.tendon.machine_channels import as_read, without_zero
from tssgeom.tendon.machine_command import MayWait, next_angle
from tssgeom.tendon.machine_history import GIVEN_DRIVES, DriveName, MachineHistory
from tssgeom.tendon.machine_simulation import (
    begun,
    drive_channels,
    drive_of,
    simulated,
    with_pending,
    with_torque,
)
from tssgeom.tendon.moving import unmoved
from tssgeom.tendon.state import SHARPER, TendonState
from tssgeom.tendon.transmission import Transmission

JOINT_TARGET = "joint_angle_target_rad"
"""Reading of a frame that is no measurement: the angle at which the joint is wanted."""


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
    """What the motor has to do for the target of a frame."""

    motor_angle: float
    """Angle at which the joint gets where it is wanted, as the sensor of the motor reads it [rad]."""
    joint_angle: float
    """Angle that the joint gets to [rad]."""
    reached: bool
    """Whether that is the target."""
    limited: str = ""
    """Limits of the drive that cut it, by their keys in `[drive] limits`."""
    waits: bool = False
    """Whether the motor is held inside the dead zone."""
    joint_angle_se: float | None = None
    """Standard error of the angle that the joint gets to [rad]; None where no error is computed."""
    out_of_tolerance: float | None = None
    """Probability that the joint misses its target by more than the tolerance [1]; None without one."""


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
        if self.command is None:
            return dict(self.channels)
        command = {"motor_angle_command_rad": self.command.motor_angle}
        if not self.command.reached or self.command.limited or self.command.waits:
            command["joint_angle_reached_rad"] = self.command.joint_angle
        if self.command.joint_angle_se is not None:
            command["joint_angle_se_rad"] = self.command.joint_angle_se
        return {**self.channels, **command}


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
        What the frame measures, by channel, and `joint_angle_target_rad`. The first one decides what drives.
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
    target = readings.get(JOINT_TARGET)
    run = dict(with_torque({name: np.array([value]) for name, value in readings.items()}, rig))
    run["time_s"] = np.array([time])
    drive, is_driven = driven_by(run, before, rig, machine.count, target)
    if before is None:
        before = begun(machine, drive, run["time_s"])
    if not is_driven and target is None:
        run |= held_drive(drive, machine, tension_in)
    end_given = rig.end.given == "angle" and "joint_angle_rad" in run
    elapsed = 0.0 if state.history is None else max(time - state.time, 0.0)
    command = None
    if not is_driven and target is not None:
        command = command_of(machine, before, run, target, elapsed, may_wait)
        run["motor_angle_rad"] = np.array([command.motor_angle])
    done = simulated(machine, run, end_given=end_given, before=before)
    if is_driven and target is not None:
        command = command_of(machine, done.history, run, target, elapsed, may_wait)
    channels = {name: float(values[0]) for name, values in done.channels.items()}
    _check(done.history, drive)
    after = CarriedMachine(machine, route, done.history, state.way)
    tendon, ends = first_tendon(after, machine, done.history, channels, shared)
    after = replace(after, way=ends.direction_index)
    return MachineMoment(after, channels, command, tendon, ends, is_driven or target is not None)


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
    run: Mapping[str, Vector], before: MachineHistory | None, rig: Rig, count: int, target: float | None
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
        by_position: DriveName = "motor_angle_rad" if target is not None else "displacement_in"
        return (by_position if target is not None or rig.end.kind == "carried" else "tension_in"), False
    names = drive_channels(before.drive, count)
    if all(name in run for name in names):
        return before.drive, True
    if brought or (target is not None and before.drive != "motor_angle_rad"):
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
    target: float,
    elapsed: float,
    may_wait: MayWait | None,
) -> MachineCommand:
    """Return what the motor has to do for a target [rad] from where the machine stands."""
    history = with_pending(machine, history, float(run["time_s"][0]))
    span = max(float(run["time_s"][0]) - history.time, 0.0)
    load = float(without_zero(run, "joint_torque_Nm", machine.rig)[0])
    following = next_angle(machine, history, span, load, target, elapsed, may_wait)
    read = as_read(following.motor, "motor_angle_rad", machine.rig)
    return MachineCommand(read, following.joint, following.reached, following.limited, following.waits)


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
    ends = transmission.of_bars(along, routed(shared.on(route), rig), rig)
    return TendonState(along, route, history.time, ends.tension_out_se), ends


def greatest_pull(channels: Mapping[str, float]) -> float:
    """Return the greatest proximal tension among channels of a machine [N]."""
    return max((value for name, value in channels.items() if name.startswith("tension_in")), default=0.0)


def channels_of(rig: Rig) -> tuple[str, ...]:
    """Return the channels that a machine may compute, in the order of tables."""
    count, names = tendon_count(rig.drive, rig.end), list[str]()
    for name in ("tension_in_N", "tension_out_N", "displacement_in_m", "displacement_out_m"):
        names += numbered(name, count)
    if rig.drive.radius_m > 0.0:
        names += ["motor_angle_rad", "motor_torque_Nm"]
    if rig.drive.torque_constant_Nm_per_A > 0.0:
        names.append("motor_current_A")
    if rig.end.kind == "joint":
        names += ["joint_angle_rad", "joint_torque_Nm"]
    if rig.end.kind == "segment":
        names += ["bending_x_rad", "bending_y_rad", "tip_x_m", "tip_y_m", "tip_z_m"]
    return tuple(names)


def numbers_of(rig: Rig) -> tuple[str, ...]:
    """Return the names of `MachineMoment.numbers` that a rig may have; none of one tendon on a spring."""
    if not rig.is_machine:
        return ()
    commands = ("motor_angle_command_rad", "joint_angle_reached_rad", "joint_angle_se_rad")
    return (*channels_of(rig), *(commands if rig.end.kind == "joint" else ()))

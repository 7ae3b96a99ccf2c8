"""A frame of a stream whose machine is followed: drive, mean machine and command; docs/model.md (205)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from tssgeom.adapt.followed_machine import FollowedMachine
from tssgeom.adapt.followed_tendon import with_filter
from tssgeom.adapt.follower import Follower
from tssgeom.adapt.machine_filter import MachineFilter
from tssgeom.adapt.machine_readings import MachineReadings
from tssgeom.core.constants_tendon import BAR
from tssgeom.errors import SettingsError, TssgeomError
from tssgeom.mechanism import per_motor_angle
from tssgeom.plausibility.frames import strain_remarks
from tssgeom.plausibility.rules import warnings_of
from tssgeom.rig import Rig
from tssgeom.tendon.command_error import is_near, outside
from tssgeom.tendon.machine import machine_of, routed
from tssgeom.tendon.machine_channels import as_read
from tssgeom.tendon.machine_commander import MachineCommander, Moved
from tssgeom.tendon.machine_simulation import drive_channels
from tssgeom.tendon.machine_stream import (
    JOINT_TARGET,
    CarriedMachine,
    MachineCommand,
    MachineMoment,
    brings_drive,
    command_of,
    driven_by,
    first_tendon,
    greatest_pull,
    held_drive,
)


def moved(
    follower: Follower,
    commander: MachineCommander,
    before: CarriedMachine,
    readings: Mapping[str, float],
    at: Moved,
) -> MachineMoment:
    """Do as `MachineCommander.moved`, on the mean machine of a filter.

    Parameters
    ----------
    follower
        Takes in the frame; where its target is refused, it forgets the frame.
    commander
        Its tolerance and policy count; errors are those of the filter.
    before
        The machine before the frame.
    readings
        What the frame measures, by channel, and its target.
    at
        Route and time.

    Raises
    ------
    SettingsError, FitError
        As `Follower.take` and `command_of`; where the frame has no time.
    """
    if not math.isfinite(at.time):
        raise SettingsError("a rig is followed over time: give the time of each frame [s]")
    at = replace(at, arcs=follower.carried.lies_on(at.arcs))
    target = readings.get(JOINT_TARGET)
    measured = {name: value for name, value in readings.items() if name != JOINT_TARGET}
    elapsed = 0.0 if before.history is None else max(at.time - before.time, 0.0)
    if brings_drive(measured, follower.rig):
        kept = follower.kept()
        moment = _taken(follower, before, MachineReadings(measured), at, None)
        try:
            strained = strain_remarks(follower.rig, at.arcs.total_length, greatest_pull(moment.channels))
            warnings_of(None, strained)
            if target is None:
                return moment
            command = _commanded(follower, commander, moment.state, measured, target, at, elapsed)
            return moment._replace(command=command)
        except TssgeomError:
            follower.go_back(kept)
            raise
    if target is None:
        held = _held(follower, before, at)
        return _taken(follower, before, MachineReadings({**measured, **held}, commanded=True), at, None)
    rest = MachineReadings({**measured, "motor_angle_rad": 0.0}, commanded=True)
    now, carried = _filter(follower, at, rest, before)
    stands = before if before.history is not None else carried.state(now, before.way, at.time - BAR.untimed)
    command = _commanded(follower, commander, stands, measured, target, at, elapsed)
    done = MachineReadings({**measured, "motor_angle_rad": command.motor_angle}, commanded=True)
    return _taken(follower, before, done, at, command)


def _held(follower: Follower, before: CarriedMachine, at: Moved) -> dict[str, float]:
    """Return the drive of a frame that brings neither drive nor target, as without a filter."""
    rig = follower.rig
    machine = before.machine or machine_of(rig, [routed(at.arcs, rig)])
    drive = driven_by({}, before.history, rig, machine.count, None)[0]
    held = held_drive(drive, machine, at.tension_in)
    return {name: float(value[0]) for name, value in held.items()}


def _taken(
    follower: Follower,
    before: CarriedMachine,
    readings: MachineReadings,
    at: Moved,
    command: MachineCommand | None,
) -> MachineMoment:
    """Let the follower take in a frame; return the mean machine."""
    held = readings.commanded and command is None
    now, carried = _filter(follower, at, readings, before)
    known = follower.take(at.arcs, readings, at.time)
    carried.refresh(now, known)
    state = carried.state(now, before.way, at.time)
    assert state.machine is not None
    assert state.history is not None
    channels = {name: value for name, (value, _) in known.read.items()}
    tendon, ends = first_tendon(state, state.machine, state.history, channels, at.shared)
    state = replace(state, way=ends.direction_index)
    return MachineMoment(state, channels, command, tendon, with_filter(ends, known), not held)


def _filter(
    follower: Follower, at: Moved, readings: MachineReadings, before: CarriedMachine
) -> tuple[MachineFilter, FollowedMachine]:
    now, carried = follower.begin(at.arcs, readings, before), follower.carried
    assert isinstance(now, MachineFilter)
    assert isinstance(carried, FollowedMachine)
    return now, carried


def _commanded(
    follower: Follower,
    commander: MachineCommander,
    state: CarriedMachine,
    measured: Mapping[str, float],
    target: float,
    at: Moved,
    elapsed: float,
) -> MachineCommand:
    """Return what the motor has to do for a target [rad] from where the mean machine stands."""
    now = follower.filter
    assert isinstance(now, MachineFilter)
    assert state.machine is not None
    assert state.history is not None
    rig, arm = state.machine.rig, state.machine.rig.end.radius_m
    span = max(at.time - state.history.time, 0.0)

    def error(motor_read: float) -> float:
        return now.joint_after({**measured, **_to_angle(now, rig, motor_read)}, span)[1]

    def may_wait(miss: float, motor: float) -> bool:
        return is_near(arm * miss, arm * error(as_read(motor, "motor_angle_rad", rig)), commander.tolerance)

    run = {name: np.array([value]) for name, value in measured.items()} | {"time_s": np.array([at.time])}
    waits = may_wait if commander.waits else None
    command = command_of(state.machine, state.history, run, target, elapsed, waits)
    se, tolerance = error(command.motor_angle), commander.tolerance
    miss = arm * (command.joint_angle - target)
    risk = None if tolerance is None else outside(miss, arm * se, tolerance)
    return command._replace(joint_angle_se=se, out_of_tolerance=risk)


def _to_angle(now: MachineFilter, rig: Rig, motor_read: float) -> dict[str, float]:
    """Return what the sensors of the drive read where the motor is at an angle, as its own one reads it."""
    if now.drive != "displacement_in":
        return {"motor_angle_rad": motor_read}
    arms = per_motor_angle(rig.drive, now.count) * motor_read
    return dict(zip(drive_channels(now.drive, now.count), arms.tolist(), strict=True))

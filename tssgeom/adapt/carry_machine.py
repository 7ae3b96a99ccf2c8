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
from tssgeom.arrays import Matrix
from tssgeom.core.constants_tendon import BAR
from tssgeom.errors import SettingsError, TssgeomError
from tssgeom.plausibility.frames import strain_remarks
from tssgeom.plausibility.rules import warnings_of
from tssgeom.tendon.machine import machine_of, routed
from tssgeom.tendon.machine_commander import MachineCommander, Moved, as_drive
from tssgeom.tendon.machine_stream import (
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
from tssgeom.tendon.machine_target import following, without_targets


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
    measured, targets = without_targets(readings, follower.rig)
    elapsed = 0.0 if before.history is None else max(at.time - before.time, 0.0)
    if brings_drive(measured, follower.rig):
        kept = follower.kept()
        moment = _taken(follower, before, MachineReadings(measured), at, None)
        try:
            strained = strain_remarks(follower.rig, at.arcs.total_length, greatest_pull(moment.channels))
            warnings_of(None, strained)
            if not targets:
                return moment
            command = _commanded(follower, commander, moment.state, measured, targets, at, elapsed)
            return moment._replace(command=command)
        except TssgeomError:
            follower.go_back(kept)
            raise
    if not targets:
        held = _held(follower, before, at)
        return _taken(follower, before, MachineReadings({**measured, **held}, commanded=True), at, None)
    at_zero = dict.fromkeys(following(follower.rig, targets).inputs, 0.0)
    rest = MachineReadings({**measured, **at_zero}, commanded=True)
    now, carried = _filter(follower, at, rest, before)
    stands = before if before.history is not None else carried.state(now, before.way, at.time - BAR.untimed)
    command = _commanded(follower, commander, stands, measured, targets, at, elapsed)
    done = MachineReadings({**measured, **command.inputs}, commanded=True)
    return _taken(follower, before, done, at, command)


def _held(follower: Follower, before: CarriedMachine, at: Moved) -> dict[str, float]:
    """Return the drive of a frame that brings neither drive nor target, as without a filter."""
    rig = follower.rig
    machine = before.machine or machine_of(rig, [routed(at.arcs, rig)])
    drive = driven_by({}, before.history, rig, machine.count, {})[0]
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
    targets: Mapping[str, float],
    at: Moved,
    elapsed: float,
) -> MachineCommand:
    """Return what the drives have to do for targets from where the mean machine stands."""
    now = follower.filter
    assert isinstance(now, MachineFilter)
    assert state.machine is not None
    assert state.history is not None
    rig, history = state.machine.rig, state.history
    follows, span = following(rig, targets), max(at.time - history.time, 0.0)

    def covariance(command: Mapping[str, float]) -> Matrix:
        values = {**measured, **as_drive(command, rig, now.drive)}
        return np.atleast_2d(np.cov(now.outputs_after(values, span, follows), rowvar=False))

    run = {name: np.array([value]) for name, value in measured.items()} | {"time_s": np.array([at.time])}
    wait = commander.may_wait(follows, rig, targets, covariance)
    command = command_of(state.machine, history, run, targets, elapsed, wait)
    return commander.with_errors(command, covariance(command.inputs), rig, targets)

"""A frame of a stream whose rig is followed: drive, mean tendon and command; docs/model.md (205)."""

from __future__ import annotations

import math
from dataclasses import replace

from tssgeom.adapt.followed_tendon import FollowedTendon
from tssgeom.adapt.follower import Follower
from tssgeom.adapt.readings import Readings
from tssgeom.adapt.rig_filter import RigFilter
from tssgeom.core.constants_tendon import BAR
from tssgeom.errors import SettingsError, TssgeomError
from tssgeom.plausibility.frames import strain_remarks
from tssgeom.plausibility.limits import LIMITS
from tssgeom.plausibility.rules import warnings_of
from tssgeom.tendon.command import Command
from tssgeom.tendon.command_error import DistalErrors, Step
from tssgeom.tendon.commander import Commander, Given, ReadDrive, Target
from tssgeom.tendon.state import TendonState


def moved(
    follower: Follower,
    commander: Commander,
    before: TendonState,
    at: Step,
    given: Given,
    read: Readings,
    tension_in: float,
) -> tuple[TendonState, Command | None, Commander]:
    """Do as `Commander.moved`, on the mean tendon of a filter.

    Parameters
    ----------
    follower
        Takes in the frame; where its target is refused, it forgets the frame.
    commander
        What commands the frame.
    before
        The tendon before it.
    at, given
        Route and time, and what the frame brings of drive and target.
    read
        What is measured at the distal end; its drive is not used.
    tension_in
        Drives the tendon where the frame brings neither drive nor target [N].

    Raises
    ------
    SettingsError, FitError
        As `Follower.take` and `Commander.command`; where the frame has no time.
    """
    pull, located, wanted, wanted_pull = given
    has_target, driven = wanted is not None or wanted_pull is not None, not pull is located is None
    at = at._replace(arcs=follower.carried.lies_on(at.arcs))
    target = Target(wanted, wanted_pull if wanted is None else None)
    if driven:
        # a copy takes time, and a drive that has hardly moved strains no tendon
        is_far = located is not None and abs(located) > LIMITS.usual_strain * at.arcs.total_length
        kept = follower.kept() if has_target or is_far else None
        state = _taken(follower, before, at, read._replace(tension_in=pull, displacement_in=located))
        true = state.tension_in if located is None else None
        commander = _followed(commander, follower).driven(at, tension_in=true, displacement_in=located)
        try:
            if is_far:
                rig = follower.carried.rig
                warnings_of(None, strain_remarks(rig, at.arcs.total_length, state.tension_in))
            if not has_target:
                return state, None, commander
            by: ReadDrive = "tension" if located is None else "displacement"
            return state, *_commanded(follower, commander, before, state, at, target, by)
        except TssgeomError:
            follower.go_back(kept)
            raise
    if not has_target:
        held = read._replace(tension_in=tension_in, commanded=True)
        return _taken(follower, before, at, held), None, _followed(commander, follower)
    follower.begin(at.arcs, read._replace(displacement_in=0.0, commanded=True), before)
    commander = _followed(commander, follower)
    command, commander = _commanded(follower, commander, before, before, at, target, None)
    done = read._replace(displacement_in=command.displacement_in, commanded=True)
    return _taken(follower, before, at, done), command, commander


def _commanded(
    follower: Follower,
    commander: Commander,
    before: TendonState,
    state: TendonState,
    at: Step,
    target: Target,
    measured: ReadDrive,
) -> tuple[Command, Commander]:
    elapsed = at.time - before.time if at.time is not None and at.time >= before.time else 0.0
    assert isinstance(follower.carried, FollowedTendon)
    at = at._replace(arcs=follower.carried.felt(at.arcs))
    return commander.command(state, at, target, elapsed=elapsed, measured=measured)


def _followed(commander: Commander, follower: Follower) -> Commander:
    """Return the commander with the rig that is followed, and the errors of its filter."""
    now, route = follower.filter, follower.carried.sensed
    assert isinstance(now, RigFilter)
    assert route is not None

    def errors_after(displacement_in: float, tension_in: float) -> DistalErrors:
        located = now.ends_after(route, 0.0, displacement_in=displacement_in)[1]
        pulled = now.ends_after(route, 0.0, displacement_in=None, tension_in=tension_in)[1]
        return DistalErrors(float(located[1]), float(located[3]), float(pulled[1]), float(pulled[3]))

    return replace(commander, rig=follower.carried.rig, of_filter=errors_after)


def _taken(follower: Follower, before: TendonState, at: Step, readings: Readings) -> TendonState:
    """Let the follower take in a frame; return the mean tendon."""
    if at.time is None or not math.isfinite(at.time):
        raise SettingsError("a rig is followed over time: give the time of each frame [s]")
    now, carried = follower.begin(at.arcs, readings, before), follower.carried
    assert isinstance(now, RigFilter)
    assert isinstance(carried, FollowedTendon)
    since = now.time
    known = follower.take(at.arcs, readings, at.time, at.temperature)
    carried.refresh(now, known)
    used = follower.taken
    drive = used.tension_in if used.by_force else used.displacement_in
    if not used.commanded or drive is None:
        drive = now.drive_value(used.by_force)
    span = BAR.untimed if math.isnan(since) else at.time - since
    return carried.state(now, known, drive, used.by_force, span)

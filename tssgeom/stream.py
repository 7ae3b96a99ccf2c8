"""One frame of a stream: the tendon carried over it, and its result."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from tssgeom.effects import named
from tssgeom.errors import SettingsError
from tssgeom.frame import Frame
from tssgeom.mechanism import OF_CURRENT, channels_of
from tssgeom.plausibility.frames import frame_warnings, given_route_remarks
from tssgeom.result import Result
from tssgeom.rig import Rig
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.observations import Shape
from tssgeom.route.pieces import Arcs
from tssgeom.route.route import Route
from tssgeom.route.route_fit import NO_ERRORS, RouteFit, SharedErrors
from tssgeom.route.tracking import TrackedFit
from tssgeom.sensed_route import SensedRoute
from tssgeom.tendon.capstan import Transmission
from tssgeom.tendon.command import Command
from tssgeom.tendon.command_error import Step, with_rig_errors
from tssgeom.tendon.commander import Commander, Given, commander_of
from tssgeom.tendon.machine_commander import Moved, machine_commander_of
from tssgeom.tendon.machine_simulation import current_notes
from tssgeom.tendon.machine_stream import CarriedMachine, MachineMoment, greatest_pull
from tssgeom.tendon.machine_target import name_of, possible_outputs
from tssgeom.tendon.state import TendonState, pretensioned, transmit_after

if TYPE_CHECKING:  # a stream whose rig is not followed does not load what follows rigs
    from tssgeom.adapt.alert import Alert
    from tssgeom.adapt.follower import Follower
    from tssgeom.adapt.readings import FollowedRig

Carried = TendonState | CarriedMachine
"""What goes on from frame to frame: one tendon, or a machine."""


@dataclass(frozen=True, slots=True, repr=False)
class FrameResult(Result):
    """Geometry and transmission of one frame."""

    seq: int
    """Count of the frame on arrival, from 0."""
    frame: Frame
    """The frame as it was given."""
    shape: Shape
    """Its points that are used."""
    fit: RouteFit
    """The fit of the route, at its resolution, with all errors of its source."""
    tracked: TrackedFit
    """The fit from which that of the next frame starts."""
    state: TendonState
    """Tension along the tendon after the frame."""
    transmission: Transmission
    """Tension at both ends and elongation."""
    warnings: tuple[str, ...] = ()
    """What to know of the result, a sentence each."""
    command: Command | None = None
    """What the drive has to do for the frame's target, where it has one."""
    commander: Commander | None = None
    """What commands the next frame."""
    followed: FollowedRig | None = None
    """What is known of the rig, where it is followed."""
    alert: Alert | None = None
    """What readings and model disagree in, where the rig is followed and they do."""
    machine: MachineMoment | None = None
    """What a machine does, of which `state` and `transmission` are the first tendon."""

    @property
    def carried(self) -> Carried:
        """What the next frame starts from: the tendon, or the whole machine."""
        return self.state if self.machine is None else self.machine.state

    @property
    def displacement_command(self) -> float | None:
        """Position of the drive at which the frame's target is reached, where it has one [m]."""
        return None if self.command is None else self.command.displacement_in

    @property
    def tension_command(self) -> float | None:
        """Proximal tension at which the frame's target is reached, where it has one [N]."""
        return None if self.command is None else self.command.tension_in

    @property
    def arcs(self) -> Arcs:
        """The route as pieces of constant curvature."""
        return self.fit.arcs

    @property
    def route(self) -> Route:
        """The route on its nodes."""
        return self.fit.route

    @property
    def profile(self) -> CurvatureProfile:
        """Curvature on the same nodes."""
        return self.fit.profile

    @property
    def sensed_noise(self) -> float:
        """Noise of a coordinate as sensed [m]: by differences in time where points are filtered.

        The noise of a fit of few points also holds what it does not follow of the route.
        """
        points = self.tracked.filtered
        if points is not None and points.coordinates == 3:
            return points.sensed_noise
        return self.route.noise * self.tracked.sensed_over_fitted

    def strip(self) -> FrameResult:
        """Return it without what only the fit of the next frame needs, which is most of its size."""
        of = self.tracked
        share = self.sensed_noise / self.route.noise if self.route.noise > 0.0 else of.sensed_over_fitted
        kept = TrackedFit(of.fit.strip(), of.index, sensed_over_fitted=share)
        fit = kept.fit if self.fit is of.fit else self.fit.strip()
        return replace(self, fit=fit, tracked=kept, commander=None)


@dataclass(frozen=True, slots=True)
class Rejected:
    """A frame that could not be used; the tendon's state is as before it."""

    seq: int
    """Count of the frame on arrival, from 0."""
    time: float
    """Time of the frame [s]."""
    reason: str
    """Why it could not be used, with a hint."""
    id: str | int = ""
    """The sender's own name of the frame."""


def pulled(
    seq: int,
    frame: Frame,
    state: Carried,
    rig: Rig,
    tension_in: float,
    sensed: SensedRoute,
    commander: Commander | None = None,
    follower: Follower | None = None,
) -> FrameResult:
    """Carry the tendon from `state` over one frame, whose route is fitted already.

    Where a `follower` takes in its readings, tendon and rig are the follower's.

    Raises SettingsError where the tension is negative or not finite, or a target out of reach; FitError where
    the tendon has no equilibrium.
    """
    if rig.is_machine:
        commander = commander or commander_of(rig)
        return _of_machine(seq, frame, state, rig, tension_in, sensed, commander, follower)
    if isinstance(state, CarriedMachine):
        raise SettingsError("the state is of a machine, the rig is one tendon on a spring: start anew")
    shape, tracked, fit, shared = sensed
    length = fit.arcs.total_length
    pull = frame.tension_in or 0.0
    warnings = frame_warnings(frame, rig, length, pull)  # before a follower takes them in
    points = tracked.filtered
    stands = None if points is None else points.stands
    at = Step(fit.arcs, frame.time, frame.temperature, stands, shared)
    given = Given(
        frame.tension_in, frame.displacement_in, frame.displacement_target, frame.tension_out_target
    )
    commander = commander or commander_of(rig)
    if follower is None:
        moved, command, commander = commander.moved(state, at, given, tension_in)
    else:
        from tssgeom.adapt import carry
        from tssgeom.adapt.readings import Readings

        read = Readings(tension_out=frame.tension_out, elongation=frame.elongation)
        moved, command, commander = carry.moved(follower, commander, state, at, given, read, tension_in)
        rig = follower.carried.rig
    most = moved.tension_in if command is None else max(moved.tension_in, command.tension_in)
    if follower is not None or most > pull:
        warnings = frame_warnings(frame, rig, length, most)
    whole, moved, transmission = _transmitted(state, moved, rig, stands, fit, shared)
    known = None if follower is None else follower.known
    if known is not None:
        from tssgeom.adapt.followed_tendon import with_filter

        transmission = with_filter(transmission, known)
    elif commander.variants or rig.unexplained:
        by_position = given.tension_in is None and (given.displacement_in is not None or command is not None)
        transmission = with_rig_errors(
            transmission, commander.variants, rig, moved.route, by_tension=not by_position
        )
    of_route = frame.warnings + shape.warnings + fit.warnings
    of_frame = _temperature_warnings(rig, frame) + _unread(frame) + warnings
    return FrameResult(
        seq=seq,
        frame=frame,
        shape=shape,
        fit=whole,
        tracked=tracked,
        state=moved,
        transmission=transmission,
        warnings=of_route + of_frame + (() if follower is None else follower.warnings),
        command=command,
        commander=commander,
        followed=known,
        alert=None if follower is None else follower.alert,
    )


def at_rest(rig: Rig) -> Carried:
    """Return what the first frame starts from: a tendon under its pretension, or a machine at rest."""
    return CarriedMachine() if rig.is_machine else pretensioned(rig)


def _of_machine(
    seq: int,
    frame: Frame,
    state: Carried,
    rig: Rig,
    tension_in: float,
    sensed: SensedRoute,
    commander: Commander,
    follower: Follower | None,
) -> FrameResult:
    """Take a machine through a frame, as `pulled` takes one tendon."""
    shape, tracked, fit, shared = sensed
    before = state if isinstance(state, CarriedMachine) else CarriedMachine()
    readings, warnings = _readings(frame, rig)
    of_machine = commander.of_machine or machine_commander_of(rig)
    at = Moved(fit.arcs, frame.time, tension_in, shared)
    length, pulls = fit.arcs.total_length, greatest_pull(readings)
    of_route = list(given_route_remarks(rig, length, fit.arcs.total_angle, fit.arcs.total_angle_se))
    frame_warnings(frame, rig, length, pulls, of_route)  # before a follower takes them in
    if follower is None:
        moment, of_machine = of_machine.moved(before, rig, readings, at)
    else:
        from tssgeom.adapt import carry_machine

        moment = carry_machine.moved(follower, of_machine, before, readings, at)
    most = max(pulls, greatest_pull(moment.channels))
    warnings = frame.warnings + shape.warnings + fit.warnings + warnings
    warnings += frame_warnings(frame, rig, length, most, of_route)
    return FrameResult(
        seq=seq,
        frame=frame,
        shape=shape,
        fit=shared.beside(fit),
        tracked=tracked,
        state=moment.tendon,
        transmission=moment.transmission,
        warnings=warnings + (() if follower is None else follower.warnings),
        commander=replace(commander, of_machine=of_machine),
        followed=None if follower is None else follower.known,
        alert=None if follower is None else follower.alert,
        machine=moment,
    )


def _readings(frame: Frame, rig: Rig) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return what a frame measures of a machine, by channel, and a warning for each reading that it has not.

    Raises SettingsError where the rig has no such target, or a reading is not finite.
    """
    of_one = {
        "displacement_target_m": frame.displacement_target,
        "tension_out_target_N": frame.tension_out_target,
        "tension_in_N": frame.tension_in,
        "tension_out_N": frame.tension_out,
        "displacement_in_m": frame.displacement_in,
        "elongation_m": frame.elongation,
    }
    given = {name: value for name, value in of_one.items() if value is not None} | dict(
        frame.of_machine or {}
    )
    for name, value in given.items():
        if not math.isfinite(value):
            raise SettingsError(f"{name} is {value:g}: give a finite value, or leave it out")
    targets = {name_of(each, "target") for each in possible_outputs(rig)}
    if wrong := sorted(name for name in given if "_target" in name and name not in targets):
        takes = " and ".join(sorted(targets)) or "no target"
        raise SettingsError(
            f"{wrong[0]} is of another rig: one with end.kind = {rig.end.kind!r} takes {takes}"
        )
    unknown = sorted(given.keys() - {*channels_of(rig.drive, rig.end), OF_CURRENT, "elongation_m", *targets})
    notes = (f"{name} is not used: the rig has no such channel" for name in unknown)
    return given, (*notes, *current_notes(given, rig))


def held(frame: Frame, state: TendonState) -> tuple[Frame, float]:
    """Return a frame without drive and target with a warning, and the tension at which the tendon is held."""
    pull = state.tension_in
    text = f"the frame brings neither drive nor target: the tendon is held at {pull:.4g} N"
    return replace(frame, warnings=(*frame.warnings, text)), pull


_MAY_DRIVE = ("motor_", "displacement_in", "tension_in")


def _unread(frame: Frame) -> tuple[str, ...]:
    """Name the readings of a machine in a frame of one tendon.

    Raises SettingsError where one of them may be the drive, and nothing else drives the tendon.
    """
    if not frame.of_machine:
        return ()
    wanted = [name for name in frame.of_machine if name.startswith(_MAY_DRIVE) or "_target" in name]
    names = ", ".join(frame.of_machine)
    if wanted and not frame.drives_tendon:
        raise SettingsError(
            f"{wanted[0]} is of a machine, and nothing else drives the tendon: give [drive] and [end]"
        )
    return (f"{names}: not read, the rig is one tendon on a spring",)


def _temperature_warnings(rig: Rig, frame: Frame) -> tuple[str, ...]:
    """Name the effects that do nothing in a frame because its temperature is unknown."""
    if frame.temperature is not None or not rig.effects:
        return ()
    idle = named(effect for effect in rig.effects if "temperature_C" in effect.needs)
    return (f"no temperature_C: {idle} does nothing",) if idle else ()


def _transmitted(
    before: TendonState, now: TendonState, rig: Rig, stands: bool | None, fit: RouteFit, shared: SharedErrors
) -> tuple[RouteFit, TendonState, Transmission]:
    """Return fit and what the tendon transmits with errors that all frames share: none of them moves it."""
    if shared == NO_ERRORS:
        return fit, *transmit_after(before, now, rig, stands)
    whole, route = shared.beside(fit), now.route
    if route is None:
        return whole, *transmit_after(before, now, rig, stands)
    with_shared = whole.arcs if route is fit.arcs else shared.on(route)
    moved, transmission = transmit_after(before, replace(now, route=with_shared), rig, stands)
    return whole, replace(moved, route=route), transmission

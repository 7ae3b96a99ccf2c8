"""Commands of a joint in a stream: with the errors of route, rig and state, tolerance and policy.

Sources: docs/model.md (212), (213), (215), (219).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.mechanism import per_motor_angle
from tssgeom.rig import Rig, with_values
from tssgeom.route.pieces import Arcs
from tssgeom.route.resolution import NO_ERRORS, SharedErrors
from tssgeom.tendon.command_error import is_near, outside, spread_of
from tssgeom.tendon.machine import machine_of, routed
from tssgeom.tendon.machine_channels import as_read
from tssgeom.tendon.machine_command import MayWait
from tssgeom.tendon.machine_simulation import drive_channels, simulated
from tssgeom.tendon.machine_stream import (
    JOINT_TARGET,
    CarriedMachine,
    MachineMoment,
    brings_drive,
    moved_machine,
)
from tssgeom.uncertain import Uncertain, deviations


@dataclass(frozen=True, slots=True)
class Moved:
    """What a frame brings of a machine beside its readings."""

    arcs: Arcs
    """The route as sensed."""
    time: float
    """[s]."""
    tension_in: float
    """Tension of each tendon before a frame has brought a drive or a target [N]."""
    shared: SharedErrors = NO_ERRORS
    """Errors of the route that all frames share."""

    def moved(
        self,
        state: CarriedMachine,
        rig: Rig,
        readings: Mapping[str, float],
        may_wait: MayWait | None = None,
    ) -> MachineMoment:
        """Take a machine through the frame."""
        of = {"time": self.time, "tension_in": self.tension_in, "shared": self.shared}
        return moved_machine(state, self.arcs, rig, readings, may_wait=may_wait, **of)


@dataclass(frozen=True, slots=True)
class MachineVariant:
    """A rig as it may be, and where its machine would stand after all frames so far."""

    rig: Rig
    bent: float = 0.0
    """Standard errors of the route's angle by which it is bent more [1]."""
    state: CarriedMachine = field(default_factory=CarriedMachine)
    joint: float = 0.0
    """Angle of its joint [rad]."""

    def from_state(self, state: CarriedMachine) -> MachineVariant:
        """Return it with the state of the machine before, where it has none of its own."""
        return self if self.state.history is not None else replace(self, state=replace(state, machine=None))

    def bent_route(self, arcs: Arcs, total_angle_se: float) -> Arcs:
        """Return a route bent more, its angle having a standard error [rad]."""
        if not self.bent or arcs.total_angle <= 0.0:
            return arcs
        more = self.bent * total_angle_se / arcs.total_angle
        return replace(arcs, angle=read_only(arcs.angle * max(1.0 + more, 0.0)))

    def after(self, readings: Mapping[str, float], at: Moved) -> MachineVariant:
        """Return it after a frame."""
        arcs = self.bent_route(at.arcs, at.shared.on(at.arcs).total_angle_se) if self.bent else at.arcs
        moment = replace(at, arcs=arcs).moved(self.state, self.rig, readings)
        assert moment.state.history is not None
        joint = float(moment.state.history.state.coordinate[0])
        return replace(self, state=moment.state, joint=joint)

    def to_angle(self, motor_read: float, measured: Mapping[str, float], at: Moved) -> MachineVariant:
        """Return it after the motor has gone to an angle, as its sensor reads it [rad]."""
        history, read = self.state.history, {"motor_angle_rad": motor_read}
        if history is not None and history.drive == "displacement_in":
            count = len(history.held)
            arms = per_motor_angle(self.rig.drive, count) * motor_read
            read = dict(zip(drive_channels(history.drive, count), arms.tolist(), strict=True))
        return self.after({**measured, **read}, at)


@dataclass(frozen=True, slots=True)
class MachineCommander:
    """What commands of a joint need beside the machine; each frame returns the one for the next frame."""

    tolerance: float | None = None
    """Distance from the target that may be missed, at the lever arm of the joint [m]."""
    waits: bool = False
    """Whether the motor is held inside the dead zone where that is near enough to the target."""
    variants: tuple[MachineVariant, ...] = ()
    """Two for each uncertain number, a standard deviation higher and lower."""

    def moved(
        self, state: CarriedMachine, rig: Rig, readings: Mapping[str, float], at: Moved
    ) -> tuple[MachineMoment, MachineCommander]:
        """Return what a machine does in a frame, and the commander of the next one.

        Raises
        ------
        SettingsError, FitError
            As `moved_machine`.
        """
        target = readings.get(JOINT_TARGET)
        measured = {name: value for name, value in readings.items() if name != JOINT_TARGET}
        if target is None:
            moment = at.moved(state, rig, readings)
            return moment, replace(self, variants=tuple(each.after(measured, at) for each in self.variants))
        driven, arm = brings_drive(measured, rig), rig.end.radius_m
        before = tuple(each.from_state(state) for each in self.variants)
        if driven:
            before = tuple(each.after(measured, at) for each in before)

        def may_wait(miss: float, motor: float) -> bool:
            read = as_read(motor, "motor_angle_rad", rig)
            error = _spread([each.to_angle(read, measured, at) for each in before])
            return is_near(arm * miss, arm * error, self.tolerance)

        moment = at.moved(state, rig, readings, may_wait if self.waits else None)
        command = moment.command
        if command is None or not (self.variants or self.tolerance is not None):
            return moment, self
        trials = tuple(each.to_angle(command.motor_angle, measured, at) for each in before)
        error = _spread(trials)
        miss = command.joint_angle - target
        risk = None if self.tolerance is None else outside(arm * miss, arm * error, self.tolerance)
        command = command._replace(joint_angle_se=error, out_of_tolerance=risk)
        return moment._replace(command=command), replace(self, variants=before if driven else trials)


def _spread(variants: Sequence[MachineVariant]) -> float:
    """Return how far the joints of variants are apart [rad], two of each number."""
    return float(_spread_of(np.array([[each.joint] for each in variants]))[0]) if variants else 0.0


def _spread_of(angles: Matrix) -> Vector:
    return spread_of(angles, np.full(len(angles), 0.5))


def joint_errors(
    arcs: Sequence[Arcs], rig: Rig, run: Mapping[str, Vector], uncertain: Sequence[Uncertain]
) -> Vector:
    """Return the standard error of a joint under commands, by its routes and its rig [n] [rad].

    Parameters
    ----------
    arcs
        Routes as sensed, one for all tendons or one for each.
    rig
        The machine.
    run
        Columns: `time_s`, `motor_angle_rad` as commanded, and what acts on the joint.
    uncertain
        Numbers of the rig that have a standard deviation.

    Raises
    ------
    SettingsError
        Where a number is out of bounds a standard deviation from its value.
    FitError
        Where a machine has no equilibrium there.
    """
    angles = list[Vector]()
    for each in (*_of_numbers(rig, uncertain), *_of_route(rig)):
        routes = [routed(each.bent_route(one, one.total_angle_se), each.rig) for one in arcs]
        done = simulated(machine_of(each.rig, routes), run, drive="motor_angle_rad")
        angles.append(done.channels["joint_angle_rad"])
    return _spread_of(np.array(angles))


def machine_commander_of(
    rig: Rig, uncertain: Sequence[Uncertain] = (), *, tolerance: float | None = None, waits: bool = False
) -> MachineCommander:
    """Return the commander of a machine before its first frame; `commander_of` has what it takes.

    Raises
    ------
    SettingsError
        Where a number is out of bounds a standard deviation from its value.
    """
    variants = _of_numbers(rig, uncertain)
    if variants or waits or tolerance is not None:
        variants += _of_route(rig)
    return MachineCommander(tolerance, waits, variants)


def _of_numbers(rig: Rig, uncertain: Sequence[Uncertain]) -> tuple[MachineVariant, ...]:
    stated = [each for each in uncertain if each.stated]
    return tuple(MachineVariant(with_values(rig, values)) for values in deviations(stated))


def _of_route(rig: Rig) -> tuple[MachineVariant, ...]:
    return tuple(MachineVariant(rig, bent) for bent in (-1.0, 1.0))

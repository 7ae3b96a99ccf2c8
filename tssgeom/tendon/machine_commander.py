"""Commands of a machine in a stream: with the errors of route, rig and state, tolerance and policy.

Sources: docs/model.md (212), (213), (215), (219).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.errors import SettingsError
from tssgeom.mechanism import per_motor_angle, tendon_count
from tssgeom.rig import Rig, with_values
from tssgeom.route.pieces import Arcs
from tssgeom.route.route_fit import NO_ERRORS, SharedErrors
from tssgeom.tendon.machine import machine_of, routed
from tssgeom.tendon.machine_command import MayWait
from tssgeom.tendon.machine_error import covariance_of, is_near, outside_plane
from tssgeom.tendon.machine_simulation import drive_channels, simulated
from tssgeom.tendon.machine_stream import (
    CarriedMachine,
    MachineCommand,
    MachineMoment,
    as_inputs,
    brings_drive,
    moved_machine,
)
from tssgeom.tendon.machine_target import (
    Following,
    following,
    lever,
    outputs_of,
    wanted_of,
    without_targets,
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
        return replace(self, state=replace(at, arcs=arcs).moved(self.state, self.rig, readings).state)

    def going_to(
        self, command: Mapping[str, float], measured: Mapping[str, float], at: Moved
    ) -> MachineVariant:
        """Return it after the drives have gone where a command has them, as their sensors read it."""
        drive = None if self.state.history is None else self.state.history.drive
        return self.after({**measured, **as_drive(command, self.rig, drive)}, at)


def as_drive(command: Mapping[str, float], rig: Rig, drive: str | None) -> Mapping[str, float]:
    """Return a command as what drives: positions of the drives where those do and a motor is commanded."""
    if drive != "displacement_in" or "motor_angle_rad" not in command:
        return command
    count = tendon_count(rig.drive, rig.end)
    arms = per_motor_angle(rig.drive, count) * command["motor_angle_rad"]
    return dict(zip(drive_channels(drive, count), arms.tolist(), strict=True))


@dataclass(frozen=True, slots=True)
class MachineCommander:
    """What commands of a machine need beside it; each frame returns the one for the next frame."""

    tolerance: float | None = None
    """Distance from the target that the end may miss, by `lever` [m]."""
    waits: bool = False
    """Whether the drives are held inside the dead zone where that is near enough to the target."""
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
        measured, targets = without_targets(readings, rig)
        if not targets:
            moment = at.moved(state, rig, readings)
            return moment, replace(self, variants=tuple(each.after(measured, at) for each in self.variants))
        follows, driven = following(rig, targets), brings_drive(measured, rig)
        before = tuple(each.from_state(state) for each in self.variants)
        if driven:
            before = tuple(each.after(measured, at) for each in before)

        def after(command: Mapping[str, float]) -> tuple[MachineVariant, ...]:
            return tuple(each.going_to(command, measured, at) for each in before)

        wait = self.may_wait(follows, rig, targets, lambda command: _covariance(follows, after(command)))
        moment = at.moved(state, rig, readings, wait)
        command = moment.command
        if command is None or not (self.variants or self.tolerance is not None):
            return moment, self
        trials = after(command.inputs)
        command = self.with_errors(command, _covariance(follows, trials), rig, targets)
        return moment._replace(command=command), replace(self, variants=before if driven else trials)

    def may_wait(
        self,
        follows: Following,
        rig: Rig,
        targets: Mapping[str, float],
        covariance: Callable[[Mapping[str, float]], Matrix],
    ) -> MayWait | None:
        """Return what says whether drives may be held, by the covariance of outputs after a command."""
        if not self.waits:
            return None
        moves = lever(rig, wanted_of(follows, targets))

        def near(miss: Vector, inputs: Vector) -> bool:
            whole = _with_unexplained(covariance(as_inputs(follows, inputs, rig)), rig, follows.outputs)
            of_end = moves @ whole @ moves.T
            return is_near(moves @ miss, of_end, self.tolerance)

        return near

    def with_errors(
        self, command: MachineCommand, covariance: Matrix, rig: Rig, targets: Mapping[str, float]
    ) -> MachineCommand:
        """Return a command with the errors of its outputs, and the probability that it misses its target."""
        covariance = _with_unexplained(covariance, rig, tuple(command.outputs))
        errors = dict(zip(command.outputs, np.sqrt(np.diag(covariance)).tolist(), strict=True))
        risk = None
        if self.tolerance is not None:
            wanted = np.array([targets.get(each, 0.0) for each in command.outputs])
            risk = risk_of(rig, wanted, np.array([*command.outputs.values()]), covariance, self.tolerance)
        return command._replace(errors=errors, out_of_tolerance=risk)


def risk_of(rig: Rig, wanted: Vector, reached: Vector, covariance: Matrix, tolerance: float) -> float:
    """Return the probability that an end misses its target by more than a tolerance [m]; docs/model.md (343).

    `wanted` and `reached` are outputs [d], `covariance` [d, d] is that of the second.
    """
    moves = lever(rig, wanted)
    return outside_plane(moves @ (reached - wanted), moves @ covariance @ moves.T, tolerance)


def _covariance(follows: Following, variants: Sequence[MachineVariant]) -> Matrix:
    """Return the covariance of the outputs of variants [d, d], two of each number."""
    stand = [each.state.history.state for each in variants if each.state.history is not None]
    if not stand:
        return np.zeros((len(follows.outputs),) * 2)
    return covariance_of(np.array([outputs_of(follows, each) for each in stand]))


def _with_unexplained(covariance: np.ndarray, rig: Rig, outputs: Sequence[str]) -> np.ndarray:
    """Return a covariance of outputs [..., d, d] with what the model left of measured runs; (354)."""
    return covariance + np.diag(np.square(rig.unexplained.of(outputs)))


def output_errors(
    arcs: Sequence[Arcs],
    rig: Rig,
    run: Mapping[str, Vector],
    uncertain: Sequence[Uncertain],
    outputs: Sequence[str],
) -> np.ndarray:
    """Return the covariance of what follows commands, by its routes and its rig [n, d, d].

    Parameters
    ----------
    arcs
        Routes as sensed, one for all tendons or one for each.
    rig
        The machine.
    run
        Columns: `time_s`, the commands, and what acts on a joint.
    uncertain
        Numbers of the rig that have a standard deviation.
    outputs
        [d] Channels that follow.

    Raises
    ------
    SettingsError
        Where a number is out of bounds a standard deviation from its value.
    FitError
        Where a machine has no equilibrium there.
    """
    values = list[Matrix]()
    for each in (*_of_numbers(rig, uncertain), *_of_route(rig)):
        routes = [routed(each.bent_route(one, one.total_angle_se), each.rig) for one in arcs]
        channels = simulated(machine_of(each.rig, routes), run).channels
        values.append(np.column_stack([channels[name] for name in outputs]))
    covariance = np.array([covariance_of(each) for each in np.swapaxes(np.array(values), 0, 1)])
    return _with_unexplained(covariance, rig, outputs)


def machine_commander_of(
    rig: Rig, uncertain: Sequence[Uncertain] = (), *, tolerance: float | None = None, waits: bool = False
) -> MachineCommander:
    """Return the commander of a machine before its first frame; `commander_of` has what it takes.

    Raises
    ------
    SettingsError
        Where a number is out of bounds a standard deviation from its value, or an end that stands has a
        tolerance.
    """
    if tolerance is not None and rig.end.kind == "blocked":
        raise SettingsError("--tolerance-mm is of an end that moves, and this one is blocked: leave it out")
    variants = _of_numbers(rig, uncertain)
    if variants or waits or tolerance is not None or rig.unexplained:
        variants += _of_route(rig)
    return MachineCommander(tolerance, waits, variants)


def _of_numbers(rig: Rig, uncertain: Sequence[Uncertain]) -> tuple[MachineVariant, ...]:
    stated = [each for each in uncertain if each.stated]
    return tuple(MachineVariant(with_values(rig, values)) for values in deviations(stated))


def _of_route(rig: Rig) -> tuple[MachineVariant, ...]:
    return tuple(MachineVariant(rig, bent) for bent in (-1.0, 1.0))

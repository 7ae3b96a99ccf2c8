"""Commands of a stream: with the errors of route, rig and state, tolerance and policy.

Sources: docs/model.md (211) to (215).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, Protocol

from tssgeom.errors import SettingsError
from tssgeom.rig import Rig
from tssgeom.tendon.command import Command, compensate
from tssgeom.tendon.command_error import (
    NO_DISTAL_ERRORS,
    DistalErrors,
    Step,
    Variant,
    is_near,
    model_errors,
    outside,
    route_errors,
    spread,
    variants_of,
)
from tssgeom.tendon.machine_commander import MachineCommander, machine_commander_of
from tssgeom.tendon.sensor_errors import true_tension
from tssgeom.tendon.state import TendonState, step, transmit
from tssgeom.uncertain import Uncertain

Policy = Literal["cross", "wait"]
"""What a drive does where a target makes it turn: `cross` the dead zone at once, or `wait` inside it."""
ReadDrive = Literal["tension", "displacement"] | None
"""What is measured of a drive."""


class Target(NamedTuple):
    """Where the distal end is wanted; one of both."""

    displacement_out: float | None
    """Movement of the load [m]."""
    tension_out: float | None
    """Distal tension [N]."""


class Given(NamedTuple):
    """What a frame brings of the drive and of its target."""

    tension_in: float | None
    """Proximal tension as its sensor reads [N]."""
    displacement_in: float | None
    """Position of the drive [m]; not used beside a tension."""
    displacement_target: float | None
    """Wanted movement of the load [m]."""
    tension_out_target: float | None
    """Wanted distal tension [N]; not used beside a movement."""


class FilterErrors(Protocol):
    """Errors of the distal end after a move of the drive, by a filter of rig and state."""

    def __call__(self, displacement_in: float, tension_in: float) -> DistalErrors:
        """Return them for a drive that goes to a position [m], and for one that pulls with a tension [N]."""
        ...


@dataclass(frozen=True, slots=True)
class Commander:
    """What commands need beside the tendon: the rigs that it may be, the tolerance and the drive's position.

    It is carried from frame to frame as the tendon is; each call returns the one for the next frame.
    """

    rig: Rig
    """The rig that is commanded."""
    variants: tuple[Variant, ...] = ()
    """Rigs and tendons as they may be. A filter of rig and state puts its own here, with its weights."""
    tolerance: float | None = None
    """Distance from the target that may be missed [m]."""
    policy: Policy = "cross"
    """What the drive does inside the dead zone."""
    position: float | None = None
    """Position of the drive as last commanded or measured [m]; None where the model has it."""
    kept: DistalErrors | None = None
    """Errors that the route caused when the distal end last moved; None where `TendonState` has them."""
    of_filter: FilterErrors | None = None
    """Estimates of a filter of rig and state, beside the variants."""
    of_machine: MachineCommander | None = None
    """What commands a joint; None of one tendon on a spring."""

    def moved(
        self, state: TendonState, at: Step, given: Given, tension_in: float
    ) -> tuple[TendonState, Command | None, Commander]:
        """Return the tendon after a frame, the command for its target, and the commander of the next frame.

        `tension_in` drives the tendon where the frame brings neither drive nor target [N].

        Raises
        ------
        SettingsError, FitError
            As `step` and `command`.
        """
        read, located, wanted, pull = given
        commander = self
        elapsed = at.time - state.time if at.time is not None and at.time >= state.time else 0.0
        has_target, driven = wanted is not None or pull is not None, read is not None or located is not None
        if driven or not has_target:
            tension = read if driven else tension_in
            if read is not None and self.rig.effects:
                tension = true_tension(self.rig, read)
            position = located if tension is None else None
            state = step(
                state,
                at.arcs,
                self.rig,
                tension_in=tension,
                displacement_in=position,
                time=at.time,
                temperature=at.temperature,
                stands=at.stands,
            )
            commander = self.driven(at, tension_in=tension, displacement_in=position)
        if not has_target:
            return state, None, commander
        target = Target(wanted, pull if wanted is None else None)
        measured: ReadDrive = None if not driven else "displacement" if read is None else "tension"
        command, after = commander.command(state, at, target, elapsed=elapsed, measured=measured)
        return (state if driven else command.state), command, after

    def driven(
        self, at: Step, *, tension_in: float | None = None, displacement_in: float | None = None
    ) -> Commander:
        """Return it after a drive that is known: a true tension [N] or a position [m]."""
        if not self.variants and self.position == displacement_in and self.kept is None:
            return self
        moved = tuple(each.driven(at, displacement_in, tension_in) for each in self.variants)
        return replace(self, variants=moved, position=displacement_in, kept=None)

    def command(
        self,
        state: TendonState,
        at: Step,
        target: Target,
        *,
        elapsed: float | None = None,
        measured: ReadDrive = None,
    ) -> tuple[Command, Commander]:
        """Return the command that reaches a target, and the commander after it.

        Parameters
        ----------
        state
            The tendon before the command.
        at, target
            The route and the time after it, and where the distal end is wanted.
        elapsed
            Time since the drive was where it is [s].
        measured
            What is measured of the drive: then the tendon follows that. Where nothing is, the command counts
            as carried out.

        Raises
        ------
        SettingsError, FitError
            As `compensate`; where a tolerance is given and the load has no stiffness.
        """

        def near_enough(held: TendonState) -> bool:
            return self._near_enough(state, held, at, target, measured)

        command = compensate(
            state,
            at.arcs,
            self.rig,
            tension_out=target.tension_out,
            displacement_out=target.displacement_out,
            time=at.time,
            temperature=at.temperature,
            position=self.position,
            elapsed=elapsed,
            may_wait=near_enough if self.policy == "wait" else None,
            shared=at.shared,
            kept=self.kept,
        )
        of_route = command.errors
        trials = self._trials(command.displacement_in, command.tension_in, at)
        if trials or self.rig.unexplained or self.tolerance is not None or self.of_filter is not None:
            errors = of_route.beside(self._of_model(command.state))
            errors = self._of_rig(errors, trials, command.displacement_in, command.tension_in)
            miss = self._miss(target, command.displacement_reached, command.tension_reached)
            risk = None if self.tolerance is None else outside(miss, _of(errors, measured), self.tolerance)
            command = replace(command, errors=errors, out_of_tolerance=risk)
        if measured is not None:
            return command, self
        return command, replace(self, variants=trials, position=command.displacement_in, kept=of_route)

    def _trials(self, displacement_in: float, tension_in: float, at: Step) -> tuple[Variant, ...]:
        free = at._replace(stands=None)  # as `compensate` steps the tendon
        return tuple(each.driven(free, displacement_in, tension_in) for each in self.variants)

    def _of_model(self, state: TendonState) -> DistalErrors:
        """Return the errors of what the model left of measured runs, at no cost where it left nothing."""
        if not self.rig.unexplained:
            return NO_DISTAL_ERRORS
        return model_errors(transmit(state, self.rig), self.rig, state.route)

    def _of_rig(
        self, of_both: DistalErrors, trials: Sequence[Variant], displacement_in: float, tension_in: float
    ) -> DistalErrors:
        """Return the errors of route and model beside those of rig and state."""
        errors = of_both.beside(spread(trials))
        return (
            errors if self.of_filter is None else errors.beside(self.of_filter(displacement_in, tension_in))
        )

    def _miss(self, target: Target, displacement_out: float, tension_out: float) -> float:
        """Return by how much the load is beyond its target [m]."""
        if target.displacement_out is not None:
            return displacement_out - target.displacement_out
        stiffness = self.rig.load.stiffness_N_per_m
        if stiffness == 0.0:
            raise SettingsError(
                "load.stiffness_N_per_m is 0: a tolerance in mm does not apply to a tension: leave "
                "--tolerance-mm, or give the stiffness"
            )
        return (tension_out - (target.tension_out or 0.0)) / stiffness

    def _near_enough(
        self, before: TendonState, held: TendonState, at: Step, target: Target, measured: ReadDrive
    ) -> bool:
        """Whether a drive that is held inside the dead zone may stay there; docs/model.md (215)."""
        ends, rig = transmit(held, self.rig), self.rig
        trials = self._trials(ends.displacement_in, ends.tension_in, at)
        of_route = route_errors(before, held, ends, rig, at.shared, self.kept)
        errors = of_route.beside(self._of_model(held))
        errors = self._of_rig(errors, trials, ends.displacement_in, ends.tension_in)
        if target.tension_out is not None and rig.load.stiffness_N_per_m == 0.0:
            by_tension = measured == "tension"
            error = errors.tension_out_by_tension if by_tension else errors.tension_out
            return abs(ends.tension_out - target.tension_out) <= error
        miss = self._miss(target, ends.displacement_out, ends.tension_out)
        return is_near(miss, _of(errors, measured), self.tolerance)


def _of(errors: DistalErrors, measured: ReadDrive) -> float:
    """Return the error of the load's position [m]: for a drive by tension where that is measured."""
    return errors.displacement_out_by_tension if measured == "tension" else errors.displacement_out


def commander_of(
    rig: Rig,
    uncertain: Sequence[Uncertain] = (),
    *,
    tolerance: float | None = None,
    policy: Policy = "cross",
    state: TendonState | None = None,
) -> Commander:
    """Return the commander of a rig before its first command.

    Parameters
    ----------
    rig, uncertain
        The rig, and its numbers that are known with an error.
    tolerance
        Distance from the target that may be missed [m]; of a joint at its lever arm.
    policy
        What a drive does inside the dead zone.
    state
        The tendon before; at rest by default.

    Returns
    -------
    Commander
        It holds the tendon; `command` gives the drive for a target.

    Raises
    ------
    SettingsError
        Where the tolerance is not positive, or a number of the rig is out of bounds a standard deviation from
        its value.

    Notes
    -----
    Source: docs/model.md (211) to (215).

    Examples
    --------
    >>> import numpy as np
    >>> from tssgeom import Frame, Rig, commander_of, process
    >>> angle = np.linspace(0.0, np.pi, 40)
    >>> points = 0.5 / np.pi * np.column_stack((np.sin(angle), 1 - np.cos(angle), 0 * angle))
    >>> frame = Frame(points, time=0.0, displacement_target=2e-3)  # [s], [m]
    >>> (result,) = process([frame], Rig(), tension_in=0.0, commander=commander_of(Rig()))
    >>> result.displacement_command > 2e-3  # [m]
    True
    """
    if tolerance is not None and not 0.0 < tolerance < float("inf"):
        raise SettingsError(f"--tolerance-mm is {1e3 * tolerance:g} mm: give a finite value > 0 mm")
    of_machine = None
    if rig.is_machine:
        of_machine = machine_commander_of(rig, uncertain, tolerance=tolerance, waits=policy == "wait")
    return Commander(rig, variants_of(rig, uncertain, state), tolerance, policy, of_machine=of_machine)


def carried_errors(rig: Rig, uncertain: Sequence[Uncertain]) -> Commander | None:
    """Return what carries one tendon with the errors of its rig; None of a machine, or without any."""
    exact = not uncertain and not rig.unexplained
    return None if rig.is_machine or exact else commander_of(rig, uncertain)

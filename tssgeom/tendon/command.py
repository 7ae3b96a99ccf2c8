"""The proximal command that makes the distal end go where it should: the model turned round.

Dead zones are jumped, so that the distal end answers at once after a reversal; docs/model.md (82), (83).
Where effects act, the command is for what is true: a sensor that reads something else is not obeyed; (122).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tssgeom.core.constants_tendon import SOLVER
from tssgeom.errors import SettingsError
from tssgeom.plausibility.frames import require_command
from tssgeom.result import Result
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.route.route_fit import NO_ERRORS, SharedErrors
from tssgeom.tendon.bars import base, with_effects
from tssgeom.tendon.bars.bar_state import BarState
from tssgeom.tendon.capstan import MOST_TENSION
from tssgeom.tendon.command_error import DistalErrors, route_errors
from tssgeom.tendon.drive_limits import PULL, cut_to_limits, drive_now
from tssgeom.tendon.sensor_errors import reading_of
from tssgeom.tendon.state import (
    MOST_FRICTION,
    TendonState,
    acts_by_speed,
    required_setup,
    rest_tension,
    route_of,
    step,
    transmit,
)

_WIDENINGS = 40  # of the range in which a drive is sought
_LEAST_REACH = 1e-3  # of the tension, to begin with
_FIRST_REACH = 1e-6  # m
DEAD_ZONE = 0.01
"""Of the tension of the drive, or of the motion of a joint: from which on there is no answer [1]; chosen."""


@dataclass(frozen=True, slots=True, repr=False)
class Command(Result):
    """What the drive has to do, and the tendon once it has done it."""

    displacement_in: float
    """Position of the drive [m]."""
    tension_in: float
    """Tension at the proximal end [N]."""
    state: TendonState
    """Tension along the tendon after the move."""
    reading_in: float
    """What the sensor of the proximal tension reads there [N]."""
    tension_reached: float
    """Distal tension then: the target, unless a limit cut the command or the drive waits [N]."""
    displacement_reached: float
    """Movement of the load then, likewise [m]."""
    errors: DistalErrors
    """Standard errors of both."""
    limited: str = ""
    """Limits of the drive that cut it, by their keys in `[drive] limits`; `tension_N` also with `lets_go`."""
    lets_go: bool = False
    """Whether the drive pulls no more, and friction still holds more than the target at the distal end."""
    waits: bool = False
    """Whether the drive is held inside the dead zone, though the target is not reached."""
    out_of_tolerance: float | None = None
    """Probability that the distal end misses its target by more than the tolerance [1]; None without one."""

    @property
    def tension_out_se(self) -> float:
        """Standard error of the distal tension after the drive has gone to the position [N]."""
        return self.errors.tension_out

    @property
    def displacement_out_se(self) -> float:
        """Standard error of the movement of the load after the drive has gone to the position [m]."""
        return self.errors.displacement_out


@dataclass(frozen=True, slots=True)
class _Move:
    """A step of the tendon whose drive is sought."""

    state: TendonState
    arcs: Arcs
    rig: Rig
    target: float
    """Wanted distal tension [N]."""
    of_load: bool
    """Whether that is what is left behind the friction of the load."""
    time: float | None
    temperature: float | None

    def pulled(self, tension_in: float) -> TendonState:
        """Return the tendon with the drive at a tension [N]."""
        return self._driven(tension_in, None)

    def located(self, displacement_in: float) -> TendonState:
        """Return the tendon with the drive at a position [m]."""
        return self._driven(None, displacement_in)

    def _driven(self, tension_in: float | None, displacement_in: float | None) -> TendonState:
        return step(
            self.state,
            self.arcs,
            self.rig,
            tension_in=tension_in,
            displacement_in=displacement_in,
            time=self.time,
            temperature=self.temperature,
        )

    def error(self, answer: TendonState) -> float:
        """Return distal tension less target [N], zero where that is rounding."""
        there = self.reached(answer)
        error = there - self.target
        return 0.0 if abs(error) <= SOLVER.accuracy * max(there, self.target) else error

    def reached(self, answer: TendonState) -> float:
        """Return the tension that is to be at the target [N]."""
        return answer.load_tension if self.of_load else answer.tension_out


def compensate(
    state: TendonState,
    arcs: Arcs,
    rig: Rig,
    *,
    tension_out: float | None = None,
    displacement_out: float | None = None,
    time: float | None = None,
    temperature: float | None = None,
    position: float | None = None,
    elapsed: float | None = None,
    may_wait: Callable[[TendonState], bool] | None = None,
    shared: SharedErrors = NO_ERRORS,
    kept: DistalErrors | None = None,
) -> Command:
    """Return the least move of the drive after which the distal end is where it should be.

    It keeps to the rig's `[drive] limits`, and comes with the errors that the route causes; `Commander` adds
    those of uncertain numbers of the rig. Where friction holds more than the target without any pull, the
    drive lets go, and the command says so.

    Parameters
    ----------
    state
        Tension along the tendon before the move.
    arcs
        The route after the move.
    rig
        Tendon, friction, load and effects.
    tension_out, displacement_out
        Wanted distal tension [N], or movement of the load since the pretensioned state [m]; one of them.
    time, temperature
        Time [s] and temperature [°C] after the move, as in `step`.
    position
        Where the drive is before the move [m], for the limit of its speed; by default where the model has it.
    elapsed
        Time since it was there [s]; a rig with a limit of the speed needs it.
    may_wait
        Says of the tendon with the drive held inside the dead zone whether that is near enough to the target;
        left out, the dead zone is crossed at once.
    shared, kept
        Errors of the route that all frames share, and errors of the distal end before the move.

    Raises
    ------
    SettingsError
        Where not exactly one target is given, where friction keeps it out of reach of any pull, or where the
        command is beyond reason: docs/checks.md; where the speed is limited and `elapsed` is not given.
    FitError
        Where there is no equilibrium on a moving route.

    Notes
    -----
    Source: docs/model.md, "Compensation: the inverse model", and (120) to (122).
    """
    target = _target(rig, tension_out, displacement_out)
    move = _Move(state, arcs, rig, target, tension_out is None, time, temperature)
    now = drive_now(state, rig, position, elapsed)
    answer, waits, lets_go, limited = move.pulled(state.tension_in), False, False, ""
    if (error := move.error(answer)) != 0.0:
        waiting = None if may_wait is None else _waiting(move, answer)
        waits = waiting is not None and may_wait is not None and may_wait(waiting)
        if waits and waiting is not None:
            answer = waiting
        else:
            answer = _reached(move, answer, error)
            lets_go = answer.tension_in == 0.0 and move.error(answer) > 0.0
            if acts_by_speed(rig):
                answer = _by_position(move, answer, lets_go=lets_go)
    if now is not None:
        answer, limited = cut_to_limits(answer, rig, now, move.pulled, move.located)
    if lets_go and PULL not in limited:
        limited = f"{PULL}, {limited}" if limited else PULL
    ends = transmit(answer, rig)
    require_command(rig, arcs.total_length, ends.tension_in, ends.displacement_in)
    return Command(
        displacement_in=ends.displacement_in,
        tension_in=ends.tension_in,
        state=answer,
        reading_in=reading_of(rig, ends.tension_in),
        tension_reached=ends.tension_out,
        displacement_reached=ends.displacement_out,
        errors=route_errors(state, answer, ends, rig, shared, kept),
        limited=limited,
        lets_go=lets_go,
        waits=waits,
    )


def _waiting(move: _Move, held: TendonState) -> TendonState | None:
    """Return the tendon with the drive where it is, if that is inside the dead zone; docs/model.md (215)."""
    before, sign = move.state, 1 if move.target > move.reached(held) else -1
    start = _answering(held, move.rig, held.load_tension, sign)
    if before.route is None or sign * (start - held.tension_in) <= DEAD_ZONE * held.tension_in:
        return None
    if held.route is before.route:
        return held
    return move.located(transmit(before, move.rig).displacement_in)


def _target(rig: Rig, tension_out: float | None, displacement_out: float | None) -> float:
    """Return the wanted distal tension [N]."""
    if (tension_out is None) == (displacement_out is None):
        raise SettingsError("a command needs one target: give tension_out [N] or displacement_out [m]")
    if tension_out is not None:
        target, said = tension_out, f"tension_out is {tension_out:g} N"
    else:
        stiffness = rig.load.stiffness_N_per_m
        if stiffness == 0.0:
            raise SettingsError(
                "load.stiffness_N_per_m is 0: the position of a dead weight sets no tension: give it"
            )
        target = rest_tension(rig) + stiffness * (displacement_out or 0.0)  # docs/model.md (82)
        said = f"displacement_out is {displacement_out:g} m, a distal tension of {target:g} N"
    if not 0.0 <= target <= MOST_TENSION:
        raise SettingsError(f"{said}: a tendon only pulls; choose a target with a finite tension >= 0 N")
    return target


def _reached(move: _Move, held: TendonState, error: float) -> TendonState:
    """Return the state with the distal tension at the target, off by `error` [N] while the drive is held.

    Where more is held without any pull, it is the state without; docs/model.md (214).
    """
    sign = 1 if error < 0.0 else -1
    start = held.tension_in
    along = held.along
    rubs = along.load_friction if isinstance(along, BarState) and not move.of_load else 0.0
    load = max(move.target - sign * rubs, 0.0)
    far = _answering(held, move.rig, load, sign)  # docs/model.md (83): exact where all slides slowly
    if far > MOST_TENSION:
        raise SettingsError(
            f"{move.target:g} N at the distal end need {far:.3g} N at the proximal end: "
            "friction keeps the target out of reach"
        )
    reach = max(sign * (far - start), _LEAST_REACH * max(start, move.target))
    far = max(start + sign * reach, 0.0) if sign * (far - start) <= 0.0 else far
    answer = move.pulled(far)
    for _ in range(_WIDENINGS):  # friction that grows with speed needs more
        if sign * (error := move.error(answer)) >= 0.0:
            break
        if far == 0.0:
            return answer
        reach *= 2.0
        far = max(start + sign * reach, 0.0)
        answer = move.pulled(far)
    if error == 0.0:
        return answer
    low, high = sorted((start, far))  # not all slides one way where the route has moved too
    xtol = 1e-13 * max(high, 1.0)
    return move.pulled(_root(lambda tension_in: move.error(move.pulled(tension_in)), low, high, xtol, move))


def _by_position(move: _Move, answer: TendonState, *, lets_go: bool) -> TendonState:
    """Return the state reached by position: with friction by speed the way there matters; (65)."""
    near = transmit(answer, move.rig).displacement_in
    start = move.located(near)
    if lets_go:
        return start
    error, reach = move.error(start), _FIRST_REACH
    far, other = near, start
    for _ in range(_WIDENINGS):
        if error * move.error(other) <= 0.0:
            break
        far, reach = near - math.copysign(reach, error), 2.0 * reach
        other = move.located(far)
    if error == 0.0:
        return start
    low, high = sorted((near, far))
    return move.located(_root(lambda position: move.error(move.located(position)), low, high, 1e-16, move))


def _root(error: Callable[[float], float], low: float, high: float, xtol: float, move: _Move) -> float:
    """Return where an error is zero, between two drives to which it has other signs."""
    from scipy.optimize import brentq

    try:
        root: Any = brentq(error, low, high, xtol=xtol)
    except ValueError as failure:  # the same signs: of numbers beyond reason no digit is left
        raise SettingsError(
            f"no drive brings {move.target:g} N to the distal end: check the target and the rig"
        ) from failure
    return float(root)


def _answering(state: TendonState, rig: Rig, load_tension: float, way: int) -> float:
    """Return the proximal tension from which on a slow pull (+1) or release (−1) moves the load [N].

    `load_tension` is what is left behind its friction then [N]; docs/model.md (83), (122).
    """
    route, along = route_of(state), state.along
    if isinstance(along, BarState) and along.has_effects:
        model = with_effects.model_on(along, route, required_setup(rig))
        return with_effects.answering(along, model, load_tension, way)
    if rig.friction.coefficient * route.total_angle > MOST_FRICTION:
        raise base.too_much_friction(rig.friction.coefficient, route.total_angle)
    return load_tension * math.exp(way * rig.friction.coefficient * route.total_angle)

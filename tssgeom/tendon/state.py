"""The tendon after its whole history, whatever its route does: the one state that streams carry along.

As long as the route stays and the tendon is driven by force, the corner list is exact and costs nothing. From
the first change of the route under load, or the first position drive, the tendon goes on as a chain of bars.
Where the rig has effects, it is a chain of bars from the first step on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.effects import Setup
from tssgeom.errors import SettingsError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon import capstan
from tssgeom.tendon.bars import base, with_effects
from tssgeom.tendon.bars.bar_state import AT_LIMIT, BarState, end_slope, on_better_route, to_bars, to_corners
from tssgeom.tendon.bars.with_effects import effective_setup
from tssgeom.tendon.capstan import Corners, Transmission
from tssgeom.tendon.moving import unmoved

HALVINGS = 4
"""The first bar is halved so often: just after a reversal T_in is known to half of that bar."""
MOST_FRICTION = 500.0
"""μΦ whose exponential can still be squared [1]."""
UNCHANGED = 1e-4  # change of the distal tension in one step that is rounding [1]; chosen
SHARPER = 0.5  # of the old standard error of Φ: a route known so much better replaces it [1]; chosen


@dataclass(frozen=True, slots=True)
class TendonState:
    """Tension along the tendon, and the route it lies on."""

    along: Corners | BarState
    """Corners over the curve angle, or bars of the tendon."""
    route: Arcs | None
    """The route on which the tendon lies; None before the first step."""
    time: float = math.nan
    """Time of the last step for which it was given [s]; NaN before that."""
    tension_out_se: float = 0.0
    """Standard error of the distal tension when it last changed [N]."""

    @property
    def tension_in(self) -> float:
        """Total tension at the proximal end [N]."""
        return self.along.tension_in

    @property
    def tension_out(self) -> float:
        """Total tension at the distal end of the route [N]."""
        along = self.along
        if isinstance(along, Corners):
            return float(capstan.tension(along, np.array([route_of(self).total_angle]))[0])
        return along.tension_out

    @property
    def load_tension(self) -> float:
        """Tension behind the friction of the load [N]; docs/model.md (333)."""
        return self.along.load_tension if isinstance(self.along, BarState) else self.tension_out


def pretensioned(rig: Rig, time: float = math.nan) -> TendonState:
    """Return the tendon before its first pull, on no route yet.

    Parameters
    ----------
    rig, time
        The rig, and when it is so [s].

    Returns
    -------
    TendonState
        The tendon at its pretension.

    Examples
    --------
    >>> from tssgeom import Rig, pretensioned
    >>> pretensioned(Rig()).tension_in  # [N]
    0.0
    """
    return TendonState(capstan.level(rest_tension(rig)), None, time)


def rest_tension(rig: Rig) -> float:
    """Return the tension before the first pull [N]: the rig's pretension, and what effects make of it."""
    setup = effective_setup(rig)
    return rig.tendon.pretension_N if setup is None else setup.pretension


def acts_by_speed(rig: Rig) -> bool:
    """Whether friction depends on speed, so that the way to a state matters and not its end alone."""
    setup = effective_setup(rig)
    return setup is not None and bool(setup.speed_gain or setup.drag_Ns_per_m2)


def step(
    state: TendonState,
    arcs: Arcs,
    rig: Rig,
    *,
    tension_in: float | None = None,
    displacement_in: float | None = None,
    stretches_with_route: bool = False,
    time: float | None = None,
    temperature: float | None = None,
    stands: bool | None = None,
) -> TendonState:
    """Move the drive and the route at once.

    A route that differs from the one the tendon lies on by no more than the errors of both has not moved:
    noise would shake the tendon along its sheath. Slow drift shows, as the old route stays the measure.

    Parameters
    ----------
    state
        Tension along the tendon before the step.
    arcs
        The route after the step, as sensed.
    rig
        Tendon, friction, load and effects.
    tension_in, displacement_in
        New total tension [N] or new position [m] of the drive; one of them. Both are true ones: what a sensor
        that effects spoil reads of them is `readings`.
    stretches_with_route
        Whether a longer route stretches the tendon; otherwise only more of it lies in view, as on insertion.
    time
        Time after the step [s], which effects such as creep need. A step at the time of the last one is taken
        to last as long as that one.
    temperature
        Temperature after the step [°C]; left out, it is as before. It matters to thermal drift alone.
    stands
        Whether the route is known to stand: what has changed of it is what is known of it. The tension then
        keeps its history over the curve angle. A route that is known to move has moved where it differs by
        half of the usual distance. None where neither is known; where effects act, this has no meaning.

    Returns
    -------
    TendonState
        The tendon after the step.

    Raises
    ------
    SettingsError
        Where not exactly one drive is given, or where it is negative or not finite; where effects act over
        time and none is given.
    FitError
        Where there is no equilibrium.

    Examples
    --------
    >>> import math
    >>> from tssgeom import Arcs, Rig, pretensioned, step
    >>> half_circle = Arcs.exact(0.5, math.pi)  # [m], [rad]
    >>> pulled = step(pretensioned(Rig()), half_circle, Rig(), tension_in=15.0)
    >>> round(step(pulled, half_circle, Rig(), tension_in=10.0).tension_out, 2)  # [N]
    9.51
    """
    now = state.time if time is None else time
    drives, setup = (tension_in, displacement_in), effective_setup(rig) if rig.effects else None
    if setup is None:
        before, compared = with_better_route(state, arcs, rig) if stands else state, arcs
        known = before.route
        if stands is False and known is not None:
            before, compared = replace(before, route=known.with_errors(0.5)), arcs.with_errors(0.5)
        along, route = _without_effects(before, compared, rig, drives, stretches_with_route)
        route = arcs if route is compared or known is None else known
        return TendonState(along, route, now, state.tension_out_se)
    if stretches_with_route:
        raise SettingsError("effects act, so a route cannot stretch the tendon: leave stretches_with_route")
    drive, along = base.one_drive(*drives), state.along
    if isinstance(along, BarState) and along.has_effects:
        before = arcs if state.route is None else state.route
        routes = before, arcs
    else:
        before, moves = _compared(state, arcs)
        along = with_effects.cut(corners(state), before, setup)
        routes = before, arcs if moves else before
    model = with_effects.model_on(along, before, setup)
    span = with_effects.step_span(state.time, time, along.span, setup)
    friction = rig.friction.coefficient, MOST_FRICTION
    along, route = with_effects.driven(along, model, routes, drive, span, temperature, friction)
    return TendonState(along, route, now, state.tension_out_se)


def with_better_route(state: TendonState, arcs: Arcs, rig: Rig) -> TendonState:
    """Move a tendon to a better estimate of the route on which it lies; docs/model.md (160).

    The tension over the curve angle stays as it is, beyond the old end it goes on as before it.
    """
    along, route = state.along, state.route
    if route is None or isinstance(along, Corners):
        return replace(state, route=arcs)
    return replace(state, along=on_better_route(along, route, arcs, rig), route=arcs)


def _without_effects(
    state: TendonState,
    arcs: Arcs,
    rig: Rig,
    drives: tuple[float | None, float | None],
    stretches_with_route: bool,
) -> tuple[Corners | BarState, Arcs]:
    """Step the tendon of the base model; return it and the route on which it lies."""
    tension_in, displacement_in = drives
    along, load = state.along, rig.load.stiffness_N_per_m
    if isinstance(along, BarState) and not along.has_effects:
        routes = arcs if state.route is None else state.route, arcs
    else:
        before, moves = _compared(state, arcs)
        along = corners(state)
        if not moves and displacement_in is None and tension_in is not None:
            return capstan.step(along, tension_in, rig.friction.coefficient), before
        along = to_bars(along, before, rig, halvings=HALVINGS)
        routes = before, arcs if moves else before
    return base.step_on(
        along, routes, rig, load, base.one_drive(*drives), stretches_with_route, MOST_FRICTION
    )


def corners(state: TendonState) -> Corners:
    """Return the tension along the tendon as corners over the curve angle of its route; for drawing."""
    along = state.along
    if isinstance(along, Corners):
        return along
    return to_corners(along.edge, along.along, along.direction_index, route_of(state))


def tension(state: TendonState, phi: Vector, s: Vector | None = None) -> Vector:
    """Return the tension along the tendon.

    Parameters
    ----------
    state
        The tendon.
    phi
        Accumulated curve angles [n] [rad].
    s
        Arc lengths of the same positions [n] [m]; needed where effects change it over straight pieces.

    Returns
    -------
    numpy.ndarray
        Tension at each of them [n] [N].

    Examples
    --------
    >>> import numpy as np
    >>> from tssgeom import Arcs, Rig, pretensioned, step, tension
    >>> state = step(pretensioned(Rig()), Arcs.exact(0.5, np.pi), Rig(), tension_in=15.0)
    >>> tension(state, np.array([0.0, np.pi])).round(2).tolist()
    [15.0, 9.51]
    """
    along = state.along
    if s is None or isinstance(along, Corners) or not along.has_effects:
        return capstan.tension(corners(state), phi)
    return with_effects.tension_along(along, route_of(state), s)


def transmit(state: TendonState, rig: Rig) -> Transmission:
    """Return tension, elongation and dead zone of a tendon on the route it lies on.

    Parameters
    ----------
    state, rig
        The tendon after a step, and its rig.

    Returns
    -------
    Transmission
        Tensions [N], elongation and displacements [m], with standard errors.

    Raises
    ------
    SettingsError
        Where it lies on no route yet, or where it was last stepped with effects that the rig lacks.

    Examples
    --------
    >>> import math
    >>> from tssgeom import Arcs, Rig, pretensioned, step, transmit
    >>> state = step(pretensioned(Rig()), Arcs.exact(0.5, math.pi), Rig(), tension_in=15.0)
    >>> round(transmit(state, Rig()).tension_out, 2)  # [N]
    9.51
    """
    route, along = route_of(state), state.along
    if isinstance(along, Corners):
        return capstan.transmit(along, route, rig)
    if not along.has_effects:
        return base.transmit(along, route, rig)
    model = with_effects.model_on(along, route, required_setup(rig))
    return with_effects.transmit(along, model, route)


def transmit_after(
    before: TendonState, now: TendonState, rig: Rig, stands: bool | None
) -> tuple[TendonState, Transmission]:
    """Do as `transmit`, with the error that a distal tension keeps from when it was reached; model.md (161).

    Returns also the state that remembers that error.
    """
    result = transmit(now, rig)
    error = result.tension_out_se
    if before.route is not None and not (stands and _slides_at_end(now, rig)):
        dead = abs(now.tension_out - before.tension_out) <= UNCHANGED * now.tension_out
        error = max(error, before.tension_out_se) if dead or result.dead_zone else error
    more = math.sqrt(max(error**2 - result.tension_out_se**2, 0.0))
    kept = 0.5 * rig.tendon.compliance_per_N * route_of(now).total_length * more  # none at the proximal end
    elongation_se = math.hypot(result.elongation_se, kept)
    result = result._replace(tension_out_se=error, elongation_se=elongation_se)
    return replace(now, tension_out_se=error), result


def _slides_at_end(now: TendonState, rig: Rig) -> bool:
    """Whether all of the distal tension follows from what is now known of a route that stands."""
    along = now.along
    if isinstance(along, Corners) or along.has_effects:
        return True
    return abs(end_slope(along, route_of(now))) >= AT_LIMIT * rig.friction.coefficient


def _compared(state: TendonState, arcs: Arcs) -> tuple[Arcs, bool]:
    """Return the route on which the tendon lies before a step, and whether it moves to `arcs`."""
    known, along = state.route, state.along
    if known is None or arcs is known:
        return arcs, False
    if isinstance(along, Corners) and len(along.angle) == 1:
        return arcs, False  # a tension that is the same all along lies as well on any route
    if not unmoved(known, arcs):
        return known, True
    sharper = isinstance(along, Corners) and arcs.noise_angle_se < SHARPER * known.noise_angle_se
    return arcs if sharper else known, False


def route_of(state: TendonState) -> Arcs:
    """Return the route on which a tendon lies; raises SettingsError where it lies on none."""
    if state.route is None:
        raise SettingsError("the tendon lies on no route yet: step it first")
    return state.route


def required_setup(rig: Rig) -> Setup:
    """Return the setup of a rig; raises SettingsError where it has no effects."""
    if (setup := effective_setup(rig)) is None:
        raise SettingsError("effects acted in the last step that the rig lacks: step the tendon with the rig")
    return setup

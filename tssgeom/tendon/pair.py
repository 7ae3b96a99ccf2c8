"""Two tendons that pull one joint against each other, each in its own sheath; docs/model.md (84), (85)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from tssgeom.effects import named
from tssgeom.errors import FitError, SettingsError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.bar_state import BARS, BarState, pretensioned_bars
from tssgeom.tendon.bars.base import against_load

HALVINGS = 4
"""The bars at both ends are halved so often: the tension at a held end is known to half of the last bar."""
_MOST_DOUBLINGS = 60
_CLOSED = 1e-12  # what may stay open between the movements of both tendons [m]


class Both(NamedTuple):
    """One number for each tendon."""

    agonist: float
    antagonist: float


class Routes(NamedTuple):
    """The route of each tendon."""

    agonist: Arcs
    antagonist: Arcs


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint that turns by θ where the agonist moves by rθ towards its drive, the antagonist by −rθ."""

    radius: float
    """Lever arm of both tendons, r [m]."""
    stiffness: float
    """Torque for each radian, greater than 0 [N·m/rad]."""

    def __post_init__(self) -> None:
        for name in ("radius", "stiffness"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise SettingsError(f"joint.{name} is {value:g}: give a finite value > 0")


@dataclass(frozen=True, slots=True)
class PairState:
    """Both tendons and the joint between them."""

    agonist: BarState
    antagonist: BarState
    angle: float
    """Angle of the joint since the pretensioned state, θ [rad]."""
    torque: float
    """Load on the joint, against the agonist [N·m]."""


def pretensioned_pair(rig: Rig, routes: Routes, bars: int = BARS) -> PairState:
    """Return the joint at rest between two tendons with the rig's pretension.

    Raises
    ------
    SettingsError
        Where the rig has effects, which pairs do not know.
    """
    if rig.effects:
        raise SettingsError(f"a pair knows no effects, but the rig has {named(rig.effects)}: leave them out")
    agonist, antagonist = (pretensioned_bars(rig, arcs, bars, halvings=HALVINGS) for arcs in routes)
    return PairState(agonist, antagonist, 0.0, 0.0)


def step(
    pair: PairState,
    routes: Routes,
    rig: Rig,
    joint: Joint,
    *,
    tension_in: Both | None = None,
    displacement_in: Both | None = None,
    torque: float = 0.0,
) -> PairState:
    """Move both drives, both routes and the load at once.

    Parameters
    ----------
    pair
        Tendons and joint before the step.
    routes
        Their routes after the step; a longer one shows more of the tendon and does not stretch it.
    rig
        Tendon and friction, alike for both; the joint takes the place of its load.
    joint
        Lever arm and stiffness.
    tension_in, displacement_in
        New tensions [N] or positions [m] of the drives; one of them.
    torque
        New load on the joint, against the agonist [N·m].

    Raises
    ------
    SettingsError
        Where not exactly one kind of drive is given, or a value is not finite.
    FitError
        Where no equilibrium was found.
    """
    if not math.isfinite(torque):
        raise SettingsError(f"torque is {torque:g} N·m: give a finite torque")
    lift = 0.5 * (torque - pair.torque) / joint.radius
    force, position = tension_in or (None, None), displacement_in or (None, None)
    pulls = (
        _puller(pair.agonist, routes.agonist, rig, joint, force[0], position[0], lift),
        _puller(pair.antagonist, routes.antagonist, rig, joint, force[1], position[1], -lift),
    )
    common = _common_tension(pulls, pair)
    agonist, antagonist = (pull(common) for pull in pulls)
    turned = 0.5 * (agonist.displacement_out - antagonist.displacement_out) / joint.radius
    return PairState(agonist, antagonist, turned, torque)


_Pull = Callable[[float], BarState]


def _puller(
    state: BarState,
    arcs: Arcs,
    rig: Rig,
    joint: Joint,
    tension_in: float | None,
    displacement_in: float | None,
    lift: float,
) -> _Pull:
    """Return the tendon as a function of what the tension that both share grows by [N]."""
    half = 0.5 * joint.stiffness / joint.radius**2  # docs/model.md (84): each tendon against half the spring

    def pull(growth: float) -> BarState:
        load = (half, lift + growth)
        return against_load(state, arcs, rig, load, tension_in=tension_in, displacement_in=displacement_in)

    return pull


def _common_tension(pulls: tuple[_Pull, _Pull], pair: PairState) -> float:
    """Return the growth of the shared tension that keeps both tendons on one joint; docs/model.md (85)."""

    def opening(growth: float) -> float:
        agonist, antagonist = (pull(growth) for pull in pulls)
        return agonist.displacement_out + antagonist.displacement_out

    from scipy.optimize import brentq

    at_rest = opening(0.0)
    if abs(at_rest) <= _CLOSED:
        return 0.0
    near, far = 0.0, math.copysign(1e-3 * (1.0 + _greatest(pair)), at_rest)
    for _ in range(_MOST_DOUBLINGS):
        if opening(far) * at_rest <= 0.0:
            low, high = sorted((near, far))
            root: Any = brentq(opening, low, high, xtol=1e-14 * (1.0 + _greatest(pair)))
            return float(root)
        near, far = far, 2.0 * far
    raise FitError("no equilibrium of the joint was found: take smaller steps")


def _greatest(pair: PairState) -> float:
    return float(max(pair.agonist.tension.max(), pair.antagonist.tension.max()))

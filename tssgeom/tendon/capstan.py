"""Tension along a tendon on a fixed route after any history of the proximal tension, and what it transmits.

Friction bounds the slope of u = ln T over the accumulated curve angle φ by the coefficient μ. A change of
the proximal tension therefore moves only the part next to the proximal end: a front of slope ∓μ runs in
until it meets the old profile. This is a play operator, and the profile after any history is a short list
of corners (φ, u).

For what it transmits, a piece of the route is cut at the corners. Within each run ln T is linear in the
curve angle, hence also in arc length, and the integrals of the tension are elementary. A straight piece is
a run over which the angle, and so the tension, does not change. Sources: docs/model.md (2)-(14); paper
Theorems 1 and 2, eqs. (6), (7), (9)-(12).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_tendon import PROFILE
from tssgeom.errors import SettingsError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs

MOST_TENSION = 1e9
"""Above it a tension is taken for a mistake of units or of a sensor [N]."""
MAX_CORNERS = 512
"""Longest corner list; beyond it corners are dropped where they stand closest."""
_FRICTIONLESS = 1e-100  # below this coefficient μφ is lost against any ln T, whatever the route


@dataclass(frozen=True, slots=True)
class Corners:
    """Tension along the tendon: ln T is linear between corners and constant after the last one.

    The corners are kept over the accumulated curve angle and do not know where the route ends.
    """

    angle: Vector
    """[c] Accumulated curve angle φ of the corners, the first 0, not decreasing [rad]."""
    log_tension: Vector
    """[c] ln T at the corners, T in N; `PROFILE.slack` where the tension is zero [1]."""
    direction_index: int
    """ζ: +1 where the tension was last raised, or never changed; −1 where it was last lowered."""
    tension_in: float
    """T at the proximal end as it was put there [N]; `log_tension` holds it but for rounding."""


class Transmission(NamedTuple):
    """Tension and elongation of a tendon on a route, at one instant."""

    tension_in: float
    """Total tension at the proximal end [N]."""
    tension_out: float
    """Total tension at the distal end [N]."""
    elongation: float
    """Elongation of the tendon inside the sheath, above the pretensioned state [m]."""
    elongation_se: float
    """Standard error of the elongation, from that of the pieces and, in a stream, of the rig [m]."""
    tension_out_se: float
    """Standard error of the distal tension, from that of the pieces and, in a stream, of the rig [N]."""
    direction_index: int
    """ζ: +1 pulling, −1 releasing."""
    dead_zone: bool
    """True where the distal end does not yet respond to the last change of the proximal tension."""
    dead_zone_width: float
    """Further change of the proximal tension, in the present direction, until the distal end responds [N]."""
    slip_front: float
    """Curve angle up to which the tendon slid when the drive last moved, φ*; Φ where all of it did [rad]."""
    displacement_in: float
    """Movement of the drive since the pretensioned state, pulling positive [m]."""
    displacement_out: float
    """Movement of the load since the pretensioned state, towards the tendon positive [m]."""


def check_tension(tension_in: float) -> None:
    """Refuse what no tendon's proximal tension can be [N].

    Raises SettingsError where it is negative, not finite, or beyond `MOST_TENSION`.
    """
    if not 0.0 <= tension_in <= MOST_TENSION:
        raise SettingsError(
            f"tension_in is {tension_in:g} N: a tendon only pulls; give a finite total tension >= 0 N, "
            "and check its unit"
        )


def pretensioned(rig: Rig) -> Corners:
    """Return the tendon before its first pull: the rig's pretension all along."""
    return level(rig.tendon.pretension_N)


def level(tension: float, direction_index: int = 1) -> Corners:
    """Return the same tension [N] all along."""
    return _state(np.array([[0.0], [_log(tension)]]), direction_index, tension)


def step(state: Corners, tension_in: float, friction: float) -> Corners:
    """Move the proximal tension to `tension_in` and return the new tension along the tendon.

    The step is exact for a drive that goes there monotonically, at any speed; docs/model.md (2), (3). An
    unchanged tension returns the same state. One history uses one friction coefficient.

    Parameters
    ----------
    state
        Tension along the tendon before the step.
    tension_in
        New total tension at the proximal end [N].
    friction
        Coulomb coefficient μ between tendon and sheath [1].

    Raises
    ------
    SettingsError
        Where `tension_in` is negative or not finite.
    """
    check_tension(tension_in)
    if tension_in == 0.0 or friction < _FRICTIONLESS:
        return _levelled(state, tension_in)
    count, corners = core.step_corners(state.angle, state.log_tension, math.log(tension_in), friction)
    if count == 0:
        return state
    corners = corners[:, : abs(count)]
    if abs(count) > MAX_CORNERS:
        corners = _thinned(corners)
    return _state(corners, 1 if count > 0 else -1, tension_in)


def tension(state: Corners, phi: Vector) -> Vector:
    """Return the tension [N] at the accumulated curve angles `phi` [rad]."""
    return np.exp(np.interp(phi, state.angle, state.log_tension))


def transmit(state: Corners, arcs: Arcs, rig: Rig) -> Transmission:
    """Return tension, elongation and dead zone of a tendon in `state` on the route `arcs`."""
    way = state.direction_index
    ends, _ = _at_ends(state, arcs, rig)
    tension_out, tension_out_se, elongation, elongation_se, width, front, _ = ends.tolist()
    moved_out = load_moved(tension_out, rig)
    return Transmission(
        tension_in=state.tension_in,
        tension_out=tension_out,
        elongation=elongation,
        elongation_se=elongation_se,
        tension_out_se=tension_out_se,
        direction_index=way,
        dead_zone=width > 0.0,
        dead_zone_width=width,
        slip_front=front,
        displacement_in=elongation + moved_out,
        displacement_out=moved_out,
    )


def elongation_slopes(state: Corners, arcs: Arcs, rig: Rig) -> tuple[Vector, float]:
    """Return how tension and elongation answer to each length and angle, the state held over φ.

    At a corner of the profile a derivative is one-sided: towards larger angle.

    Returns
    -------
    Vector
        [2k] Derivative of the elongation with respect to each length [1], then to each angle, later pieces
        moving on in φ [m/rad].
    float
        Derivative of ln T at the distal end with respect to any one of the angles [1/rad].
    """
    ends, gradient = _at_ends(state, arcs, rig)
    return read_only(gradient), float(ends[6])


def load_moved(tension_out: float, rig: Rig) -> float:
    """Return how far a distal tension stretches the rig's spring beyond its length at the pretension [m].

    A dead weight, of stiffness 0, stays where it is.
    """
    stiffness = rig.load.stiffness_N_per_m
    return (tension_out - rig.tendon.pretension_N) / stiffness if stiffness > 0.0 else 0.0


def _at_ends(state: Corners, arcs: Arcs, rig: Rig) -> tuple[Vector, Vector]:
    """Return what `core.transmit_corners` does."""
    return core.transmit_corners(
        state.angle,
        state.log_tension,
        arcs.length,
        arcs.angle,
        arcs.covariance,
        rig.tendon.compliance_per_N,
        rig.tendon.pretension_N,
        rig.friction.coefficient,
        state.direction_index,
    )


def _log(tension_in: float) -> float:
    return math.log(tension_in) if tension_in > 0.0 else PROFILE.slack


def _levelled(state: Corners, drive: float) -> Corners:
    """Return the same tension all along: what a drive without friction leaves, and one that lets go."""
    change = _log(drive) - state.log_tension[0]
    return state if abs(change) <= ROUNDING.exact else level(drive, 1 if change > 0 else -1)


def _state(corners: Matrix, direction_index: int, tension_in: float) -> Corners:
    corners.setflags(write=False)
    return Corners(corners[0], corners[1], direction_index, tension_in)


def _thinned(corners: Matrix) -> Matrix:
    """Drop the inner corner whose neighbours stand closest together.

    What stays is on the true profile, so the error in ln T is below μ/2 times that distance.
    """
    distance = corners[0, 2:] - corners[0, :-2]
    return np.delete(corners, 1 + int(np.argmin(distance)), axis=1)

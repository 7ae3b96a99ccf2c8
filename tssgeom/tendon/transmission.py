"""What a loaded tendon does on a route: tension at the far end, elongation, dead zone, with standard errors.

Sources: docs/model.md (5)-(14); paper Theorem 2, eqs. (9)-(12).
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.capstan import RESOLUTION, Corners
from tssgeom.tendon.mean_tension import means_on_pieces

_SLIDES = 1e-6  # of ln T: bars are solved to 1e-10, and points on one line within 1e-9 are left out


@dataclass(frozen=True, slots=True)
class Transmission:
    """Tension and elongation of a tendon on a route, at one instant."""

    tension_in: float
    """Total tension at the proximal end [N]."""
    tension_out: float
    """Total tension at the distal end [N]."""
    elongation: float
    """Elongation of the tendon inside the sheath, above the pretensioned state [m]."""
    elongation_se: float
    """Standard error of the elongation from that of the pieces [m]."""
    tension_out_se: float
    """Standard error of the distal tension from that of the pieces [N]."""
    direction_index: int
    """ζ: +1 pulling, −1 releasing."""
    dead_zone: bool
    """True where the distal end has not yet answered to the last change of the proximal tension."""
    dead_zone_width: float
    """How much further the proximal tension has to go, in the present direction, for an answer [N]."""
    slip_front: float
    """Curve angle up to which the tendon slid when the drive last moved, φ*; Φ where all of it did [rad]."""
    displacement_in: float
    """Movement of the drive since the pretensioned state, pulling positive [m]."""
    displacement_out: float
    """Movement of the load since the pretensioned state, towards the tendon positive [m]."""


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Exact derivatives with respect to the length and the angle of each piece."""

    elongation_by_length: Vector
    """[k] Derivative of the elongation with respect to each length [1]."""
    elongation_by_angle: Vector
    """[k] Derivative of the elongation with respect to each angle, later pieces moving on in φ [m/rad]."""
    log_tension_out_by_angle: float
    """Derivative of ln T at the distal end with respect to any one of the angles [1/rad]."""


def transmit(state: Corners, arcs: Arcs, rig: Rig) -> Transmission:
    """Return tension, elongation and dead zone of a tendon in `state` on the route `arcs`."""
    tendon, way = rig.tendon, state.direction_index
    pieces = (arcs.length, arcs.angle, arcs.covariance)
    elastic = (tendon.compliance_per_N, tendon.pretension_N, rig.friction.coefficient)
    seen = on_pieces(state.angle, state.log_tension, pieces, elastic, way)
    tension_out, tension_out_se, elongation, elongation_se, width, front = seen
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


@njit(cache=True, nogil=True)
def on_pieces(
    angle: np.ndarray,
    log_tension: np.ndarray,
    pieces: tuple[np.ndarray, np.ndarray, np.ndarray],
    elastic: tuple[float, float, float],
    way: int,
) -> tuple[float, float, float, float, float, float]:
    """Return what corners [c], [c] mean on a route.

    Parameters
    ----------
    angle, log_tension
        The corners of the profile [rad], [ln N].
    pieces
        Lengths [k] [m], angles [k] [rad] and the covariance of both [2k, 2k].
    elastic
        Compliance [1/N], pretension [N] and coefficient of friction [1].
    way
        Direction index ζ.

    Returns
    -------
    tuple
        Distal tension and its standard error [N], elongation and its standard error [m], width of the dead
        zone [N], curve angle of the slip front [rad].
    """
    compliance, pretension, friction = elastic
    means, log_tension_out, slope_out = means_on_pieces(pieces[1], angle, log_tension)
    tension_out = math.exp(log_tension_out)  # docs/model.md (5)
    elongation, variance, reach, angle_variance = _elongated(
        means, pieces[0], pieces[1], pieces[2], compliance, pretension
    )
    tension_out_se = tension_out * abs(slope_out) * math.sqrt(angle_variance)  # docs/model.md (14)
    width = _dead_zone_width(log_tension[0], log_tension_out, way, friction * reach)
    front = min(_front(angle, log_tension, way * friction), reach)
    return tension_out, tension_out_se, elongation, math.sqrt(variance), width, front


def load_moved(tension_out: float, rig: Rig) -> float:
    """Return how far a distal tension has drawn the rig's spring from where the pretension left it [m].

    A dead weight, of stiffness 0, stays where it is.
    """
    stiffness = rig.load.stiffness_N_per_m
    return (tension_out - rig.tendon.pretension_N) / stiffness if stiffness > 0.0 else 0.0


def sensitivity(state: Corners, arcs: Arcs, rig: Rig) -> Sensitivity:
    """Return how tension and elongation answer to each length and angle, the state held over φ.

    At a corner of the profile the derivative is one-sided: towards larger angle.
    """
    means, _, slope_out = means_on_pieces(arcs.angle, state.angle, state.log_tension)
    tendon, k = rig.tendon, len(arcs.length)
    gradient = _gradient(means, arcs.length, tendon.compliance_per_N, tendon.pretension_N)
    return Sensitivity(read_only(gradient[:k]), read_only(gradient[k:]), slope_out)


@njit(cache=True, nogil=True)
def _gradient(means: Matrix, length: Vector, compliance: float, pretension: float) -> Vector:
    """Differentiate the elongation with respect to each length, then each angle, [2k]."""
    k, later = len(length), 0.0  # what the later pieces gain for an angle added anywhere before them
    gradient = np.empty(2 * k)
    for i in range(k - 1, -1, -1):
        gradient[i] = compliance * (means[0, i] - pretension)  # docs/model.md (10)
        gradient[k + i] = compliance * (length[i] * means[2, i] + later)  # docs/model.md (11)
        later += length[i] * means[1, i]
    return gradient


@njit(cache=True, nogil=True)
def _elongated(
    means: Matrix, length: Vector, angle: Vector, covariance: Matrix, compliance: float, pretension: float
) -> tuple[float, float, float, float]:
    """Elongation and its variance, angle of the whole route and its variance; docs/model.md (9), (13)."""
    k = len(length)
    gradient = _gradient(means, length, compliance, pretension)
    elongation, variance, turned, angle_variance = 0.0, 0.0, 0.0, 0.0
    for i in range(k):
        elongation += compliance * length[i] * (means[0, i] - pretension)
        turned += angle[i]
        for j in range(k):
            angle_variance += covariance[k + i, k + j]
    for i in range(2 * k):
        for j in range(2 * k):
            variance += gradient[i] * covariance[i, j] * gradient[j]
    return elongation, max(variance, 0.0), turned, max(angle_variance, 0.0)


@njit(cache=True, nogil=True)
def _dead_zone_width(log_tension_in: float, log_tension_out: float, way: int, reach: float) -> float:
    """Return how far the proximal tension is from moving the distal end [N]; `reach` is μΦ."""
    needed = log_tension_out + way * reach  # docs/model.md (6)
    if way * (needed - log_tension_in) <= RESOLUTION:
        return 0.0
    return abs(_exp(needed) - _exp(log_tension_in))


@njit(cache=True, nogil=True)
def _front(angle: np.ndarray, log_tension: np.ndarray, slope: float) -> float:
    """Return where the run that starts at the proximal end with the slope of sliding ends [rad]."""
    if len(angle) == 1:
        return math.inf
    slides = abs(log_tension[0] - log_tension[1] - slope * angle[1]) <= _SLIDES
    return angle[1] if slides else 0.0  # docs/model.md (4)


@njit(cache=True, nogil=True)
def _exp(exponent: float) -> float:
    return math.exp(min(exponent, 700.0))  # beyond it float64 ends: 1e304 N stands for out of reach

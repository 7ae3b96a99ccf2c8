"""What a loaded tendon does on a route: tension at the far end, elongation, dead zone, with standard errors.

A piece is cut at the corners of the tension profile. Within each run ln T is linear in the accumulated curve
angle, hence also in arc length, and the integrals of the tension are elementary. A straight piece is a run
over which the angle, and so the tension, does not change. Sources: docs/model.md (5)-(14); paper Theorem 2,
eqs. (9)-(12).
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.bar_state import BarState, through_bars
from tssgeom.tendon.capstan import RESOLUTION, Corners, load_moved

_SERIES_BELOW = 1e-2  # there the cubic series of h is better than its closed form
_SOLVED = 1e-8  # ln T of bars within which the front has come through: they are solved to 1e-10
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


def of_corners(state: Corners, arcs: Arcs, rig: Rig) -> Transmission:
    """Return tension, elongation and dead zone of a tendon in `state` on the route `arcs`."""
    tendon, way = rig.tendon, state.direction_index
    pieces = (arcs.length, arcs.angle, arcs.covariance)
    elastic = (tendon.compliance_per_N, tendon.pretension_N, rig.friction.coefficient)
    tension_out, tension_out_se, elongation, elongation_se, width, front = on_pieces(
        state.angle, state.log_tension, pieces, elastic, way
    )
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


def of_bars(state: BarState, arcs: Arcs, rig: Rig) -> Transmission:
    """Return tension, elongation and dead zone of bars on the route `arcs`; docs/model.md (49)."""
    tendon, way = rig.tendon, state.direction_index
    pieces = (arcs.length, arcs.angle, arcs.covariance)
    elastic = (tendon.compliance_per_N, tendon.pretension_N, rig.friction.coefficient)
    tension_out, tension_out_se, _, elongation_se, width, front = _on_route(
        state.edge, state.tension, arcs.total_angle, pieces, elastic, way
    )
    inside = width > _SOLVED * max(state.tension_in, tension_out)  # bars are less exact than corners
    return Transmission(
        tension_in=state.tension_in,
        tension_out=state.tension_out,
        elongation=state.elongation,
        elongation_se=elongation_se,
        tension_out_se=tension_out_se,
        direction_index=way,
        dead_zone=inside,
        dead_zone_width=width if inside else 0.0,
        slip_front=front,
        displacement_in=state.displacement_in,
        displacement_out=state.displacement_out,
    )


@njit(cache=True, nogil=True)
def _on_route(
    edge: np.ndarray,
    tension: np.ndarray,
    turned: float,
    pieces: tuple[np.ndarray, np.ndarray, np.ndarray],
    elastic: tuple[float, float, float],
    way: int,
) -> tuple[float, float, float, float, float, float]:
    """Return what `on_pieces` does, of the corners through the bars."""
    angle, log_tension = through_bars(edge, tension, pieces[0], pieces[1], turned)
    return on_pieces(angle, log_tension, pieces, elastic, way)


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


@njit(cache=True, nogil=True)
def mean_decay(x):
    """Mean of exp(−xτ) over 0 ≤ τ ≤ 1 [1]."""
    return 1.0 if x == 0.0 else -math.expm1(-x) / x  # docs/model.md (8)


@njit(cache=True, nogil=True)
def mean_decay_moment(x):
    """Mean of τ·exp(−xτ) over 0 ≤ τ ≤ 1 [1]."""
    if abs(x) < _SERIES_BELOW:
        return 1 / 2 - x * (1 / 3 - x * (1 / 8 - x * (1 / 30 - x * (1 / 144 - x / 840))))
    return (mean_decay(x) - math.exp(-x)) / x  # docs/model.md (12)


@njit(cache=True, nogil=True)
def _slope(angle, log_tension, segment):
    """Slope of ln T over φ behind corner number `segment` [1/rad]."""
    if segment + 1 == angle.size:
        return 0.0
    return (log_tension[segment + 1] - log_tension[segment]) / (angle[segment + 1] - angle[segment])


@njit(cache=True, nogil=True)
def _run(log_tension_at_start, slope, span, before, share):
    """Return what one run adds to the means over its piece: of T, of dT/dφ, and of t·dT/dφ.

    `span` is the angle of the run [rad]; t goes from 0 to 1 along the piece, and the run lies between
    `before` and `before + share`.
    """
    x = abs(slope) * span  # from the end where the tension is greater: it may start from none
    greatest = share * math.exp(log_tension_at_start + max(slope * span, 0.0))
    level = greatest * mean_decay(x)  # docs/model.md (9)
    moment = greatest * mean_decay_moment(x)
    if slope > 0.0:
        moment = level - moment
    return level, slope * level, slope * (before * level + share * moment)  # docs/model.md (9), (12)


@njit(cache=True, nogil=True)
def means_on_pieces(piece_angle, angle, log_tension):
    """Return the tension on each piece and at the distal end.

    Parameters
    ----------
    piece_angle
        [k] Accumulated curve angle of each piece [rad].
    angle, log_tension
        [c] Corners of the tension profile [rad], [ln N].

    Returns
    -------
    means
        [3, k] Means over the arc length of each piece: of T [N]; of dT/dφ, which is the derivative of the
        first with respect to the angle of any earlier piece [N/rad]; of t·dT/dφ with t from 0 to 1 along the
        piece, which is its derivative with respect to the piece's own angle [N/rad].
    log_tension_out, slope_out
        ln T at the distal end [ln N], and its derivative with respect to the angle of any piece [1/rad].
    """
    means = np.zeros((3, piece_angle.size))
    segment, at = 0, 0.0
    log_tension_here, slope = log_tension[0], 0.0
    for piece in range(piece_angle.size):
        start, end = at, at + piece_angle[piece]
        while True:
            while segment + 1 < angle.size and angle[segment + 1] <= at:
                segment += 1
            stop = end if segment + 1 == angle.size else min(end, angle[segment + 1])
            before, share = 0.0, 1.0
            if end > start:
                before, share = (at - start) / (end - start), (stop - at) / (end - start)
            slope = _slope(angle, log_tension, segment)
            log_tension_here = log_tension[segment] + slope * (at - angle[segment])
            level, drop, turn = _run(log_tension_here, slope, stop - at, before, share)
            means[0, piece] += level
            means[1, piece] += drop
            means[2, piece] += turn
            log_tension_here += slope * (stop - at)
            at = stop
            if not at < end:
                break
    return means, log_tension_here, slope

"""Mean tension on each piece of constant curvature, in closed form, with its derivatives.

A piece is cut at the corners of the tension profile. Within each run ln T is linear in the accumulated curve
angle, hence also in arc length, and the integrals are elementary. A straight piece is a run over which the
angle, and so the tension, does not change. Sources: docs/model.md (8)-(12); paper Theorem 2, eqs. (11), (12).
"""

import math

import numpy as np
from numba import njit

_SERIES_BELOW = 1e-2  # there the cubic series of h is better than its closed form


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

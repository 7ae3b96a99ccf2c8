"""Where a tendon is cut into bars, and what the route makes of its bars and of the contacts between them.

Bars are cut at fractions of the tendon, not of any one route: pieces, points and the sensed length may change
from step to step and the history of each bar stays with it. Source: docs/model.md (41), (60), (63).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from tssgeom.arrays import Vector
from tssgeom.effects.kinds import Setup
from tssgeom.route.pieces import Arcs

_GRADING = 1.5  # power of the share at which bars are cut: fronts start at the drive, so bars there are small
_FIRST = 0.1  # the first bar is smaller by this factor: a position drive does not know what its contact holds


@dataclass(frozen=True, slots=True)
class ContactGrid:
    """The bars and contacts of a tendon on one route."""

    length: Vector
    """[n] Arc length under each bar [m]."""
    mean_angle: Vector
    """[n] Mean of the accumulated curve angle φ over each bar, to which its tension belongs [rad]."""
    angle: Vector
    """[n+1] Curve angle of each contact; their sum is Φ [rad]."""
    span: Vector
    """[n+1] Length of sheath of each contact; their sum is L [m]."""


def equal_edges(bars: int, halvings: int = 0, halvings_out: int = 0) -> Vector:
    """Return where to cut the tendon into equal bars, as fractions of its length [bars + 1].

    Each of `halvings` cuts the first bar in two once more, each of `halvings_out` the last one.
    """
    edge = _refined(np.linspace(0.0, 1.0, bars + 1), halvings)
    return 1.0 - _refined(1.0 - edge[::-1], halvings_out)[::-1] if halvings_out else edge


def _refined(edge: Vector, halvings: int) -> Vector:
    """Cut the first bar in two, the part next to the end again, and so on."""
    return np.concatenate(([0.0], edge[1] * 0.5 ** np.arange(halvings, 0, -1), edge[1:]))


def edges(arcs: Arcs, bars: int) -> Vector:
    """Return where to cut the tendon, as fractions of its length, [bars + 1]; docs/model.md (63).

    Half of the bars go by length, half by angle, so that sharp bends get several.
    """
    s = np.concatenate(([0.0], np.cumsum(arcs.length)))
    phi = np.concatenate(([0.0], np.cumsum(arcs.angle)))
    s, phi = s / s[-1], phi / max(phi[-1], 1e-12)
    blend = (s + phi) / (s[-1] + phi[-1])
    cut = np.interp(np.linspace(0.0, 1.0, bars + 1) ** _GRADING, blend, s)
    cut[0], cut[-1] = 0.0, 1.0
    cut[1] *= _FIRST
    return cut


@njit(cache=True, nogil=True)
def bent(length, angle, bends):
    """Return lengths and angles of the pieces with hidden bends added; docs/model.md (60).

    `bends` [m, 3] holds the middle [m], the angle [rad] and the width [m] of each.
    """
    for i in range(bends.shape[0]):
        middle, extra, width = bends[i]
        end = np.concatenate((np.zeros(1), np.cumsum(length)))
        whole = end[-1]
        start = min(max(middle - 0.5 * width, 0.0), whole)
        stop = min(max(middle + 0.5 * width, 0.0), whole)
        if stop - start < 1e-9 * whole:
            start, stop = max(start - width, 0.0), min(stop + width, whole)
        knots = np.unique(np.concatenate((np.array([start, stop]), end)))
        phi = np.interp(knots, end, np.concatenate((np.zeros(1), np.cumsum(angle))))
        for k in range(knots.size):
            phi[k] += extra * min(max((knots[k] - start) / (stop - start), 0.0), 1.0)
        length, angle = np.diff(knots), np.diff(phi)
    return length, angle


def with_bends(setup: Setup, arcs: Arcs) -> Arcs:
    """Return the route as the tendon feels it, hidden bends included; docs/model.md (60)."""
    if not setup.bends:
        return arcs
    return Arcs.exact(*bent(arcs.length, arcs.angle, np.array(setup.bends)))


def discretise(edge: Vector, arcs: Arcs) -> ContactGrid:
    """Put bars, cut at the fractions `edge` of the tendon, at the same fractions of a route."""
    return ContactGrid(*discretised(edge, arcs.length, arcs.angle))


@njit(cache=True, nogil=True)
def discretised(edge, piece_length, piece_angle):
    """Return length and mean φ of each bar, angle and span of each contact; docs/model.md (41)."""
    n = edge.size - 1
    length, mean_angle = np.empty(n), np.empty(n)
    angle, span = np.empty(n + 1), np.empty(n + 1)
    whole = np.sum(piece_length)
    piece, begin, phi = 0, 0.0, 0.0  # the piece, where it begins, and φ there
    s, phi_before, middle_before = 0.0, 0.0, 0.0
    phi_here = 0.0
    for k in range(n):
        start, end = s, edge[k + 1] * whole
        if k == n - 1:
            end = whole
        moment = 0.0
        while True:
            stop = begin + piece_length[piece]
            if piece == piece_length.size - 1 or stop > end:
                stop = end
            phi_stop = phi + piece_angle[piece] * (stop - begin) / piece_length[piece]
            moment += 0.5 * (phi_here + phi_stop) * (stop - s)
            s, phi_here = stop, phi_stop
            if s >= end:
                break
            begin += piece_length[piece]
            phi += piece_angle[piece]
            piece += 1
        length[k] = end - start
        mean_angle[k] = moment / length[k]
        angle[k] = max(mean_angle[k] - phi_before, 0.0)
        span[k] = 0.5 * (start + end) - middle_before
        phi_before, middle_before = mean_angle[k], 0.5 * (start + end)
    angle[n] = max(phi_here - phi_before, 0.0)
    span[n] = whole - middle_before
    return length, mean_angle, angle, span

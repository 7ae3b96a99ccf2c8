"""The tendon as a chain of bars that carry their tension with them, whatever happens to the route.

Bars are cut at fractions of the tendon, not of any one route: pieces, points and the sensed length may change
from step to step and the history of each bar stays with it. Source: docs/model.md (41), (48), (49).
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tssgeom.arrays import Vector, read_only
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.capstan import RESOLUTION, SLACK, Corners, tension
from tssgeom.tendon.transmission import load_moved

Signs = Annotated[NDArray[np.int8], "n"]

BARS = 60
"""Bars of a tendon where nothing else is asked for."""


@dataclass(frozen=True, slots=True)
class MaterialState:
    """Tension and slack of every bar of the tendon, and how far both ends have moved.

    Bar 0 is what drives the proximal end, the last bar what the distal end pulls against; between them are
    the n bars of the tendon in the sheath. Contacts with the sheath lie between neighbours.
    """

    edge: Vector
    """[n+1] Where the bars are cut, as fractions of the tendon in the sheath, from 0 to 1 [1]."""
    tension: Vector
    """[n+2] Tension of each bar [N]."""
    slack: Vector
    """[n+2] Length that each bar has to be pulled before it carries tension [m]."""
    inelastic: Vector
    """[n+2] Length that each bar gained other than by tension: creep, heat [m]."""
    slip: Signs
    """[n+1] What each contact did in the last step: +1 slid on a pull, 0 stuck, −1 slid on a release."""
    length: float
    """Length of the route at the last step [m]."""
    displacement_in: float
    """Movement of the drive since the pretensioned state, pulling positive [m]."""
    displacement_out: float
    """Movement of the load since the pretensioned state, towards the tendon positive [m]."""
    elongation: float
    """Elongation of the tendon inside the sheath, above the pretensioned state [m]."""
    direction_index: int
    """ζ: +1 where the proximal end was last pulled, or never moved; −1 where it was last released."""
    iterations: int
    """Linear solves that the last step took."""

    @property
    def tension_in(self) -> float:
        """Total tension at the proximal end [N]."""
        return float(self.tension[0])

    @property
    def tension_out(self) -> float:
        """Total tension at the distal end [N]."""
        return float(self.tension[-1])


@dataclass(frozen=True, slots=True)
class Bed:
    """A route as the bars lie on it."""

    length: Vector
    """[n] Arc length under each bar [m]."""
    place: Vector
    """[n] Accumulated curve angle at which each bar's tension stands: its mean over the bar [rad]."""
    angle: Vector
    """[n+1] Curve angle of each contact; their sum is Φ [rad]."""
    span: Vector
    """[n+1] Length of sheath of each contact; their sum is L [m]."""


def pretensioned_bars(rig: Rig, arcs: Arcs, bars: int = BARS, *, halvings: int = 0) -> MaterialState:
    """Return the tendon before its first pull, cut into equal bars: the rig's pretension all along.

    Each of `halvings` cuts the first and the last bar in two.
    """
    edge = _refined(np.linspace(0.0, 1.0, bars + 1), halvings)
    edge = 1.0 - _refined(1.0 - edge[::-1], halvings)[::-1]
    return _at_rest(edge, np.full(len(edge) + 1, rig.tendon.pretension_N), arcs.total_length)


def lay(edge: Vector, arcs: Arcs) -> Bed:
    """Lay bars, cut at the fractions `edge` of the tendon, on a route at the same fractions of its length."""
    return Bed(*_lay(edge, arcs.length, arcs.angle))


def to_bars(state: Corners, arcs: Arcs, rig: Rig, bars: int = BARS, *, halvings: int = 0) -> MaterialState:
    """Hand a corner list over to the bars: the same tension at the place of every bar.

    Both advance alike on a fixed route under force drive, so it does not matter when they are exchanged. The
    load is taken for the rig's spring, which sets the displacements; docs/model.md (48). Each of `halvings`
    cuts the first bar in two.
    """
    edge = _refined(np.linspace(0.0, 1.0, bars + 1), halvings)
    bed = lay(edge, arcs)
    phi = np.concatenate(([0.0], bed.place, [arcs.total_angle]))
    stretch = rig.tendon.compliance_per_N * bed.length
    held = tension(state, phi)
    rest = _at_rest(edge, held, arcs.total_length)
    elongation = float(stretch @ (held[1:-1] - rig.tendon.pretension_N))
    moved = load_moved(float(held[-1]), rig)
    return MaterialState(
        edge=rest.edge,
        tension=rest.tension,
        slack=rest.slack,
        inelastic=rest.inelastic,
        slip=rest.slip,
        length=rest.length,
        displacement_in=elongation + moved,
        displacement_out=moved,
        elongation=elongation,
        direction_index=state.direction_index,
        iterations=0,
    )


def to_corners(edge: Vector, held: Vector, direction_index: int, arcs: Arcs) -> Corners:
    """Hand bars over to a corner list on the route `arcs`: ln T linear in φ between their places.

    The bars are cut at the fractions `edge` [n+1] and have the tensions `held` [n+2] [N]. The list knows
    neither slack nor displacement, and friction that bounds the slope of ln T over φ; docs/model.md (49).
    """
    angle, log_tension = through_bars(edge, held, arcs.length, arcs.angle, arcs.total_angle)
    return Corners(read_only(angle), read_only(log_tension), direction_index, float(held[0]))


def _refined(edge: Vector, halvings: int) -> Vector:
    """Cut the first bar in two, the part next to the end again, and so on."""
    return np.concatenate(([0.0], edge[1] * 0.5 ** np.arange(halvings, 0, -1), edge[1:]))


def _at_rest(edge: Vector, held: Vector, length: float) -> MaterialState:
    slip = np.zeros(len(edge), dtype=np.int8)
    slip.setflags(write=False)
    none = read_only(np.zeros(len(held)))
    return MaterialState(read_only(edge), read_only(held), none, none, slip, length, 0.0, 0.0, 0.0, 1, 0)


@njit(cache=True, nogil=True)
def _corners(phi, log_tension):
    """Return which points are needed: of points at one angle the last, of points on one line its ends."""
    keep = np.zeros(phi.size, dtype=np.bool_)
    keep[0] = True
    last = 0
    for i in range(1, phi.size - 1):
        if phi[i + 1] <= phi[i] or phi[i] <= phi[last]:
            continue
        here = (log_tension[i] - log_tension[last]) / (phi[i] - phi[last])
        bend = (log_tension[i + 1] - log_tension[i]) / (phi[i + 1] - phi[i]) - here
        if abs(bend) * (phi[i + 1] - phi[last]) > 1e3 * RESOLUTION:
            keep[i] = True
            last = i
    keep[-1] = phi[-1] > phi[last]
    return keep


@njit(cache=True, nogil=True)
def through_bars(edge, held, piece_length, piece_angle, turned):
    """Return φ and ln T of the corners through bars on a route that turns by `turned` [rad], [ln N]."""
    _, place, _, _ = _lay(edge, piece_length, piece_angle)
    beyond = turned * (1.0 + 0.1 * RESOLUTION)  # rounding leaves no gap before the distal end
    return _profile(place, beyond, held)


@njit(cache=True, nogil=True)
def _profile(place, end, tension):
    """Return φ and ln T of the corners through the bars' places and both ends, as few as are needed."""
    phi, log_tension = np.empty(tension.size), np.empty(tension.size)
    phi[0], phi[1:-1], phi[-1] = 0.0, place, end
    for i in range(tension.size):
        log_tension[i] = np.log(tension[i]) if tension[i] > 0.0 else SLACK
    keep = _corners(phi, log_tension)
    return phi[keep], log_tension[keep]


@njit(cache=True, nogil=True)
def _lay(edge, piece_length, piece_angle):
    """Return length and place of each bar, angle and span of each contact; docs/model.md (41)."""
    n = edge.size - 1
    length, place = np.empty(n), np.empty(n)
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
        place[k] = moment / length[k]
        angle[k] = max(place[k] - phi_before, 0.0)
        span[k] = 0.5 * (start + end) - middle_before
        phi_before, middle_before = place[k], 0.5 * (start + end)
    angle[n] = max(phi_here - phi_before, 0.0)
    span[n] = whole - middle_before
    return length, place, angle, span

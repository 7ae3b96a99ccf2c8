"""Where a tendon is cut into bars, and what the route makes of its bars and of the contacts between them.

Bars are cut at fractions of the tendon, not of any one route: pieces, points and the sensed length may change
from step to step and the history of each bar stays with it. Source: docs/model.md (41), (60), (63).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector, read_only
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
    return _edges(arcs.length.tobytes(), arcs.angle.tobytes(), bars)


@lru_cache(maxsize=64)  # chosen: fits ask for the same few routes again and again
def _edges(length: bytes, angle: bytes, bars: int) -> Vector:
    s = np.concatenate(([0.0], np.cumsum(np.frombuffer(length))))
    phi = np.concatenate(([0.0], np.cumsum(np.frombuffer(angle))))
    s, phi = s / s[-1], phi / max(phi[-1], 1e-12)
    blend = (s + phi) / (s[-1] + phi[-1])
    cut = np.interp(np.linspace(0.0, 1.0, bars + 1) ** _GRADING, blend, s)
    cut[0], cut[-1] = 0.0, 1.0
    cut[1] *= _FIRST
    return read_only(cut)


def bends_of(setup: Setup) -> Matrix:
    """Return middle [m], angle [rad] and width [m] of each hidden bend, [m, 3]."""
    return np.array(setup.bends, dtype=np.float64).reshape(-1, 3)


def with_bends(setup: Setup, arcs: Arcs) -> Arcs:
    """Return the route as the tendon feels it, hidden bends included; docs/model.md (60)."""
    if not setup.bends:
        return arcs
    count, pieces = core.add_bends(arcs.length, arcs.angle, bends_of(setup))
    return Arcs.exact(pieces[0, :count], pieces[1, :count])


def discretise(edge: Vector, arcs: Arcs) -> ContactGrid:
    """Put bars, cut at the fractions `edge` of the tendon, at the same fractions of a route."""
    bars, contacts = core.discretise(edge, arcs.length, arcs.angle)
    return ContactGrid(*bars, *contacts)

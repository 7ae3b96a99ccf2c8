"""What both ends of a tendon on a fixed route show along a whole history of the proximal tension.

Sources: docs/model.md (3), (5), (9).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.core.constants import ROUNDING
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.capstan import pretensioned, step, tension, transmit


@dataclass(frozen=True, slots=True)
class History:
    """Answers of a tendon to one proximal tension after another, from the pretensioned state on."""

    tension_in: Vector
    """[n] Total tension at the proximal end [N]."""
    tension_out: Vector
    """[n] Total tension at the distal end [N]."""
    elongation: Vector
    """[n] Elongation above the pretensioned state [m]."""


def driven(tension_in: Iterable[float], arcs: Arcs, rig: Rig) -> History:
    """Drive a pretensioned tendon through tensions [N], with monotone changes from one to the next.

    Raises SettingsError where a tension is negative or not finite.
    """
    state, rows = pretensioned(rig), list[tuple[float, float, float]]()
    for drive in tension_in:
        state = step(state, drive, rig.friction.coefficient)
        ends = transmit(state, arcs, rig)
        rows.append((drive, ends.tension_out, ends.elongation))
    columns = np.array(rows, dtype=np.float64).reshape(-1, 3).T
    return History(read_only(columns[0]), read_only(columns[1]), read_only(columns[2]))


def profiles(tension_in: Iterable[float], phi: Vector, rig: Rig) -> Matrix:
    """Tension [n, m] [N] at m curve angles `phi` [rad], after each of n proximal tensions [N]."""
    state, rows = pretensioned(rig), list[Vector]()
    for drive in tension_in:
        state = step(state, drive, rig.friction.coefficient)
        rows.append(tension(state, phi))
    return np.array(rows)


def joined(*routes: Arcs) -> Arcs:
    """Routes one after the other, proximal first, as one route; their errors are taken as independent."""
    length = np.concatenate([route.length for route in routes])
    angle = np.concatenate([route.angle for route in routes])
    covariance = np.zeros((2 * len(length),) * 2)
    at = 0
    for route in routes:
        k = len(route.length)
        here = np.concatenate([np.arange(at, at + k), len(length) + np.arange(at, at + k)])
        covariance[np.ix_(here, here)] = route.covariance
        at += k
    return Arcs(read_only(length), read_only(angle), read_only(covariance), routes[-1].method)


def last_peak(tension: Vector) -> int:
    """Index of the last peak within 1 % of the greatest of these tensions [N]; where it is held, the end."""
    high = np.flatnonzero(tension >= 0.99 * tension.max())
    last_visit = np.split(high, np.flatnonzero(np.diff(high) > 1) + 1)[-1]
    top = tension[last_visit].max()
    return int(last_visit[np.flatnonzero(tension[last_visit] >= top * (1 - ROUNDING.exact))[-1]])

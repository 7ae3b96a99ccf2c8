"""Routes in time: whether a sensed route has moved at all, and where a recorded one is between its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.errors import ShapeError
from tssgeom.route.pieces import Arcs


class RouteComparison(NamedTuple):
    """When two sensed routes count as one that has not moved."""

    shares: int = 8
    """Even shares of the length at which the curve angles are compared [1]; chosen."""
    sigmas: float = 3.0
    """Standard errors of a difference that still count as noise [1]; chosen: 99.7 % of normal errors."""
    rounding: float = 1e-9
    """Difference of lengths [1] and angles [rad] that is rounding; chosen."""


SAME = RouteComparison()
"""Used wherever two sensed routes are compared."""


def unmoved(before: Arcs, now: Arcs) -> bool:
    """Whether two sensed routes differ by no more than their errors; docs/model.md (80).

    The accumulated curve angle is compared at even shares of the length, and the length itself.
    """
    return _unmoved(before.length, before.angle, before.covariance, now.length, now.angle, now.covariance)


@dataclass(frozen=True, slots=True)
class MovingRoute:
    """A recorded route: between its frames as between the two nearest ones, outside as the first or last."""

    time: Vector
    """[f] Times of the frames, increasing [s]."""
    arcs: Sequence[Arcs]
    """[f] The route in each frame."""

    def __post_init__(self) -> None:
        if len(self.arcs) == 0:
            raise ShapeError("a moving route has no frame: give at least one")

    def at(self, time: float) -> Arcs:
        """Return the route at a time [s]."""
        after = int(np.searchsorted(self.time, time, side="right"))
        if after == 0 or after == len(self.time):
            return self.arcs[min(after, len(self.arcs) - 1)]
        begin, end = self.time[after - 1], self.time[after]
        return between(self.arcs[after - 1], self.arcs[after], float((time - begin) / (end - begin)))


def between(first: Arcs, second: Arcs, share: float) -> Arcs:
    """Return the route at a share of the way from one to the other; docs/model.md (81).

    Length and accumulated curve angle at each share of the length change linearly, so pieces may differ in
    number. The errors of the two are taken as independent.
    """
    if share == 0.0 or first is second:
        return first
    edges = _merged(_shares(first), _shares(second))
    near, far = _onto(first, edges), _onto(second, edges)
    values = (1 - share) * near @ _values(first) + share * far @ _values(second)
    covariance = (1 - share) ** 2 * near @ first.covariance @ near.T
    covariance += share**2 * far @ second.covariance @ far.T
    cells = len(edges) - 1
    method = first.method if share < 0.5 else second.method
    return Arcs(read_only(values[:cells]), read_only(values[cells:]), read_only(covariance), method)


def _values(arcs: Arcs) -> Vector:
    return np.concatenate((arcs.length, arcs.angle))


def _shares(arcs: Arcs) -> Vector:
    ends = np.concatenate(([0.0], np.cumsum(arcs.length)))
    return ends / ends[-1]


def _merged(first: Vector, second: Vector) -> Vector:
    """Return all joints in order; of joints within rounding of each other one."""
    edges = np.union1d(first, second)
    kept = edges[np.concatenate(([True], np.diff(edges) > SAME.rounding))]
    kept[-1] = 1.0
    return kept


def _onto(arcs: Arcs, edges: Vector) -> Matrix:
    """Return the matrix that takes lengths and angles of pieces to those of cells between `edges`."""
    k, joints = len(arcs.length), _shares(arcs)
    overlap = np.minimum(edges[1:, None], joints[1:]) - np.maximum(edges[:-1, None], joints[:-1])
    onto = np.zeros((2 * len(overlap), 2 * k))
    onto[: len(overlap), :k] = np.diff(edges)[:, None]
    onto[len(overlap) :, k:] = np.maximum(overlap, 0.0) / np.diff(joints)
    return onto


@njit(cache=True, nogil=True)
def _angle_at(share, length, angle, covariance, gradient):
    """Return φ at a share of the length and its variance; `gradient` is room for 2k numbers."""
    k, whole = length.size, np.sum(length)
    piece, begin, phi = 0, 0.0, 0.0
    gradient[:] = 0.0
    while piece < k - 1 and begin + length[piece] < share * whole:
        gradient[k + piece] = 1.0
        begin, phi, piece = begin + length[piece], phi + angle[piece], piece + 1
    inside = min((share * whole - begin) / length[piece], 1.0)
    kappa = angle[piece] / length[piece]
    gradient[k + piece] = inside
    for i in range(k):
        gradient[i] = kappa * share
        if i < piece:
            gradient[i] -= kappa
    gradient[piece] -= kappa * inside
    variance = 0.0
    for i in range(2 * k):
        for j in range(2 * k):
            variance += gradient[i] * covariance[i, j] * gradient[j]
    return phi + inside * angle[piece], variance


@njit(cache=True, nogil=True)
def _unmoved(length, angle, covariance, length_now, angle_now, covariance_now):
    k, m = length.size, length_now.size
    change = np.sum(length_now) - np.sum(length)
    variance = np.sum(covariance[:k, :k]) + np.sum(covariance_now[:m, :m])
    if abs(change) > SAME.sigmas * np.sqrt(max(variance, 0.0)) + SAME.rounding * np.sum(length):
        return False
    room, room_now = np.empty(2 * k), np.empty(2 * m)
    for step in range(SAME.shares, 0, -1):
        share = step / SAME.shares
        phi, spread = _angle_at(share, length, angle, covariance, room)
        phi_now, spread_now = _angle_at(share, length_now, angle_now, covariance_now, room_now)
        if abs(phi_now - phi) > SAME.sigmas * np.sqrt(max(spread + spread_now, 0.0)) + SAME.rounding:
            return False
    return True

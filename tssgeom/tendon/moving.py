"""Routes in time: whether a sensed route has moved at all, and where a recorded one is between its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.core.constants import ROUNDING
from tssgeom.errors import ShapeError
from tssgeom.route.pieces import Arcs


def unmoved(before: Arcs, now: Arcs) -> bool:
    """Whether two sensed routes differ by no more than their errors; docs/model.md (80).

    The accumulated curve angle is compared at even shares of the length, and the length itself.
    """
    return bool(
        core.is_unmoved(
            before.length, before.angle, before.noise_covariance, now.length, now.angle, now.noise_covariance
        )
    )


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
    form = (1 - share) ** 2 * first.form_variance + share**2 * second.form_variance
    models = (1 - share) ** 2 * first.model_variance + share**2 * second.model_variance
    return Arcs(
        read_only(values[:cells]), read_only(values[cells:]), read_only(covariance), method, form, models
    )


def _values(arcs: Arcs) -> Vector:
    return np.concatenate((arcs.length, arcs.angle))


def _shares(arcs: Arcs) -> Vector:
    ends = np.concatenate(([0.0], np.cumsum(arcs.length)))
    return ends / ends[-1]


def _merged(first: Vector, second: Vector) -> Vector:
    """Return all joints in order; of joints within rounding of each other one."""
    edges = np.union1d(first, second)
    kept = edges[np.concatenate(([True], np.diff(edges) > ROUNDING.relative))]
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

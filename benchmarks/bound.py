"""Cramér–Rao bound: the least standard deviation that any unbiased estimator can have on a chain of arcs.

The chain is described by its start, its first direction, the curvature vectors of its curved pieces, its
joints and, where stations are unknown, its length. That a piece is straight, and how many pieces there are,
counts as known. With C the inverse of JᵀJ/σ², J the derivatives of all points, a quantity with gradient g has
the bound √(gᵀCg).

Where stations are unknown, each is one more parameter, which takes away what its point says along the
tangent. The first and the last point lie at the ends of the route, so they keep all three components; that
brings the variance σ²(κ_first² + κ_last²) of angles at unknown ends by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.routes import arc_positions
from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.rig import Rig
from tssgeom.route.synthetic import Course

RIG = Rig()
TENSION_IN = 15.0
"""Tension at the proximal end, from a slack tendon [N]."""


def first_pull(length: Vector, angle: Vector) -> float:
    """Elongation [m] on pieces of the given lengths [m] and angles [rad]; docs/model.md (9), T_0 = 0."""
    turn = RIG.friction.coefficient * angle
    reaching = TENSION_IN * np.exp(-(np.cumsum(turn) - turn))
    mean = np.where(turn > 1e-12, -np.expm1(-turn) / np.maximum(turn, 1e-300), 1.0)
    return float(RIG.tendon.compliance_per_N * (length * mean) @ reaching)


_STEP = 1e-6  # of a length of the route, of an angle of 1, of a curvature of one over the length
_SINGULAR = 1e-9  # smallest singular value over the largest, with columns of equal length


@dataclass(frozen=True, slots=True)
class Bound:
    """Least standard deviations; infinite where the points do not determine the chain."""

    angle: float
    """Of Φ [rad]."""
    elongation: float
    """Of the elongation on the first pull to 15 N [m]."""


def cramer_rao(course: Course, station: Vector, noise: float, *, stations_known: bool) -> Bound:
    """Bound for one layout of stations.

    Parameters
    ----------
    course
        True chain of arcs.
    station
        True arc length of each usable point, the first 0 and the last the length of the route [m].
    noise
        Standard deviation of each coordinate [m].
    stations_known
        Whether the sensor tells the stations.
    """
    chain = _Chain(course, stations_known)
    jacobian = chain.jacobian(lambda theta: chain.points(theta, station))
    if not stations_known:
        jacobian = _across(jacobian, chain.tangents(station))
    gradient = chain.jacobian(chain.quantities)
    deviation = noise * _deviations(jacobian.reshape(-1, chain.size), gradient)
    return Bound(float(deviation[0]), float(deviation[1]))


class _Chain:
    """A chain of arcs as a function of its parameters, which are all 0 at the truth."""

    def __init__(self, course: Course, stations_known: bool) -> None:
        self.course = course
        self.curved = np.flatnonzero(np.any(course.bend != 0.0, axis=1))
        self.edges = np.concatenate(([0.0], np.cumsum(course.length)))
        self.known = stations_known
        self.bends = 5 + 2 * len(self.curved)  # where the joints begin
        self.size = self.bends + len(course.length) - int(stations_known)

    def at(self, theta: Vector) -> Course:
        """Pieces for parameters `theta`."""
        bend, edges = self.course.bend.copy(), self.edges.copy()
        bend[self.curved] += theta[5 : self.bends].reshape(-1, 2)
        edges[1 : 1 + self.size - self.bends] += theta[self.bends :]
        return Course(np.diff(edges), bend)

    def points(self, theta: Vector, station: Vector) -> Points:
        """Places of the stations; the last one moves with the length, where that is free."""
        moved = station.copy()
        course = self.at(theta)
        if not self.known:
            moved[-1] = course.length.sum()
        turn = Rotation.from_rotvec([0.0, theta[3], theta[4]])
        return turn.apply(arc_positions(course)(moved)) + theta[:3]

    def quantities(self, theta: Vector) -> Vector:
        """Φ [rad] and elongation [m]."""
        course = self.at(theta)
        angle = np.hypot(*course.bend.T) * course.length
        return np.array([angle.sum(), first_pull(course.length, angle)])

    def tangents(self, station: Vector) -> Points:
        """Return the unit tangents at the stations."""
        position, step = arc_positions(self.course), _STEP * self.edges[-1]
        return (position(station + step) - position(station - step)) / (2 * step)

    def jacobian(self, function: Callable[[Vector], np.ndarray]) -> np.ndarray:
        """Differentiate a function by every parameter, in a last axis, by central differences."""
        steps = np.full(self.size, _STEP * self.edges[-1])
        steps[3:5] = _STEP
        steps[5 : self.bends] = _STEP / self.edges[-1]
        columns = [(function(h) - function(-h)) / (2 * h.sum()) for h in np.diag(steps)]
        return np.stack(columns, axis=-1)


def _across(jacobian: np.ndarray, tangent: Points) -> np.ndarray:
    """Drop what inner points say along the tangent [n, 3, parameters]."""
    along = np.einsum("nc,ncp->np", tangent, jacobian)
    along[[0, -1]] = 0.0
    return jacobian - tangent[:, :, None] * along[:, None, :]


def _deviations(jacobian: Matrix, gradient: Matrix) -> Vector:
    """√(g (JᵀJ)⁻¹ gᵀ) of each row g, infinite where J lacks rank."""
    scale = np.linalg.norm(jacobian, axis=0) + 1e-300
    _, singular, directions = np.linalg.svd(jacobian / scale, full_matrices=False)
    if len(singular) < jacobian.shape[1] or singular[-1] < _SINGULAR * singular[0]:
        return np.full(len(gradient), np.inf)
    return np.linalg.norm((gradient / scale) @ directions.T / singular, axis=1)

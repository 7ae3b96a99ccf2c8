"""Constant-curvature pieces: what the tendon model needs to know of a route."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.route.curvature import CurvatureProfile, angle_covariance
from tssgeom.route.spline.fit import Spline


class Staircase(NamedTuple):
    """How smooth curvature is cut into pieces of constant curvature; docs/model.md (27)."""

    most_cells: int = 400
    """Cells on which joints may lie. Chosen: by speed, the cut takes time quadratic in them."""
    least_step: float = 0.03
    """Steps of curvature below which a piece is not worth it, over the greatest curvature [1]. Chosen."""
    parameters_per_piece: float = 3.0
    """Parameters of one more piece [1]. Derived: two of curvature, one joint."""


STAIRCASE = Staircase()


@dataclass(frozen=True, slots=True)
class Arcs:
    """A route as pieces of constant curvature, proximal to distal; a straight piece has angle 0."""

    length: Vector
    """Arc length of each piece [m]."""
    angle: Vector
    """Accumulated curve angle of each piece, >= 0 [rad]."""
    covariance: Matrix
    """Covariance of all lengths followed by all angles, 2k by 2k [m, rad]."""
    method: str
    """Estimator behind the pieces: "spline", "arcs", or "exact" for given numbers."""

    @classmethod
    def exact(cls, length: Vector, angle: Vector) -> Arcs:
        """Pieces that are known without error: lengths [m] and angles [rad]."""
        length, angle = np.atleast_1d(length), np.atleast_1d(angle)
        return cls(read_only(length), read_only(angle), read_only(np.zeros((2 * len(length),) * 2)), "exact")

    @property
    def kappa(self) -> Vector:
        """Curvature of each piece [1/m]."""
        return self.angle / self.length

    @property
    def s_start(self) -> Vector:
        """Arc length at which each piece begins [m]."""
        return np.concatenate(([0.0], np.cumsum(self.length)[:-1]))

    @property
    def total_length(self) -> float:
        """Arc length of the whole route [m]."""
        return math.fsum(self.length)

    @property
    def total_angle(self) -> float:
        """Accumulated curve angle of the whole route, Φ [rad]."""
        return math.fsum(self.angle)

    @property
    def total_angle_se(self) -> float:
        """Standard error of the accumulated curve angle [rad]."""
        k = len(self.length)
        return math.sqrt(max(float(self.covariance[k:, k:].sum()), 0.0))


def constant_curvature_pieces(spline: Spline, profile: CurvatureProfile) -> Arcs:
    """Cut a fitted route into pieces of constant curvature that keep its length and angle.

    The joints come from exact dynamic programming on the curvature vector in the parallel-transport
    frame, their number from the Bayesian information criterion; docs/model.md (27).
    """
    joints = _joints(spline)
    length, angle = np.diff(profile.s[joints]), np.diff(profile.phi[joints])
    spread = angle_covariance(spline, joints)
    k = len(length)
    covariance = np.zeros((2 * k, 2 * k))
    rest = max(profile.total_angle_se**2 - spread.sum(), 0.0)
    covariance[k:, k:] = spread + spread_over_angles(angle, rest)
    if not spline.stations_known:
        for end in (0, k - 1):
            covariance[end, end] += spline.route.noise**2
    return Arcs(read_only(length), read_only(angle), read_only(covariance), "spline")


def spread_over_angles(angle: Vector, variance: float) -> Matrix:
    """Spread a variance of the whole angle over the pieces in proportion to their angles [k, k] [rad²]."""
    share = angle / max(angle.sum(), 1e-300)
    return np.outer(share, share) * variance


def _joints(spline: Spline) -> np.ndarray:
    """Nodes at which the pieces meet, with both ends."""
    route = spline.route
    penalty = STAIRCASE.parameters_per_piece * math.log(max(len(route.weight), 2.0))
    cells = np.linspace(0, len(route.s) - 1, min(len(route.s) - 1, STAIRCASE.most_cells) + 1)
    return _cut(
        route.s,
        route.tangent,
        route.curvature_vector,
        spline.covariance,
        np.round(cells).astype(np.int64),
        spline.freedom,
        penalty,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _cut(
    s: np.ndarray,
    tangent: np.ndarray,
    bend: np.ndarray,
    covariance: np.ndarray,
    nodes: np.ndarray,
    freedom: float,
    penalty: float,
) -> np.ndarray:
    """Nodes among `nodes` at which runs of constant curvature vector meet; docs/model.md (27)."""
    parts = parallel_components(tangent, bend)
    cells = len(nodes) - 1
    mean, variance = np.zeros((cells, 2)), np.zeros(cells)
    sharpest = 0.0
    for i in range(len(s)):
        sharpest = max(sharpest, parts[i, 0] ** 2 + parts[i, 1] ** 2)
    for j in range(cells):
        length = s[nodes[j + 1]] - s[nodes[j]]
        for i in range(nodes[j], nodes[j + 1]):
            half = 0.5 * (s[i + 1] - s[i])
            mean[j, 0] += half * (parts[i, 0] + parts[i + 1, 0]) / length
            mean[j, 1] += half * (parts[i, 1] + parts[i + 1, 1]) / length
            variance[j] += half * (covariance[i, 7] + covariance[i + 1, 7])
        variance[j] += STAIRCASE.least_step**2 * sharpest * length
        # the errors are correlated: the whole route is worth as many values as the fit has parameters
        variance[j] = freedom * length * length / (s[-1] * max(variance[j], 1e-300))
    return nodes[best_partition(mean, variance, penalty)]


@njit(cache=True, nogil=True)
def normals(tangent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors normal to a unit tangent and to each other, right-handed with it."""
    first = np.zeros(3)
    first[np.argmin(np.abs(tangent))] = 1.0
    first -= np.dot(first, tangent) * tangent
    first /= np.linalg.norm(first)
    second = np.empty(3)
    for c in range(3):
        d, e = (c + 1) % 3, (c + 2) % 3
        second[c] = tangent[d] * first[e] - tangent[e] * first[d]
    return first, second


@njit(cache=True, nogil=True, error_model="numpy")
def parallel_components(tangent: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Components of a normal vector field in a frame carried along the tangents without twist, [n, 2]."""
    first, second = normals(tangent[0])
    out = np.empty((len(tangent), 2))
    for i in range(len(tangent)):
        here = tangent[i]
        if i > 0:
            before = tangent[i - 1]
            stripped = 1.0 + before[0] * here[0] + before[1] * here[1] + before[2] * here[2] + 1e-12
            turned = (first[0] * here[0] + first[1] * here[1] + first[2] * here[2]) / stripped
            other = (second[0] * here[0] + second[1] * here[1] + second[2] * here[2]) / stripped
            for c in range(3):
                middle = before[c] + here[c]
                first[c] -= turned * middle
                second[c] -= other * middle
        v = vector[i]
        out[i, 0] = v[0] * first[0] + v[1] * first[1] + v[2] * first[2]
        out[i, 1] = v[0] * second[0] + v[1] * second[1] + v[2] * second[2]
    return out


@njit(cache=True, nogil=True)
def best_partition(value: np.ndarray, weight: np.ndarray, penalty: float) -> np.ndarray:
    """Cut a sequence into runs of constant value, exactly least in squared error plus `penalty` a run.

    Parameters
    ----------
    value, weight
        Sequence of vectors [n, 2] and their precisions [n].
    penalty
        Cost of each run.

    Returns
    -------
    joints
        Indices at which runs begin, and n at the end.
    """
    n = len(value)
    mass, first, square = np.zeros(n + 1), np.zeros((n + 1, 2)), np.zeros(n + 1)
    for i in range(n):
        mass[i + 1] = mass[i] + weight[i]
        for c in range(2):
            first[i + 1, c] = first[i, c] + weight[i] * value[i, c]
        square[i + 1] = square[i] + weight[i] * (value[i, 0] ** 2 + value[i, 1] ** 2)
    cost, begin = np.zeros(n + 1), np.zeros(n + 1, dtype=np.int64)
    cost[0] = -penalty
    alive, left = np.zeros(n + 1, dtype=np.int64), 1  # where a last run may still begin
    so_far = np.empty(n + 1)
    for j in range(1, n + 1):
        cost[j] = np.inf
        for k in range(left):
            i = alive[k]
            a, b = first[j, 0] - first[i, 0], first[j, 1] - first[i, 1]
            within = square[j] - square[i] - (a * a + b * b) / (mass[j] - mass[i])
            so_far[k] = cost[i] + max(within, 0.0)
            if so_far[k] + penalty < cost[j]:
                cost[j], begin[j] = so_far[k] + penalty, i
        # a begin that is now behind a cut at j stays behind it for good
        kept = 0
        for k in range(left):
            if so_far[k] <= cost[j]:
                alive[kept] = alive[k]
                kept += 1
        alive[kept], left = j, kept + 1
    runs, j = 0, n
    while j > 0:
        runs, j = runs + 1, begin[j]
    joints = np.empty(runs + 1, dtype=np.int64)
    joints[runs] = n
    for k in range(runs, 0, -1):
        joints[k - 1] = begin[joints[k]]
    return joints

"""Fitting a chain of arcs to points by Levenberg and Marquardt, with the covariance of its parameters."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.shape.chain import along, normal_equations, project

_SETTLED = 1e-3  # of the noise variance: a step that saves less of the cost is the last
_MOST_STEPS = 40
_LEAST_VARIANCE = 1e-26  # rounding of coordinates [m²]
_MOST_TURN = 2.0  # from point to point [rad]


class Data(NamedTuple):
    """Points and what is known of them, lengths in metres."""

    points: Points
    weight: Vector
    free: bool
    """True where stations are unknown."""
    variance: float
    """Known noise variance of a coordinate, 0 where unknown [m²]."""
    gap: float
    """Shortest piece [m]."""

    @property
    def values(self) -> int:
        """Number of values that are fitted."""
        return (2 if self.free else 3) * int(np.count_nonzero(self.weight))


class Chain(NamedTuple):
    """A fitted chain; see `chain.normal_equations` for its parameters."""

    start: Vector
    axes: Matrix
    joints: Vector
    bend: Points
    curved: np.ndarray
    stations: Vector
    matrix: Matrix
    cost: float


def first_joint_column(free: bool) -> int:
    """Return the parameter of the first inner joint: before it stand the start and two turns."""
    return (2 if free else 3) + 2


def curvature_columns(chain: Chain, free: bool) -> np.ndarray:
    """First parameter of each piece's curvature [k], -1 for a straight piece."""
    base = first_joint_column(free) + len(chain.bend) - 1
    return np.where(chain.curved, base + 2 * (np.cumsum(chain.curved) - 1), -1)


def criterion(data: Data, chain: Chain) -> float:
    """-2 ln of the greatest likelihood, plus the price of every parameter."""
    n = data.values
    price = len(chain.matrix) * math.log(n)
    if data.variance > 0.0:
        return chain.cost / data.variance + n * math.log(data.variance) + price
    return n * math.log(chain.cost / n + 1e-300) + n + price


def noise_variance(data: Data, chain: Chain) -> float:
    """Noise variance of a coordinate, known or from the residuals [m²]."""
    if data.variance > 0.0:
        return data.variance
    return max(chain.cost / max(data.values - len(chain.matrix), 1), _LEAST_VARIANCE)


def parameter_covariance(data: Data, chain: Chain) -> Matrix:
    """Covariance of the parameters, in the order of `chain.normal_equations`."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(chain.matrix), 1e-30))
    inverse = np.linalg.pinv(chain.matrix * scale[:, None] * scale, rcond=1e-13, hermitian=True)
    return np.asarray(noise_variance(data, chain) * inverse * scale[:, None] * scale, dtype=np.float64)


def settle(data: Data, chain: Chain) -> Chain:
    """Fit a chain without changing the number of its pieces; the given matrix and cost are not used."""
    return Chain(*_levenberg_marquardt(*data[:3], data.gap, *chain[:6]))


@njit(cache=True, nogil=True)
def _levenberg_marquardt(
    points: np.ndarray,
    weight: np.ndarray,
    free: bool,
    gap: float,
    start: np.ndarray,
    axes: np.ndarray,
    joints: np.ndarray,
    bend: np.ndarray,
    curved: np.ndarray,
    stations: np.ndarray,
) -> tuple:
    """Least squares from the given chain; returns the fields of `Chain`."""
    s = stations.copy()
    if free:
        project(points, s, start, axes, joints, bend, 2 * gap)
    matrix, gradient, cost = normal_equations(points, weight, s, start, axes, joints, bend, curved, free)
    values = (2 if free else 3) * np.sum(weight > 0)
    damping = 1e-9
    for _ in range(_MOST_STEPS):
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-30))
        scaled = matrix / scale / scale.reshape(-1, 1) + damping * np.eye(len(matrix))
        if not np.isfinite(scaled).all():
            break
        step = np.linalg.solve(scaled, gradient / scale) / scale
        new_start, new_axes, new_joints, new_bend = _moved(
            step, start, axes, joints, bend, curved, free, gap, s[-1]
        )
        new_s = s.copy()
        if free:
            project(points, new_s, new_start, new_axes, new_joints, new_bend, 2 * gap)
            project(points, new_s, new_start, new_axes, new_joints, new_bend, gap)
        new_matrix, new_gradient, new_cost = normal_equations(
            points, weight, new_s, new_start, new_axes, new_joints, new_bend, curved, free
        )
        sane = np.isfinite(new_matrix).all() and np.max(np.abs(new_bend)) * gap < _MOST_TURN
        if sane and new_cost < cost:
            settled = cost - new_cost < _SETTLED * cost / values
            start, axes, joints, bend, s = new_start, new_axes, new_joints, new_bend, new_s
            matrix, gradient, cost = new_matrix, new_gradient, new_cost
            if settled and damping <= 1e-6:
                break
            damping = max(0.03 * damping, 1e-13)
        else:
            if np.sum(step * gradient) < _SETTLED * cost / values or damping > 1e6:
                break
            damping = max(30.0 * damping, 1e-6)
    return start, axes, joints, bend, curved, s, matrix, cost


@njit(cache=True, nogil=True)
def _moved(
    step: np.ndarray,
    start: np.ndarray,
    axes: np.ndarray,
    joints: np.ndarray,
    bend: np.ndarray,
    curved: np.ndarray,
    free: bool,
    gap: float,
    end: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Apply a parameter step, joints kept in order and at least `gap` apart."""
    shifts = 2 if free else 3
    new_start = start.copy()
    for c in range(shifts):
        new_start += step[c] * axes[1 + c] if free else step[c] * np.eye(3)[c]
    turn = step[shifts] * axes[1] + step[shifts + 1] * axes[2]
    size = math.sqrt(np.sum(turn * turn))
    new_axes = axes.copy()
    if size > 0.0:
        unit = turn / size
        for i in range(3):
            v = axes[i]
            cross = np.array(
                [
                    unit[1] * v[2] - unit[2] * v[1],
                    unit[2] * v[0] - unit[0] * v[2],
                    unit[0] * v[1] - unit[1] * v[0],
                ]
            )
            half = math.sin(0.5 * size)
            new_axes[i] = v + math.sin(size) * cross + 2 * half * half * (unit * np.sum(unit * v) - v)
    k = len(bend)
    new_joints, new_bend = joints.copy(), bend.copy()
    for j in range(1, k):
        new_joints[j] = joints[j] + step[shifts + 1 + j]
    for j in range(1, k):
        new_joints[j] = max(new_joints[j], new_joints[j - 1] + gap)
    for j in range(k - 1, 0, -1):
        limit = new_joints[j + 1] if j + 1 < k else end
        new_joints[j] = min(new_joints[j], limit - gap)
    row = shifts + 2 + k - 1
    for j in range(k):
        if curved[j]:
            new_bend[j, 0] += step[row]
            new_bend[j, 1] += step[row + 1]
            row += 2
    return new_start, new_axes, new_joints, new_bend


def places(chain: Chain, s: Vector) -> tuple[Points, Points, Points]:
    """Place, unit tangent and curvature vector of a chain at arc lengths `s`, each [n, 3]."""
    return along(s, chain.start, chain.axes, chain.joints, chain.bend)

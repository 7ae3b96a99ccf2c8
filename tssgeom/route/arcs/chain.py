"""A chain of arcs and the points that it is fitted to: parameters in order, values that count, criterion."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.statistics import information_price

KINK = 0.1
"""Shortest piece of a chain with kinks [mean spacings]."""

_CLEARLY = 0.9  # of the mean spacing: a piece shorter than this is a kink
_LEAST_VARIANCE = 1e-26  # rounding of coordinates [m²]


class WeightedTangents(NamedTuple):
    """Sensed directions beside the points of a chain."""

    unit: Points
    """Unit tangents [n, 3]; a row without weight is not read."""
    weight: Vector
    """Noise variance of the points over that of each direction, 0 where none is used [n] [m²]."""
    variance: Vector
    """Variance of each direction, 0 where none is used [n] [rad²]."""


class Data(NamedTuple):
    """Points and what is known of them, lengths in metres."""

    points: Points
    weight: Vector
    free: bool
    """True where stations are unknown: only distances across the chain count."""
    variance: float
    """Known noise variance of a coordinate, 0 where unknown [m²]."""
    spacing: float
    """Mean spacing [m]."""
    tangents: WeightedTangents | None = None
    """Sensed directions, where there are any."""
    shortest: float = 1.0
    """Shortest piece [mean spacings]: `KINK` where there are kinks, or noise would look like them."""


class Chain(NamedTuple):
    """A fitted chain.

    Its parameters in order are the start (3 coordinates, or 2 across where stations are unknown, since these
    then slide along), turns about both normals, inner joints, and curvature components of the curved pieces.
    """

    start: Vector
    """Position of the start [3] [m]."""
    axes: Matrix
    """Tangent and both normals there [3, 3]."""
    joints: Vector
    """Arc length at which each piece begins [k] [m]."""
    bend: Points
    """Curvature components of each piece [k, 2] [1/m]."""
    curved: np.ndarray
    """Which pieces may be curved [k]."""
    stations: Vector
    """Arc length of the foot of each point [n] [m]."""
    matrix: Matrix
    """Normal equations of Gauss and Newton [m, m]."""
    cost: float
    """Weighted sum of squares [m²]."""
    square: Vector
    """Squared distance of each point, across the chain where stations are unknown [n] [m²]."""


def unfitted(start: Vector, axes: Matrix, joints: Vector, bend: Points, stations: Vector) -> Chain:
    """Return a chain of curved pieces that is yet to be fitted.

    Every array is a copy: numba compiles a kernel once for arrays that can be written and once more for those
    that cannot, and fitted chains can.
    """
    curved = np.ones(len(bend), dtype=np.bool_)
    given = (np.array(start), np.array(axes), np.array(joints), np.array(bend), curved, np.array(stations))
    return Chain(*given, matrix=np.zeros((0, 0)), cost=0.0, square=np.zeros(0))


@njit(cache=True, nogil=True)
def piece_length(chain: Chain, j: int) -> float:
    """Length of piece j [m]."""
    end = chain.joints[j + 1] if j + 1 < len(chain.joints) else chain.stations[-1]
    return end - chain.joints[j]


@njit(cache=True, nogil=True)
def has_kink(chain: Chain, spacing: float) -> bool:
    """Whether an inner piece is clearly shorter than the mean spacing [m]."""
    least, joints = math.inf, chain.joints
    for j in range(1, len(joints) - 1):
        least = min(least, joints[j + 1] - joints[j])
    return least < _CLEARLY * spacing


@njit(cache=True, nogil=True)
def value_count(data: Data) -> int:
    """Return the number of values that are fitted."""
    used = 0
    for weight in data.weight:
        used += 1 if weight > 0.0 else 0
    return (2 if data.free else 3) * used + 2 * tangent_count(data.tangents)


@njit(cache=True, nogil=True)
def tangent_count(tangents: WeightedTangents | None) -> int:
    """Return the number of directions that are fitted."""
    if tangents is None:
        return 0
    return int(np.sum(tangents.weight > 0.0))


@njit(cache=True, nogil=True)
def first_joint_column(free: bool) -> int:
    """Return the parameter of the first inner joint: before it stand the start and two turns."""
    return (2 if free else 3) + 2


def parameter_count(curved: np.ndarray, free: bool) -> int:
    """Return the number of parameters of a chain: start, turns, joints, curvatures."""
    return first_joint_column(free) + len(curved) - 1 + 2 * int(curved.sum())


@njit(cache=True, nogil=True)
def curvature_columns(curved: np.ndarray, free: bool) -> np.ndarray:
    """First parameter of each piece's curvature [k], -1 for a straight piece."""
    column = np.full(len(curved), -1)
    following = first_joint_column(free) + len(curved) - 1
    for j in range(len(curved)):
        if curved[j]:
            column[j] = following
            following += 2
    return column


@njit(cache=True, nogil=True)
def criterion(data: Data, chain: Chain) -> float:
    """Bayesian information criterion: -2 ln of the greatest likelihood, plus the price of every parameter."""
    n = value_count(data)
    price = information_price(len(chain.matrix), n)
    if data.variance > 0.0:
        return chain.cost / data.variance + n * math.log(data.variance) + price
    return n * math.log(chain.cost / n + 1e-300) + n + price


def cost_at_criterion(data: Data, parameters: int, least: float) -> float:
    """Cost [m²] at which a chain of so many parameters has the criterion `least`."""
    n = value_count(data)
    rest = least - information_price(parameters, n)
    if data.variance > 0.0:
        return (rest - n * math.log(data.variance)) * data.variance
    return n * math.exp(min(rest / n - 1.0, 700.0))


@njit(cache=True, nogil=True)
def noise_variance(data: Data, chain: Chain) -> float:
    """Noise variance of a coordinate, known or from the residuals [m²]."""
    if data.variance > 0.0:
        return data.variance
    return max(chain.cost / max(value_count(data) - len(chain.matrix), 1), _LEAST_VARIANCE)

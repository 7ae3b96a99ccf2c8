"""How far the end of a machine may be from its target, on a line or in a plane; docs/model.md (343)."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import CHANCE, ROUNDING
from tssgeom.tendon.command_error import MOST_OUTSIDE, outside


class PlaneSettings(NamedTuple):
    """How a probability in a plane is integrated along its shorter axis."""

    nodes: int = 48
    """Of Gauss and Legendre [1]; derived: 400 random cases are off by 2e-9."""


PLANE = PlaneSettings()


def outside_plane(miss: Vector, covariance: Matrix, tolerance: float) -> float:
    """Return the probability that an end misses its target by more than a tolerance; docs/model.md (343).

    Parameters
    ----------
    miss
        By how much it is predicted to miss it [d], d = 1 or 2 [m].
    covariance
        Of that [d, d] [m²].
    tolerance
        [m].
    """
    variances, axes = np.linalg.eigh(covariance)
    across, along = np.sqrt(np.maximum(variances[[0, -1]], 0.0)).tolist()
    off = miss @ axes
    if len(miss) == 1:
        return outside(float(off[0]), along, tolerance)
    if along <= ROUNDING.relative * tolerance:
        return float(np.hypot(*miss) > tolerance)
    if across <= ROUNDING.relative * tolerance:
        half = math.sqrt(max(tolerance**2 - off[0] ** 2, 0.0))
        return outside(float(off[1]), along, half) if half > 0.0 else 1.0
    reach = off[0] + CHANCE.never * across * np.array([-1.0, 1.0])
    low, high = np.arcsin(np.clip(reach / tolerance, -1.0, 1.0)).tolist()
    nodes, weight = _nodes()
    turn = low + 0.5 * (high - low) * (nodes + 1.0)
    half = tolerance * np.cos(turn)
    density = np.exp(-0.5 * ((tolerance * np.sin(turn) - off[0]) / across) ** 2) * half
    inside = [1.0 - outside(float(off[1]), along, each) for each in half.tolist()]
    share = 0.5 * (high - low) * float(weight @ (density * inside)) / (math.sqrt(2.0 * math.pi) * across)
    return min(max(1.0 - share, 0.0), 1.0)


@cache
def _nodes() -> tuple[Vector, Vector]:
    """Return where the integral is summed between −1 and 1, and with which weights."""
    return np.polynomial.legendre.leggauss(PLANE.nodes)


def is_near(miss: Vector, covariance: Matrix, tolerance: float | None) -> bool:
    """Whether an end is as near to its target as its error there or a tolerance asks for [m]; (215).

    `miss` [d] [m] and its `covariance` [d, d] [m²]; the error counts in the direction of the miss.
    """
    far = float(miss @ miss)
    if far * far <= float(miss @ covariance @ miss):
        return True
    return tolerance is not None and outside_plane(miss, covariance, tolerance) <= MOST_OUTSIDE


def covariance_of(values: Matrix) -> Matrix:
    """Return the covariance of outputs [variants, d], of which each number has two; docs/model.md (212)."""
    apart = values - values.mean(axis=0)
    return 0.5 * apart.T @ apart

"""The smoothing problem of a route and its solution, in units of the mean spacing.

By the prior the rate of the curvature vector, carried along without twist, is a Brownian
motion of intensity q with a restoring rate against the curvature. λ is the noise variance of a point over q.
Source: docs/model.md (20) to (22).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector


class FilterModel(NamedTuple):
    """Points and prior as the filter takes them."""

    u: Vector
    """Stations [n]."""
    y: Points
    """Points [n, 3]."""
    weight: Vector
    """Weight of each point, 0 where it was not observed or is an outlier [n]."""
    transition: Matrix
    """Transitions of the state, `core.transitions` [n, 12]."""
    start: Matrix
    """Guess of the state at the first station [3, 4]."""
    ends: Vector
    """Variances of r and T at the first station, and of a and b at both ends, over the noise variance [4]."""
    curve_tangent: Points
    """Unit tangents of the curve of the last pass [n, 3]."""
    across_only: bool
    """Whether only the part of an innovation normal to these counts."""


class Problem(NamedTuple):
    """Points, stations and prior."""

    model: FilterModel
    variance: float
    """Known noise variance of a coordinate, 0 where unknown."""
    coupling: Matrix
    """κ² and κκ' on the interval before each station, and ω² [n, 3]."""
    stations_known: bool
    """Whether the sensor gives the stations."""
    tangents: Points | None = None
    """Sensed directions, rows of NaN where none is used [n, 3]."""
    sensor_variance: float = 0.0
    """Variance of a component of a direction by its sensor [rad²]."""
    tangent_variance: Vector | None = None
    """The same at each point, 0 where no direction is used; None in the first pass [n]."""
    likely_variance: float = 0.0
    """Noise variance of the last pass, in which `model.ends` are counted."""

    @property
    def sensed(self) -> tuple[Points | None, Vector | None]:
        """Directions and their variances as the filter takes them; None in the first pass, or without any."""
        return (None, None) if self.tangent_variance is None else (self.tangents, self.tangent_variance)

    def ends_at(self, variance: float) -> Vector:
        """Variances at the ends in units of the noise variance of a solution."""
        scaled = self.tangent_variance is not None and self.variance == 0.0
        return self.model.ends * (self.likely_variance / variance) if scaled else self.model.ends


class Solution(NamedTuple):
    """Likeliest λ and q, `core.innovations` there, and the posterior at the stations of `core.smooth`."""

    ratio: float
    intensity: float
    log_s: float
    squares: float
    values: int
    mean: Matrix
    covariance: Matrix
    gain: Matrix

    @property
    def variance(self) -> float:
        """Noise variance of a coordinate."""
        return self.ratio * self.intensity


class LastPass(NamedTuple):
    """What the next fit of a moving route begins with."""

    u: Vector
    y: Points
    weight: Vector
    mean: Matrix
    covariance: Matrix
    ratio: float
    intensity: float
    spacing: float
    """Mean spacing [m]."""
    stations_known: bool
    tangents: Points | None
    """Sensed directions that were used [n, 3]."""

    @property
    def noise(self) -> float:
        """Standard deviation of a coordinate [m]."""
        return math.sqrt(self.ratio * self.intensity) * self.spacing

    def on(self, before: Vector, index: Vector) -> LastPass | None:
        """Return it on other points of the sequence, in between where one was missing; None for other ends.

        `before` and `index` are the counts in the sensed sequence of its points and of those that are wanted.
        """
        if np.array_equal(before, index):
            return self
        if (index[0], index[-1]) != (before[0], before[-1]):
            return None
        row = np.interp(index, before, np.arange(len(before)))
        low = np.minimum(row.astype(int), len(before) - 2)
        part = row - low

        def between(values: np.ndarray) -> np.ndarray:
            share = part.reshape(-1, *(1,) * (values.ndim - 1))
            return (1.0 - share) * values[low] + share * values[low + 1]

        return self._replace(
            u=between(self.u),
            y=between(self.y),
            weight=np.where(np.isin(index, before), between(self.weight), 1.0),
            mean=between(self.mean),
            covariance=between(self.covariance),
            tangents=None if self.tangents is None else self.tangents[low],
        )

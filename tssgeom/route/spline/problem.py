"""The smoothing problem of a route and its solution, in units of the mean spacing.

By the prior the rate of the curvature vector, carried along without twist, is a Brownian
motion of intensity q with a restoring rate against the curvature. λ is the noise variance of a point over q.
Source: docs/model.md (20) to (22).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.core.constants_route import PASSES, PRIOR, SEARCH
from tssgeom.route.directions import tangent_variances


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


def scaled_variance(noise: float | None, spacing: float) -> float:
    """Return the variance of a known noise [m] in squares of the spacing [m], or 0 where it is not known."""
    return 0.0 if noise is None else max(noise / spacing, PRIOR.rounding) ** 2


def before_pass(last: LastPass, variance: float, tangents: Points | None, sensor_variance: float) -> Problem:
    """Return the problem from which `next_pass` goes on, with the points of the last pass."""
    model = FilterModel(last.u, last.y, last.weight, *(np.zeros(0),) * 4, across_only=True)
    return Problem(model, variance, np.zeros(0), last.stations_known, tangents, sensor_variance)


class NoiseSearch(NamedTuple):
    """How the noise of the points is searched beside directions of known noise."""

    first: tuple[float, ...] = tuple(math.log(10.0**-k) for k in (10, 8, 6, 5, 4, 3, 2))
    """First trials of the noise variance [ln spacing²]; chosen."""
    step: float = 1.0
    """Distance of the next trials of it [ln]; chosen."""
    shrink: float = 0.4
    """Factor on the distance where neither trial is better [1]; chosen."""


NOISE = NoiseSearch()


def solve(problem: Problem, guess: float = 0.0) -> Solution:
    """Solve a problem, λ searched from a guess, or everywhere where that is 0.

    Raises FitError where the points give no finite curve.
    """
    model, sensed, inverse_intensity = problem.model, problem.sensed, 0.0
    if sensed[0] is None or problem.variance > 0.0:
        best = core.best_ratio(*model, *sensed, problem.variance, guess)
    else:
        best = _best_noise(problem, guess)
    if sensed[0] is not None:
        model = model._replace(ends=problem.ends_at(best[0] * best[1]))
        inverse_intensity = 1.0 / best[1]
    return Solution(*best, *core.smooth(*model, *sensed, best[0], inverse_intensity))


def _best_noise(problem: Problem, guess: float) -> tuple[float, float, float, float, int]:
    """λ, q and `core.innovations` where they are likeliest beside directions of known noise; (92)."""
    model, likely = problem.model, problem.likely_variance
    dimensions = 2 if model.across_only else 3

    def at(x: float, guess: float) -> tuple[float, tuple[float, float, float, float, int]]:
        variance = math.exp(x)
        own = model._replace(ends=model.ends * (likely / variance))
        best = core.best_ratio(*own, *problem.sensed, variance, guess)
        ratio, q, log_s, squares, n = best
        deviance = dimensions * (n * math.log(q) + log_s) + squares / q
        return deviance + SEARCH.price_per_decade * math.log10(ratio), best

    x, width = math.log(likely), NOISE.step
    if guess <= 0.0:
        x = min((x, *NOISE.first), key=lambda trial: at(trial, 0.0)[0])
    least, best = at(x, guess)
    while width > PASSES.same_ratio:
        trials = [(*at(x + way * width, best[0]), x + way * width) for way in (-1.0, 1.0)]
        value, trial, there = min(trials, key=lambda trial: trial[0])
        if value < least and there > math.log(PRIOR.rounding**2):
            x, least, best = there, value, trial
        else:
            width *= NOISE.shrink
    return best


def next_pass(problem: Problem, solution: Solution | LastPass, stations: Vector | None = None) -> Problem:
    """Linearise the prior along the fitted curve, and put unknown stations at the feet of the points.

    `stations` are those of the next pass, where the sensor gives them.
    """
    model, known = problem.model, problem.stations_known
    u, coupling, ends, curve_tangent = core.prior_along_curve(
        model.u,
        model.y,
        model.weight,
        solution.ratio,
        solution.intensity,
        solution.mean,
        solution.covariance,
        known,
    )
    u = u if stations is None else stations
    variance = max(solution.ratio * solution.intensity, PRIOR.rounding**2)
    tangent_variance = None
    if problem.tangents is not None:
        slid = np.zeros(len(u)) if known else coupling[:, 0] * (problem.variance or variance)
        tangent_variance = tangent_variances(problem.tangents, problem.sensor_variance, slid)
    model = FilterModel(
        u=u,
        y=model.y,
        weight=model.weight,
        transition=core.transitions(u, coupling),
        start=solution.mean[0].copy(),
        ends=ends,
        curve_tangent=curve_tangent,
        across_only=True,
    )
    return problem._replace(
        model=model, coupling=coupling, tangent_variance=tangent_variance, likely_variance=variance
    )


def deviance(problem: Problem, solution: Solution, spacing: float) -> float:
    """-2 ln of the evidence of the points normal to the route [ln m²]; docs/model.md (34).

    The restricted likelihood prices the unknown position and direction by their information in units of the
    spacing; that price is replaced by the logarithm of the number of values for each of the four, and for
    both variances at the ends.
    """
    q = max(solution.intensity, 1e-280)
    tangent_variance = np.zeros(0)
    if problem.tangent_variance is not None:
        tangent_variance = problem.tangent_variance[problem.tangent_variance > 0.0]
    n = solution.values + 2
    points = n - len(tangent_variance)
    variance = max(solution.ratio * q, 1e-280) * spacing**2
    by_tangents = float(np.sum(solution.ratio * q / tangent_variance))  # docs/model.md (92)
    information = math.log(points * (points * (points * points - 1.0) / 12.0 + by_tangents))
    fitted = 2 * (solution.values * math.log(q) + solution.log_s) + solution.squares / q
    fitted += 4 * (points - 2) * math.log(spacing)
    return fitted + 4 * math.log(variance) - 2 * information + 6 * math.log(2 * n)

"""The smoothing problem of a route, in units of its mean spacing, solved by passes that bend with it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.errors import FitError
from tssgeom.route.directions import tangent_variances
from tssgeom.route.observations import Shape
from tssgeom.route.outliers import LIMITS
from tssgeom.route.route import summed
from tssgeom.route.spline.filtering import FilterModel, SensedTangents
from tssgeom.route.spline.intensity import best_noise, best_ratio
from tssgeom.route.spline.outliers import (
    leaves_out_a_stretch,
    may_drop_tangent,
    outlying_points,
    outlying_tangent,
)
from tssgeom.route.spline.prior import PRIOR, prior_along_curve, transitions
from tssgeom.route.spline.smoother import smooth


class SplinePasses(NamedTuple):
    """How many passes a fit takes, each with its prior along the curve of the last one, and when they end."""

    most: int = 12
    """Most passes [1]; chosen: at a kink no pass is the last."""
    same_noise: float = 0.01
    """Relative change of the noise variance at which they have converged [1]; chosen."""
    same_ratio: float = 0.05
    """Change of ln λ at which they have converged [1]; chosen."""
    uneven: float = 2.0
    """ln likelihood of a point by which chord lengths must beat even spacing as first stations [1];
    chosen."""
    warm_searches: int = 4
    """Searches for λ from its last value in a route that moves [1]; chosen."""
    warm_ratio: float = 3.0
    """Change of ln λ in such a search above which another one is needed [1]; chosen."""
    warm_noise: float = 2.0
    """Factor on the noise variance of the last fit beyond which a fit begins from nothing [1]; chosen."""


PASSES = SplinePasses()


class Problem(NamedTuple):
    """Points, stations and prior, with lengths in units of the mean spacing."""

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
    def sensed_tangents(self) -> SensedTangents | None:
        """Directions as the filter takes them; None in the first pass, or where none are sensed."""
        if self.tangents is None or self.tangent_variance is None:
            return None
        return SensedTangents(self.tangents, self.tangent_variance)


class Solution(NamedTuple):
    """Posterior at the stations, as `smoother.smooth` gives it."""

    ratio: float
    intensity: float
    log_s: float
    squares: float
    values: int
    """What `filtering.innovations` gives at this ratio."""
    mean: Matrix
    covariance: Matrix
    gain: Matrix


def posterior(shape: Shape, spacing: float, noise: float | None) -> tuple[Problem, Solution]:
    """Stations, weights and posterior of a shape; docs/model.md (20) to (22).

    Raises
    ------
    FitError
        Where the points give no finite curve.
    """
    problem, solution = _without_outliers(*_first(shape, spacing, noise))
    best, least = (problem, solution), math.inf
    for _ in range(PASSES.most):
        before, first = solution, problem.tangent_variance is None and problem.tangents is not None
        try:
            problem = _next_pass(problem, solution, known=shape.stations is not None)
            solution = _solve(problem, 0.0 if first else solution.ratio)
            problem, solution = _without_outliers(problem, solution)
        except FitError:
            break
        if _converged(before, solution) and not first:
            return problem, solution
        reached = deviance(problem, solution, spacing)
        if reached < least:
            best, least = (problem, solution), reached
    return best  # at a kink the prior and the curve along which it is linearised sharpen each other


def _converged(before: Solution, solution: Solution) -> bool:
    """Whether one more pass would change little: noise within a part in a hundred, λ within a twentieth."""
    noise = solution.ratio * solution.intensity / max(before.ratio * before.intensity, 1e-300)
    return (
        abs(noise - 1.0) < PASSES.same_noise
        and abs(np.log(solution.ratio / before.ratio)) < PASSES.same_ratio
    )


def warmed(
    shape: Shape, noise: float | None, last: tuple[Problem, Solution, float]
) -> tuple[Problem, Solution, float] | None:
    """Posterior of a shape in one pass that begins with the last one of the same route, a moment ago.

    None where it has another number of points, or where the last λ, noise or weights no longer hold.
    """
    before, solved, spacing = last
    same = (shape.stations is not None) == before.stations_known
    same &= (shape.directions is None) == (before.tangents is None)
    if len(shape.points) != len(before.model.u) or not same:
        return None
    y = (shape.points - shape.points[0]) / spacing
    variance = 0.0 if noise is None else max(noise / spacing, PRIOR.rounding) ** 2
    # unknown stations stay at the last feet: the route may have moved by more than their spacing
    before = before._replace(variance=variance, tangents=shape.directions)
    problem = _next_pass(before, solved, known=before.stations_known)
    model = problem.model._replace(y=y)
    model.start[:, 0] = y[0]
    if before.stations_known and shape.stations is not None:
        model = model._replace(u=shape.stations / spacing)
    problem = problem._replace(model=model)
    solution = _solution_nearby(problem, solved.ratio)
    if solution is None:
        return None
    change = solution.ratio * solution.intensity / max(solved.ratio * solved.intensity, 1e-300)
    if not 1.0 / PASSES.warm_noise < change < PASSES.warm_noise:
        return None
    _, count = _outlying_points(problem, solution)
    good = not count and model.weight.min() > 0.0 and _outlying_tangent(problem, solution) < 0
    return (problem, solution, spacing) if good else None


def _solution_nearby(problem: Problem, ratio: float) -> Solution | None:
    """Solution with λ searched from its last value, or None where a few searches do not suffice."""
    for _ in range(PASSES.warm_searches):
        solution = _solve(problem, ratio)
        if abs(math.log(solution.ratio / ratio)) <= PASSES.warm_ratio:
            return solution
        ratio = solution.ratio
    return None


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


def _first(shape: Shape, spacing: float, noise: float | None) -> tuple[Problem, Solution]:
    """Problem with known stations, or with the likelier of even spacing and chord lengths."""
    n = len(shape.points)
    y = (shape.points - shape.points[0]) / spacing
    variance = 0.0 if noise is None else max(noise / spacing, PRIOR.rounding) ** 2

    start, ends, square = _vague(y, variance)
    coupling = np.zeros((n, 3))
    coupling[:, 0] = square

    def on(u: Vector) -> Problem:
        model = FilterModel(
            u, y, np.ones(n), transitions(u, coupling), start, ends, np.zeros((n, 3)), across_only=False
        )
        stations_known = shape.stations is not None
        return Problem(model, variance, coupling, stations_known, shape.directions, shape.direction_noise**2)

    if shape.stations is not None:
        problem = on(shape.stations / spacing)
        return problem, _solve(problem)
    even = on(shape.index - shape.index[0])
    chord = on(summed(np.linalg.norm(np.diff(y, axis=0), axis=1)))
    first, second = _solve(even), _solve(chord)
    if _deviance(second) < _deviance(first) - PASSES.uneven * n:
        return chord, second
    return even, first


def _deviance(solution: Solution) -> float:
    """-2 ln of the likelihood of the points in all three coordinates at the solution's own noise."""
    q = max(solution.intensity, 1e-280)
    return 3 * (solution.values * math.log(q) + solution.log_s) + solution.squares / q


def _vague(y: Points, variance: float) -> tuple[Matrix, Vector, float]:
    """State, variances and κ² of the first pass, from differences over long steps and over short ones."""
    n = len(y)
    noise = variance or max(
        min(np.mean(np.diff(y, k, axis=0) ** 2) / c for k, c in ((2, 6), (3, 20))), PRIOR.rounding**2
    )
    few = np.linspace(0, n - 1, min(n, PRIOR.guess_points)).round().astype(np.int64)
    interval = (n - 1) / (len(few) - 1)
    chord = np.diff(y[few], axis=0)
    turned = (
        np.linalg.norm(np.cross(chord[:-1], chord[1:]), axis=1),
        np.einsum("ij,ij->i", chord[:-1], chord[1:]),
    )
    square = float(np.mean(np.arctan2(*turned) ** 2)) / interval**2
    bend = max(square / 3.0, noise / interval**4)
    start = np.zeros((3, 4))
    start[:, 0], start[:, 1] = y[0], (y[few[1]] - y[0]) / interval
    turn = bend * interval**2 + noise / interval**2
    vague, vague_bend = PRIOR.vague, PRIOR.vague_bend
    spread = np.array([vague * noise, vague * turn, vague_bend * bend, vague_bend * bend / interval**2])
    return start, spread / noise, float(np.clip(square - 12.0 * noise / interval**4, 0.0, PRIOR.sharpest**2))


def scaled_ends(problem: Problem, variance: float) -> Vector:
    """Variances at the ends in units of the noise variance of the solution."""
    scaled = problem.tangent_variance is not None and problem.variance == 0.0
    return problem.model.ends * (problem.likely_variance / variance) if scaled else problem.model.ends


def _solve(problem: Problem, guess: float = 0.0) -> Solution:
    tangents, model, inverse_intensity = problem.sensed_tangents, problem.model, 0.0
    if tangents is None or problem.variance > 0.0:
        best = best_ratio(model, problem.variance, guess, tangents)
    else:
        best = best_noise(model, problem.likely_variance, guess, tangents)
    if tangents is not None:
        model = model._replace(ends=scaled_ends(problem, best[0] * best[1]))
        inverse_intensity = 1.0 / best[1]
    mean, covariance, gain = smooth(model, best[0], tangents, inverse_intensity)
    if not math.isfinite(mean.sum()):
        raise FitError("the points give no finite curve: check the unit and look for stray points")
    return Solution(*best, mean, covariance, gain)


def _next_pass(problem: Problem, solution: Solution, *, known: bool) -> Problem:
    """Linearise the prior along the fitted curve, and put unknown stations at the feet of the points."""
    model = problem.model
    u, coupling, ends, curve_tangent = prior_along_curve(
        model.u,
        model.y,
        model.weight,
        solution.ratio,
        solution.intensity,
        solution.mean,
        solution.covariance,
        known,
    )
    variance, tangent_variance = max(solution.ratio * solution.intensity, PRIOR.rounding**2), None
    if problem.tangents is not None:
        slid = np.zeros(len(u)) if known else coupling[:, 0] * (problem.variance or variance)
        tangent_variance = tangent_variances(problem.tangents, problem.sensor_variance, slid)
    model = model._replace(
        u=u,
        transition=transitions(u, coupling),
        start=solution.mean[0].copy(),
        ends=ends,
        curve_tangent=curve_tangent,
        across_only=True,
    )
    return problem._replace(
        model=model, coupling=coupling, tangent_variance=tangent_variance, likely_variance=variance
    )


def _without_outliers(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """Fit again without directions and points that their neighbours' curve does not explain."""
    problem, solution = _without_outlying_tangents(problem, solution)
    for _ in range(LIMITS.spline_rounds):
        outlier, count = _outlying_points(problem, solution)
        if not count:
            break
        weight = np.where(outlier, 0.0, problem.model.weight)
        if leaves_out_a_stretch(weight):
            weight = np.ones_like(weight)
        problem = problem._replace(model=problem.model._replace(weight=weight))
        solution = _solve(problem, solution.ratio)
        if weight.min() > 0.0:
            break
    return problem, solution


def _outlying_points(problem: Problem, solution: Solution) -> tuple[np.ndarray, int]:
    """Mark and count the outliers among the points."""
    u, y, weight = problem.model[:3]
    return outlying_points(u, y, weight, problem.variance, solution.ratio, solution.mean, solution.covariance)


def _without_outlying_tangents(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """Fit again without directions that the curve through all else does not explain, one at a time."""
    sensed = problem.tangents
    for _ in range(LIMITS.spline_rounds):
        worst = _outlying_tangent(problem, solution)
        if worst < 0 or not may_drop_tangent(problem.tangents, sensed):
            break
        tangents, variance = np.array(problem.tangents), np.array(problem.tangent_variance)
        tangents[worst], variance[worst] = np.nan, 0.0
        problem = problem._replace(tangents=tangents, tangent_variance=variance)
        solution = _solve(problem, solution.ratio)
    return problem, solution


def _outlying_tangent(problem: Problem, solution: Solution) -> int:
    """Return the direction that is farthest off the curve, if an outlier, or -1."""
    tangents = problem.sensed_tangents
    if tangents is None:
        return -1
    spread = solution.covariance[:, 4] * solution.intensity
    return outlying_tangent(*tangents, problem.model.u, solution.mean, spread)

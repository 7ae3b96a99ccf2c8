"""Posterior of a smooth route: passes, each with its prior along the curve of the last one."""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.core.constants_route import PASSES, PRIOR, SEARCH
from tssgeom.errors import FitError
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.route.directions import tangent_variances
from tssgeom.route.observations import Shape
from tssgeom.route.outliers import leaves_out_a_stretch, may_drop_tangent, outlying_tangent
from tssgeom.route.route import summed
from tssgeom.route.spline.problem import (
    FilterModel,
    LastPass,
    Problem,
    Solution,
)


class NoiseSearch(NamedTuple):
    """How the noise of the points is searched beside directions of known noise."""

    first: tuple[float, ...] = tuple(math.log(10.0**-k) for k in (10, 8, 6, 5, 4, 3, 2))
    """First trials of the noise variance [ln spacing²]; chosen."""
    step: float = 1.0
    """Distance of the next trials of it [ln]; chosen."""
    shrink: float = 0.4
    """Factor on the distance where neither trial is better [1]; chosen."""


NOISE = NoiseSearch()

PARAMETERS = 20
"""A pass of the spline takes as long as one over a chain of so many parameters. Chosen: by latency."""


def posterior_in_steps(
    shape: Shape, spacing: float, noise: float | None
) -> Generator[float, None, tuple[Problem, Solution]]:
    """Stations, weights and posterior of a shape, with a stop after each pass; docs/model.md (20) to (22).

    Raises FitError where the points give no finite curve.
    """
    problem, solution = _without_outliers(*_first(shape, spacing, noise))
    best, least = (problem, solution), math.inf
    for _ in range(PASSES.most):
        before, first = solution, problem.tangent_variance is None and problem.tangents is not None
        try:
            problem = next_pass(problem, solution)
            solution = solve(problem, 0.0 if first else solution.ratio)
            problem, solution = _without_outliers(problem, solution)
        except FitError:
            break
        if _converged(before, solution) and not first:
            return problem, solution
        reached = deviance(problem, solution, spacing)
        if reached < least:
            best, least = (problem, solution), reached
        yield PARAMETERS * len(shape.points)
    return best  # at a kink the prior and the curve along which it is linearised sharpen each other


def _converged(before: Solution, solution: Solution) -> bool:
    """Whether one more pass would change little: noise within a part in a hundred, λ within a twentieth."""
    noise = solution.variance / max(before.variance, 1e-300)
    return (
        abs(noise - 1.0) < PLAUSIBLE.negligible
        and abs(np.log(solution.ratio / before.ratio)) < PASSES.same_ratio
    )


def warmed(
    shape: Shape, noise: float | None, last: LastPass, growth: float
) -> tuple[Problem, Solution, bool]:
    """Posterior of a shape in one pass that begins with the last one of the same route, a moment ago.

    Without directions `core.spline_frame` does the same in one call. Returns also whether the last λ, noise
    and weights still hold; the noise variance may have changed by a factor between 1 and `growth`.
    """
    y = (shape.points - shape.points[0]) / last.spacing
    variance = scaled_variance(noise, last.spacing)
    # unknown stations stay at the last feet: the route may have moved by more than their spacing
    before = before_pass(last, variance, shape.directions, shape.direction_noise**2)
    stations = None if shape.stations is None else shape.stations / last.spacing
    problem = next_pass(before, last, stations)
    problem.model.start[:, 0] = y[0]
    problem = problem._replace(model=problem.model._replace(y=y))
    solution = solve(problem, last.ratio)
    change = solution.variance / max(last.ratio * last.intensity, 1e-300)
    if not min(growth, 1.0) / PASSES.warm_noise < change < max(growth, 1.0) * PASSES.warm_noise:
        return problem, solution, False
    count, outlier = _outlying_points(problem, solution)
    may_return = (last.weight <= 0.0) & (outlier == 0)
    good = not count and not may_return.any() and _outlying_tangent(problem, solution) < 0
    return problem, solution, good


def _first(shape: Shape, spacing: float, noise: float | None) -> tuple[Problem, Solution]:
    """Problem with known stations, or with the likelier of even spacing and chord lengths."""
    n = len(shape.points)
    y = (shape.points - shape.points[0]) / spacing
    variance = scaled_variance(noise, spacing)

    start, ends, square = _vague(y, variance)
    coupling = np.zeros((n, 3))
    coupling[:, 0] = square

    def on(u: Vector) -> Problem:
        model = FilterModel(
            u, y, np.ones(n), core.transitions(u, coupling), start, ends, np.zeros((n, 3)), across_only=False
        )
        stations_known = shape.stations is not None
        return Problem(model, variance, coupling, stations_known, shape.directions, shape.direction_noise**2)

    if shape.stations is not None:
        problem = on(shape.stations / spacing)
        return problem, solve(problem)
    even = on(shape.index - shape.index[0])
    chord = on(summed(np.linalg.norm(np.diff(y, axis=0), axis=1)))
    first, second = solve(even), solve(chord)
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


def _without_outliers(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """Fit again without directions and points that their neighbours' curve does not explain."""
    problem, solution = _without_outlying_tangents(problem, solution)
    for _ in range(PASSES.most):
        count, outlier = _outlying_points(problem, solution)
        if not count:
            break
        weight = np.where(outlier, 0.0, problem.model.weight)
        if leaves_out_a_stretch(weight):
            weight = np.ones_like(weight)
        problem = problem._replace(model=problem.model._replace(weight=weight))
        solution = solve(problem, solution.ratio)
        if weight.min() > 0.0:
            break
    return problem, solution


def _outlying_points(problem: Problem, solution: Solution) -> tuple[int, np.ndarray]:
    """Count the outliers among the points that have a weight, and mark these and those that have none."""
    u, y, weight = problem.model[:3]
    return core.outlying_points(
        u, y, weight, problem.variance, solution.ratio, solution.mean, solution.covariance
    )


def _without_outlying_tangents(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """Fit again without directions that the curve through all else does not explain, one at a time."""
    sensed = problem.tangents
    for _ in range(PASSES.most):
        worst = _outlying_tangent(problem, solution)
        if worst < 0 or not may_drop_tangent(problem.tangents, sensed):
            break
        tangents, variance = np.array(problem.tangents), np.array(problem.tangent_variance)
        tangents[worst], variance[worst] = np.nan, 0.0
        problem = problem._replace(tangents=tangents, tangent_variance=variance)
        solution = solve(problem, solution.ratio)
    return problem, solution


def _outlying_tangent(problem: Problem, solution: Solution) -> int:
    """Return the direction that is farthest off the curve, if an outlier, or -1."""
    tangents, variance = problem.sensed
    if tangents is None or variance is None:
        return -1
    spread = solution.covariance[:, 4] * solution.intensity
    return outlying_tangent(tangents, variance, problem.model.u, solution.mean, spread)


def scaled_variance(noise: float | None, spacing: float) -> float:
    """Return the variance of a known noise [m] in squares of the spacing [m], or 0 where it is not known."""
    return 0.0 if noise is None else max(noise / spacing, PRIOR.rounding) ** 2


def before_pass(last: LastPass, variance: float, tangents: Points | None, sensor_variance: float) -> Problem:
    """Return the problem from which `next_pass` goes on, with the points of the last pass."""
    model = FilterModel(last.u, last.y, last.weight, *(np.zeros(0),) * 4, across_only=True)
    return Problem(model, variance, np.zeros(0), last.stations_known, tangents, sensor_variance)


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

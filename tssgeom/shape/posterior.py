"""The smoothing problem of a route, in units of its mean spacing, solved by passes that bend with it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.errors import FitError
from tssgeom.shape.points import Shape
from tssgeom.shape.smoother import best_ratio, innovations, smooth
from tssgeom.shape.stations import across, foot_stations

_PASSES = 4
_ROUNDS = 8  # of looking for outliers
_BEND_SHARE = 0.3  # of κh²: what a jump of curvature alone can move a point off its neighbours' curve
_END_SHARE = (2.0, 1.0)  # the same at the last points, which have neighbours on one side only
_LAGS = (1, 2, 3)
_SHARPEST = 1.5  # turn from point to point that the prior follows [rad]
_EXACT = 1e-9  # of the spacing: rounding, not noise
_UNEVEN = 2.0  # ln likelihood a point by which chord lengths must beat even spacing as first stations


class Problem(NamedTuple):
    """Points and stations, with lengths in units of the mean spacing."""

    u: Vector
    y: Points
    weight: Vector
    kappa2: Vector
    tangent: Points
    planar: bool
    variance: float
    """Known noise variance of a coordinate, 0 where unknown."""


class Solution(NamedTuple):
    """Posterior at the stations, as `smoother.smooth` gives it."""

    ratio: float
    intensity: float
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
    for _ in range(_PASSES):
        problem = _bent(problem, solution, known=shape.stations is not None)
        solution = _solve(problem)
        problem, solution = _without_outliers(problem, solution)
    return problem, solution


def curve(mean: Matrix) -> tuple[Vector, Points, Points]:
    """Speed, unit tangent and curvature vector from position and derivatives [n, 3, 3]."""
    first, second = mean[:, :, 1], mean[:, :, 2]
    speed = np.maximum(np.linalg.norm(first, axis=1), 1e-12)
    tangent = first / speed[:, None]
    return speed, tangent, across(second, tangent) / (speed * speed)[:, None]


def deviance(problem: Problem, solution: Solution, spacing: float) -> float:
    """-2 ln of the evidence of the points normal to the route [ln m²]; docs/model.md (34).

    The restricted likelihood prices the unknown place, direction and curvature by their information in units
    of the spacing; that price is replaced by the logarithm of the number of values for each of the six.
    """
    log_s, squares, n = innovations(*problem[:6], solution.ratio, np.empty((0, 3)))
    q, used = solution.intensity, problem.weight > 0.0
    values = 2 * int(np.count_nonzero(used))
    u = (problem.u[used] - problem.u[0]) / (problem.u[-1] / len(problem.u))
    basis = np.column_stack((np.ones_like(u), u, 0.5 * u * u))
    information = np.linalg.slogdet(basis.T @ basis)[1]
    variance = max(solution.ratio * q, 1e-280) * spacing**2
    fitted = 2 * (n * np.log(max(q, 1e-280) * spacing**2) + log_s) + squares / max(q, 1e-280)
    return float(fitted + 6 * np.log(variance) - 2 * information + 6 * np.log(values))


def swings(problem: Problem, solution: Solution) -> float:
    """How far the errors swing back and forth along the route, in standard deviations of chance.

    The most negative autocorrelation of the innovations at lags 1 to 3 times the root of their number; white
    errors give values above -3, errors that neighbours share give large negative ones.
    """
    e = np.zeros_like(problem.y)
    innovations(*problem[:6], solution.ratio, e)
    e = e[np.any(e != 0.0, axis=1)]
    if len(e) <= _LAGS[-1]:
        return 0.0
    e = np.clip(e / np.sqrt(np.mean(e * e)), -3.0, 3.0)
    power = np.sum(e * e)
    return float(min(np.sum(e[lag:] * e[:-lag]) for lag in _LAGS) / power * np.sqrt(2.0 * len(e)))


def _first(shape: Shape, spacing: float, noise: float | None) -> tuple[Problem, Solution]:
    """Problem with known stations, or with the likelier of even spacing and chord lengths."""
    n = len(shape.points)
    y = (shape.points - shape.points[0]) / spacing
    variance = 0.0 if noise is None else (noise / spacing) ** 2

    def on(u: Vector) -> Problem:
        return Problem(u, y, np.ones(n), np.zeros(n), np.zeros((n, 3)), False, variance)

    if shape.stations is not None:
        problem = on(shape.stations / spacing)
        return problem, _solve(problem)
    even = on(shape.index - shape.index[0])
    chord = on(np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(y, axis=0), axis=1)))))
    first, second = _solve(even), _solve(chord)
    if _deviance(chord, second) < _deviance(even, first) - _UNEVEN * n:
        return chord, second
    return even, first


def _deviance(problem: Problem, solution: Solution) -> float:
    """-2 ln of the likelihood of the points at the solution's own noise."""
    log_s, squares, n = innovations(*problem[:6], solution.ratio, np.empty((0, 3)))
    q = solution.intensity
    return 3 * (n * np.log(max(q, 1e-280)) + log_s) + squares / max(q, 1e-280)


def _solve(problem: Problem) -> Solution:
    ratio, intensity = best_ratio(*problem)
    mean, covariance, gain = smooth(problem.u, problem.y, problem.weight, problem.kappa2, ratio)
    if not np.isfinite(mean).all():
        raise FitError("the points give no finite curve: check the unit and look for stray points")
    return Solution(ratio, intensity, mean, covariance, gain)


def _bent(problem: Problem, solution: Solution, *, known: bool) -> Problem:
    """Bend the prior along the curve found, and put unknown stations at the feet of the points."""
    speed, tangent, bend = curve(solution.mean)
    u = problem.u
    if not known:
        u = foot_stations(u, solution.mean[:, :, 0], speed, tangent, problem.y, problem.weight)
    noise = solution.intensity * solution.covariance[:, 5] / 3.0
    squares = np.maximum(np.einsum("ij,ij->i", bend, bend) - noise, 0.0)
    squares = np.minimum(squares, _SHARPEST**2)
    kappa2 = squares.copy()
    kappa2[1:] = 0.5 * (squares[1:] + squares[:-1])
    return problem._replace(u=u, kappa2=kappa2, tangent=tangent, planar=True)


def _without_outliers(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """Take the weight from points that their neighbours' curve does not explain."""
    for _ in range(_ROUNDS):
        stray = _stray_points(problem, solution)
        if not stray.any():
            break
        problem = problem._replace(weight=np.where(stray, 0.0, problem.weight))
        solution = _solve(problem)
    return problem, solution


def _stray_points(problem: Problem, solution: Solution) -> np.ndarray:
    """Mark points whose leave-one-out residual is beyond chance and beyond a jump of curvature."""
    _, tangent, bend = curve(solution.mean)
    distance = np.linalg.norm(across(problem.y - solution.mean[:, :, 0], tangent), axis=1)
    free = np.maximum(1.0 - solution.covariance[:, 0] / solution.ratio, 1e-12)
    used = problem.weight > 0.0
    left_out, size = distance / free, distance / np.sqrt(free)
    scale = max(float(np.median(size[used])) / 1.177, np.sqrt(problem.variance), _EXACT)
    step = np.gradient(problem.u)
    sharpest = float(np.max(np.linalg.norm(bend, axis=1)[used]))
    share = np.full(len(size), _BEND_SHARE)
    share[:2], share[-2:] = _END_SHARE, _END_SHARE[::-1]
    beyond_chance = size > scale * np.sqrt(16.0 + 2.0 * np.log(len(size)))
    stray = used & beyond_chance & (left_out > share * sharpest * step * step)
    return stray & (size >= _windowed_maximum(np.where(used, size, 0.0)))


def _windowed_maximum(x: Vector, reach: int = 3) -> Vector:
    padded = np.pad(x, reach, constant_values=0.0)
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).max(axis=1)

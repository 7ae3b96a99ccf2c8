"""The smoothing problem of a route, in units of its mean spacing, solved by passes that bend with it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.errors import FitError
from tssgeom.route.directions import may_drop, outlying_direction, variances
from tssgeom.route.observations import Shape
from tssgeom.route.route import across, summed
from tssgeom.route.spline.bending import SHARPEST, bent_along, is_stretch, stray_points
from tssgeom.route.spline.filtering import transitions
from tssgeom.route.spline.intensity import best_noise, best_ratio
from tssgeom.route.spline.smoother import smooth

_MOST_PASSES = 12
_NEARBY = 4  # searches for λ from its last value
_OFF_RATIO = 3.0  # ln λ
_OFF_NOISE = 2.0  # factor on the noise variance
_SAME_NOISE = 0.01
_SAME_RATIO = 0.05
_FEW = 9  # points between which the first guess of the bend is taken
_VAGUE = 1e4  # variance of place and direction at the first station over that of a first guess
_LOOSE = 4.0  # variance of the bend in the first pass over that of a first guess
_ROUNDS = 8  # of looking for outliers
_EXACT = 1e-6  # of the spacing: less is rounding, which a filter of four states must not take for truth
_UNEVEN = 2.0  # ln likelihood a point by which chord lengths must beat even spacing as first stations


class Problem(NamedTuple):
    """Points, stations and prior, with lengths in units of the mean spacing."""

    u: Vector
    y: Points
    weight: Vector
    step: Matrix
    """Transitions of the state [n, 12]."""
    start: Matrix
    """Guess of the state at the first station [3, 4]."""
    ends: Vector
    """Variances of r and T at the first station, and of a and b at both ends, over the noise variance [4]."""
    tangent: Points
    planar: bool
    variance: float
    """Known noise variance of a coordinate, 0 where unknown."""
    coupling: Matrix
    """κ² and κκ' on the interval before each station, and ω² [n, 3]."""
    known: bool
    """Whether the sensor told the stations."""
    aim: Points | None = None
    """Sensed directions, rows of NaN where none is used [n, 3]."""
    facing: float = 0.0
    """Variance of a component of a direction [rad²]."""
    blur: Vector | None = None
    """The same at each point, 0 where no direction is used; None in the first pass [n]."""
    likely: float = 0.0
    """Noise variance of the last pass, in which `ends` are counted."""


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
    for _ in range(_MOST_PASSES):
        before, first = solution, problem.blur is None and problem.aim is not None
        try:
            problem = _bent(problem, solution, known=shape.stations is not None)
            solution = _solve(problem, 0.0 if first else solution.ratio)
            problem, solution = _without_outliers(problem, solution)
        except FitError:
            break
        if _settled(before, solution) and not first:
            return problem, solution
        reached = deviance(problem, solution, spacing)
        if reached < least:
            best, least = (problem, solution), reached
    return best  # at a kink the bend that is followed feeds on itself, and no pass is the last


def _settled(before: Solution, solution: Solution) -> bool:
    """Whether one more pass would change little: noise within a part in a hundred, λ within a twentieth."""
    noise = solution.ratio * solution.intensity / max(before.ratio * before.intensity, 1e-300)
    return abs(noise - 1.0) < _SAME_NOISE and abs(np.log(solution.ratio / before.ratio)) < _SAME_RATIO


def warmed(
    shape: Shape, noise: float | None, last: tuple[Problem, Solution, float]
) -> tuple[Problem, Solution, float] | None:
    """Posterior of a shape in one pass that begins with the last one of the same route, a moment ago.

    None where it has another number of points, or where the last λ, noise or weights no longer hold.
    """
    before, solved, spacing = last
    n = len(before.u)
    same = (shape.stations is not None) == before.known and (shape.directions is None) == (before.aim is None)
    if len(shape.points) != n or not same:
        return None
    y = (shape.points - shape.points[0]) / spacing
    variance = 0.0 if noise is None else max(noise / spacing, _EXACT) ** 2
    # unknown stations stay at the last feet: the route may have moved by more than their spacing
    before = before._replace(variance=variance, aim=shape.directions)
    problem = _bent(before, solved, known=before.known)._replace(y=y)
    problem.start[:, 0] = y[0]
    if before.known and shape.stations is not None:
        problem = problem._replace(u=shape.stations / spacing)
    solution = _settled_nearby(problem, solved.ratio)
    if solution is None:
        return None
    louder = solution.ratio * solution.intensity / max(solved.ratio * solved.intensity, 1e-300)
    if not 1.0 / _OFF_NOISE < louder < _OFF_NOISE:
        return None
    _, count = stray_points(
        problem.u, y, problem.weight, variance, solution.ratio, solution.mean, solution.covariance
    )
    good = not count and problem.weight.min() > 0.0 and _stray_direction(problem, solution) < 0
    return (problem, solution, spacing) if good else None


def _settled_nearby(problem: Problem, ratio: float) -> Solution | None:
    """Solution with a λ found from the last one in a few steps, if they suffice."""
    for _ in range(_NEARBY):
        solution = _solve(problem, ratio)
        if abs(math.log(solution.ratio / ratio)) <= _OFF_RATIO:
            return solution
        ratio = solution.ratio
    return None


def curve(mean: Matrix) -> tuple[Vector, Points, Points]:
    """Speed, unit tangent and curvature vector from the state [n, 3, 4]."""
    first, second = mean[:, :, 1], mean[:, :, 2]
    speed = np.maximum(np.linalg.norm(first, axis=1), 1e-12)
    tangent = first / speed[:, None]
    return speed, tangent, across(second, tangent) / (speed * speed)[:, None]


def deviance(problem: Problem, solution: Solution, spacing: float) -> float:
    """-2 ln of the evidence of the points normal to the route [ln m²]; docs/model.md (34).

    The restricted likelihood prices the unknown place and direction by their information in units of the
    spacing; that price is replaced by the logarithm of the number of values for each of the four, and for
    both variances at the ends.
    """
    q = max(solution.intensity, 1e-280)
    n, blur = solution.values + 2, np.zeros(0) if problem.blur is None else problem.blur[problem.blur > 0.0]
    variance = max(solution.ratio * q, 1e-280) * spacing**2
    told, seen = float(np.sum(solution.ratio * q / blur)), n - len(blur)  # docs/model.md (92)
    information = math.log(seen * (seen * (seen * seen - 1.0) / 12.0 + told))
    fitted = 2 * (solution.values * math.log(q) + solution.log_s) + solution.squares / q
    fitted += 4 * (seen - 2) * math.log(spacing)
    return fitted + 4 * math.log(variance) - 2 * information + 6 * math.log(2 * n)


def _first(shape: Shape, spacing: float, noise: float | None) -> tuple[Problem, Solution]:
    """Problem with known stations, or with the likelier of even spacing and chord lengths."""
    n = len(shape.points)
    y = (shape.points - shape.points[0]) / spacing
    variance = 0.0 if noise is None else max(noise / spacing, _EXACT) ** 2

    start, ends, square = _vague(y, variance)
    coupling = np.zeros((n, 3))
    coupling[:, 0] = square

    def on(u: Vector) -> Problem:
        step = transitions(u, coupling)
        return Problem(
            u,
            y,
            np.ones(n),
            step,
            start,
            ends,
            np.zeros((n, 3)),
            False,
            variance,
            coupling,
            shape.stations is not None,
            shape.directions,
            shape.direction_noise**2,
        )

    if shape.stations is not None:
        problem = on(shape.stations / spacing)
        return problem, _solve(problem)
    even = on(shape.index - shape.index[0])
    chord = on(summed(np.linalg.norm(np.diff(y, axis=0), axis=1)))
    first, second = _solve(even), _solve(chord)
    if _deviance(second) < _deviance(first) - _UNEVEN * n:
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
        min(np.mean(np.diff(y, k, axis=0) ** 2) / c for k, c in ((2, 6), (3, 20))), _EXACT**2
    )
    few = np.linspace(0, n - 1, min(n, _FEW)).round().astype(np.int64)
    gap = (n - 1) / (len(few) - 1)
    chord = np.diff(y[few], axis=0)
    turned = (
        np.linalg.norm(np.cross(chord[:-1], chord[1:]), axis=1),
        np.einsum("ij,ij->i", chord[:-1], chord[1:]),
    )
    square = float(np.mean(np.arctan2(*turned) ** 2)) / gap**2
    bend = max(square / 3.0, noise / gap**4)
    start = np.zeros((3, 4))
    start[:, 0], start[:, 1] = y[0], (y[few[1]] - y[0]) / gap
    turn = bend * gap**2 + noise / gap**2
    spread = np.array([_VAGUE * noise, _VAGUE * turn, _LOOSE * bend, _LOOSE * bend / gap**2])
    return start, spread / noise, float(np.clip(square - 12.0 * noise / gap**4, 0.0, SHARPEST**2))


def scaled_ends(problem: Problem, variance: float) -> Vector:
    """Variances at the ends in units of the noise variance that was found."""
    scaled = problem.blur is not None and problem.variance == 0.0
    return problem.ends * (problem.likely / variance) if scaled else problem.ends


def _solve(problem: Problem, guess: float = 0.0) -> Solution:
    if problem.aim is None or problem.blur is None:
        found = best_ratio(*problem[:9], guess, None, None)  # defaults would take the slow way in
        mean, covariance, gain = smooth(*problem[:6], found[0], None, None, 0.0)
    else:
        told = problem.aim, problem.blur
        if problem.variance > 0.0:
            found = best_ratio(*problem[:9], guess, *told)
        else:
            found = best_noise(problem[:8], problem.likely, guess, *told)
        ends = scaled_ends(problem, found[0] * found[1])
        mean, covariance, gain = smooth(*problem[:5], ends, found[0], *told, 1.0 / found[1])
    if not math.isfinite(mean.sum()):
        raise FitError("the points give no finite curve: check the unit and look for stray points")
    return Solution(*found, mean, covariance, gain)


def _stray_direction(problem: Problem, solution: Solution) -> int:
    """Return the direction that stands off the curve most, or -1."""
    if problem.aim is None or problem.blur is None:
        return -1
    spread = solution.covariance[:, 4] * solution.intensity
    return outlying_direction(problem.aim, problem.blur, problem.u, solution.mean, spread)


def _without_stray_directions(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """Leave out directions that the curve through all else does not explain, one at a time."""
    sensed = problem.aim
    for _ in range(_ROUNDS):
        worst = _stray_direction(problem, solution)
        if worst < 0 or not may_drop(problem.aim, sensed):
            break
        aim, blur = np.array(problem.aim), np.array(problem.blur)
        aim[worst], blur[worst] = np.nan, 0.0
        problem = problem._replace(aim=aim, blur=blur)
        solution = _solve(problem, solution.ratio)
    return problem, solution


def _bent(problem: Problem, solution: Solution, *, known: bool) -> Problem:
    """Bend the prior along the curve found, and put unknown stations at the feet of the points."""
    u, coupling, ends, tangent = bent_along(
        problem.u,
        problem.y,
        problem.weight,
        solution.ratio,
        solution.intensity,
        solution.mean,
        solution.covariance,
        known,
    )
    variance, blur = max(solution.ratio * solution.intensity, _EXACT**2), None
    if problem.aim is not None:
        slid = np.zeros(len(u)) if known else coupling[:, 0] * (problem.variance or variance)
        blur = variances(problem.aim, problem.facing, slid)
    return problem._replace(
        u=u,
        step=transitions(u, coupling),
        coupling=coupling,
        start=solution.mean[0].copy(),
        ends=ends,
        tangent=tangent,
        planar=True,
        blur=blur,
        likely=variance,
    )


def _without_outliers(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """Take the weight from points that their neighbours' curve does not explain."""
    problem, solution = _without_stray_directions(problem, solution)
    for _ in range(_ROUNDS):
        stray, count = stray_points(
            problem.u,
            problem.y,
            problem.weight,
            problem.variance,
            solution.ratio,
            solution.mean,
            solution.covariance,
        )
        if not count:
            break
        weight = np.where(stray, 0.0, problem.weight)
        if is_stretch(weight):
            weight = np.ones_like(weight)
        problem = problem._replace(weight=weight)
        solution = _solve(problem, solution.ratio)
        if weight.min() > 0.0:
            break
    return problem, solution

"""A smooth route through noisy points, with the covariance of everything that follows from it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.route.directions import direction_warnings
from tssgeom.route.observations import Shape, outlier_warnings
from tssgeom.route.route import Route, insert_nodes, mean_spacing
from tssgeom.route.spline.clusters import clustered, merged
from tssgeom.route.spline.filtering import innovations, transitions
from tssgeom.route.spline.posterior import Problem, Solution, deviance, posterior, scaled_ends, warmed
from tssgeom.route.spline.smoother import smooth

_NODES = 120  # fewest nodes on which curvature is evaluated
_SWING = -3.5  # standard deviations beyond which errors of clustered points are not white
_SWING_OF_CELLS = -4.0
_LAGS = (1, 2, 3)
_CELL = 2.83  # mean spacings in the first cell tried
_FEWEST_CELLS = 12


@dataclass(frozen=True, slots=True)
class Spline:
    """A route with its posterior, docs/model.md (20) to (22)."""

    route: Route
    covariance: Matrix
    """Posterior covariance of r, T, a and b of (20), one coordinate, upper triangle [m, 10]."""
    gain: Matrix
    """Smoother gains: covariance of neighbouring nodes is gain i times covariance i+1, [m-1, 4, 4]."""
    freedom: float
    """Effective number of parameters of one coordinate [1]."""
    deviance: float
    """-2 ln of the evidence of the points normal to the route [ln m²]."""
    stations_known: bool
    """Whether the sensor told the stations."""
    memory: tuple[Problem, Solution, float]
    """What the next fit of a moving route begins with, and its mean spacing [m]."""
    angle_doubt: float = 0.0
    """Relative standard error of all angles that comes from errors that neighbouring points share [1]."""
    facing: float = 0.0
    """Share of the effective parameters that sensed directions tell [1]."""
    warnings: tuple[str, ...] = ()
    """What the user should know of the fit."""


def fit(shape: Shape, noise: float | None = None, last: Spline | None = None) -> Spline:
    """Fit a smooth route.

    Parameters
    ----------
    shape
        Validated points.
    noise
        Known standard deviation of each coordinate [m]; estimated where left out.
    last
        Fit of the same route a moment ago, as in a stream: where it still holds, one pass that begins with
        it is enough.

    Raises
    ------
    FitError
        Where the points give no finite curve.
    """
    if last is not None and last.angle_doubt == 0.0:
        found = warmed(shape, noise, last.memory)
        if found is not None:
            return _spline(shape, *found)
    spline = _fit_white(shape, noise)
    alone = shape.stations is None and shape.directions is None
    if noise is None and alone and clustered(shape.points, spline.route.noise) and _swing(spline) < _SWING:
        return _fit_merged(shape, spline)
    return spline


def _fit_white(shape: Shape, noise: float | None) -> Spline:
    spacing = _mean_spacing(shape)
    return _spline(shape, *posterior(shape, spacing, noise), spacing)


def _swing(spline: Spline) -> float:
    """How far the errors swing back and forth along the route, in standard deviations of chance.

    The most negative autocorrelation of the innovations at lags 1 to 3 times the root of their number; white
    errors give values above -3, errors that neighbours share give large negative ones.
    """
    problem, solution, _ = spline.memory
    e = np.zeros_like(problem.y)
    if problem.blur is None:
        innovations(*problem[:8], solution.ratio, e)
    else:
        per_q = 1.0 / solution.intensity
        innovations(*problem[:8], solution.ratio, e, problem.aim, problem.blur, per_q)
    e = e[np.any(e != 0.0, axis=1)]
    if len(e) <= _LAGS[-1]:
        return 0.0
    e = np.clip(e / np.sqrt(np.mean(e * e)), -3.0, 3.0)
    power = np.sum(e * e)
    return float(min(np.sum(e[lag:] * e[:-lag]) for lag in _LAGS) / power * np.sqrt(2.0 * len(e)))


def _mean_spacing(shape: Shape) -> float:
    if shape.stations is not None:
        return float(shape.stations[-1]) / (len(shape.stations) - 1)
    return mean_spacing(shape.points)


def _fit_merged(shape: Shape, spline: Spline) -> Spline:
    """Merge points that share their errors into cells, the smallest tried that leave white errors; (28).

    The angle still depends on the size of the cells: half of what changes between cells of half and of double
    the area is taken as its standard error.
    """
    cell = _CELL * float(spline.route.s[-1]) / len(shape.points)
    while True:
        coarse, cell_of = merged(shape, cell)
        if len(coarse.points) < _FEWEST_CELLS:
            return spline
        fitted = _fit_white(coarse, None)
        if _swing(fitted) >= _SWING_OF_CELLS:
            break
        cell *= np.sqrt(2.0)
    finer, coarser = (_angle_in_cells(shape, cell * x) for x in (0.5**0.5, 2**0.5))
    doubt = 0.5 * abs(finer - coarser) / _raw_angle(fitted.route)
    warning = f"neighbouring points share their errors: merged into cells of {cell * 1e3:.3g} mm"
    route = _on_all_points(shape, fitted.route, cell_of)
    return replace(fitted, route=route, angle_doubt=doubt, warnings=(warning,))


def _angle_in_cells(shape: Shape, cell: float) -> float:
    return _raw_angle(_fit_white(merged(shape, cell)[0], None).route)


def _raw_angle(route: Route) -> float:
    return float(np.trapezoid(np.linalg.norm(route.curvature_vector, axis=1), route.s)) + 1e-12


def _on_all_points(shape: Shape, route: Route, cell_of: np.ndarray) -> Route:
    """Give each sensed point its foot on a route that was fitted to cells."""
    near = np.interp(route.station[cell_of], route.s, np.arange(len(route.s))).round().astype(int)
    along = np.einsum("ij,ij->i", shape.points - route.position[near], route.tangent[near])
    station = np.clip(route.s[near] + along, 0.0, route.s[-1])
    foot = np.column_stack([np.interp(station, route.s, route.position[:, c]) for c in range(3)])
    return replace(
        route,
        weight=read_only(route.weight[cell_of]),
        station=read_only(station),
        residual=read_only(shape.points - foot),
    )


def _spline(shape: Shape, problem: Problem, solution: Solution, spacing: float) -> Spline:
    """Spline on its nodes in SI; the nodes are the stations, and more in between where these are few."""
    u, where = problem.u, None
    mean, covariance, gain = solution[5:]
    if len(u) < _NODES:
        u, where = insert_nodes(problem.u, problem.u[-1] / _NODES)
        mean, covariance, gain = _on_nodes(problem, solution, u, where)
    q = solution.intensity
    s, position, tangent, bend, covariance, gain = in_metres(
        u, mean, covariance, gain, shape.points[0], spacing, q, problem.known
    )
    feet = slice(None) if where is None else where
    route = Route(
        s=read_only(s),
        position=read_only(position),
        tangent=read_only(tangent),
        curvature_vector=read_only(bend),
        noise=math.sqrt(solution.ratio * q) * spacing,
        weight=read_only(problem.weight),
        station=read_only(s[feet]),
        residual=read_only(shape.points - position[feet]),
    )
    warnings = outlier_warnings(shape, problem.weight)
    warnings += direction_warnings(shape.directions, problem.aim, shape.index)
    facing = _told_by_directions(problem, solution)
    freedom = float(problem.weight @ solution.covariance[:, 0]) / solution.ratio + facing
    return Spline(
        route=route,
        covariance=read_only(covariance),
        gain=read_only(gain),
        freedom=freedom,
        deviance=deviance(problem, solution, spacing),
        stations_known=problem.known,
        memory=(problem, solution, spacing),
        facing=facing / freedom,
        warnings=warnings,
    )


def _told_by_directions(problem: Problem, solution: Solution) -> float:
    """Effective number of parameters of one coordinate that the directions tell [1]."""
    if problem.blur is None:
        return 0.0
    used = problem.blur > 0.0
    return float(np.sum(solution.covariance[used, 4] / problem.blur[used])) * solution.intensity


@njit(cache=True, nogil=True, error_model="numpy")
def in_metres(
    u: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
    gain: np.ndarray,
    origin: np.ndarray,
    spacing: float,
    q: float,
    known: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Arc length, places, tangents, curvature vectors, covariance and gains in SI."""
    n = len(u)
    s, position, tangent, bend = np.empty(n), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    wide, gains = np.empty((n, 10)), np.empty((n - 1, 4, 4))
    unit = np.array([spacing, 1.0, 1.0 / spacing, spacing**-2])
    pair = np.empty(10)
    k = 0
    for i in range(4):
        for j in range(i, 4):
            pair[k] = unit[i] * unit[j] * q
            k += 1
    arc, before = 0.0, 0.0
    for i in range(n):
        m = mean[i]
        square = max(m[0, 1] ** 2 + m[1, 1] ** 2 + m[2, 1] ** 2, 1e-24)
        speed = math.sqrt(square)
        along = (m[0, 1] * m[0, 2] + m[1, 1] * m[1, 2] + m[2, 1] * m[2, 2]) / square
        for c in range(3):
            position[i, c] = m[c, 0] * spacing + origin[c]
            tangent[i, c] = m[c, 1] / speed
            bend[i, c] = (m[c, 2] - along * m[c, 1]) / (square * spacing)
        if i > 0:
            arc += 0.5 * (speed + before) * (u[i] - u[i - 1])
        before = speed
        s[i] = (u[i] if known else arc) * spacing
        for k in range(10):
            wide[i, k] = covariance[i, k] * pair[k]
        if i < n - 1:
            for j in range(4):
                for k in range(4):
                    gains[i, j, k] = gain[i, j, k] * unit[j] / unit[k]
    return s, position, tangent, bend, wide, gains


def _on_nodes(
    problem: Problem, solution: Solution, u: Vector, where: np.ndarray
) -> tuple[Matrix, Matrix, Matrix]:
    """Posterior on more nodes than the stations, which are `where` among them."""
    n = len(u)
    y, weight = np.zeros((n, 3)), np.zeros(n)
    y[where], weight[where] = problem.y, problem.weight
    interval = np.minimum(np.searchsorted(where, np.arange(n)), len(where) - 1)
    step = transitions(u, problem.coupling[interval])
    ends = scaled_ends(problem, solution.ratio * solution.intensity)
    given = (u, y, weight, step, problem.start, ends, solution.ratio)
    if problem.aim is None or problem.blur is None:
        return smooth(*given, None, None, 0.0)
    aim, blur = np.zeros((n, 3)), np.zeros(n)
    aim[where], blur[where] = problem.aim, problem.blur
    return smooth(*given, aim, blur, 1.0 / solution.intensity)

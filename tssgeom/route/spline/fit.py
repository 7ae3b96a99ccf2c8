"""A smooth route through noisy points, with the covariance of everything that follows from it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.arrays import Matrix, Points, Vector, read_only
from tssgeom.route.directions import direction_warnings
from tssgeom.route.observations import Shape, outlier_warnings
from tssgeom.route.route import Route, insert_nodes, mean_spacing
from tssgeom.route.spline.filtering import FilterModel, SensedTangents, innovations
from tssgeom.route.spline.posterior import Problem, Solution, deviance, posterior, scaled_ends, warmed
from tssgeom.route.spline.prior import transitions
from tssgeom.route.spline.smoother import smooth

_NODES = 120  # fewest nodes on which curvature is evaluated


class SharedErrors(NamedTuple):
    """When neighbouring points share their errors, as in centre lines traced in images, and what is done."""

    close: float = 0.25
    """Distance of neighbours that are close, of the median [1]; chosen."""
    many: float = 0.08
    """Share of close neighbours that no even sensor has [1]; chosen."""
    quiet: float = 0.01
    """Noise of the median distance [1], below which neighbours are close because the route bends; chosen."""
    correlation: float = -3.5
    """Autocorrelation of the innovations below which errors are not white [standard deviations]; chosen:
    white ones stay above -3."""
    correlation_of_cells: float = -4.0
    """The same for points merged into cells [standard deviations]; chosen."""
    lags: tuple[int, ...] = (1, 2, 3)
    """Lags at which it is taken [points]; chosen."""
    clipped: float = 3.0
    """Innovation beyond which it is clipped, so that no outlier decides [standard deviations]; chosen."""
    first_cell: float = 2.83
    """Size of the first cells [mean spacings]; chosen: 2√2, docs/model.md (28)."""
    growth: float = 2.0**0.5
    """Factor from one size of cells to the next [1]; chosen."""
    fewest_cells: int = 12
    """Fewest cells that are fitted [1]; chosen."""


SHARED = SharedErrors()


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
    """Whether the sensor gives the stations."""
    memory: tuple[Problem, Solution, float]
    """What the next fit of a moving route begins with, and its mean spacing [m]."""
    shared_angle_error: float = 0.0
    """Relative standard error of all angles that comes from errors that neighbouring points share [1]."""
    tangent_share: float = 0.0
    """Share of the effective parameters that sensed directions determine [1]."""
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
    if last is not None and last.shared_angle_error == 0.0:
        warm = warmed(shape, noise, last.memory)
        if warm is not None:
            return _spline(shape, *warm)
    spline = _fit_white(shape, noise)
    alone = noise is None and shape.stations is None and shape.directions is None
    if alone and _clustered(shape.points, spline.route.noise) and _correlation(spline) < SHARED.correlation:
        return _fit_cells(shape, spline)
    return spline


def _fit_white(shape: Shape, noise: float | None) -> Spline:
    spacing = _mean_spacing(shape)
    return _spline(shape, *posterior(shape, spacing, noise), spacing)


def _clustered(points: Points, noise: float) -> bool:
    """Whether many neighbours lie far closer together than the rest, as no even sensor puts them.

    Points with hardly any noise [m] lie closer together because the route bends there.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    usual = np.median(steps)
    return bool(noise > SHARED.quiet * usual and np.mean(steps < SHARED.close * usual) > SHARED.many)


def _correlation(spline: Spline) -> float:
    """Return the most negative autocorrelation of the innovations, in standard deviations of chance.

    It is taken at lags 1 to 3, times the root of their number; white errors give values above -3, errors that
    neighbours share give large negative ones.
    """
    problem, solution, _ = spline.memory
    e, tangents = np.zeros_like(problem.model.y), problem.sensed_tangents
    innovations(
        problem.model, solution.ratio, e, tangents, 0.0 if tangents is None else 1.0 / solution.intensity
    )
    e = e[np.any(e != 0.0, axis=1)]
    if len(e) <= SHARED.lags[-1]:
        return 0.0
    e = np.clip(e / np.sqrt(np.mean(e * e)), -SHARED.clipped, SHARED.clipped)
    power = np.sum(e * e)
    return float(min(np.sum(e[lag:] * e[:-lag]) for lag in SHARED.lags) / power * np.sqrt(2.0 * len(e)))


def _mean_spacing(shape: Shape) -> float:
    if shape.stations is not None:
        return float(shape.stations[-1]) / (len(shape.stations) - 1)
    return mean_spacing(shape.points)


def _fit_cells(shape: Shape, spline: Spline) -> Spline:
    """Merge points that share their errors into cells, the smallest tried that leave white errors; (28).

    The angle still depends on the size of the cells: half of what changes between cells of half and of double
    the area is taken as its standard error.
    """
    cell = SHARED.first_cell * float(spline.route.s[-1]) / len(shape.points)
    while True:
        coarse, cell_of = _merged(shape, cell)
        if len(coarse.points) < SHARED.fewest_cells:
            return spline
        fitted = _fit_white(coarse, None)
        if _correlation(fitted) >= SHARED.correlation_of_cells:
            break
        cell *= SHARED.growth
    finer, coarser = (_angle_in_cells(shape, cell * x) for x in (0.5**0.5, 2**0.5))
    error = 0.5 * abs(finer - coarser) / _raw_angle(fitted.route)
    warning = f"neighbouring points share their errors: merged into cells of {cell * 1e3:.3g} mm"
    route = _on_all_points(shape, fitted.route, cell_of)
    return replace(fitted, route=route, shared_angle_error=error, warnings=(warning,))


def _merged(shape: Shape, cell: float) -> tuple[Shape, np.ndarray]:
    """Return the mean of the points in each cell of a size [m], and the cell of each point [n]."""
    cell_of = _cells(shape.points, cell)
    count = np.bincount(cell_of)
    sums = np.column_stack([np.bincount(cell_of, shape.points[:, c]) for c in range(3)])
    index = np.arange(len(count), dtype=np.float64)
    return Shape(read_only(sums / count[:, None]), read_only(index), None, shape.warnings), cell_of


@njit(cache=True, nogil=True)
def _cells(points: np.ndarray, cell: float) -> np.ndarray:
    out = np.zeros(len(points), dtype=np.int64)
    first = 0
    for i in range(1, len(points)):
        out[i] = out[i - 1]
        square = 0.0
        for c in range(3):
            square += (points[i, c] - points[first, c]) ** 2
        if square > cell * cell:
            out[i] += 1
            first = i
    return out


def _angle_in_cells(shape: Shape, cell: float) -> float:
    return _raw_angle(_fit_white(_merged(shape, cell)[0], None).route)


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
    u, where = problem.model.u, None
    mean, covariance, gain = solution[5:]
    if len(u) < _NODES:
        u, where = insert_nodes(u, u[-1] / _NODES)
        mean, covariance, gain = _on_nodes(problem, solution, u, where)
    q, weight = solution.intensity, problem.model.weight
    s, position, tangent, bend, covariance, gain = _in_metres(
        u, mean, covariance, gain, shape.points[0], spacing, q, problem.stations_known
    )
    feet = slice(None) if where is None else where
    route = Route(
        s=read_only(s),
        position=read_only(position),
        tangent=read_only(tangent),
        curvature_vector=read_only(bend),
        noise=math.sqrt(solution.ratio * q) * spacing,
        weight=read_only(weight),
        station=read_only(s[feet]),
        residual=read_only(shape.points - position[feet]),
    )
    warnings = outlier_warnings(shape, weight)
    warnings += direction_warnings(shape.directions, problem.tangents, shape.index)
    by_tangents = _parameters_of_tangents(problem, solution)
    freedom = float(weight @ solution.covariance[:, 0]) / solution.ratio + by_tangents
    return Spline(
        route=route,
        covariance=read_only(covariance),
        gain=read_only(gain),
        freedom=freedom,
        deviance=deviance(problem, solution, spacing),
        stations_known=problem.stations_known,
        memory=(problem, solution, spacing),
        tangent_share=by_tangents / freedom,
        warnings=warnings,
    )


def _parameters_of_tangents(problem: Problem, solution: Solution) -> float:
    """Effective number of parameters of one coordinate that the directions determine [1]."""
    variance = problem.tangent_variance
    if variance is None:
        return 0.0
    used = variance > 0.0
    return float(np.sum(solution.covariance[used, 4] / variance[used])) * solution.intensity


@njit(cache=True, nogil=True, error_model="numpy")
def _in_metres(
    u: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
    gain: np.ndarray,
    origin: np.ndarray,
    spacing: float,
    q: float,
    known: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Arc length, positions, tangents, curvature vectors, covariance and gains in SI."""
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
    n, given = len(u), problem.model
    y, weight = np.zeros((n, 3)), np.zeros(n)
    y[where], weight[where] = given.y, given.weight
    interval = np.minimum(np.searchsorted(where, np.arange(n)), len(where) - 1)
    step = transitions(u, problem.coupling[interval])
    ends = scaled_ends(problem, solution.ratio * solution.intensity)
    model = FilterModel(u, y, weight, step, given.start, ends, np.zeros((n, 3)), given.across_only)
    if problem.sensed_tangents is None:
        return smooth(model, solution.ratio, None, 0.0)
    tangents = SensedTangents(np.zeros((n, 3)), np.zeros(n))
    tangents.unit[where], tangents.variance[where] = problem.sensed_tangents
    return smooth(model, solution.ratio, tangents, 1.0 / solution.intensity)

"""A smooth route through noisy points, with the covariance of everything that follows from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, read_only
from tssgeom.core.constants_route import NODES, PRIOR
from tssgeom.route.directions import direction_warnings
from tssgeom.route.observations import Shape, outlier_warnings
from tssgeom.route.route import Route
from tssgeom.route.spline.posterior import PARAMETERS, posterior_in_steps, warmed
from tssgeom.route.spline.problem import LastPass, Problem, Solution, deviance
from tssgeom.route.steps import at_once


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
    memory: LastPass
    """What the next fit of a moving route begins with."""
    joints: np.ndarray
    """Nodes at which pieces of constant curvature meet, with both ends."""
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
        moved = _moved(shape, noise, last)
        if moved is not None:
            return moved
    return at_once(fit_in_steps(shape, noise))


def fit_in_steps(
    shape: Shape, noise: float | None, last: Spline | None = None
) -> Generator[int, None, Spline]:
    """Do as `fit`, with a stop after each pass."""
    if last is not None and last.shared_angle_error == 0.0:
        moved = _moved(shape, noise, last)
        if moved is not None:
            return moved
        yield PARAMETERS * len(shape.points)
    spline, correlation = yield from _fit_white(shape, noise)
    alone = noise is None and shape.stations is None and shape.directions is None
    if alone and _clustered(shape.points, spline.route.noise) and correlation() < SHARED.correlation:
        return _fit_cells(shape, spline)
    return spline


def _fit_white(shape: Shape, noise: float | None) -> Generator[int, None, tuple[Spline, Callable[[], float]]]:
    """Fit a route as if all errors were white; returns also how to ask for their correlation."""
    spacing = _mean_spacing(shape)
    problem, solution = yield from posterior_in_steps(shape, spacing, noise)
    return _spline(shape, problem, solution, spacing), partial(_correlation, problem, solution)


def _clustered(points: Points, noise: float) -> bool:
    """Whether many neighbours lie far closer together than the rest, as no even sensor puts them.

    Points with hardly any noise [m] lie closer together because the route bends there.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    usual = np.median(steps)
    return bool(noise > SHARED.quiet * usual and np.mean(steps < SHARED.close * usual) > SHARED.many)


def _correlation(problem: Problem, solution: Solution) -> float:
    """Return the most negative autocorrelation of the innovations, in standard deviations of chance.

    It is taken at lags 1 to 3, times the root of their number; white errors give values above -3, errors that
    neighbours share give large negative ones.
    """
    sensed = problem.sensed
    inverse_intensity = 0.0 if sensed[0] is None else 1.0 / solution.intensity
    e = core.innovations(*problem.model, *sensed, solution.ratio, inverse_intensity)[0]
    e = e[np.any(e != 0.0, axis=1)]
    if len(e) <= SHARED.lags[-1]:
        return 0.0
    e = np.clip(e / np.sqrt(np.mean(e * e)), -SHARED.clipped, SHARED.clipped)
    power = np.sum(e * e)
    return float(min(np.sum(e[lag:] * e[:-lag]) for lag in SHARED.lags) / power * np.sqrt(2.0 * len(e)))


def _mean_spacing(shape: Shape) -> float:
    if shape.stations is not None:
        return float(shape.stations[-1]) / (len(shape.stations) - 1)
    return core.mean_spacing(shape.points)


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
        fitted, correlation = at_once(_fit_white(coarse, None))
        if correlation() >= SHARED.correlation_of_cells:
            break
        cell *= SHARED.growth
    finer, coarser = (_angle_in_cells(shape, cell * x) for x in (0.5**0.5, 2**0.5))
    error = 0.5 * abs(finer - coarser) / _raw_angle(fitted.route)
    warning = f"neighbouring points share their errors: merged into cells of {cell * 1e3:.3g} mm"
    return replace(
        fitted,
        route=_on_all_points(shape, fitted.route, cell_of),
        joints=_joints(fitted.route, fitted.covariance, fitted.freedom, len(shape.points)),
        shared_angle_error=error,
        warnings=(warning,),
    )


def _merged(shape: Shape, cell: float) -> tuple[Shape, np.ndarray]:
    """Return the mean of the points in each cell of a size [m], and the cell of each point [n]."""
    cell_of = _cells(shape.points, cell)
    count = np.bincount(cell_of)
    sums = np.column_stack([np.bincount(cell_of, shape.points[:, c]) for c in range(3)])
    index = np.arange(len(count), dtype=np.float64)
    return Shape(read_only(sums / count[:, None]), read_only(index), None, shape.warnings), cell_of


def _cells(points: Points, cell: float) -> np.ndarray:
    out, first, count = [], 0, 0
    for i, point in enumerate(points):
        if math.dist(point, points[first]) > cell:
            first, count = i, count + 1
        out.append(count)
    return np.array(out, dtype=np.int64)


def _angle_in_cells(shape: Shape, cell: float) -> float:
    return _raw_angle(at_once(_fit_white(_merged(shape, cell)[0], None))[0].route)


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


def _moved(shape: Shape, noise: float | None, last: Spline) -> Spline | None:
    """Spline of the same route a moment after the last one, or None where that no longer holds."""
    before = last.memory
    same = (shape.stations is not None) == before.stations_known
    same &= (shape.directions is None) == (before.tangents is None)
    if len(shape.points) != len(before.u) or not same:
        return None
    if shape.directions is None:
        return _moved_at_once(shape, noise, before)
    warm = warmed(shape, noise, before)
    return None if warm is None else _spline(shape, *warm, before.spacing)


def _moved_at_once(shape: Shape, noise: float | None, last: LastPass) -> Spline | None:
    """Do as `warmed` and `_spline` do, in one call of the core."""
    n, spacing = len(shape.points), last.spacing
    variance = 0.0 if noise is None else max(noise / spacing, PRIOR.rounding) ** 2
    result, u, y, mean, state, count, *nodes, pieces = core.spline_frame(
        shape.points,
        last.u,
        last.y,
        last.weight,
        last.mean,
        last.covariance,
        last.ratio,
        last.intensity,
        spacing,
        variance,
        shape.stations,
        _rows(n),
    )
    ratio, intensity, freedom, least, held = result.tolist()
    if not held:
        return None
    s, vectors, covariance, gain, station, residual, joints = nodes
    for array in (s, vectors, covariance, gain, station, residual, joints):
        array.flags.writeable = False
    position, tangent, bend = vectors
    route = Route(
        s=s[:count],
        position=position[:count],
        tangent=tangent[:count],
        curvature_vector=bend[:count],
        noise=math.sqrt(ratio * intensity) * spacing,
        weight=last.weight,
        station=station,
        residual=residual,
    )
    return Spline(
        route=route,
        covariance=covariance[:count],
        gain=gain[: count - 1],
        freedom=freedom,
        deviance=least,
        stations_known=last.stations_known,
        memory=LastPass(u, y, last.weight, mean, state, ratio, intensity, spacing, last.stations_known, None),
        joints=joints[: pieces + 1],
    )


def _rows(n: int) -> int:
    """Room for the nodes of a route of n stations."""
    return n if n >= NODES.fewest else n + NODES.fewest


def _spline(shape: Shape, problem: Problem, solution: Solution, spacing: float) -> Spline:
    """Spline on its nodes in SI; the nodes are the stations, and more in between where these are few."""
    model, n = problem.model, len(shape.points)
    count, s, vectors, covariance, gain, where = core.spline_nodes(
        model.u,
        model.y,
        model.weight,
        model.start,
        problem.ends_at(solution.variance),
        model.across_only,
        problem.coupling,
        *problem.sensed,
        solution.ratio,
        solution.intensity,
        solution.mean,
        solution.covariance,
        solution.gain,
        shape.points[0],
        spacing,
        problem.stations_known,
        _rows(n),
    )
    s, (position, tangent, bend) = s[:count], vectors[:, :count]
    by_tangents = _parameters_of_tangents(problem, solution)
    freedom = float(model.weight @ solution.covariance[:, 0]) / solution.ratio + by_tangents
    covariance = covariance[:count]
    route = Route(
        s=read_only(s),
        position=read_only(position),
        tangent=read_only(tangent),
        curvature_vector=read_only(bend),
        noise=math.sqrt(solution.variance) * spacing,
        weight=read_only(model.weight),
        station=read_only(s[where]),
        residual=read_only(shape.points - position[where]),
    )
    warnings = outlier_warnings(shape, model.weight)
    warnings += direction_warnings(shape.directions, problem.tangents, shape.index)
    return Spline(
        route=route,
        covariance=read_only(covariance),
        gain=read_only(gain[: count - 1]),
        freedom=freedom,
        deviance=deviance(problem, solution, spacing),
        stations_known=problem.stations_known,
        memory=LastPass(
            model.u,
            model.y,
            model.weight,
            solution.mean,
            solution.covariance,
            solution.ratio,
            solution.intensity,
            spacing,
            problem.stations_known,
            problem.tangents,
        ),
        joints=_joints(route, covariance, freedom, n),
        tangent_share=by_tangents / freedom,
        warnings=warnings,
    )


def _joints(route: Route, covariance: Matrix, freedom: float, points: int) -> np.ndarray:
    """Nodes at which pieces of constant curvature meet, with both ends."""
    pieces, joints = core.joints(route.s, route.tangent, route.curvature_vector, covariance, freedom, points)
    joints.flags.writeable = False
    return joints[: pieces + 1]


def _parameters_of_tangents(problem: Problem, solution: Solution) -> float:
    """Effective number of parameters of one coordinate that the directions determine [1]."""
    variance = problem.tangent_variance
    if variance is None:
        return 0.0
    used = variance > 0.0
    return float(np.sum(solution.covariance[used, 4] / variance[used])) * solution.intensity

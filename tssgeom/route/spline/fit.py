"""A smooth route through noisy points, with the covariance of everything that follows from it.

Points that share their errors with their neighbours are merged into cells; docs/model.md (28).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Points, read_only, rows_at
from tssgeom.core.constants import CHANCE
from tssgeom.core.constants_route import OUTLIERS, SPACING
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.route.observations import Shape
from tssgeom.route.route import Route
from tssgeom.route.spline.posterior import PARAMETERS, posterior_in_steps
from tssgeom.route.spline.problem import Problem, Solution
from tssgeom.route.spline.spline import Spline, joints_of, spline_of
from tssgeom.route.spline.warm import warm
from tssgeom.route.steps import at_once


class CellRules(NamedTuple):
    """When neighbouring points share their errors, as in centre lines traced in images, and what is done."""

    correlation: float = -3.5
    """Autocorrelation of the innovations below which errors are not white [standard deviations]. Chosen:
    white ones stay above -3, the raw centre lines of an aorta are at -3.75."""
    lags: tuple[int, ...] = (1, 2, 3)
    """Lags at which innovations are correlated [points]; chosen."""
    growth: float = 2.0**0.5
    """Factor from one size of cells to the next [1]; chosen. The first are three such steps above the
    spacing, 2√2, docs/model.md (28)."""
    fewest_cells: int = 12
    """Fewest cells that are fitted [1]; chosen."""


CELLS = CellRules()


def clustered(points: Points, noise: float) -> bool:
    """Whether many neighbours lie far closer together than the rest, as no even sensor puts them.

    Points with hardly any noise [m] lie closer together because the route bends there.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    usual = np.median(steps)
    return bool(
        noise > PLAUSIBLE.negligible * usual and np.mean(SPACING.uneven * steps < usual) > OUTLIERS.share
    )


def correlation_of_innovations(problem: Problem, solution: Solution) -> float:
    """Return the most negative autocorrelation of the innovations, in standard deviations of chance.

    It is taken at lags 1 to 3, times the root of their number; white errors give values above -3, errors that
    neighbours share give large negative ones.
    """
    sensed = problem.sensed
    inverse_intensity = 0.0 if sensed[0] is None else 1.0 / solution.intensity
    e = core.innovations(*problem.model, *sensed, solution.ratio, inverse_intensity)[0]
    e = e[np.any(e != 0.0, axis=1)]
    if len(e) <= CELLS.lags[-1]:
        return 0.0
    e = np.clip(e / np.sqrt(np.mean(e * e)), -CHANCE.clear, CHANCE.clear)  # so that no outlier decides
    power = np.sum(e * e)
    return float(min(np.sum(e[lag:] * e[:-lag]) for lag in CELLS.lags) / power * np.sqrt(2.0 * len(e)))


def merged(shape: Shape, cell: float) -> tuple[Shape, np.ndarray]:
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


def raw_angle(route: Route) -> float:
    """Angle of a route by its curvature as it was fitted, above 0 [rad]."""
    return float(np.trapezoid(np.linalg.norm(route.curvature_vector, axis=1), route.s)) + 1e-12


def on_all_points(shape: Shape, route: Route, cell_of: np.ndarray) -> Route:
    """Give each sensed point its foot on a route that was fitted to cells."""
    near = np.interp(route.station[cell_of], route.s, np.arange(len(route.s))).round().astype(int)
    along = np.einsum("ij,ij->i", shape.points - route.position[near], route.tangent[near])
    station = np.clip(route.s[near] + along, 0.0, route.s[-1])
    foot = rows_at(station, route.s, route.position)
    return replace(
        route,
        weight=read_only(route.weight[cell_of]),
        station=read_only(station),
        residual=read_only(shape.points - foot),
    )


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

    Returns
    -------
    Spline
        The route as position, tangent and curvature at knots [m, 1, 1/m], with covariances.

    Raises
    ------
    FitError
        Where the points give no finite curve.

    Notes
    -----
    Source: docs/model.md (20) to (22).

    Examples
    --------
    >>> from tssgeom import clean, fit
    >>> import numpy as np
    >>> angle = np.linspace(0.0, np.pi, 40)  # a half circle of 0.5 m
    >>> points = 0.5 / np.pi * np.column_stack((np.sin(angle), 1 - np.cos(angle), 0 * angle))
    >>> round(float(fit(clean(points), noise=1e-4).route.s[-1]), 4)  # [m]
    0.5
    """
    return at_once(fit_in_steps(shape, noise, last))


def fit_in_steps(
    shape: Shape, noise: float | None, last: Spline | None = None
) -> Generator[float, None, Spline]:
    """Do as `fit`, with a stop after each pass."""
    if last is not None and last.shared_angle_error == 0.0:
        moved = warm(shape, noise, last)
        if moved is not None:
            return moved
        yield PARAMETERS * len(shape.points)
    spline, correlation = yield from _fit_white(shape, noise)
    alone = noise is None and shape.stations is None and shape.directions is None
    if alone and clustered(shape.points, spline.route.noise) and correlation() < CELLS.correlation:
        return _fit_cells(shape, spline)
    return spline


def _fit_white(
    shape: Shape, noise: float | None
) -> Generator[float, None, tuple[Spline, Callable[[], float]]]:
    """Fit a route as if all errors were white; returns also a function that fits their correlation."""
    spacing = _mean_spacing(shape)
    problem, solution = yield from posterior_in_steps(shape, spacing, noise)
    return spline_of(shape, problem, solution, spacing), partial(
        correlation_of_innovations, problem, solution
    )


def _mean_spacing(shape: Shape) -> float:
    if shape.stations is not None:
        return float(shape.stations[-1]) / (len(shape.stations) - 1)
    return core.mean_spacing(shape.points)


def _fit_cells(shape: Shape, spline: Spline) -> Spline:
    """Merge points that share their errors into cells, the smallest tried that leave white errors; (28).

    The angle still depends on the size of the cells: half of what changes between cells of half and of double
    the area is taken as its standard error.
    """
    cell = CELLS.growth**3 * float(spline.route.s[-1]) / len(shape.points)
    while True:
        coarse, cell_of = merged(shape, cell)
        if len(coarse.points) < CELLS.fewest_cells:
            return spline
        fitted, correlation = at_once(_fit_white(coarse, None))
        if correlation() >= CELLS.correlation:
            break
        cell *= CELLS.growth
    finer, coarser = (_angle_in_cells(shape, cell * x) for x in (0.5**0.5, 2**0.5))
    error = 0.5 * abs(finer - coarser) / raw_angle(fitted.route)
    warning = f"neighbouring points share their errors: merged into cells of {cell * 1e3:.3g} mm"
    return replace(
        fitted,
        route=on_all_points(shape, fitted.route, cell_of),
        joints=joints_of(fitted.route, fitted.covariance, fitted.freedom, len(shape.points)),
        shared_angle_error=error,
        warnings=(warning,),
    )


def _angle_in_cells(shape: Shape, cell: float) -> float:
    return raw_angle(at_once(_fit_white(merged(shape, cell)[0], None))[0].route)

"""Points that share their errors with their neighbours, merged into cells; docs/model.md (28)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Points, read_only, rows_at
from tssgeom.core.constants import CHANCE
from tssgeom.core.constants_route import OUTLIERS, SPACING
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.route.observations import Shape
from tssgeom.route.route import Route
from tssgeom.route.spline.problem import Problem, Solution


class CellRules(NamedTuple):
    """When neighbouring points share their errors, as in centre lines traced in images, and what is done."""

    lags: tuple[int, ...] = (1, 2, 3)
    """Lags at which it is taken [points]; chosen."""
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

"""A smooth route through noisy points, with the covariance of everything that follows from it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector, read_only
from tssgeom.shape.clusters import clustered, merged
from tssgeom.shape.points import Shape
from tssgeom.shape.posterior import Problem, Solution, curve, deviance, posterior, swings
from tssgeom.shape.route import Route
from tssgeom.shape.smoother import smooth
from tssgeom.shape.stations import accumulated, insert_nodes

_NODES = 160  # fewest nodes on which curvature is evaluated
_SWING = -4.0  # standard deviations beyond which errors are not white
_CELL = 4.0  # mean spacings in the first cell tried
_FEWEST_CELLS = 12


@dataclass(frozen=True, slots=True)
class Spline:
    """A route with its posterior, docs/model.md (20) to (22)."""

    route: Route
    covariance: Matrix
    """Posterior covariance of position, tangent and its derivative, one coordinate, upper triangle [m, 6]."""
    gain: Matrix
    """Smoother gains: covariance of neighbouring nodes is gain i times covariance i+1, [m-1, 3, 3]."""
    freedom: float
    """Effective number of parameters of one coordinate [1]."""
    deviance: float
    """-2 ln of the evidence of the points normal to the route [ln m²]."""
    stations_known: bool
    """Whether the sensor told the stations."""
    angle_doubt: float = 0.0
    """Relative standard error of all angles that comes from errors that neighbouring points share [1]."""


def fit(shape: Shape, noise: float | None = None) -> Spline:
    """Fit a smooth route.

    Parameters
    ----------
    shape
        Validated points.
    noise
        Known standard deviation of each coordinate [m]; estimated where left out.

    Raises
    ------
    FitError
        Where the points give no finite curve.
    """
    spline, swing = _fit_white(shape, noise)
    if swing < _SWING and noise is None and shape.stations is None and clustered(shape.points):
        return _fit_merged(shape, spline)
    return spline


def _fit_white(shape: Shape, noise: float | None) -> tuple[Spline, float]:
    spacing = _mean_spacing(shape)
    problem, solution = posterior(shape, spacing, noise)
    return _spline(shape, problem, solution, spacing), swings(problem, solution)


def _mean_spacing(shape: Shape) -> float:
    if shape.stations is not None:
        return float(shape.stations[-1]) / (len(shape.stations) - 1)
    chord = np.linalg.norm(shape.points[-1] - shape.points[0])
    steps = np.linalg.norm(np.diff(shape.points, axis=0), axis=1)
    return float(max(np.median(steps), chord / len(steps)))


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
        fitted, swing = _fit_white(coarse, None)
        if swing >= _SWING:
            break
        cell *= np.sqrt(2.0)
    finer, coarser = (_angle_in_cells(shape, cell * x) for x in (0.5**0.5, 2**0.5))
    doubt = 0.5 * abs(finer - coarser) / _raw_angle(fitted.route)
    return replace(fitted, route=_on_all_points(shape, fitted.route, cell_of, cell), angle_doubt=doubt)


def _angle_in_cells(shape: Shape, cell: float) -> float:
    return _raw_angle(_fit_white(merged(shape, cell)[0], None)[0].route)


def _raw_angle(route: Route) -> float:
    return float(np.trapezoid(np.linalg.norm(route.curvature_vector, axis=1), route.s)) + 1e-12


def _on_all_points(shape: Shape, route: Route, cell_of: np.ndarray, cell: float) -> Route:
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
        warnings=(f"neighbouring points share their errors: merged into cells of {cell * 1e3:.3g} mm",),
    )


def _spline(shape: Shape, problem: Problem, solution: Solution, spacing: float) -> Spline:
    u, where = insert_nodes(problem.u, problem.u[-1] / _NODES)
    ratio, q = solution.ratio, solution.intensity
    mean, covariance, gain = solution[2:]
    if len(u) > len(where):
        mean, covariance, gain = smooth(u, *_on_nodes(problem, where, len(u)), ratio)
    unit = np.array([spacing, 1.0, 1.0 / spacing])
    pairs = unit[[0, 0, 0, 1, 1, 2]] * unit[[0, 1, 2, 1, 2, 2]]
    return Spline(
        route=_route(shape, problem, mean, u, where, float(np.sqrt(ratio * q)), spacing),
        covariance=read_only(covariance * q * pairs),
        gain=read_only(gain * unit[:, None] / unit[None, :]),
        freedom=float(np.sum(problem.weight * solution.covariance[:, 0])) / ratio,
        deviance=deviance(problem, solution, spacing),
        stations_known=shape.stations is not None,
    )


def _route(
    shape: Shape,
    problem: Problem,
    mean: Matrix,
    u: Vector,
    where: np.ndarray,
    noise: float,
    spacing: float,
) -> Route:
    speed, tangent, bend = curve(mean)
    s = u if shape.stations is not None else accumulated(u, speed)
    return Route(
        s=read_only(s * spacing),
        position=read_only(mean[:, :, 0] * spacing + shape.points[0]),
        tangent=read_only(tangent),
        curvature_vector=read_only(bend / spacing),
        noise=noise * spacing,
        weight=read_only(problem.weight),
        station=read_only(s[where] * spacing),
        residual=read_only((problem.y - mean[where, :, 0]) * spacing),
        warnings=_outlier_warnings(shape, problem.weight),
    )


def _on_nodes(problem: Problem, where: np.ndarray, n: int) -> tuple[Points, Vector, Vector]:
    y, weight = np.zeros((n, 3)), np.zeros(n)
    y[where], weight[where] = problem.y, problem.weight
    interval = np.minimum(np.searchsorted(where, np.arange(n)), len(where) - 1)
    return y, weight, problem.kappa2[interval]


def _outlier_warnings(shape: Shape, weight: Vector) -> tuple[str, ...]:
    stray = shape.index[weight <= 0.0].astype(int)
    if not len(stray):
        return ()
    named = ", ".join(str(i) for i in stray[:5]) + (", ..." if len(stray) > 5 else "")
    return (f"{len(stray)} outlying points ignored (count from 0: {named})",)

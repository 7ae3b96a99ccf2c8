"""A smooth route through noisy points, with the covariance of everything that follows from it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector, read_only
from tssgeom.shape.clusters import clustered, merged
from tssgeom.shape.points import Shape
from tssgeom.shape.posterior import Problem, Solution, curve, deviance, posterior, swings
from tssgeom.shape.smoother import smooth
from tssgeom.shape.stations import accumulated, insert_nodes

_NODES = 160  # fewest nodes on which curvature is evaluated
_SWING = -4.0  # standard deviations beyond which errors are not white
_CELL = 4.0  # mean spacings in the first cell tried
_FEWEST_CELLS = 12


@dataclass(frozen=True, slots=True)
class Route:
    """A fitted route on nodes along its arc length; the posterior of docs/model.md (20) to (22)."""

    s: Vector
    """Arc length at the nodes, from 0 [m]."""
    position: Points
    """Places of the nodes [m]."""
    tangent: Points
    """Unit tangents [1]."""
    curvature_vector: Points
    """Change of the unit tangent with arc length, normal to it [1/m]."""
    noise: float
    """Standard deviation of one coordinate of the points, known or estimated [m]."""
    weight: Vector
    """Weight of each sensed point: 1, or 0 for an outlier."""
    station: Vector
    """Arc length of the foot of each sensed point [m]."""
    residual: Points
    """Sensed point less its foot [m]."""
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
    warnings: tuple[str, ...] = ()


def fit(shape: Shape, noise: float | None = None) -> Route:
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
    route, swing = _fit_white(shape, noise)
    if swing < _SWING and noise is None and shape.stations is None and clustered(shape.points):
        return _fit_merged(shape, route)
    return route


def _fit_white(shape: Shape, noise: float | None) -> tuple[Route, float]:
    spacing = _mean_spacing(shape)
    problem, solution = posterior(shape, spacing, noise)
    return _route(shape, problem, solution, spacing), swings(problem, solution)


def _mean_spacing(shape: Shape) -> float:
    if shape.stations is not None:
        return float(shape.stations[-1]) / (len(shape.stations) - 1)
    chord = np.linalg.norm(shape.points[-1] - shape.points[0])
    steps = np.linalg.norm(np.diff(shape.points, axis=0), axis=1)
    return float(max(np.median(steps), chord / len(steps)))


def _fit_merged(shape: Shape, route: Route) -> Route:
    """Merge points that share their errors into cells, the smallest tried that leave white errors; (28).

    The angle still depends on the size of the cells: half of what changes between cells of half and of double
    the area is taken as its standard error.
    """
    cell = _CELL * float(route.s[-1]) / len(shape.points)
    while True:
        coarse, cell_of = merged(shape, cell)
        if len(coarse.points) < _FEWEST_CELLS:
            return route
        fitted, swing = _fit_white(coarse, None)
        if swing >= _SWING:
            break
        cell *= np.sqrt(2.0)
    finer, coarser = (_raw_angle(_fit_white(merged(shape, cell * x)[0], None)[0]) for x in (0.5**0.5, 2**0.5))
    doubt = 0.5 * abs(finer - coarser) / _raw_angle(fitted)
    return _on_all_points(shape, fitted, cell_of, doubt, cell)


def _raw_angle(route: Route) -> float:
    return float(np.trapezoid(np.linalg.norm(route.curvature_vector, axis=1), route.s)) + 1e-12


def _on_all_points(shape: Shape, route: Route, cell_of: np.ndarray, doubt: float, cell: float) -> Route:
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
        angle_doubt=doubt,
        warnings=(f"neighbouring points share their errors: merged into cells of {cell * 1e3:.3g} mm",),
    )


def _route(shape: Shape, problem: Problem, solution: Solution, spacing: float) -> Route:
    u, where = insert_nodes(problem.u, problem.u[-1] / _NODES)
    ratio, q = solution.ratio, solution.intensity
    mean, covariance, gain = solution[2:]
    if len(u) > len(where):
        mean, covariance, gain = smooth(u, *_on_nodes(problem, where, len(u)), ratio)
    speed, tangent, bend = curve(mean)
    s = u if shape.stations is not None else accumulated(u, speed)
    unit = np.array([spacing, 1.0, 1.0 / spacing])
    pairs = unit[[0, 0, 0, 1, 1, 2]] * unit[[0, 1, 2, 1, 2, 2]]
    return Route(
        s=read_only(s * spacing),
        position=read_only(mean[:, :, 0] * spacing + shape.points[0]),
        tangent=read_only(tangent),
        curvature_vector=read_only(bend / spacing),
        noise=float(np.sqrt(ratio * q)) * spacing,
        weight=read_only(problem.weight),
        station=read_only(s[where] * spacing),
        residual=read_only((problem.y - mean[where, :, 0]) * spacing),
        covariance=read_only(covariance * q * pairs),
        gain=read_only(gain * unit[:, None] / unit[None, :]),
        freedom=float(np.sum(problem.weight * solution.covariance[:, 0])) / ratio,
        deviance=deviance(problem, solution, spacing),
        stations_known=shape.stations is not None,
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

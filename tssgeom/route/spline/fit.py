"""A smooth route through noisy points, with the covariance of everything that follows from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.core.constants_route import NODES
from tssgeom.route.directions import direction_warnings
from tssgeom.route.observations import Shape, outlier_warnings
from tssgeom.route.route import Route, arcs_over_chords
from tssgeom.route.spline.cells import (
    SHARED,
    clustered,
    correlation_of_innovations,
    merged,
    on_all_points,
    raw_angle,
)
from tssgeom.route.spline.posterior import PARAMETERS, posterior_in_steps, warmed
from tssgeom.route.spline.problem import LastPass, Problem, Solution, deviance, scaled_variance
from tssgeom.route.steps import at_once


@dataclass(frozen=True, slots=True)
class Spline:
    """A route with its posterior, docs/model.md (20) to (22)."""

    route: Route
    """The fitted route on its nodes."""
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
    by_chords: bool = False
    """Whether the stations are those of arcs over the chords between the points."""
    ratio_variance: float = 0.0
    """Variance of Φ from not knowing λ, over Φ² [1]."""
    ratio_length_variance: float = 0.0
    """The same of the length, over its square [1]."""
    tangent_share: float = 0.0
    """Share of the effective parameters that sensed directions determine [1]."""
    warnings: tuple[str, ...] = ()
    """What the user should know of the fit."""

    def averaged_as(self, other: Spline) -> Spline:
        """Return it with the stations and the unknown λ of a fit of the same route a moment ago."""
        if not other.by_chords and other.ratio_variance == 0.0:
            return self
        known = self.stations_known and not other.by_chords
        return replace(
            self,
            stations_known=known,
            by_chords=other.by_chords,
            ratio_variance=other.ratio_variance,
            ratio_length_variance=other.ratio_length_variance,
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
    if alone and clustered(shape.points, spline.route.noise) and correlation() < SHARED.correlation:
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


def on_chords(shape: Shape, weight: Vector | None = None) -> Shape:
    """Return a shape with the stations of arcs over the chords between its points that have a weight [n]."""
    if weight is None or weight.min() > 0.0:
        return replace(shape, stations=read_only(arcs_over_chords(shape.points)))
    used, every = np.flatnonzero(weight > 0.0), np.arange(len(weight))
    inside = np.interp(every, used, arcs_over_chords(shape.points[used]))
    # an end that is not used lies one mean step beyond
    beyond = np.minimum(every - used[0], 0) + np.maximum(every - used[-1], 0)
    stations = inside + beyond * (inside[-1] / (used[-1] - used[0]))
    return replace(shape, stations=read_only(stations - stations[0]))


def _mean_spacing(shape: Shape) -> float:
    if shape.stations is not None:
        return float(shape.stations[-1]) / (len(shape.stations) - 1)
    return core.mean_spacing(shape.points)


def _fit_cells(shape: Shape, spline: Spline) -> Spline:
    """Merge points that share their errors into cells, the smallest tried that leave white errors; (28).

    The angle still depends on the size of the cells: half of what changes between cells of half and of double
    the area is taken as its standard error.
    """
    cell = SHARED.growth**3 * float(spline.route.s[-1]) / len(shape.points)
    while True:
        coarse, cell_of = merged(shape, cell)
        if len(coarse.points) < SHARED.fewest_cells:
            return spline
        fitted, correlation = at_once(_fit_white(coarse, None))
        if correlation() >= SHARED.correlation:
            break
        cell *= SHARED.growth
    finer, coarser = (_angle_in_cells(shape, cell * x) for x in (0.5**0.5, 2**0.5))
    error = 0.5 * abs(finer - coarser) / raw_angle(fitted.route)
    warning = f"neighbouring points share their errors: merged into cells of {cell * 1e3:.3g} mm"
    return replace(
        fitted,
        route=on_all_points(shape, fitted.route, cell_of),
        joints=_joints(fitted.route, fitted.covariance, fitted.freedom, len(shape.points)),
        shared_angle_error=error,
        warnings=(warning,),
    )


def _angle_in_cells(shape: Shape, cell: float) -> float:
    return raw_angle(at_once(_fit_white(merged(shape, cell)[0], None))[0].route)


def warm(
    shape: Shape, noise: float | None, last: Spline | None, growth: float = 1.0, index: Vector | None = None
) -> Spline | None:
    """Fit the same route a moment after the last fit in one pass; None where that no longer holds.

    The noise variance may have changed by a factor between 1 and `growth`. `index` are the counts in the
    sensed sequence of the points of the last fit; without it they are those of the shape.
    """
    if last is None or last.shared_angle_error:
        return None
    before = last.memory if index is None else last.memory.on(index, shape.index)
    if before is None:
        return None
    if last.by_chords and shape.stations is None:
        shape = on_chords(shape, before.weight)
    same = (shape.stations is not None) == before.stations_known
    same &= (shape.directions is None) == (before.tangents is None)
    if len(shape.points) != len(before.u) or not same:
        return None
    if shape.directions is None:
        moved = _moved_at_once(shape, noise, before, growth)
    else:
        warm = warmed(shape, noise, before, growth)
        moved = None if warm is None else spline_of(shape, *warm, before.spacing)
    return None if moved is None else moved.averaged_as(last)


def _moved_at_once(shape: Shape, noise: float | None, last: LastPass, growth: float) -> Spline | None:
    """Do as `warmed` and `spline_of` do, in one call of the core."""
    n, spacing = len(shape.points), last.spacing
    variance = scaled_variance(noise, spacing)
    result, u, y, mean, state, count, *nodes, pieces = core.spline_frame(
        shape.points,
        last.u,
        last.y,
        last.weight,
        last.mean,
        last.covariance,
        last.ratio,
        last.intensity,
        growth,
        spacing,
        variance,
        shape.stations,
        rows_for(n),
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


def rows_for(n: int) -> int:
    """Room for the nodes of a route of n stations."""
    return n if n >= NODES.fewest else n + NODES.fewest


def spline_of(shape: Shape, problem: Problem, solution: Solution, spacing: float) -> Spline:
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
        rows_for(n),
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

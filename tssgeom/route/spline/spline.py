"""A fitted spline, on its nodes and in SI."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, read_only
from tssgeom.core.constants_route import NODES
from tssgeom.route.directions import direction_warnings
from tssgeom.route.observations import Shape, outlier_warnings
from tssgeom.route.route import Route
from tssgeom.route.spline.posterior import deviance
from tssgeom.route.spline.problem import LastPass, Problem, Solution


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
        joints=joints_of(route, covariance, freedom, n),
        tangent_share=by_tangents / freedom,
        warnings=warnings,
    )


def joints_of(route: Route, covariance: Matrix, freedom: float, points: int) -> np.ndarray:
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

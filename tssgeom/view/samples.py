"""Samples of a route for a picture: a few hundred nodes with their tension, and axis ranges for a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Points, Vector, rows_at
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.pieces import Arcs
from tssgeom.stream import FrameResult
from tssgeom.tendon.state import tension

MOST_NODES = 256
"""A picture shows no more nodes of a route than this."""


_COMMON, _STEPS, _HEADROOM, _LEAST_ANGLE = 0.995, 2.0, 1.05, 0.2
"""Top of the axis of curvature: the quantile of nodes below it, since one noisy node must not flatten all
others; multiple of that up to which pieces count; over the largest curvature; least turn of a route [rad]."""
_SPIKE = 0.5
"""Distance from the common values at which spikes stand, over their range; chosen: these fill half a plot."""


@dataclass(frozen=True, slots=True)
class RouteSamples:
    """Values at the nodes of one route that a picture draws."""

    s: Vector
    """Arc length [m]."""
    position: Points
    """Position [m]."""
    tension: Vector
    """Tension of the tendon [N]."""
    phi: Vector
    """Accumulated curve angle [rad]."""
    kappa: Vector
    """Curvature [1/m]."""
    kappa_se: Vector
    """Standard error of the curvature [1/m]."""
    phi_se: Vector
    """Standard error of the accumulated curve angle [rad]."""

    def at(self, s: Vector) -> Points:
        """Positions at arc lengths `s` [m], linear between nodes [m]."""
        return rows_at(s, self.s, self.position)

    def tension_at(self, s: Vector) -> Vector:
        """Tension at arc lengths `s` [m], linear between nodes [N]."""
        return np.interp(s, self.s, self.tension)


def route_samples(result: FrameResult, most: int = MOST_NODES) -> RouteSamples:
    """Choose at most `most` nodes of a route, evenly and with both ends, and their tension."""
    route, profile = result.route, result.profile
    chosen = evenly(len(route.s), most)
    phi = profile.phi[chosen]
    return RouteSamples(
        s=route.s[chosen],
        position=route.position[chosen],
        tension=tension(result.state, phi, route.s[chosen]),
        phi=phi,
        kappa=profile.kappa[chosen],
        kappa_se=profile.kappa_se[chosen],
        phi_se=profile.phi_se[chosen],
    )


def tension_se(result: FrameResult, frame: RouteSamples | CurvatureProfile) -> Vector:
    """Return the standard error of the tension that comes from that of the curve angle [N]."""
    middle, upper, lower = (
        tension(result.state, np.maximum(frame.phi + side * frame.phi_se, 0.0)) for side in (0.0, 1.0, -1.0)
    )
    # the larger of both sides: the tension has corners, and ends at Φ
    return np.maximum(np.abs(upper - middle), np.abs(middle - lower))


def numbers_of(result: FrameResult) -> tuple[float, float, float, float, float]:
    """T_in [N], T_out [N], elongation [m], and curve angle with its standard error [rad] of one frame."""
    ends, arcs = result.transmission, result.arcs
    return ends.tension_in, ends.tension_out, ends.elongation, arcs.total_angle, arcs.total_angle_se


def front(result: FrameResult, frame: RouteSamples) -> float:
    """Arc length up to which the tendon slid when the drive last moved [m].

    Where that is all of it, the front is at the distal end.
    """
    return float(np.interp(result.transmission.slip_front, frame.phi, frame.s))


def at_edge(measured: Vector, model: Vector) -> Vector:
    """Return measured values, single spikes moved to the edge of what most of them and the model reach.

    It lies half the spread of these and of the model beyond them.
    """
    finite = measured[np.isfinite(measured)]
    if not len(finite):
        return measured
    low, high = np.quantile(finite, (0.01, 0.99))
    low, high = min(float(low), float(np.nanmin(model))), max(float(high), float(np.nanmax(model)))
    return np.clip(measured, low - _SPIKE * (high - low), high + _SPIKE * (high - low))


def evenly(count: int, most: int) -> NDArray[np.intp]:
    """Choose at most `most` of `count` indices, evenly, with the first and the last."""
    return np.unique(np.rint(np.linspace(0, count - 1, min(count, most))).astype(np.intp))


def outliers(result: FrameResult) -> Points:
    """Sensed points that the route does not follow: removed before the fit, or given no weight by it [m]."""
    points, kept = result.frame.points, result.shape.points
    is_removed = np.asarray(~np.isnan(points).any(axis=1))
    is_removed[result.shape.index.astype(np.intp)] = False
    removed = points[is_removed]
    repeated = (removed[:, None] == kept[None]).all(axis=2).any(axis=1)
    return np.concatenate([removed[~repeated], kept[result.route.weight < 0.5]])


def staircase(arcs: Arcs) -> tuple[Vector, Vector]:
    """Curvature of the pieces as a staircase: arc length [m] and curvature [1/m], two points a piece."""
    edges = np.append(arcs.s_start, arcs.total_length)
    return np.repeat(edges, 2)[1:-1], np.repeat(arcs.kappa, 2)


@dataclass(frozen=True, slots=True)
class Ranges:
    """Where the axes and colours of a run end, in every frame of it."""

    tension: float
    """[N]."""
    length: float
    """[m]."""
    kappa: float
    """[1/m]."""


def ranges(frames: Sequence[RouteSamples], pieces: Sequence[Arcs]) -> Ranges:
    """Ranges from 0 that hold every frame; rare peaks of the sensed curvature may exceed theirs."""
    return Ranges(
        tension=round_up(max(float(frame.tension.max()) for frame in frames)),
        length=max(float(frame.s[-1]) for frame in frames),
        kappa=top_of_curvature(frames, pieces),
    )


def top_of_curvature(profiles: Sequence[RouteSamples | CurvatureProfile], pieces: Sequence[Arcs]) -> float:
    """Return a round curvature that few nodes and pieces exceed [1/m]; one of both may be empty.

    Pieces count up to twice the curvature of the nodes.
    """
    length = max([*(float(one.s[-1]) for one in profiles), *(arcs.total_length for arcs in pieces)])
    steps, error = max([float(arcs.kappa.max()) for arcs in pieces], default=0.0), 0.0
    common = steps
    if profiles:
        nodes = float(np.quantile(np.concatenate([one.kappa for one in profiles]), _COMMON))
        common = max(nodes, min(steps, _STEPS * nodes))
        error = float(np.median(np.concatenate([one.kappa_se for one in profiles])))
    return round_up(max(_HEADROOM * common + error, _LEAST_ANGLE / length))


def round_up(value: float) -> float:
    """Return the next round number that is not below `value`; 1 where that is not positive."""
    if value <= 0:
        return 1.0
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    steps = (10, 12, 15, 16, 18, 20, 25, 30, 35, 40, 45, 50, 60, 70, 80, 90, 100)
    return next(step * unit for step in steps if step * unit >= value * (1 - 1e-9))


def round_down(value: float) -> float:
    """Return the next of 1, 2, 5, 10, 20 and so on that is not above `value` > 0."""
    unit = 10.0 ** math.floor(math.log10(value))
    return next(step * unit for step in (5, 2, 1) if step * unit <= value * (1 + 1e-9))

"""What a picture draws of a frame: a few hundred nodes with their tension, and ranges for a whole run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Points, Vector
from tssgeom.route.pieces import Arcs
from tssgeom.route.tracking import TrackedFit
from tssgeom.stream import FrameResult
from tssgeom.tendon.state import tension

MOST_NODES = 256
"""A picture shows no more nodes of a route than this."""
_LEAST_ANGLE = 0.2
"""The curvature axis of a nearly straight route is as high as if it turned by this angle in all [rad]."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """The nodes of one route that a picture shows."""

    s: Vector
    """Arc length [m]."""
    position: Points
    """Place [m]."""
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
        """Places at arc lengths `s` [m], between nodes along the chord."""
        return np.column_stack([np.interp(s, self.s, axis) for axis in self.position.T])

    def tension_at(self, s: Vector) -> Vector:
        """Tension at arc lengths `s` [m], between nodes along a straight line [N]."""
        return np.interp(s, self.s, self.tension)


def drawn(result: FrameResult, most: int = MOST_NODES) -> Drawn:
    """Choose at most `most` nodes of a route, evenly and with both ends, and their tension."""
    route, profile = result.route, result.profile
    chosen = evenly(len(route.s), most)
    phi = profile.phi[chosen]
    return Drawn(
        s=route.s[chosen],
        position=route.position[chosen],
        tension=tension(result.state, phi, route.s[chosen]),
        phi=phi,
        kappa=profile.kappa[chosen],
        kappa_se=profile.kappa_se[chosen],
        phi_se=profile.phi_se[chosen],
    )


def tension_se(result: FrameResult, frame: Drawn) -> Vector:
    """Return the standard error of the tension that comes from that of the curve angle [N]."""
    sure, more, less = (
        tension(result.state, np.maximum(frame.phi + side * frame.phi_se, 0.0)) for side in (0.0, 1.0, -1.0)
    )
    return np.maximum(
        np.abs(more - sure), np.abs(sure - less)
    )  # the profile ends at Φ, its corners are sharp


def lean(result: FrameResult) -> FrameResult:
    """Return a result without what only the next fit needs, to be sent to another process."""
    return replace(result, tracked=TrackedFit(result.tracked.fit.strip(), result.shape.index))


def numbers_of(result: FrameResult) -> tuple[float, float, float, float]:
    """T_in [N], T_out [N], elongation [m] and accumulated curve angle [rad] of one frame."""
    seen = result.transmission
    return seen.tension_in, seen.tension_out, seen.elongation, result.arcs.total_angle


def front(result: FrameResult, frame: Drawn) -> float:
    """Arc length up to which the tendon slid when the drive last moved [m].

    Where that is all of it, the front is at the distal end.
    """
    return float(np.interp(result.transmission.slip_front, frame.phi, frame.s))


def evenly(count: int, most: int) -> NDArray[np.intp]:
    """Choose at most `most` of `count` indices, evenly, with the first and the last."""
    return np.unique(np.rint(np.linspace(0, count - 1, min(count, most))).astype(np.intp))


def outliers(result: FrameResult) -> Points:
    """Sensed places that the route does not follow: left out as stray, or given no weight by the fit [m]."""
    points, kept = result.frame.points, result.shape.points
    left_out = np.asarray(~np.isnan(points).any(axis=1))
    left_out[result.shape.index.astype(np.intp)] = False
    stray = points[left_out]
    repeated = (stray[:, None] == kept[None]).all(axis=2).any(axis=1)
    return np.concatenate([stray[~repeated], kept[result.route.weight < 0.5]])


def staircase(arcs: Arcs) -> tuple[Vector, Vector]:
    """Curvature of the pieces as a staircase: arc length [m] and curvature [1/m], two points a piece."""
    edges = np.append(arcs.s_start, arcs.total_length)
    return np.repeat(edges, 2)[1:-1], np.repeat(arcs.kappa, 2)


@dataclass(frozen=True, slots=True)
class Ranges:
    """Where the axes and colours of a run end; they are the same in every frame of it."""

    tension: float
    """[N]."""
    length: float
    """[m]."""
    kappa: float
    """[1/m]."""


def ranges(frames: Sequence[Drawn], pieces: Sequence[Arcs]) -> Ranges:
    """Ranges from 0 that hold every frame; rare peaks of the sensed curvature may leave the top."""
    length = max(float(frame.s[-1]) for frame in frames)
    return Ranges(
        tension=round_up(max(float(frame.tension.max()) for frame in frames)),
        length=length,
        kappa=round_up(max(_common_curvature(frames, pieces), _LEAST_ANGLE / length)),
    )


def _common_curvature(frames: Sequence[Drawn], pieces: Sequence[Arcs]) -> float:
    """Curvature that hardly any node exceeds, and no piece unless it is beyond twice that [1/m]."""
    nodes = float(np.quantile(np.concatenate([frame.kappa for frame in frames]), 0.995))
    steps = max(float(arcs.kappa.max()) for arcs in pieces)
    error = float(np.median(np.concatenate([frame.kappa_se for frame in frames])))
    return 1.05 * max(nodes, min(steps, 2 * nodes)) + error


def round_up(value: float) -> float:
    """Return the next number of two plain digits that is not below `value`; 1 for nothing at all."""
    if value <= 0:
        return 1.0
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    steps = (10, 12, 15, 16, 18, 20, 25, 30, 35, 40, 45, 50, 60, 70, 80, 90, 100)
    return next(step * unit for step in steps if step * unit >= value * (1 - 1e-9))


def round_down(value: float) -> float:
    """Return the next number of the kind 1, 2, 5, 10, 20 and so on that is not above `value` > 0."""
    unit = 10.0 ** math.floor(math.log10(value))
    return next(step * unit for step in (5, 2, 1) if step * unit <= value * (1 + 1e-9))

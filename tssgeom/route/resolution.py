"""Φ at a resolution, and the errors that neighbouring points share; docs/model.md (163), (164).

A shape does not distinguish a bend from an error of the same length. Only what is known of the source of the
points, and of how short a wave a sheath can follow, separates them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector, read_only, rows_at
from tssgeom.core.constants_route import STAIRCASE
from tssgeom.route.route import Route, carried
from tssgeom.route.route_fit import Deferred, Nodes, RouteFit


@dataclass(frozen=True, slots=True)
class ResolutionLimits:
    """How a curvature is freed of short waves."""

    octave: float = 2.0**0.75
    """Factor on either side of a resolution; what Φ changes between both is its error [1]. Chosen: 1.5
    octaves in all."""
    noiseless: float = 1e-6
    """Noise over the length of a route below which its points were not sensed [1]. Chosen: a tenth of what
    the best cameras reach."""
    hidden: float = 0.02
    """Share of Φ in bends shorter than a tenth of a smooth route from which they may be errors [1]. Measured:
    of 417 smooth fits of ten kinds of routes with white noise two at most have more."""
    steep: float = 8.0
    """Exponent of a filter that parts short waves from long ones [1]. Chosen: waves twice as long as the
    resolution keep 99.7 %; by the exponent 2 of (163), which leaves no ripples, 84 %."""


LIMITS = ResolutionLimits()


def angle_over_resolution(fit: RouteFit, resolution: Vector) -> Vector:
    """Return Φ [rad] at resolutions [n] [m]; (163)."""
    waves = _waves(fit)
    return np.array([waves.angle(float(at))[-1] for at in resolution])


def share_of_short_bends(fit: RouteFit, resolution: float) -> float:
    """Return the share of Φ > 0 in waves shorter than a resolution [m], without that of longer ones [1]."""
    longer = float(_waves(fit).angle(resolution, LIMITS.steep)[-1])
    return 1.0 - longer / fit.arcs.total_angle


def at_resolution(fit: RouteFit, resolution: float) -> tuple[RouteFit, float]:
    """Return a fit without waves shorter than a resolution [m], and what others change of Φ [rad]; (163)."""
    waves, arcs = _waves(fit), fit.arcs
    angle = waves.angle(resolution)
    slope = waves.angle(resolution / LIMITS.octave)[-1] - waves.angle(resolution * LIMITS.octave)[-1]
    joints = np.append(arcs.s_start, arcs.total_length)
    within = np.maximum(np.diff(np.interp(joints, waves.edge, angle)), 0.0)
    share = float(angle[-1]) / max(arcs.total_angle, 1e-12)
    smoother = replace(arcs.scaled(angle=share), angle=read_only(within))
    nodes = Deferred(partial(_nodes_at, fit.nodes, waves.edge, angle, share))
    return replace(fit, arcs=smoother, nodes=nodes, resolution=resolution), float(slope)


def without_errors(fit: RouteFit, share: float) -> RouteFit:
    """Return a fit whose angles are this share of those as fitted, as are their errors [1]; (232)."""
    nodes = Deferred(partial(_with_scaled_profile, fit.nodes, share))
    return replace(fit, arcs=fit.arcs.scaled(angle=share), nodes=nodes)


def _with_scaled_profile(nodes: Deferred[Nodes], share: float) -> Nodes:
    route, profile = nodes.value
    names = ("kappa", "phi", "kappa_se", "phi_se")
    return Nodes(route, replace(profile, **{one: read_only(share * getattr(profile, one)) for one in names}))


def _nodes_at(nodes: Deferred[Nodes], edge: Vector, angle: Vector, share: float) -> Nodes:
    route, profile = nodes.value
    kappa = np.interp(profile.s, 0.5 * (edge[1:] + edge[:-1]), np.diff(angle) / np.diff(edge))
    profile = replace(
        profile,
        kappa=read_only(kappa),
        phi=read_only(np.interp(profile.s, edge, angle)),
        kappa_se=read_only(profile.kappa_se * share),
        phi_se=read_only(profile.phi_se * share),
    )
    return Nodes(route, profile)


@dataclass(frozen=True, slots=True)
class _Waves:
    """Curvature along a route as a sum of cosines."""

    edge: Vector
    """Arc lengths between the cells [m]."""
    amplitude: np.ndarray
    """Of both components in the frame that is carried without twist [cells + 1, 2]; complex."""
    scale: float
    """Φ of the fit over that of these components [1]."""

    def angle(self, resolution: float, exponent: float = 2.0) -> Vector:
        """Return the accumulated angle at the edges at a resolution [m] [rad]."""
        share = left_of_waves(len(self.amplitude), resolution / float(self.edge[-1]), exponent)
        kept = np.fft.irfft(self.amplitude * share[:, None], axis=0)
        turn = np.linalg.norm(kept[: len(self.edge) - 1], axis=1) * np.diff(self.edge)
        return self.scale * np.concatenate(([0.0], np.cumsum(turn)))


def left_of_waves(count: int, resolution: float, exponent: float = 2.0) -> Vector:
    """Return what is left of each cosine at a resolution over the length: half of a wave as long as it."""
    return np.exp2(-((np.arange(count) * 0.5 * resolution) ** exponent))


def _waves(fit: RouteFit) -> _Waves:
    edge = np.linspace(0.0, float(fit.route.s[-1]), STAIRCASE.most_cells + 1)
    sampled = sampled_bend(fit)
    angle = float(np.linalg.norm(sampled, axis=1).sum()) * (edge[1] - edge[0])
    scale = fit.arcs.total_angle / angle if angle > 0.0 else 1.0
    mirrored = np.concatenate((sampled, sampled[::-1]))  # so that it is a sum of cosines
    return _Waves(edge, np.fft.rfft(mirrored, axis=0), scale)


def sampled_bend(fit: RouteFit) -> Matrix:
    """Return the curvature in even cells along a route, as `bend_without_twist` [n, 2] [1/m]."""
    bend, s = bend_without_twist(fit.route), fit.route.s
    middle = (np.arange(STAIRCASE.most_cells) + 0.5) * (float(s[-1]) / STAIRCASE.most_cells)
    return rows_at(middle, s, bend)


def bend_without_twist(route: Route) -> Matrix:
    """Return the curvature of a route along two axes that are carried along it without twist [n, 2] [1/m]."""
    along = (np.einsum("ij,ij->i", route.curvature_vector, axis) for axis in without_twist(route.tangent))
    return np.column_stack(list(along))


def without_twist(tangent: Points) -> tuple[Points, Points]:
    """Return two axes across unit tangents [n, 3] that are carried along them without twist."""
    first = carried(tangent, core.normals(tangent[0])[0])
    return first, np.cross(tangent, first)

"""The route of a fibre: its curvature carried along exactly, with the covariance of what follows from it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector, read_only
from tssgeom.core.constants_arcs import CHAIN_PARAMETERS
from tssgeom.core.constants_route import STAIRCASE
from tssgeom.route.arcs.chain import form_of
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.fibre.draws import Draws
from tssgeom.route.fibre.models import (
    Partition,
    Sensed,
    joint_variance,
    piece_curvature,
    piece_means,
    stretches,
)
from tssgeom.route.pieces import Arcs, spread_over
from tssgeom.route.route import Route
from tssgeom.route.route_fit import Nodes, RouteFit, available

AXES = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Tangent and the two normals, towards which κ_x and κ_y bend, where the fibre begins."""

_NODES = 160  # intervals into which a route is cut at least, for pictures


class FibreCurve(NamedTuple):
    """A fibre in space, on its nodes."""

    s: Vector
    position: Points
    axes: np.ndarray
    bend: Points
    """Curvature components at the nodes [m, 2] [1/m]."""


def integrated(s: Vector, bend: Points) -> tuple[Points, np.ndarray]:
    """Position [m, 3] and axes [m, 3 axes, 3] at nodes, with curvature components linear in between.

    A stretch h on which they run from a to b is two arcs of h/2 with curvatures (5a + b)/6 and (a + 5b)/6:
    exact on circles, otherwise of fourth order (docs/model.md (35)).
    """
    a, b = bend[:-1], bend[1:]
    halves = np.empty((2 * len(a) + 1, 2))
    halves[0:-1:2], halves[1:-1:2], halves[-1] = (5 * a + b) / 6, (a + 5 * b) / 6, bend[-1]
    at = np.empty(len(halves))
    at[::2], at[1::2] = s, 0.5 * (s[1:] + s[:-1])
    position, axes = core.along_chain(at, form_of(np.zeros(3), AXES, at, halves))
    return position[::2], axes[::2]


def fit_of_pieces(
    sensed: Sensed, partition: Partition, noise: float, stations: Vector, draws: Draws
) -> RouteFit:
    """Fit of pieces of constant curvature, whose angles add up to the mean of the draws; docs/model.md (241).

    Parameters
    ----------
    sensed, partition, noise
        The curvatures, how they are cut, and the standard deviation of a component [1/m].
    stations
        Arc length of every grating [m].
    draws
        Draws of the curvature.
    """
    kappa, spread = piece_curvature(sensed, partition, noise)
    joint, shift = joint_variance(sensed, partition, noise)
    ends = np.concatenate(([0.0], joint, [sensed.length]))
    arcs = _partition_arcs(kappa, spread, np.diff(ends), shift, draws.phi[:, -1])
    direction, _ = piece_means(sensed, partition)
    bend = direction * (arcs.kappa / np.maximum(np.linalg.norm(direction, axis=1), 1e-300))[:, None]
    s = np.unique(np.concatenate((np.linspace(0.0, sensed.length, _NODES + 1), ends)))
    piece = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, len(kappa) - 1)
    travelled = np.clip(s[:, None], ends[:-1], ends[1:]) - ends[:-1]
    profile = _profile(s, arcs.kappa[piece], travelled @ arcs.kappa, draws)
    position, axes = core.along_chain(s, form_of(np.zeros(3), AXES, s, bend[piece]))
    return _fit(FibreCurve(s, position, axes, bend[piece]), stations, profile, arcs, draws)


def _partition_arcs(kappa: Vector, spread: Vector, length: Vector, shift: Vector, phi: Vector) -> Arcs:
    """Pieces whose lengths and angles share the variance of their joints; that of the fibre has none.

    Their angles add up to the mean of the sampled Φ, unless all pieces are straight.
    """
    moved = np.diff(np.eye(len(length) + 1)[:, 1:-1], axis=0)
    gradient = np.vstack((moved, kappa[:, None] * moved))
    covariance = (gradient * shift) @ gradient.T
    k = len(length)
    covariance[k:, k:] += np.diag(length**2 * spread)
    angle, own = kappa * length, covariance[k:, k:].sum()
    if own > 0.0:
        share = covariance[k:, k:].sum(axis=1) / own
        angle = np.where(kappa > 0.0, np.maximum(angle + share * (phi.mean() - angle.sum()), 0.0), 0.0)
    if angle.sum() > 0.0:
        angle = angle * (phi.mean() / angle.sum())
    variance = float(np.mean((phi - angle.sum()) ** 2))
    if own > variance:
        covariance[k:] *= math.sqrt(variance / own)
        covariance[:, k:] *= math.sqrt(variance / own)
    rest = max(variance - own, 0.0)
    covariance[k:, k:] += spread_over(angle if angle.sum() > 0.0 else length, rest)
    return Arcs(read_only(length), read_only(angle), read_only(covariance), "arcs")


def fit_of_draws(sensed: Sensed, draws: Draws, noise: float, stations: Vector) -> RouteFit:
    """Fit of smooth curvature: means and covariances of the draws. Parameters as in `fit_of_pieces`."""
    profile = _profile(draws.s, draws.kappa.mean(axis=0), draws.phi.mean(axis=0), draws)
    of_bend = np.mean(np.einsum("dmc,dmc->dm", draws.off, draws.off), axis=0) / 2.0
    each = (len(draws.s) - 1) // (len(sensed.s) - 1)
    freedom = float(sensed.merged @ of_bend[::each]) / noise**2
    curve = FibreCurve(draws.s, *integrated(draws.s, draws.bend), draws.bend)
    joints = _staircase(curve, of_bend, freedom, len(stations))
    arcs = _wander_arcs(draws.s[joints], draws.phi[:, joints])
    return _fit(curve, stations, profile, arcs, draws)


def _staircase(curve: FibreCurve, v: Vector, freedom: float, count: int) -> np.ndarray:
    """Nodes at which pieces of constant curvature meet that stand for a smooth route; docs/model.md (27)."""
    cell = np.diff(curve.s)
    mean = 0.5 * (curve.bend[1:] + curve.bend[:-1])
    floor = (STAIRCASE.least_step * np.max(np.linalg.norm(curve.bend, axis=1))) ** 2
    weight = freedom * cell / curve.s[-1] / np.maximum(0.5 * (v[1:] + v[:-1]) + floor, 1e-300)
    penalty = CHAIN_PARAMETERS.joint * math.log(max(count, 2))
    pieces, joints = core.best_partition(mean, weight, penalty)
    return joints[: pieces + 1]


def _wander_arcs(ends: Vector, phi: Matrix) -> Arcs:
    """Pieces between joints [k+1] [m], from draws of the angle up to them [d, k+1] [rad]."""
    length, angle = np.diff(ends), np.diff(phi, axis=1)
    k = len(length)
    off = angle - angle.mean(axis=0)
    covariance = np.zeros((2 * k, 2 * k))
    covariance[k:, k:] = off.T @ off / len(off)
    return Arcs(read_only(length), read_only(angle.mean(axis=0)), read_only(covariance), "spline")


def _profile(s: Vector, kappa: Vector, phi: Vector, draws: Draws) -> CurvatureProfile:
    """Profile whose standard errors are the root mean square distances of the draws from it; (38)."""
    off = draws.phi - np.interp(draws.s, s, phi)
    kappa_off = draws.kappa - np.interp(draws.s, s, kappa)
    phi_se, kappa_se = (np.sqrt(np.mean(each**2, axis=0)) for each in (off, kappa_off))
    return CurvatureProfile(
        s=read_only(s),
        kappa=read_only(kappa),
        phi=read_only(np.maximum.accumulate(phi)),
        kappa_se=read_only(np.interp(s, draws.s, kappa_se)),
        phi_se=read_only(np.interp(s, draws.s, phi_se)),
    )


def _fit(
    curve: FibreCurve, stations: Vector, profile: CurvatureProfile, arcs: Arcs, draws: Draws
) -> RouteFit:
    """Collect the result; its `noise` is the standard deviation of one coordinate of the distal end [m]."""
    noise, weight = math.sqrt(_variance_of_end(draws)), read_only(np.ones(len(stations)))
    route = Route(
        s=read_only(curve.s),
        position=read_only(curve.position),
        tangent=read_only(curve.axes[:, 0]),
        curvature_vector=read_only(np.einsum("ia,iac->ic", curve.bend, curve.axes[:, 1:])),
        noise=noise,
        weight=weight,
        station=stations,
        residual=read_only(np.zeros((len(stations), 3))),
    )
    return RouteFit(arcs, noise, weight, available(Nodes(route, profile)), available(draws.log_evidence))


def _variance_of_end(draws: Draws) -> float:
    """Variance of one coordinate of the distal end, a third of that of all three [m²]; (35)."""
    position, axes = integrated(draws.s, draws.bend)
    moved = np.cross(axes[:, 1:], (position[-1] - position)[:, None, :]) * stretches(draws.s)[:, None, None]
    off = np.tensordot(draws.off, moved, axes=2)
    return float(np.mean(np.sum(off**2, axis=1))) / 3.0

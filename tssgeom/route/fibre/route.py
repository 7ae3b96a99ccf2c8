"""The route of a fibre: its curvature carried along exactly, with the covariance of what follows from it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector, read_only
from tssgeom.core.constants_arcs import CHAIN_MOVES
from tssgeom.core.constants_route import STAIRCASE
from tssgeom.route.arcs.chain import form_of
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.fibre.models import (
    Partition,
    Prior,
    Sensed,
    joint_variance,
    magnitude,
    piece_curvature,
    piece_means,
    posterior,
    wander_nodes,
)
from tssgeom.route.pieces import Arcs, spread_over
from tssgeom.route.route import Route, accumulated
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
    covariance: Matrix
    """Covariance of one component [m, m] [1/m²]."""


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
    sensed: Sensed, partition: Partition, noise: float, stations: Vector, variance: float, log_evidence: float
) -> RouteFit:
    """Fit of pieces of constant curvature; docs/model.md (36).

    Parameters
    ----------
    sensed, partition, noise
        The curvatures, how they are cut, and the standard deviation of a component [1/m].
    stations
        Arc length of every grating [m].
    variance
        Mean square error of Φ over all models [rad²].
    log_evidence
        Evidence of the curvatures (natural logarithm).
    """
    kappa, spread = piece_curvature(sensed, partition, noise)
    mean, _ = piece_means(sensed, partition.joints, partition.curved)
    mean *= (kappa / np.maximum(np.linalg.norm(mean, axis=1), 1e-300))[:, None]
    joint, shift = joint_variance(sensed, partition, noise)
    ends = np.concatenate(([0.0], joint, [sensed.length]))
    arcs = _partition_arcs(kappa, spread, np.diff(ends), shift, variance)
    s = np.unique(np.concatenate((np.linspace(0.0, sensed.length, _NODES + 1), ends)))
    piece = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, len(kappa) - 1)
    travelled = np.clip(s[:, None], ends[:-1], ends[1:]) - ends[:-1]
    passed = np.square(np.diff(kappa)) * shift * (s[:, None] > joint)
    of_phi = np.square(travelled) @ spread + passed.sum(axis=1)
    profile = _profile(s, kappa[piece], travelled @ kappa, np.sqrt(spread[piece]), of_phi, variance)
    position, axes = core.along_chain(s, form_of(np.zeros(3), AXES, s, mean[piece]))
    same_piece = piece[:, None] == piece
    curve = FibreCurve(s, position, axes, mean[piece], spread[piece][:, None] * same_piece)
    return _fit(curve, stations, profile, arcs, log_evidence)


def _partition_arcs(kappa: Vector, spread: Vector, length: Vector, shift: Vector, variance: float) -> Arcs:
    """Pieces whose lengths and angles share the variance of their joints; that of the fibre has none."""
    moved = np.diff(np.eye(len(length) + 1)[:, 1:-1], axis=0)
    gradient = np.vstack((moved, kappa[:, None] * moved))
    covariance = (gradient * shift) @ gradient.T
    k = len(length)
    covariance[k:, k:] += np.diag(length**2 * spread)
    angle = kappa * length
    rest = max(variance - covariance[k:, k:].sum(), 0.0)
    covariance[k:, k:] += spread_over(angle if angle.sum() > 0.0 else length, rest)
    return Arcs(read_only(length), read_only(angle), read_only(covariance), "arcs")


def fit_of_wander(
    sensed: Sensed, prior: Prior, stations: Vector, variance: float, log_evidence: float
) -> RouteFit:
    """Fit of smooth curvature; docs/model.md (37). Parameters as in `fit_of_pieces`."""
    nodes = wander_nodes(sensed, _NODES)
    smooth = posterior(sensed, prior, nodes)
    kappa, covariance = magnitude(smooth)
    phi = accumulated(nodes, kappa)
    to_phi = _integrals(nodes)
    of_phi = to_phi @ covariance @ to_phi.T
    profile = _profile(nodes, kappa, phi, np.sqrt(np.diag(smooth.covariance)), np.diag(of_phi), variance)
    here = np.searchsorted(nodes, sensed.s - 1e-8 * sensed.length)
    freedom = float(np.sum(sensed.merged * np.diag(smooth.covariance)[here])) / prior.noise**2
    position, axes = integrated(nodes, smooth.mean)
    curve = FibreCurve(nodes, position, axes, smooth.mean, smooth.covariance)
    joints = _staircase(curve, freedom, len(stations))
    arcs = _wander_arcs(nodes[joints], phi[joints], of_phi[np.ix_(joints, joints)], variance)
    return _fit(curve, stations, profile, arcs, log_evidence)


def _integrals(s: Vector) -> Matrix:
    """Weights of the trapezoid rule from the first node to each, [m, m]."""
    half = 0.5 * np.diff(s)
    step = np.zeros((len(s), len(s)))
    rows = np.arange(1, len(s))
    step[rows, rows] = half
    step[rows, rows - 1] = half
    return np.cumsum(step, axis=0)


def _staircase(curve: FibreCurve, freedom: float, count: int) -> np.ndarray:
    """Nodes at which pieces of constant curvature meet that stand for a smooth route; docs/model.md (27)."""
    cell = np.diff(curve.s)
    mean = 0.5 * (curve.bend[1:] + curve.bend[:-1])
    v = np.diag(curve.covariance)
    floor = (STAIRCASE.least_step * np.max(np.linalg.norm(curve.bend, axis=1))) ** 2
    weight = freedom * cell / curve.s[-1] / np.maximum(0.5 * (v[1:] + v[:-1]) + floor, 1e-300)
    penalty = CHAIN_MOVES.joint_parameters * math.log(max(count, 2))
    pieces, joints = core.best_partition(mean, weight, penalty)
    return joints[: pieces + 1]


def _wander_arcs(ends: Vector, phi: Vector, of_phi: Matrix, variance: float) -> Arcs:
    length, angle = np.diff(ends), np.diff(phi)
    k = len(length)
    covariance = np.zeros((2 * k, 2 * k))
    covariance[k:, k:] = np.diff(np.diff(of_phi, axis=0), axis=1)
    covariance[k:, k:] += spread_over(angle, max(variance - float(of_phi[-1, -1]), 0.0))
    return Arcs(read_only(length), read_only(angle), read_only(covariance), "spline")


def _profile(
    s: Vector, kappa: Vector, phi: Vector, kappa_se: Vector, variance: Vector, total: float
) -> CurvatureProfile:
    """Profile whose standard error of φ ends at that of the whole angle."""
    share = phi / phi[-1] if phi[-1] > 0.0 else s / s[-1]
    rest = max(total - float(variance[-1]), 0.0) * share**2
    return CurvatureProfile(
        s=read_only(s),
        kappa=read_only(kappa),
        phi=read_only(np.maximum.accumulate(phi)),
        kappa_se=read_only(kappa_se),
        phi_se=read_only(np.sqrt(np.maximum(variance, 0.0) + rest)),
    )


def _fit(
    curve: FibreCurve, stations: Vector, profile: CurvatureProfile, arcs: Arcs, log_evidence: float
) -> RouteFit:
    """Collect the result; its `noise` is the standard deviation of one coordinate of the distal end [m]."""
    noise, weight = math.sqrt(_variance_of_end(curve)), read_only(np.ones(len(stations)))
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
    return RouteFit(arcs, noise, weight, available(Nodes(route, profile)), available(log_evidence))


def _variance_of_end(curve: FibreCurve) -> float:
    """Variance of one coordinate of the distal end, a third of that of all three [m²]; (35)."""
    weight = np.gradient(curve.s)
    weight[[0, -1]] *= 0.5
    lever = curve.position[-1] - curve.position
    moved = np.cross(curve.axes[:, 1:], lever[:, None, :]) * weight[:, None, None]
    moved = moved.reshape(len(weight), -1)
    return max(float(np.sum(moved * (curve.covariance @ moved))) / 3.0, 0.0)

"""The route of a fibre: its curvature carried along exactly, with the covariance of what follows from it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector, read_only
from tssgeom.route.arcs.positions import joint_frames
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.fibre.bends import piece_curvature, wander_nodes
from tssgeom.route.fibre.partitions import Partition, Sensed, joint_spread, piece_means
from tssgeom.route.fibre.wander import Prior, magnitude, posterior
from tssgeom.route.geometry import Geometry
from tssgeom.route.outline import Outline
from tssgeom.route.pieces import Arcs, best_partition
from tssgeom.route.route import Route
from tssgeom.route.stations import accumulated

AXES = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Tangent and the two normals, towards which κ_x and κ_y bend, where the fibre begins."""

_NODES = 160
_TOLD_APART = 0.03  # of the greatest curvature: smaller steps are not worth a piece
_PER_PIECE = 3.0  # parameters that one more piece brings


class Evidence(NamedTuple):
    """What the route reports beside itself."""

    stations: Vector
    """Arc length of every grating [m]."""
    variance: float
    """Mean square error of Φ, whatever the account [rad²]."""


class Laid(NamedTuple):
    """A fibre in space, on its nodes."""

    s: Vector
    position: Points
    axes: np.ndarray
    bend: Points
    """Curvature components at the nodes [m, 2] [1/m]."""
    covariance: Matrix
    """Covariance of one component [m, m] [1/m²]."""


def carried(s: Vector, bend: Points) -> tuple[Points, np.ndarray]:
    """Place [m, 3] and axes [m, 3 axes, 3] at nodes, with curvature components linear in between.

    A stretch h on which they run from a to b is two arcs of h/2 with curvatures (5a + b)/6 and (a + 5b)/6:
    exact on circles, otherwise of fourth order (docs/model.md (35)).
    """
    a, b = bend[:-1], bend[1:]
    halves = np.empty((2 * len(a) + 1, 2))
    halves[0:-1:2], halves[1:-1:2], halves[-1] = (5 * a + b) / 6, (a + 5 * b) / 6, bend[-1]
    at = np.empty(len(halves))
    at[::2], at[1::2] = s, 0.5 * (s[1:] + s[:-1])
    place, axes = joint_frames(np.zeros(3), AXES, at, halves)
    return place[::2], axes[::2]


def of_partition(sensed: Sensed, found: Partition, noise: float, told: Evidence) -> Geometry:
    """Geometry of pieces of constant curvature; docs/model.md (36)."""
    kappa, spread = piece_curvature(sensed, found, noise)
    mean, _ = piece_means(sensed, found.joints, found.curved)
    mean *= (kappa / np.maximum(np.linalg.norm(mean, axis=1), 1e-300))[:, None]
    place, shift = joint_spread(sensed, found, noise)
    ends = np.concatenate(([0.0], place, [sensed.length]))
    length = np.diff(ends)
    arcs = _partition_arcs(kappa, spread, length, shift, told.variance)
    s = np.unique(np.concatenate((np.linspace(0.0, sensed.length, _NODES + 1), ends)))
    piece = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, len(kappa) - 1)
    travelled = np.clip(s[:, None], ends[:-1], ends[1:]) - ends[:-1]
    passed = np.square(np.diff(kappa)) * shift * (s[:, None] > place)
    variance = np.square(travelled) @ spread + passed.sum(axis=1)
    profile = _profile(s, kappa[piece], travelled @ kappa, np.sqrt(spread[piece]), variance, told.variance)
    at, axes = joint_frames(np.zeros(3), AXES, s, mean[piece])
    laid = Laid(s, at, axes, mean[piece], spread[piece][:, None] * (piece[:, None] == piece))
    return Geometry(Outline(_route(laid, told), profile), arcs)


def _partition_arcs(kappa: Vector, spread: Vector, length: Vector, shift: Vector, variance: float) -> Arcs:
    """Pieces whose lengths and angles share the doubt of their joints; the length of the fibre has none."""
    moved = np.diff(np.eye(len(length) + 1)[:, 1:-1], axis=0)
    gradient = np.vstack((moved, kappa[:, None] * moved))
    covariance = (gradient * shift) @ gradient.T
    k = len(length)
    covariance[k:, k:] += np.diag(length**2 * spread)
    angle = kappa * length
    share = angle / angle.sum() if angle.sum() > 0.0 else length / length.sum()
    rest = variance - covariance[k:, k:].sum()
    covariance[k:, k:] += max(rest, 0.0) * np.outer(share, share)
    return Arcs(read_only(length), read_only(angle), read_only(covariance), "arcs")


def of_wander(sensed: Sensed, prior: Prior, told: Evidence) -> Geometry:
    """Geometry of smooth curvature; docs/model.md (37)."""
    nodes = wander_nodes(sensed, _NODES)
    found = posterior(sensed, prior, nodes)
    kappa, covariance = magnitude(found)
    phi = accumulated(nodes, kappa)
    to_phi = _integrals(nodes)
    of_phi = to_phi @ covariance @ to_phi.T
    profile = _profile(nodes, kappa, phi, np.sqrt(np.diag(found.covariance)), np.diag(of_phi), told.variance)
    here = np.searchsorted(nodes, sensed.s - 1e-8 * sensed.length)
    freedom = float(np.sum(sensed.merged * np.diag(found.covariance)[here])) / prior.noise**2
    at, axes = carried(nodes, found.mean)
    laid = Laid(nodes, at, axes, found.mean, found.covariance)
    joints = _staircase(laid, freedom, len(told.stations))
    arcs = _wander_arcs(nodes[joints], phi[joints], of_phi[np.ix_(joints, joints)], told.variance)
    return Geometry(Outline(_route(laid, told), profile), arcs)


def _integrals(s: Vector) -> Matrix:
    """Weights of the trapezoid rule from the first node to each, [m, m]."""
    half = 0.5 * np.diff(s)
    step = np.zeros((len(s), len(s)))
    rows = np.arange(1, len(s))
    step[rows, rows] = half
    step[rows, rows - 1] = half
    return np.cumsum(step, axis=0)


def _staircase(laid: Laid, freedom: float, count: int) -> np.ndarray:
    """Nodes at which pieces of constant curvature meet that stand for a smooth route; docs/model.md (27)."""
    cell = np.diff(laid.s)
    mean = 0.5 * (laid.bend[1:] + laid.bend[:-1])
    v = np.diag(laid.covariance)
    floor = (_TOLD_APART * np.max(np.linalg.norm(laid.bend, axis=1))) ** 2
    weight = freedom * cell / laid.s[-1] / np.maximum(0.5 * (v[1:] + v[:-1]) + floor, 1e-300)
    return best_partition(mean, weight, _PER_PIECE * math.log(max(count, 2)))


def _wander_arcs(ends: Vector, phi: Vector, of_phi: Matrix, variance: float) -> Arcs:
    length, angle = np.diff(ends), np.diff(phi)
    k = len(length)
    covariance = np.zeros((2 * k, 2 * k))
    covariance[k:, k:] = np.diff(np.diff(of_phi, axis=0), axis=1)
    share = angle / max(float(angle.sum()), 1e-300)
    covariance[k:, k:] += max(variance - float(of_phi[-1, -1]), 0.0) * np.outer(share, share)
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


def _route(laid: Laid, told: Evidence) -> Route:
    """Route whose `noise` is that of one coordinate of the distal end [m]."""
    n = len(told.stations)
    return Route(
        s=read_only(laid.s),
        position=read_only(laid.position),
        tangent=read_only(laid.axes[:, 0]),
        curvature_vector=read_only(np.einsum("ia,iac->ic", laid.bend, laid.axes[:, 1:])),
        noise=math.sqrt(_spread_of_end(laid)),
        weight=read_only(np.ones(n)),
        station=told.stations,
        residual=read_only(np.zeros((n, 3))),
    )


def _spread_of_end(laid: Laid) -> float:
    """Variance of one coordinate of the distal end, a third of that of all three [m²]; (35)."""
    weight = np.gradient(laid.s)
    weight[[0, -1]] *= 0.5
    lever = laid.position[-1] - laid.position
    moved = np.cross(laid.axes[:, 1:], lever[:, None, :]) * weight[:, None, None]
    moved = moved.reshape(len(weight), -1)
    return max(float(np.sum(moved * (laid.covariance @ moved))) / 3.0, 0.0)

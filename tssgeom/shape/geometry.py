"""From a shape to everything the tendon asks of it: route, curvature profile and pieces."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.shape.arcs import Arcs, constant_curvature_pieces, normals, parallel_components
from tssgeom.shape.chainfit import (
    Chain,
    Data,
    curvature_columns,
    first_joint_column,
    noise_variance,
    parameter_covariance,
    places,
    settle,
)
from tssgeom.shape.chainmoves import better, fit_chain, slopes
from tssgeom.shape.curvature import CurvatureProfile, curvature_profile
from tssgeom.shape.points import Shape
from tssgeom.shape.route import Route
from tssgeom.shape.spline import Spline, fit
from tssgeom.shape.stations import across

Method = Literal["auto", "spline", "arcs"]

_FEWEST_FOR_CHAIN = 6
_MARGIN_OF_ONE = 15.0
_MARGIN_OF_JOINT = 18.0  # what a joint must save beyond its price: smooth routes look like staircases too
_HOPELESS = -40.0  # margin of the first chain that merging and splitting will not make up
_VALUES_A_PARAMETER = 2.5  # fewer cannot tell a staircase from a smooth route
_QUICK_MOVES = 8
_CLOSE_CALL = 12.0  # -2 ln evidence within which the loser still counts for the standard error
_CLOSE_BY_JOINT = 0.3  # by which that grows with every joint


@dataclass(frozen=True, slots=True)
class Geometry:
    """What was found out about one route."""

    route: Route
    profile: CurvatureProfile
    arcs: Arcs


def measure(shape: Shape, noise: float | None = None, method: Method = "auto") -> Geometry:
    """Fit a route to a shape and cut it into pieces.

    Parameters
    ----------
    shape
        Validated points.
    noise
        Known standard deviation of each coordinate [m]; estimated where left out.
    method
        Estimator: the spline, the chain of arcs, or the one that the points speak for; docs/model.md (34).

    Raises
    ------
    FitError
        Where the points give no finite curve.
    """
    spline = fit(shape, noise)
    smooth = _by_spline(spline)
    if method == "spline" or not _may_be_chain(shape, spline):
        return smooth
    data = _data(shape, noise, smooth.route)
    chain: Chain | None = settle(data, _first_chain(smooth.route, smooth.arcs))
    if method == "auto" and (chain := _worth_searching(data, chain, spline)) is None:
        return smooth
    chain = fit_chain(data, chain)
    arcs = _by_chain(data, chain, smooth.route)
    if method == "arcs":
        return arcs
    return _chosen(smooth, arcs, _margin(data, chain, spline) - max(slopes(data, chain), 0.0))


def _by_spline(spline: Spline) -> Geometry:
    profile = curvature_profile(spline)
    return Geometry(spline.route, profile, constant_curvature_pieces(spline, profile))


def _may_be_chain(shape: Shape, spline: Spline) -> bool:
    """Whether there are points enough, with errors of their own."""
    return len(shape.points) >= _FEWEST_FOR_CHAIN and spline.angle_doubt == 0.0


def _worth_searching(data: Data, chain: Chain, spline: Spline) -> Chain | None:
    """Return the chain after a few moves, or None where it stays far behind the spline."""
    for _ in range(_QUICK_MOVES):
        if _margin(data, chain, spline) >= _HOPELESS:
            return chain
        if (found := better(data, chain)) is None:
            break
        chain = found
    return chain if _margin(data, chain, spline) >= _HOPELESS else None


def _data(shape: Shape, noise: float | None, route: Route) -> Data:
    variance = 0.0 if noise is None else noise * noise
    spacing = float(route.s[-1]) / len(shape.points)
    return Data(shape.points, route.weight, shape.stations is None, variance, spacing)


def _first_chain(route: Route, arcs: Arcs) -> Chain:
    """Chain with the joints of the spline's pieces, and the mean curvature vector of each."""
    tangent = route.tangent[0]
    first, second = normals(tangent)
    parts = parallel_components(route.tangent, route.curvature_vector)
    at = np.searchsorted(route.s, np.append(arcs.s_start, route.s[-1]))
    bend = np.array([parts[a : max(b, a + 1)].mean(axis=0) for a, b in itertools.pairwise(at)])
    return Chain(
        start=np.array(route.position[0]),
        axes=np.array([tangent, first, second]),
        joints=np.array(arcs.s_start),
        bend=bend,
        curved=np.ones(len(bend), dtype=np.bool_),
        stations=np.array(route.station),
        matrix=np.zeros((0, 0)),
        cost=0.0,
    )


def _margin(data: Data, chain: Chain, spline: Spline) -> float:
    """-2 ln evidence by which the chain beats the spline, after the extra price of its joints; (34).

    Minus infinity where the chain has too many parameters for the points.
    """
    x, tangent, _ = places(chain, chain.stations)
    off = across(data.points - x, tangent)
    cost = float(data.weight @ np.einsum("ij,ij->i", off, off))
    values = 2 * int(np.count_nonzero(data.weight))
    if len(chain.matrix) * _VALUES_A_PARAMETER > values:
        return -math.inf
    variance = data.variance or max(cost / values, 1e-280)
    parameters = len(chain.matrix) - (0 if data.free else 1)
    deviance = values * math.log(variance) + cost / variance + parameters * math.log(values)
    return spline.deviance - deviance + _MARGIN_OF_ONE - _MARGIN_OF_JOINT * (len(chain.bend) - 1)


def _chosen(smooth: Geometry, arcs: Geometry, margin: float) -> Geometry:
    """Take the likelier; the nearer the call, the more of the difference goes into the standard error."""
    taken, other = (arcs, smooth) if margin > 0 else (smooth, arcs)
    scale = 1.0 + _CLOSE_BY_JOINT * (len(arcs.arcs.length) - 1)
    if abs(margin) > _CLOSE_CALL * scale:
        return taken
    weight = 1.0 / (1.0 + math.exp(0.5 * abs(margin) / scale))
    gap = other.profile.total_angle - taken.profile.total_angle
    extra = weight * gap * gap
    share = taken.profile.phi / max(taken.profile.total_angle, 1e-300)
    k = len(taken.arcs.length)
    part = taken.arcs.angle / max(taken.arcs.total_angle, 1e-300)
    covariance = np.array(taken.arcs.covariance)
    covariance[k:, k:] += extra * np.outer(part, part)
    return Geometry(
        taken.route,
        replace(taken.profile, phi_se=read_only(np.sqrt(taken.profile.phi_se**2 + extra * share**2))),
        replace(taken.arcs, covariance=read_only(covariance)),
    )


def _by_chain(data: Data, chain: Chain, route: Route) -> Geometry:
    """Route, profile and pieces of a fitted chain, on the nodes of the spline and its own joints."""
    begin, end = float(chain.stations[0]), float(chain.stations[-1])
    inner = np.asarray(chain.joints[1:])
    at = np.unique(np.concatenate((np.linspace(begin, end, len(route.s)), inner)))
    x, tangent, bend = places(chain, at)
    variance = noise_variance(data, chain)
    covariance = parameter_covariance(data, chain)
    foot, _, _ = places(chain, chain.stations)
    own = replace(
        route,
        s=read_only(at - begin),
        position=read_only(x),
        tangent=read_only(tangent),
        curvature_vector=read_only(bend),
        noise=math.sqrt(variance),
        station=read_only(chain.stations - begin),
        residual=read_only(data.points - foot),
    )
    ends = np.concatenate(([begin], inner, [end]))
    sigma2 = variance if data.free else 0.0
    return Geometry(
        own,
        _chain_profile(chain, at, ends, covariance, sigma2, data.free),
        _chain_pieces(chain, ends, covariance, sigma2, data.free),
    )


def _angle_gradient(chain: Chain, ends: Vector, at: Vector, free: bool) -> Matrix:
    """Differentiate φ at arc lengths `at` with respect to every parameter, [n, m]; docs/model.md (33)."""
    kappa = np.linalg.norm(chain.bend, axis=1)
    out = np.zeros((len(at), len(chain.matrix)))
    joint, column = first_joint_column(free), curvature_columns(chain, free)
    for j in range(1, len(kappa)):
        out[:, joint + j - 1] = np.where(at > ends[j], kappa[j - 1] - kappa[j], 0.0)
    for j in np.flatnonzero(chain.curved):
        travelled = np.clip(at, ends[j], ends[j + 1]) - ends[j]
        out[:, column[j] : column[j] + 2] = travelled[:, None] * chain.bend[j] / max(kappa[j], 1e-300)
    return out


def _chain_profile(
    chain: Chain, at: Vector, ends: Vector, covariance: Matrix, sigma2: float, free: bool
) -> CurvatureProfile:
    kappa = np.linalg.norm(chain.bend, axis=1)
    piece = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(kappa) - 1)
    begun = np.concatenate(([0.0], np.cumsum(kappa * np.diff(ends))))
    gradient = _angle_gradient(chain, ends, at, free)
    variance = np.einsum("ij,jk,ik->i", gradient, covariance, gradient)
    variance += np.where(at > ends[0], sigma2 * (kappa[0] ** 2 + kappa[piece] ** 2), 0.0)
    column = curvature_columns(chain, free)
    se = np.zeros(len(kappa))
    for j in np.flatnonzero(chain.curved):
        way = chain.bend[j] / max(kappa[j], 1e-300)
        block = covariance[column[j] : column[j] + 2, column[j] : column[j] + 2]
        se[j] = math.sqrt(max(float(way @ block @ way), 0.0))
    phi = begun[piece] + kappa[piece] * (at - ends[piece])
    return CurvatureProfile(
        s=read_only(at - ends[0]),
        kappa=read_only(kappa[piece]),
        phi=read_only(np.maximum.accumulate(phi)),
        kappa_se=read_only(se[piece]),
        phi_se=read_only(np.sqrt(np.maximum(variance, 0.0))),
    )


def _chain_pieces(chain: Chain, ends: Vector, covariance: Matrix, sigma2: float, free: bool) -> Arcs:
    """Pieces with the covariance of their lengths and angles; an end of unknown station adds to both."""
    kappa = np.linalg.norm(chain.bend, axis=1)
    length = np.diff(ends)
    k = len(length)
    at_ends = _angle_gradient(chain, ends, ends, free)
    joints = np.zeros_like(at_ends)
    for j in range(1, k):
        joints[j, first_joint_column(free) + j - 1] = 1.0
    # φ at a joint moves with the joint as well
    at_ends[1:-1] += joints[1:-1] * kappa[:-1, None] if k > 1 else 0.0
    gradient = np.vstack((np.diff(joints, axis=0), np.diff(at_ends, axis=0)))
    total = gradient @ covariance @ gradient.T
    for piece in (0, k - 1):
        end = np.zeros(2 * k)
        end[piece], end[k + piece] = 1.0, kappa[piece]
        total += sigma2 * np.outer(end, end)
    return Arcs(read_only(length), read_only(kappa * length), read_only(total), "arcs")

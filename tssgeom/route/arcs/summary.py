"""The route of a fitted chain of arcs: positions, curvature, angle and pieces, with their errors.

A stream needs no more than the pieces of most frames; positions and curvature on nodes cost more than those.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from functools import partial
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.core.constants import CHANCE, ROUNDING
from tssgeom.errors import FitError
from tssgeom.route.agreement import is_off, turns_unobserved
from tssgeom.route.arcs.chain import Chain, Data, along
from tssgeom.route.arcs.moves import Budget, without_piece
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.directions import counted, direction_warnings
from tssgeom.route.model_choice import chain_deviance
from tssgeom.route.observations import BACK, Shape, outlier_warnings
from tssgeom.route.pieces import Arcs
from tssgeom.route.route import Route, summed
from tssgeom.route.route_fit import Deferred, Nodes, RouteFit
from tssgeom.route.steps import at_once

_NODES = 161  # beside the joints


class ChainPieces(NamedTuple):
    """Pieces of a fitted chain, as the core returns them."""

    length: Vector
    """Length of each [k] [m]."""
    angle: Vector
    """Angle of each [k] [rad]."""
    covariance: Matrix
    """Covariance of both [2k, 2k] [m, rad]."""
    noise: float
    """Noise of a coordinate [m]."""
    unidentifiable: int
    """Piece whose bend is known least, if its points do not determine it, or -1."""

    @property
    def arcs(self) -> Arcs:
        """The pieces, with their covariance."""
        for array in self[:3]:
            array.flags.writeable = False
        return Arcs(self.length, self.angle, self.covariance, "arcs")


def chain_fit(shape: Shape, data: Data, chain: Chain, pieces: ChainPieces | None = None) -> RouteFit:
    """Fit of a chain with its pieces, where they are known already; its nodes and evidence are deferred."""
    warnings = outlier_warnings(shape, data.weight)
    if data.tangents is not None:
        used = np.where(data.tangents.variance[:, None] > 0.0, data.tangents.unit, np.nan)
        warnings += direction_warnings(shape.directions, used, shape.index)
    if pieces is None or pieces.unidentifiable >= 0:
        chain, pieces = identifiable(data, chain, pieces)
    stated = math.sqrt(data.variance)
    if 0.0 < stated < pieces.noise:
        warnings += (
            f"the points lie {1e3 * pieces.noise:.3g} mm from the route, by which its standard errors are, "
            f"and not {1e3 * stated:.3g} mm: check for outlying points, and the noise where one is stated",
        )
    if data.free:
        warnings += _order_warnings(shape, data.weight, chain.stations, pieces.noise)
    fit = RouteFit(
        arcs=pieces.arcs,
        noise=pieces.noise,
        weight=data.weight,
        nodes=Deferred(partial(chain_nodes, data, chain, pieces.noise)),
        evidence=Deferred(partial(_chain_log_evidence, data, chain)),
        warnings=warnings,
        chain=chain,
    )
    return fit.with_angle_variance(search_variance(data, chain) * fit.arcs.total_angle_se**2)


def _order_warnings(shape: Shape, weight: Vector, stations: Vector, noise: float) -> tuple[str, ...]:
    """Name the points that lie behind one before them by more than the noise of both [m]."""
    used = np.flatnonzero(weight > 0.0)
    at = stations[used]
    least = CHANCE.never * noise + ROUNDING.relative * (at[-1] - at[0])
    behind = used[np.maximum.accumulate(at) - at > least]
    if not len(behind):
        return ()
    named = counted(shape.index[behind].astype(int))
    some = "1 point runs" if len(behind) == 1 else f"{len(behind)} points run"
    return (f"{some} {BACK} {named}: check for points out of order",)


def search_variance(data: Data, chain: Chain) -> float:
    """Return what the search for joints adds to the variance of Φ, over that at given joints [1]; (168)."""
    return chain.parameters_across / max(data.values_across - chain.parameters_across, 1)


def _chain_log_evidence(data: Data, chain: Chain) -> float:
    return -0.5 * chain_deviance(data, chain)


def chain_nodes(data: Data, chain: Chain, noise: float) -> Nodes:
    """Route and profile of a fitted chain on nodes, with the noise of a coordinate [m]; model.md (33)."""
    ends = np.concatenate((chain.stations[:1], chain.joints[1:], chain.stations[-1:]))
    at = ends[0] + (ends[-1] - ends[0]) * np.arange(_NODES) / (_NODES - 1)
    at[-1] = ends[-1]
    at = np.sort(np.concatenate((at, ends[ends < ends[-1]])))
    at = at[np.append(True, at[1:] > at[:-1])]
    position, tangent, curvature_vector = along(at, chain.form)
    begin = float(ends[0])
    route = Route(
        s=read_only(at - begin),
        position=read_only(position),
        tangent=read_only(tangent),
        curvature_vector=read_only(curvature_vector),
        noise=noise,
        weight=read_only(data.weight),
        station=read_only(chain.stations - begin),
        residual=read_only(data.points - core.along_chain(chain.stations, chain.form)[0]),
    )
    return Nodes(route, _profile(data, chain, ends, at))


def chain_pieces(data: Data, chain: Chain) -> ChainPieces:
    """Return the pieces of a fitted chain; docs/model.md (33)."""
    return ChainPieces(*core.chain_pieces(*data.sensed, *chain[:5])[:5])


def identifiable(
    data: Data, chain: Chain, pieces: ChainPieces | None = None, budget: Budget | None = None
) -> tuple[Chain, ChainPieces]:
    """Drop pieces whose bend the points do not determine; returns also those that remain.

    Raises FitError where nothing is left of a budget, and of the pieces there are such still.
    """
    return at_once(identifiable_in_steps(data, chain, pieces, budget))


def identifiable_in_steps(
    data: Data, chain: Chain, pieces: ChainPieces | None = None, budget: Budget | None = None
) -> Generator[float, None, tuple[Chain, ChainPieces]]:
    """Do as `identifiable`, with a stop after each fit."""
    pieces, budget = pieces or chain_pieces(data, chain), budget or Budget()
    while pieces.unidentifiable >= 0:
        if budget.spent:
            raise FitError("the points do not determine the pieces of a chain of arcs")
        chain = yield from without_piece(data, chain, pieces.unidentifiable, budget)
        pieces = chain_pieces(data, chain)
    return chain, pieces


def chain_follows(data: Data, chain: Chain) -> bool:
    """Whether a chain follows its points, and turns between them by no more than these could show.

    Source: docs/model.md (221).
    """
    if data.variance > 0.0:
        used, spacing = int(np.count_nonzero(data.weight > 0.0)), float(chain.stations[-1]) / len(data.points)
        if is_off(float(data.weight @ chain.square), used, spacing, math.sqrt(data.variance)):
            return False
    edge = chain.edges
    turned = np.interp(chain.stations, edge, summed(np.linalg.norm(chain.bend, axis=1) * np.diff(edge)))
    return not turns_unobserved(data.points, data.weight, chain.stations, turned)


def _profile(data: Data, chain: Chain, ends: Vector, at: Vector) -> CurvatureProfile:
    """Curvature and angle at arc lengths `at` [m] along a chain, with their standard errors; (33)."""
    length, angle, of_pieces, noise, _, hidden, variances = core.chain_pieces(*data.sensed, *chain[:5])
    kappa, square = np.sqrt(np.sum(chain.bend**2, axis=1)), variances[:, 1] + hidden
    before = variances[:, 0] + summed(hidden * length**2)[:-1]
    if data.free:  # an unknown station of an end takes its angle along
        before += noise**2 * (kappa[0] ** 2 + kappa**2)
    j = np.searchsorted(ends[1:-1], at, side="right")
    t = at - ends[j]
    phi_se = np.sqrt(np.maximum(before[j] + t * (2 * variances[j, 2] + t * square[j]), 0.0))
    whole = of_pieces[len(kappa) :, len(kappa) :].sum()
    phi_se[0], phi_se[-1] = 0.0, math.sqrt(max(float(whole), 0.0))
    return CurvatureProfile(
        s=read_only(at - ends[0]),
        kappa=read_only(kappa[j]),
        phi=read_only(summed(angle)[j] + kappa[j] * t),
        kappa_se=read_only(np.sqrt(np.maximum(square, 0.0))[j]),
        phi_se=read_only(phi_se),
    )

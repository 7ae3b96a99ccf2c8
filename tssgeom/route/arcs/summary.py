"""The route of a fitted chain of arcs: positions, curvature, angle and pieces, with their errors.

A stream needs no more than the pieces of most frames; positions and curvature on nodes cost more than those.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.core.constants_arcs import CHAIN_FIT
from tssgeom.route.arcs.chain import (
    Chain,
    Data,
    along,
    curvature_columns,
    first_joint_column,
    noise_variance,
)
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.pieces import Arcs
from tssgeom.route.route import Route, summed
from tssgeom.route.route_fit import Nodes

_NODES = 161  # beside the joints


class ChainPieces(NamedTuple):
    """Pieces of a fitted chain."""

    arcs: Arcs
    noise: float
    """Noise of a coordinate [m]."""
    unidentifiable: int
    """Piece whose bend is known least, if its points do not determine it, or -1."""
    hidden: Vector
    """Mean square of the curvature that each straight piece may have [k] [1/m²]; (124)."""


def chain_nodes(data: Data, chain: Chain, pieces: ChainPieces) -> Nodes:
    """Route and profile of a fitted chain on nodes; docs/model.md (33)."""
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
        noise=pieces.noise,
        weight=read_only(data.weight),
        station=read_only(chain.stations - begin),
        residual=read_only(data.points - core.along_chain(chain.stations, chain.form)[0]),
    )
    return Nodes(route, _profile(data, chain, pieces, ends, at))


def chain_pieces(data: Data, chain: Chain) -> ChainPieces:
    """Return the pieces of a fitted chain; docs/model.md (33)."""
    return pieces_of(*core.chain_pieces(*data.sensed, *chain[:5]))


def pieces_of(
    length: Vector, angle: Vector, covariance: Matrix, noise: float, unidentifiable: int, hidden: Vector
) -> ChainPieces:
    """Pieces as the core returns them."""
    for array in (length, angle, covariance):
        array.flags.writeable = False
    return ChainPieces(Arcs(length, angle, covariance, "arcs"), noise, unidentifiable, hidden)


def _profile(data: Data, chain: Chain, pieces: ChainPieces, ends: Vector, at: Vector) -> CurvatureProfile:
    """Curvature and angle at arc lengths `at` [m] along a chain, with their standard errors; (33)."""
    k, hidden, variance = len(chain.curved), pieces.hidden, noise_variance(data, chain)
    kappa, length = np.sqrt(np.sum(chain.bend**2, axis=1)), np.diff(ends)
    own, level = _gradients(data, chain, kappa, length)
    spread = variance * core.propagated(
        chain.matrix, np.concatenate((own, level)), CHAIN_FIT.least_information
    )
    square, tilt = np.diag(spread)[:k] + hidden, np.diag(spread, -k)
    before = np.diag(spread)[k:] + summed(hidden * length**2)[:-1]
    if data.free:  # an unknown station of an end takes its angle along
        before = before + variance * (kappa[0] ** 2 + kappa**2)
    j = np.searchsorted(ends[1:-1], at, side="right")
    t = at - ends[j]
    phi_se = np.sqrt(np.maximum(before[j] + 2 * t * tilt[j] + t**2 * square[j], 0.0))
    phi_se[0], phi_se[-1] = 0.0, pieces.arcs.total_angle_se
    return CurvatureProfile(
        s=read_only(at - ends[0]),
        kappa=read_only(kappa[j]),
        phi=read_only(summed(kappa * length)[j] + kappa[j] * t),
        kappa_se=read_only(np.sqrt(np.maximum(square, 0.0))[j]),
        phi_se=read_only(phi_se),
    )


def _gradients(data: Data, chain: Chain, kappa: Vector, length: Vector) -> tuple[Matrix, Matrix]:
    """By the parameters of a chain: the curvature of each piece, and the angle where it begins [k, m]."""
    k, joint = len(kappa), first_joint_column(data.free) - 1
    own, level = np.zeros((2, k, len(chain.matrix)))
    for j, column in enumerate(curvature_columns(chain.curved, data.free)):
        if chain.curved[j] and kappa[j] > 0.0:
            own[j, column : column + 2] = chain.bend[j] / kappa[j]
    for i, j in itertools.pairwise(range(k)):
        level[j] = level[i] + length[i] * own[i]
        level[j, joint + j] = kappa[i] - kappa[j]
    return own, level

"""What a fitted chain of arcs says of the route: places, curvature, angle and pieces, with their errors."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.arrays import read_only
from tssgeom.shape.arcs import Arcs
from tssgeom.shape.chain.fit import (
    Chain,
    Data,
    curvature_columns,
    first_joint_column,
    noise_variance,
    parameter_covariance,
)
from tssgeom.shape.chain.places import along
from tssgeom.shape.curvature import CurvatureProfile
from tssgeom.shape.route import Route

_NODES = 161  # beside the joints


class Account(NamedTuple):
    """A chain written out on nodes, arc length from the first foot on, lengths in metres."""

    s: np.ndarray
    position: np.ndarray
    tangent: np.ndarray
    curvature_vector: np.ndarray
    kappa: np.ndarray
    kappa_se: np.ndarray
    phi: np.ndarray
    phi_se: np.ndarray
    length: np.ndarray
    """Of each piece."""
    angle: np.ndarray
    covariance: np.ndarray
    """Of lengths and angles [2k, 2k]."""
    station: np.ndarray
    residual: np.ndarray
    noise: float


def chain_geometry(
    weight: np.ndarray, account: Account, warnings: tuple[str, ...]
) -> tuple[Route, CurvatureProfile, Arcs]:
    """Return the route, the profile and the pieces of a chain that was written out."""
    route = Route(
        s=read_only(account.s),
        position=read_only(account.position),
        tangent=read_only(account.tangent),
        curvature_vector=read_only(account.curvature_vector),
        noise=account.noise,
        weight=read_only(weight),
        station=read_only(account.station),
        residual=read_only(account.residual),
        warnings=warnings,
    )
    profile = CurvatureProfile(
        s=route.s,
        kappa=read_only(account.kappa),
        phi=read_only(account.phi),
        kappa_se=read_only(account.kappa_se),
        phi_se=read_only(account.phi_se),
    )
    covariance = read_only(account.covariance)
    return route, profile, Arcs(read_only(account.length), read_only(account.angle), covariance, "arcs")


@njit(cache=True, nogil=True)
def written_out(data: Data, chain: Chain) -> Account:
    """Write a chain out on its nodes and joints, with all standard errors; docs/model.md (33)."""
    k, m = len(chain.bend), len(chain.matrix)
    begin, end = chain.stations[0], chain.stations[-1]
    ends = np.empty(k + 1)
    ends[0], ends[1:k], ends[k] = begin, chain.joints[1:], end
    at = _nodes(ends)
    position, tangent, curvature = along(at, chain.start, chain.axes, chain.joints, chain.bend)
    foot, _, _ = along(chain.stations, chain.start, chain.axes, chain.joints, chain.bend)
    covariance = parameter_covariance(data, chain)
    variance = noise_variance(data, chain)
    at_ends = variance if data.free else 0.0  # an unknown station of an end takes its angle along
    kappa, way = np.empty(k), np.zeros((k, 2))
    for j in range(k):
        kappa[j] = math.sqrt(chain.bend[j, 0] ** 2 + chain.bend[j, 1] ** 2)
        if kappa[j] > 0.0:
            way[j] = chain.bend[j] / kappa[j]
    column, joint = curvature_columns(chain.curved, data.free), first_joint_column(data.free) - 1
    node_kappa, node_se = np.empty(len(at)), np.empty(len(at))
    phi, phi_se = np.empty(len(at)), np.empty(len(at))
    gradient, own = np.zeros(m), np.zeros(m)  # of φ where a piece begins, and along it
    piece_gradient = np.zeros((2 * k, m))
    turned, i = 0.0, 0
    for j in range(k):
        own[:] = 0.0
        if column[j] >= 0:
            own[column[j]], own[column[j] + 1] = way[j, 0], way[j, 1]
        if j > 0:
            gradient[joint + j] = kappa[j - 1] - kappa[j]
            piece_gradient[j, joint + j], piece_gradient[k + j, joint + j] = -1.0, -kappa[j]
        if j + 1 < k:
            piece_gradient[j, joint + j + 1], piece_gradient[k + j, joint + j + 1] = 1.0, kappa[j]
        length = ends[j + 1] - ends[j]
        piece_gradient[k + j] += length * own
        carried, bent = covariance @ gradient, covariance @ own
        level, tilt, square = gradient @ carried, gradient @ bent, own @ bent
        while i < len(at) and (j == k - 1 or at[i] < ends[j + 1]):
            t = at[i] - ends[j]
            node_kappa[i], node_se[i] = kappa[j], math.sqrt(max(square, 0.0))
            phi[i] = turned + kappa[j] * t
            spread = level + 2 * t * tilt + t * t * square + at_ends * (kappa[0] ** 2 + kappa[j] ** 2)
            phi_se[i] = math.sqrt(max(spread, 0.0)) if i > 0 else 0.0
            i += 1
        gradient += length * own
        turned += kappa[j] * length
    spread = piece_gradient @ covariance @ piece_gradient.T
    for j in (0, k - 1):
        spread[j, j] += at_ends
        spread[j, k + j] += at_ends * kappa[j]
        spread[k + j, j] += at_ends * kappa[j]
        spread[k + j, k + j] += at_ends * kappa[j] ** 2
    length = np.diff(ends)
    return Account(
        at - begin,
        position,
        tangent,
        curvature,
        node_kappa,
        node_se,
        phi,
        phi_se,
        length,
        kappa * length,
        spread,
        chain.stations - begin,
        data.points - foot,
        math.sqrt(variance),
    )


@njit(cache=True, nogil=True)
def _nodes(ends: np.ndarray) -> np.ndarray:
    """Even arc lengths from end to end, and the joints in between."""
    at = np.empty(_NODES + len(ends) - 2)
    span, j, n = ends[-1] - ends[0], 1, 0
    for i in range(_NODES):
        here = ends[0] + span * i / (_NODES - 1) if i < _NODES - 1 else ends[-1]
        while j < len(ends) - 1 and ends[j] <= here:
            if ends[j] < here:
                at[n] = ends[j]
                n += 1
            j += 1
        at[n] = here
        n += 1
    return at[:n].copy()

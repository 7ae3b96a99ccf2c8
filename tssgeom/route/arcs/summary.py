"""The route of a fitted chain of arcs: positions, curvature, angle and pieces, with their errors.

A stream needs no more than the pieces of most frames; positions and curvature on nodes cost more than those.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tssgeom.arrays import TRUE, read_only
from tssgeom.route.arcs.chain import (
    Chain,
    Data,
    curvature_columns,
    first_joint_column,
    noise_variance,
    value_count,
)
from tssgeom.route.arcs.dense import LEAST_INFORMATION, factor, inverse, propagated, schur_complement
from tssgeom.route.arcs.equations import position_by_curvature, twists
from tssgeom.route.arcs.fit import equations_with_pieces, parameter_covariance
from tssgeom.route.arcs.positions import along, joint_frames
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.pieces import Arcs
from tssgeom.route.route import Route
from tssgeom.route.route_fit import Nodes
from tssgeom.statistics import information_price

_NODES = 161  # beside the joints


def chain_nodes(data: Data, chain: Chain, noise: float) -> Nodes:
    """Route and profile of a fitted chain on nodes, with the noise of a coordinate [m]."""
    points = read_only(data.points)  # as sensed, also after a pickle
    along_nodes, on_points = _written_out(data._replace(points=points), chain)
    for block in (along_nodes, on_points):
        block.flags.writeable = False
    vectors = along_nodes[9:]
    s = vectors[0]
    positions = along_nodes[:9].reshape(3, len(s), 3)
    route = Route(
        s=s,
        position=positions[0],
        tangent=positions[1],
        curvature_vector=positions[2],
        noise=noise,
        weight=read_only(data.weight),
        station=on_points[0],
        residual=on_points[1:].reshape(-1, 3),
    )
    profile = CurvatureProfile(s=s, kappa=vectors[1], phi=vectors[3], kappa_se=vectors[2], phi_se=vectors[4])
    return Nodes(route, profile)


def chain_pieces(data: Data, chain: Chain) -> tuple[Arcs, float]:
    """Return the pieces of a fitted chain and the noise of a coordinate [m]; docs/model.md (33)."""
    sizes, covariance, noise, _ = _pieces(data, chain)
    sizes.flags.writeable = covariance.flags.writeable = False
    k = len(chain.bend)
    return Arcs(sizes[:k], sizes[k:], covariance, "arcs"), noise


@njit(cache=True, nogil=True)
def _pieces(data: Data, chain: Chain) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """Lengths and angles [2k] of the pieces, their covariance [2k, 2k], noise [m], and hidden bends [k]."""
    k, m = len(chain.bend), len(chain.matrix)
    variance = noise_variance(data, chain)
    column, joint = curvature_columns(chain.curved, data.free), first_joint_column(data.free) - 1
    sizes, gradient = np.empty(2 * k), np.zeros((2 * k, m))
    for j in range(k):
        k0, k1 = chain.bend[j, 0], chain.bend[j, 1]
        kappa = math.sqrt(k0 * k0 + k1 * k1)
        begin = chain.joints[j] if j > 0 else chain.stations[0]
        length = (chain.joints[j + 1] if j + 1 < k else chain.stations[-1]) - begin
        sizes[j], sizes[k + j] = length, kappa * length
        if column[j] >= 0 and kappa > 0.0:
            gradient[k + j, column[j]] = length * k0 / kappa
            gradient[k + j, column[j] + 1] = length * k1 / kappa
        if j > 0:
            gradient[j, joint + j], gradient[k + j, joint + j] = -1.0, -kappa
        if j + 1 < k:
            gradient[j, joint + j + 1], gradient[k + j, joint + j + 1] = 1.0, kappa
        if j == k - 1 and data.free:
            slide = slide_of_end(chain)
            for a in range(m):
                gradient[j, a] += slide[a]
                gradient[k + j, a] += kappa * slide[a]
    lower, unit = factor(chain.matrix, LEAST_INFORMATION)
    covariance = propagated(lower, unit, gradient)
    for a in range(2 * k):
        for b in range(2 * k):
            covariance[a, b] *= variance
    hidden = _hidden_bends(data, chain)
    for j in range(k):
        covariance[k + j, k + j] += hidden[j] * sizes[j] ** 2
    if data.free:  # an unknown station of an end takes its angle along
        for j in (0, k - 1):
            kappa = math.sqrt(chain.bend[j, 0] ** 2 + chain.bend[j, 1] ** 2)
            covariance[j, j] += variance
            covariance[j, k + j] += variance * kappa
            covariance[k + j, j] += variance * kappa
            covariance[k + j, k + j] += variance * kappa * kappa
    return sizes, covariance, math.sqrt(variance), hidden


@njit(cache=True, nogil=True)
def _hidden_bends(data: Data, chain: Chain) -> np.ndarray:
    """Mean square of the curvature that each straight piece may have [k] [1/m²], 0 for a curved one; (124).

    A piece is straight where the criterion prefers it without curvature. It may be curved all the same, with
    the odds that the criterion gives, and then as in the best fit.
    """
    k, hidden = len(chain.bend), np.zeros(len(chain.bend))
    if np.all(chain.curved):
        return hidden
    matrix, gradient = equations_with_pieces(data, chain, chain.joints, chain.bend, np.ones(k, np.bool_))
    first = first_joint_column(data.free) + k - 1
    fitted = np.ones(len(matrix), np.bool_)
    for j in range(k):
        fitted[first + 2 * j] = fitted[first + 2 * j + 1] = chain.curved[j]
    lower, unit = factor(chain.matrix, LEAST_INFORMATION)
    variance, price = noise_variance(data, chain), information_price(2.0, value_count(data))
    for j in range(k):
        if chain.curved[j]:
            continue
        own = slice(first + 2 * j, first + 2 * j + 2)
        cross = matrix[fitted][:, own]
        left, rest = schur_complement(lower, unit, gradient[fitted], cross, matrix[own, own], gradient[own])
        spread = inverse(*factor(left, LEAST_INFORMATION))
        bend = spread @ rest
        odds = math.exp(min(0.5 * (bend @ rest / variance - price), 700.0))
        share = odds / (1.0 + odds) if k > 1 else 1.0
        hidden[j] = share * (bend @ bend + variance * np.trace(spread))
    return hidden


@njit(cache=True, nogil=True)
def _written_out(data: Data, chain: Chain) -> tuple[np.ndarray, np.ndarray]:
    """Write a chain out on its nodes and joints, with all standard errors; docs/model.md (33).

    Returns
    -------
    along_nodes
        Three blocks [n, 3] in 9 rows: positions, tangents, curvature vectors; then a row each of arc length,
        curvature and its standard error, angle and its standard error [14, n].
    on_points
        A row of stations, then the block [points, 3] of residuals in 3 rows [4, points].
    """
    k, m = len(chain.bend), len(chain.matrix)
    begin, end = chain.stations[0], chain.stations[-1]
    ends = np.empty(k + 1)
    ends[0], ends[k] = begin, end
    for j in range(1, k):
        ends[j] = chain.joints[j]
    at = _nodes(ends)
    n = len(at)
    out = np.empty((14, n))
    blocks = out[:9].reshape((3, n, 3))
    blocks[0], blocks[1], blocks[2] = along(at, chain.start, chain.axes, chain.joints, chain.bend)
    covariance = parameter_covariance(data, chain)
    at_ends = noise_variance(data, chain) if data.free else 0.0
    kappa, direction = np.empty(k), np.zeros((k, 2))
    for j in range(k):
        kappa[j] = math.sqrt(chain.bend[j, 0] ** 2 + chain.bend[j, 1] ** 2)
        if kappa[j] > 0.0:
            direction[j, 0], direction[j, 1] = chain.bend[j, 0] / kappa[j], chain.bend[j, 1] / kappa[j]
    column, joint = curvature_columns(chain.curved, data.free), first_joint_column(data.free) - 1
    gradient, own = np.zeros(m), np.zeros(m)  # of φ where a piece begins, and along it
    _, of_pieces, _, hidden = _pieces(data, chain)
    turned, before, i = 0.0, 0.0, 0
    for j in range(k):
        own[:] = 0.0
        if column[j] >= 0:
            own[column[j]], own[column[j] + 1] = direction[j, 0], direction[j, 1]
        if j > 0:
            gradient[joint + j] = kappa[j - 1] - kappa[j]
        length = ends[j + 1] - ends[j]
        level, tilt, square = 0.0, 0.0, 0.0
        for a in range(m):
            for b in range(m):
                level += gradient[a] * covariance[a, b] * gradient[b]
                tilt += gradient[a] * covariance[a, b] * own[b]
                square += own[a] * covariance[a, b] * own[b]
        while i < n and (j == k - 1 or at[i] < ends[j + 1]):
            t = at[i] - ends[j]
            spread = level + 2 * t * tilt + t * t * (square + hidden[j]) + before
            spread += at_ends * (kappa[0] ** 2 + kappa[j] ** 2)
            out[9, i] = at[i] - begin
            out[10, i], out[11, i] = kappa[j], math.sqrt(max(square + hidden[j], 0.0))
            out[12, i] = turned + kappa[j] * t
            out[13, i] = math.sqrt(max(spread, 0.0)) if i > 0 else 0.0
            i += 1
        for a in range(m):
            gradient[a] += length * own[a]
        turned += kappa[j] * length
        before += hidden[j] * length * length
    out[13, n - 1] = math.sqrt(max(np.sum(of_pieces[k:, k:]), 0.0))
    return out, _on_points(data, chain)


@njit(cache=True, nogil=True)
def slide_of_end(chain: Chain) -> np.ndarray:
    """How the foot of the last point moves along the chain with each parameter [m]; docs/model.md (31).

    A parameter that carries the end forwards leaves the point behind it.
    """
    k = len(chain.bend)
    start, frame = joint_frames(chain.start, chain.axes, chain.joints, chain.bend)
    positions, tangents, _ = along(chain.stations[-1:], chain.start, chain.axes, chain.joints, chain.bend)
    position, tangent = positions[0], tangents[0]
    twist, first, own = twists(chain, start, frame, TRUE)
    by = np.empty((2, 3))
    length = chain.stations[-1] - chain.joints[k - 1]
    position_by_curvature(chain.bend[k - 1, 0], chain.bend[k - 1, 1], length, by)
    slide, side = np.zeros(len(own)), 1
    for a in range(len(own)):
        side = 1 - side if own[a] >= 0 else side
        for c in range(3):
            d, e = (c + 1) % 3, (c + 2) % 3
            if own[a] == k - 1:
                moved = by[side, 0] * frame[k - 1, 0, c]
                moved += by[side, 1] * frame[k - 1, 1, c] + by[side, 2] * frame[k - 1, 2, c]
            elif first[a] < k:
                moved = twist[a, c] + twist[a, 3 + d] * position[e] - twist[a, 3 + e] * position[d]
            else:
                moved = 0.0
            slide[a] -= tangent[c] * moved
    return slide


@njit(cache=True, nogil=True)
def _on_points(data: Data, chain: Chain) -> np.ndarray:
    """Stations of the points, and their residuals as a block of three rows [4, points]."""
    n = len(data.points)
    foot, _, _ = along(chain.stations, chain.start, chain.axes, chain.joints, chain.bend)
    out = np.empty((4, n))
    residual = out[1:].reshape((n, 3))
    for i in range(n):
        out[0, i] = chain.stations[i] - chain.stations[0]
        for c in range(3):
            residual[i, c] = data.points[i, c] - foot[i, c]
    return out


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

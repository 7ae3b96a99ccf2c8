"""What a fitted chain of arcs says of the route: places, curvature, angle and pieces, with their errors."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tssgeom.arrays import read_only
from tssgeom.shape.arcs import Arcs
from tssgeom.shape.chain.equations import place_by_kappa, twists
from tssgeom.shape.chain.fit import (
    Chain,
    Data,
    curvature_columns,
    first_joint_column,
    noise_variance,
    parameter_covariance,
)
from tssgeom.shape.chain.places import along, joint_frames
from tssgeom.shape.curvature import CurvatureProfile
from tssgeom.shape.route import Route

_NODES = 161  # beside the joints


def chain_geometry(
    data: Data, chain: Chain, warnings: tuple[str, ...]
) -> tuple[Route, CurvatureProfile, Arcs]:
    """Return the route, the profile and the pieces of a fitted chain."""
    along_nodes, on_points, of_pieces, noise = _written_out(data, chain)
    for block in (along_nodes, on_points, of_pieces):
        block.flags.writeable = False
    vectors, k = along_nodes[9:], len(chain.bend)
    s = vectors[0]
    n = len(s)
    places = along_nodes[:9].reshape(-1)  # three [n, 3] blocks, one after the other
    route = Route(
        s=s,
        position=places[: 3 * n].reshape(n, 3),
        tangent=places[3 * n : 6 * n].reshape(n, 3),
        curvature_vector=places[6 * n :].reshape(n, 3),
        noise=noise,
        weight=read_only(data.weight),
        station=on_points[0],
        residual=on_points[1:].reshape(-1).reshape(-1, 3),
        warnings=warnings,
    )
    profile = CurvatureProfile(s=s, kappa=vectors[1], phi=vectors[3], kappa_se=vectors[2], phi_se=vectors[4])
    return route, profile, Arcs(of_pieces[0, :k], of_pieces[0, k:], of_pieces[1:], "arcs")


@njit(cache=True, nogil=True)
def _written_out(data: Data, chain: Chain) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Write a chain out on its nodes and joints, with all standard errors; docs/model.md (33).

    Returns
    -------
    along_nodes
        Three blocks [n, 3] in 9 rows: places, tangents, curvature vectors; then a row each of arc length,
        curvature and its standard error, angle and its standard error [14, n].
    on_points
        A row of stations, then the block [points, 3] of residuals in 3 rows [4, points].
    of_pieces
        A row of lengths and angles, then the covariance of both [1 + 2k, 2k].
    noise
        Standard deviation of a coordinate [m].
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
    position, tangent, curvature = along(at, chain.start, chain.axes, chain.joints, chain.bend)
    for i in range(n):
        for c in range(3):
            blocks[0, i, c], blocks[1, i, c] = position[i, c], tangent[i, c]
            blocks[2, i, c] = curvature[i, c]
    covariance = parameter_covariance(data, chain)
    variance = noise_variance(data, chain)
    at_ends = variance if data.free else 0.0  # an unknown station of an end takes its angle along
    kappa, way = np.empty(k), np.zeros((k, 2))
    for j in range(k):
        kappa[j] = math.sqrt(chain.bend[j, 0] ** 2 + chain.bend[j, 1] ** 2)
        if kappa[j] > 0.0:
            way[j, 0], way[j, 1] = chain.bend[j, 0] / kappa[j], chain.bend[j, 1] / kappa[j]
    column, joint = curvature_columns(chain.curved, data.free), first_joint_column(data.free) - 1
    gradient, own = np.zeros(m), np.zeros(m)  # of φ where a piece begins, and along it
    piece_gradient = np.zeros((2 * k, m))
    pieces = np.zeros((1 + 2 * k, 2 * k))
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
        level, tilt, square = 0.0, 0.0, 0.0
        for a in range(m):
            piece_gradient[k + j, a] += length * own[a]
            for b in range(m):
                level += gradient[a] * covariance[a, b] * gradient[b]
                tilt += gradient[a] * covariance[a, b] * own[b]
                square += own[a] * covariance[a, b] * own[b]
        while i < n and (j == k - 1 or at[i] < ends[j + 1]):
            t = at[i] - ends[j]
            spread = level + 2 * t * tilt + t * t * square + at_ends * (kappa[0] ** 2 + kappa[j] ** 2)
            out[9, i] = at[i] - begin
            out[10, i], out[11, i] = kappa[j], math.sqrt(max(square, 0.0))
            out[12, i] = turned + kappa[j] * t
            out[13, i] = math.sqrt(max(spread, 0.0)) if i > 0 else 0.0
            i += 1
        for a in range(m):
            gradient[a] += length * own[a]
        turned += kappa[j] * length
        pieces[0, j], pieces[0, k + j] = length, kappa[j] * length
    if data.free:
        slide = _slide_of_end(chain, position[n - 1], tangent[n - 1])
        for a in range(m):
            piece_gradient[k - 1, a] += slide[a]
            piece_gradient[2 * k - 1, a] += kappa[k - 1] * slide[a]
    _congruence(piece_gradient, covariance, pieces[1:])
    for j in (0, k - 1):
        pieces[1 + j, j] += at_ends
        pieces[1 + j, k + j] += at_ends * kappa[j]
        pieces[1 + k + j, j] += at_ends * kappa[j]
        pieces[1 + k + j, k + j] += at_ends * kappa[j] ** 2
    whole = 0.0
    for a in range(k):
        for b in range(k):
            whole += pieces[1 + k + a, k + b]
    out[13, n - 1] = math.sqrt(max(whole, 0.0))
    return out, _on_points(data, chain), pieces, math.sqrt(variance)


@njit(cache=True, nogil=True)
def _slide_of_end(chain: Chain, place: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """How the foot of the last point moves along the chain with each parameter [m]; docs/model.md (31).

    A parameter that carries the end forwards leaves the point behind it.
    """
    k = len(chain.bend)
    start, frame = joint_frames(chain.start, chain.axes, chain.joints, chain.bend)
    twist, first, own = twists(start, frame, chain.joints, chain.bend, chain.curved, True)
    by = np.empty((2, 3))
    length = chain.stations[-1] - chain.joints[k - 1]
    place_by_kappa(chain.bend[k - 1, 0], chain.bend[k - 1, 1], length, by)
    slide, side = np.zeros(len(own)), 1
    for a in range(len(own)):
        side = 1 - side if own[a] >= 0 else side
        for c in range(3):
            d, e = (c + 1) % 3, (c + 2) % 3
            if own[a] == k - 1:
                moved = by[side, 0] * frame[k - 1, 0, c]
                moved += by[side, 1] * frame[k - 1, 1, c] + by[side, 2] * frame[k - 1, 2, c]
            elif first[a] < k:
                moved = twist[a, c] + twist[a, 3 + d] * place[e] - twist[a, 3 + e] * place[d]
            else:
                moved = 0.0
            slide[a] -= tangent[c] * moved
    return slide


@njit(cache=True, nogil=True)
def _congruence(g: np.ndarray, covariance: np.ndarray, out: np.ndarray) -> None:
    """Write g C g' [r, r] for g [r, m]."""
    r, m = g.shape
    half = np.empty(m)
    for a in range(r):
        for b in range(m):
            total = 0.0
            for c in range(m):
                total += g[a, c] * covariance[c, b]
            half[b] = total
        for b in range(r):
            total = 0.0
            for c in range(m):
                total += half[c] * g[b, c]
            out[a, b] = total


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

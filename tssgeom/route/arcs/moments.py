"""Moments of the points on a chain of arcs: all that its normal equations need of each piece.

In the plane of its bending an arc of curvature κ is at x = (x₀, κg) with tangent (1 - κ²g, κx₀), where
x₀ = sin κh/κ and g = (1 - cos κh)/κ² are regular for a straight piece too. Every row of the fit is a sum of
few such functions of arc length, so a piece's moments follow from sums of their products over its points;
docs/model.md (32).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.route.arcs.chain import Chain, Data
from tssgeom.route.arcs.positions import arc_functions, piece_of

_SHORT_TURN = 1e-2  # squared turn up to which the series hold to rounding [rad²]


class FootSearch(NamedTuple):
    """How an unknown station moves to the foot of its point in one evaluation of a fit."""

    steps: int = 2
    """Most Newton steps [1]; chosen: the fit itself goes on from there."""
    near: float = 0.15
    """Step after which there is no other [of the longest step]; chosen."""
    least_slope: float = 0.3
    """Least derivative of the distance along the chain [1]: points beyond the centre of an arc have none;
    chosen."""


FOOT = FootSearch()


@njit(cache=True, nogil=True)
def _bending_planes(frame: np.ndarray, bend: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Curvature [k] of each piece, its direction [k, 2] on both normals, and axes [k, 3, 3] along it.

    The axes are the tangent where the piece begins, the normal that it bends to, and the one across.
    """
    k = len(bend)
    kappa, towards, flat = np.empty(k), np.empty((k, 2)), np.empty((k, 3, 3))
    for j in range(k):
        kappa[j] = math.sqrt(bend[j, 0] ** 2 + bend[j, 1] ** 2)
        towards[j, 0], towards[j, 1] = 1.0, 0.0
        if kappa[j] > 0.0:
            towards[j, 0], towards[j, 1] = bend[j, 0] / kappa[j], bend[j, 1] / kappa[j]
        for c in range(3):
            e0, e1 = frame[j, 1, c], frame[j, 2, c]
            flat[j, 0, c] = frame[j, 0, c]
            flat[j, 1, c] = towards[j, 0] * e0 + towards[j, 1] * e1
            flat[j, 2, c] = towards[j, 0] * e1 - towards[j, 1] * e0
    return kappa, towards, flat


@njit(cache=True, nogil=True, fastmath={"contract"})
def _advanced(square: float, x: float, g: float, move: float) -> tuple[float, float]:
    """x₀ and g farther on by `move` along an arc of squared curvature `square`."""
    q = square * move * move
    if q < _SHORT_TURN:
        a = 1.0 + q * (-1 / 6 + q * (1 / 120 + q * (-1 / 5040 + q * (1 / 362880))))
        b = 0.5 + q * (-1 / 24 + q * (1 / 720 + q * (-1 / 40320 + q * (1 / 3628800))))
    else:
        a, b, _, _, _ = arc_functions(q)
    forward, aside = a * move, b * move * move
    tangent = 1.0 - square * g
    return x + tangent * forward - square * x * aside, g + x * forward + tangent * aside


@njit(cache=True, nogil=True, fastmath={"contract"})
def moments_across(
    data: Data, chain: Chain, position: np.ndarray, frame: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Moments where stations are unknown: only distances across the chain count.

    Parameters
    ----------
    data, chain
        The points, and a chain; its stations are moved, in place, to the feet of the points, by at most
        `reach` at a time and a second time where the first took them far.
    position, frame
        Position [k, 3] and axes [k, 3, 3] where each piece begins.
    reach
        0 leaves the stations where they are [m].

    Returns
    -------
    moments
        Of the rows (n, x × n, n·dx/dK, residual) of each piece's points, in the world's axes [k, 9, 9].
    square
        Squared distance of each point across the chain [n] [m²].
    cost
        Weighted sum of these [m²].
    """
    p, weight, s, joints, bend = data.points, data.weight, chain.stations, chain.joints, chain.bend
    kappa, towards, flat = _bending_planes(frame, bend)
    sums, square = np.zeros((len(bend), 12)), np.empty(len(s))  # of products with 1, x₀ and g
    cost, near = 0.0, FOOT.near * reach
    # each point goes on from where the last one was before it moved, so that both may be worked on at once
    base, base_at, base_x, base_g = 0, joints[0], 0.0, 0.0
    for i in range(len(s)):
        steps = FOOT.steps if reach > 0.0 else 0
        j = piece_of(joints, s[i], base)
        if j != base:
            base, base_at, base_x, base_g = j, joints[j], 0.0, 0.0
        base_x, base_g = _advanced(kappa[j] * kappa[j], base_x, base_g, s[i] - base_at)
        base_at = s[i]
        x, g = base_x, base_g
        while True:
            k = kappa[j]
            o0, o1, r2 = -x, -k * g, 0.0
            for c in range(3):
                d = p[i, c] - position[j, c]
                o0 += d * flat[j, 0, c]
                o1 += d * flat[j, 1, c]
                r2 += d * flat[j, 2, c]
            t0, t1 = 1.0 - k * k * g, k * x
            r1 = t0 * o1 - t1 * o0
            if steps == 0:
                break
            move = min(max((t0 * o0 + t1 * o1) / max(1.0 - k * r1, FOOT.least_slope), -reach), reach)
            steps = steps - 1 if abs(move) >= near else 0
            s[i] += move
            before, j = j, piece_of(joints, s[i], j)
            if j == before:
                x, g = _advanced(k * k, x, g, move)
            else:
                x, g = _advanced(kappa[j] * kappa[j], 0.0, 0.0, s[i] - joints[j])
        square[i] = r1 * r1 + r2 * r2
        w = weight[i]
        if w > 0.0:
            cost += w * square[i]
            wx, wg, of = w * x, w * g, sums[j]
            of[0] += w
            of[1] += wx
            of[2] += wg
            of[3] += wx * x
            of[4] += wx * g
            of[5] += wg * g
            of[6] += w * r1
            of[7] += wx * r1
            of[8] += wg * r1
            of[9] += w * r2
            of[10] += wx * r2
            of[11] += wg * r2
    return _of_sums_across(sums, position, kappa, towards, flat), square, cost


@njit(cache=True, nogil=True)
def moments_known(
    data: Data, chain: Chain, position: np.ndarray, frame: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Moments where stations are known: every coordinate counts; otherwise as `moments_across`."""
    p, weight, s, joints, bend = data.points, data.weight, chain.stations, chain.joints, chain.bend
    kappa, towards, flat = _bending_planes(frame, bend)
    products, off = np.zeros((len(bend), 6, 6)), np.zeros((len(bend), 3, 6))
    square, value, o = np.empty(len(s)), np.empty(6), np.empty(3)
    cost, j = 0.0, 0
    for i in range(len(s)):
        j = piece_of(joints, s[i], j)
        k, h = kappa[j], s[i] - joints[j]
        a, b, _, da, db = arc_functions(k * k * h * h)
        x, g = h * a, h * h * b
        value[0], value[1], value[2], value[3] = 1.0, x, k * g, g
        value[4], value[5] = 2 * h * h * h * da * k, g + 2 * (h * h * k) ** 2 * db  # of dx/dκ
        o[0], o[1], o[2] = -x, -k * g, 0.0
        for c in range(3):
            d = p[i, c] - position[j, c]
            for e in range(3):
                o[e] += d * flat[j, e, c]
        square[i] = o[0] ** 2 + o[1] ** 2 + o[2] ** 2
        w = weight[i]
        if w > 0.0:
            cost += w * square[i]
            for a_of in range(6):
                wa = w * value[a_of]
                for b_of in range(a_of, 6):
                    products[j, a_of, b_of] += wa * value[b_of]
                for e in range(3):
                    off[j, e, a_of] += wa * o[e]
    return _of_sums_known(products, off, position, towards, flat), square, cost


@njit(cache=True, nogil=True)
def _of_sums_known(
    products: np.ndarray, off: np.ndarray, position: np.ndarray, towards: np.ndarray, flat: np.ndarray
) -> np.ndarray:
    """Moments [k, 9, 9] from the sums of products of 1, x₀, κg, g and both parts of dx/dκ, and residuals."""
    k = len(towards)
    moments = np.zeros((k, 9, 9))
    row = np.zeros((3, 8, 6))  # of the three axes of the plane of bending
    for j in range(k):
        for c in range(3):
            d, e = (c + 1) % 3, (c + 2) % 3
            for a in range(3):
                row[a, c, 0] = flat[j, a, c]
                row[a, 3 + c, 0] = position[j, d] * flat[j, a, e] - position[j, e] * flat[j, a, d]
            t, u, v = flat[j, 0, c], flat[j, 1, c], flat[j, 2, c]
            row[0, 3 + c, 2] = -v
            row[1, 3 + c, 1] = v
            row[2, 3 + c, 1], row[2, 3 + c, 2] = -u, t
        for c in range(2):
            row[0, 6 + c, 4] = row[1, 6 + c, 5] = towards[j, c]
        row[2, 6, 3], row[2, 7, 3] = -towards[j, 1], towards[j, 0]
        for a in range(6):
            for b in range(a):
                products[j, a, b] = products[j, b, a]
        for a in range(3):
            _add(moments[j], row[a], products[j], off[j, a])
    return moments


@njit(cache=True, nogil=True)
def _of_sums_across(
    sums: np.ndarray, position: np.ndarray, kappa: np.ndarray, towards: np.ndarray, flat: np.ndarray
) -> np.ndarray:
    """Moments [k, 9, 9] from the sums of products of 1, x₀, g and the residuals on both normals."""
    k = len(kappa)
    moments, products = np.zeros((k, 9, 9)), np.empty((3, 3))
    first, second = np.zeros((8, 3)), np.zeros((8, 3))  # rows of both normals, by 1, x₀ and g
    for j in range(k):
        of, curvature = sums[j], kappa[j]
        for c in range(3):
            d, e = (c + 1) % 3, (c + 2) % 3
            t, u, v = flat[j, 0, c], flat[j, 1, c], flat[j, 2, c]
            turn_t = position[j, d] * flat[j, 0, e] - position[j, e] * flat[j, 0, d]
            turn_u = position[j, d] * flat[j, 1, e] - position[j, e] * flat[j, 1, d]
            turn_v = position[j, d] * flat[j, 2, e] - position[j, e] * flat[j, 2, d]
            first[c, 0], first[c, 1], first[c, 2] = u, -curvature * t, -curvature * curvature * u
            second[c, 0] = v
            first[3 + c, 0] = turn_u
            first[3 + c, 1] = v - curvature * turn_t
            first[3 + c, 2] = -curvature * curvature * turn_u
            second[3 + c, 0], second[3 + c, 1], second[3 + c, 2] = turn_v, -u, curvature * t
        first[6, 2], first[7, 2] = towards[j, 0], towards[j, 1]
        second[6, 2], second[7, 2] = -towards[j, 1], towards[j, 0]
        products[0, 0], products[0, 1], products[0, 2] = of[0], of[1], of[2]
        products[1, 0], products[1, 1], products[1, 2] = of[1], of[3], of[4]
        products[2, 0], products[2, 1], products[2, 2] = of[2], of[4], of[5]
        _add(moments[j], first, products, of[6:9])
        _add(moments[j], second, products, of[9:12])
    return moments


@njit(cache=True, nogil=True)
def _add(own: np.ndarray, row: np.ndarray, products: np.ndarray, off: np.ndarray) -> None:
    """Add rows [8, f] of f functions, with the sums of their products and of those with the residual."""
    f = row.shape[1]
    half = np.empty(f)
    for a in range(8):
        for q in range(f):
            half[q] = 0.0
            for p in range(f):
                half[q] += row[a, p] * products[p, q]
        for b in range(a, 8):
            total = 0.0
            for q in range(f):
                total += half[q] * row[b, q]
            own[a, b] += total
            own[b, a] = own[a, b]
        total = 0.0
        for q in range(f):
            total += row[a, q] * off[q]
        own[a, 8] += total
        own[8, a] = own[a, 8]

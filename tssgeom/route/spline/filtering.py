"""The prior of a route that bends with it, and a Kalman filter for it.

The prior says that the rate of the curvature vector, carried along without twist, wanders like Brownian
motion of intensity q and leans back against the curvature (docs/model.md (20)). With κ = 0 the posterior mean
is the smoothing spline of degree seven; with κ², κκ' and ω² from a previous pass circles and helices cost
nothing.

The state at a station is r, r' = T, T' = a, and b with a' = b - κ² T, b' = -κκ' T - ω² a + w. Its covariance
is shared by x, y and z and kept as its upper triangle: 00, 01, 02, 03, 11, 12, 13, 22, 23, 33. Transitions
are kept without the first column, which is that of the unit matrix: rows r, T, a, b on T, a, b.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from numba import njit

Triangle: TypeAlias = tuple[float, float, float, float, float, float, float, float, float, float]

FAST: Any = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "arcp"},  # sums may be fused; nan and infinity keep their meaning
}
_TERMS = 30
_DIFFUSE = 2  # innovations spent on the unknown place and direction at the first station


@njit(**FAST)
def transitions(u: np.ndarray, coupling: np.ndarray) -> np.ndarray:
    """Carry the state over every interval before a station, [n, 12].

    Parameters
    ----------
    u
        Stations [n], in units of the mean spacing.
    coupling
        κ² and κκ' on the interval before each station, and ω² [n, 3].

    The Taylor series of T obeys T_k+3 = -κκ' T_k - (κ² + ω²) T_k+1; r is its integral, a its derivative.
    """
    n = len(u)
    out = np.zeros((n, 12))
    for i in range(1, n):
        h, c2, c3, sway = u[i] - u[i - 1], coupling[i, 0], coupling[i, 1], coupling[i, 0] + coupling[i, 2]
        f = out[i]
        f[:] = 0.0
        # columns on T, a, b of the k-th derivative of T
        x0, x1, x2, y0, y1, y2, z0, z1, z2 = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, -c2, 0.0, 1.0
        power, size = 1.0, sway * h * h + abs(c3) * h * h * h
        for k in range(_TERMS):
            after = power * h / (k + 1)
            f[0] += x0 * after
            f[1] += x1 * after
            f[2] += x2 * after
            f[3] += x0 * power
            f[4] += x1 * power
            f[5] += x2 * power
            f[6] += y0 * power
            f[7] += y1 * power
            f[8] += y2 * power
            f[9] += z0 * power
            f[10] += z1 * power
            f[11] += z2 * power
            x0, x1, x2, y0, y1, y2, z0, z1, z2 = (
                y0,
                y1,
                y2,
                z0,
                z1,
                z2,
                -c3 * x0 - sway * y0,
                -c3 * x1 - sway * y1,
                -c3 * x2 - sway * y2,
            )
            power = after
            if k >= 3 and size * power < 1e-15:
                break
        f[9] += c2 * f[3]
        f[10] += c2 * f[4]
        f[11] += c2 * f[5]
    return out


@njit(**FAST)
def predicted(p: Triangle, f: np.ndarray, h: float) -> Triangle:
    """Carry a covariance over a step: F p F' + Q, with Q what white noise of intensity 1 brings."""
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = p
    r1, r2, r3, t1, t2, t3 = f[0], f[1], f[2], f[3], f[4], f[5]
    a1, a2, a3, b1, b2, b3 = f[6], f[7], f[8], f[9], f[10], f[11]
    c1 = p01 + r1 * p11 + r2 * p12 + r3 * p13
    c2 = p02 + r1 * p12 + r2 * p22 + r3 * p23
    c3 = p03 + r1 * p13 + r2 * p23 + r3 * p33
    c0 = p00 + r1 * p01 + r2 * p02 + r3 * p03
    d1 = t1 * p11 + t2 * p12 + t3 * p13
    d2 = t1 * p12 + t2 * p22 + t3 * p23
    d3 = t1 * p13 + t2 * p23 + t3 * p33
    e1 = a1 * p11 + a2 * p12 + a3 * p13
    e2 = a1 * p12 + a2 * p22 + a3 * p23
    e3 = a1 * p13 + a2 * p23 + a3 * p33
    g1 = b1 * p11 + b2 * p12 + b3 * p13
    g2 = b1 * p12 + b2 * p22 + b3 * p23
    g3 = b1 * p13 + b2 * p23 + b3 * p33
    h2 = h * h
    h3, h4 = h2 * h, h2 * h2
    return (
        c0 + r1 * c1 + r2 * c2 + r3 * c3 + h3 * h4 / 252,
        t1 * c1 + t2 * c2 + t3 * c3 + h3 * h3 / 72,
        a1 * c1 + a2 * c2 + a3 * c3 + h2 * h3 / 30,
        b1 * c1 + b2 * c2 + b3 * c3 + h4 / 24,
        t1 * d1 + t2 * d2 + t3 * d3 + h2 * h3 / 20,
        a1 * d1 + a2 * d2 + a3 * d3 + h4 / 8,
        b1 * d1 + b2 * d2 + b3 * d3 + h3 / 6,
        a1 * e1 + a2 * e2 + a3 * e3 + h3 / 3,
        b1 * e1 + b2 * e2 + b3 * e3 + h2 / 2,
        b1 * g1 + b2 * g2 + b3 * g3 + h,
    )


@njit(**FAST)
def seen(p: Triangle, variance: float) -> Triangle:
    """Covariance after the position was seen with the given variance."""
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = p
    s = p00 + variance
    k1, k2, k3, shrink = p01 / s, p02 / s, p03 / s, variance / s
    return (
        p00 * shrink,
        p01 * shrink,
        p02 * shrink,
        p03 * shrink,
        p11 - k1 * p01,
        p12 - k1 * p02,
        p13 - k1 * p03,
        p22 - k2 * p02,
        p23 - k2 * p03,
        p33 - k3 * p03,
    )


@njit(**FAST)
def faced(p: Triangle, variance: float) -> Triangle:
    """Covariance after the direction was sensed with the given variance; docs/model.md (90)."""
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = p
    s = p11 + variance
    k0, k2, k3, shrink = p01 / s, p12 / s, p13 / s, variance / s
    return (
        p00 - k0 * p01,
        p01 * shrink,
        p02 - k0 * p12,
        p03 - k0 * p13,
        p11 * shrink,
        p12 * shrink,
        p13 * shrink,
        p22 - k2 * p12,
        p23 - k2 * p13,
        p33 - k3 * p13,
    )


@njit(**FAST)
def face(p: Triangle, m: np.ndarray, aim: np.ndarray, variance: float) -> np.ndarray:
    """Move the mean [3, 4] by a sensed direction `aim` [3]; returns the innovation [3]."""
    s = p[4] + variance
    off = aim - m[:, 1]
    for c in range(3):
        m[c, 0] += p[1] / s * off[c]
        m[c, 1] += p[4] / s * off[c]
        m[c, 2] += p[5] / s * off[c]
        m[c, 3] += p[6] / s * off[c]
    return off


@njit(**FAST)
def carry(m: np.ndarray, f: np.ndarray, out: np.ndarray) -> None:
    """Carry the mean of all coordinates [3, 4] over a step; `out` may be `m`."""
    for c in range(3):
        t, a, b = m[c, 1], m[c, 2], m[c, 3]
        out[c, 0] = m[c, 0] + f[0] * t + f[1] * a + f[2] * b
        out[c, 1] = f[3] * t + f[4] * a + f[5] * b
        out[c, 2] = f[6] * t + f[7] * a + f[8] * b
        out[c, 3] = f[9] * t + f[10] * a + f[11] * b


@njit(**FAST)
def at_start(ends: np.ndarray, ratio: float) -> Triangle:
    """Covariance before the first point was seen."""
    zero = 0.0 * ratio
    return (
        ends[0] * ratio,
        zero,
        zero,
        zero,
        ends[1] * ratio,
        zero,
        zero,
        ends[2] * ratio,
        zero,
        ends[3] * ratio,
    )


@njit(**FAST)
def tied(
    p: Triangle, m: np.ndarray, variance_a: float, variance_b: float
) -> tuple[Triangle, float, np.ndarray]:
    """Tie a and b at the last station to zero with the given variances.

    Returns
    -------
    covariance, determinant, whitened
        After the tie; determinant of the covariance of the two innovations, and these in units of their
        standard deviations [2, 3]. `m` becomes the mean after the tie.
    """
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = p
    s = p22 + variance_a
    k0, k1, k2, k3 = p02 / s, p12 / s, p22 / s, p23 / s
    q00, q01, q02, q03 = p00 - k0 * p02, p01 - k0 * p12, p02 - k0 * p22, p03 - k0 * p23
    q11, q12, q13 = p11 - k1 * p12, p12 - k1 * p22, p13 - k1 * p23
    q22, q23, q33 = p22 * variance_a / s, p23 - k2 * p23, p33 - k3 * p23
    z = q33 + variance_b
    l0, l1, l2, l3 = q03 / z, q13 / z, q23 / z, q33 / z
    white = np.empty((2, 3))
    for c in range(3):
        a = m[c, 2]
        white[0, c] = a / math.sqrt(s)
        b = m[c, 3] - k3 * a
        white[1, c] = b / math.sqrt(z)
        m[c, 0] -= k0 * a + l0 * b
        m[c, 1] -= k1 * a + l1 * b
        m[c, 2] -= k2 * a + l2 * b
        m[c, 3] -= k3 * a + l3 * b
    after = (
        q00 - l0 * q03,
        q01 - l0 * q13,
        q02 - l0 * q23,
        q03 - l0 * q33,
        q11 - l1 * q13,
        q12 - l1 * q23,
        q13 - l1 * q33,
        q22 - l2 * q23,
        q23 - l2 * q33,
        q33 * variance_b / z,
    )
    return after, s * z, white


@njit(**FAST)
def innovations(
    u: np.ndarray,
    y: np.ndarray,
    weight: np.ndarray,
    step: np.ndarray,
    start: np.ndarray,
    ends: np.ndarray,
    tangent: np.ndarray,
    planar: bool,
    ratio: float,
    out: np.ndarray,
    aim: np.ndarray | None = None,
    blur: np.ndarray | None = None,
    per_q: float = 0.0,
) -> tuple[float, float, int]:
    """Filter forward, for noise variance ratio/weight and q = 1.

    Parameters
    ----------
    u, y, weight
        Stations [n], points [n, 3] and weights [n] (0: not seen), all lengths in units of the mean spacing.
    step
        Transitions [n, 12].
    start, ends
        Guess of the state at the first station [3, 4], and variances of r and T there and of a and b at
        both ends, in units of the noise variance [4].
    tangent, planar
        Where planar, only the part of an innovation normal to the tangent [n, 3] counts.
    ratio
        λ, the noise variance per intensity of the fourth derivative.
    out
        Filled with the innovations over their standard deviations [n, 3], or empty if they are not wanted.
    aim, blur, per_q
        Where directions are sensed: these [n, 3], their variances [n] (0: not sensed), and 1/q.

    Returns
    -------
    log_s, squares, n
        Sum of the logarithms of the n innovation variances, of points and directions, less what the ties at
        the ends would be worth without any point, and sum of the squared standardised innovations.
    """
    m = start.copy()
    p = at_start(ends, ratio)
    log_s, squares, used = 0.0, 0.0, 0
    product = 1.0
    placed, pointed = False, False  # whether the first innovations went into the unknown place and direction
    for i in range(len(u)):
        if i > 0:
            p = predicted(p, step[i], u[i] - u[i - 1])
            carry(m, step[i], m)
        if aim is not None and blur is not None:  # two questions, the first of which compiles away
            variance = blur[i] * per_q
            if variance > 0.0:
                s = p[4] + variance
                off = face(p, m, aim[i], variance)
                p = faced(p, variance)
                used += 1
                if pointed:
                    along = np.dot(off, tangent[i]) if planar else 0.0
                    log_s += math.log(s)
                    squares += (np.dot(off, off) - along * along) / s
                pointed = True
        if weight[i] <= 0.0:
            continue
        s = p[0] + ratio / weight[i]
        v0, v1, v2 = y[i, 0] - m[0, 0], y[i, 1] - m[1, 0], y[i, 2] - m[2, 0]
        for j in range(4):
            k = p[j] / s
            m[0, j] += k * v0
            m[1, j] += k * v1
            m[2, j] += k * v2
        p = seen(p, ratio / weight[i])
        used += 1
        if not (placed and pointed):
            pointed, placed = placed or pointed, True
            continue
        product *= s
        if product > 1e100 or product < 1e-100:
            log_s += math.log(product)
            product = 1.0
        if planar:
            along = v0 * tangent[i, 0] + v1 * tangent[i, 1] + v2 * tangent[i, 2]
            v0 -= along * tangent[i, 0]
            v1 -= along * tangent[i, 1]
            v2 -= along * tangent[i, 2]
        squares += (v0 * v0 + v1 * v1 + v2 * v2) / s
        if len(out):
            root = math.sqrt(s)
            out[i, 0], out[i, 1], out[i, 2] = v0 / root, v1 / root, v2 / root
    va, vb, length = ends[2] * ratio, ends[3] * ratio, u[-1] - u[0]
    p, determinant, white = tied(p, m, va, vb)
    for k in range(2):
        along = np.dot(white[k], tangent[-1]) if planar else 0.0
        squares += np.dot(white[k], white[k]) - along * along
    # the same determinant for a route that no point was seen of
    p22 = 2.0 * va + vb * length**2 + length**3 / 3.0
    p23, p33 = vb * length + length**2 / 2.0, 2.0 * vb + length
    log_s += math.log(product) + math.log(determinant) - math.log(p22 * p33 - p23 * p23)
    return log_s, squares, used - _DIFFUSE

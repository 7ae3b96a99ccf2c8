"""The smoother of a route and its prior in plain Python, as oracle of the core."""

from __future__ import annotations

import math

import numpy as np

from tests.core.twins.spline_filter import (
    initial_covariance,
    predict_covariance,
    predict_mean,
    update_by_end,
    update_by_position,
    update_by_tangent,
    update_mean_by_tangent,
)
from tests.core.twins.statistics import isotonic_regression
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_route import PRIOR
from tssgeom.route.spline.problem import FilterModel

_TERMS = 30


def _gain(p: tuple, f: np.ndarray, predicted: tuple, c: np.ndarray) -> None:
    """Put the smoother gain (F p)' predicted^-1 into c, by Cholesky."""
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = predicted
    tiny = 1e-300
    l00 = math.sqrt(p00)
    l10, l20, l30 = p01 / l00, p02 / l00, p03 / l00
    l11 = math.sqrt(max(p11 - l10 * l10, tiny))
    l21, l31 = (p12 - l20 * l10) / l11, (p13 - l30 * l10) / l11
    l22 = math.sqrt(max(p22 - l20 * l20 - l21 * l21, tiny))
    l32 = (p23 - l30 * l20 - l31 * l21) / l22
    l33 = math.sqrt(max(p33 - l30 * l30 - l31 * l31 - l32 * l32, tiny))
    i00, i11, i22, i33 = 1.0 / l00, 1.0 / l11, 1.0 / l22, 1.0 / l33
    for j in range(4):
        if j == 0:
            x1, x2, x3 = p[1], p[2], p[3]
        elif j == 1:
            x1, x2, x3 = p[4], p[5], p[6]
        elif j == 2:
            x1, x2, x3 = p[5], p[7], p[8]
        else:
            x1, x2, x3 = p[6], p[8], p[9]
        z0 = (p[j] + f[0] * x1 + f[1] * x2 + f[2] * x3) * i00
        z1 = (f[3] * x1 + f[4] * x2 + f[5] * x3 - l10 * z0) * i11
        z2 = (f[6] * x1 + f[7] * x2 + f[8] * x3 - l20 * z0 - l21 * z1) * i22
        z3 = (f[9] * x1 + f[10] * x2 + f[11] * x3 - l30 * z0 - l31 * z1 - l32 * z2) * i33
        y3 = z3 * i33
        y2 = (z2 - l32 * y3) * i22
        y1 = (z1 - l21 * y2 - l31 * y3) * i11
        c[j, 3], c[j, 2], c[j, 1] = y3, y2, y1
        c[j, 0] = (z0 - l10 * y1 - l20 * y2 - l30 * y3) * i00


def _add_congruence(b: np.ndarray, p: tuple, out: np.ndarray) -> None:
    """Add b p b' to the triangle `out`, for full b and triangle p."""
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = p
    n = 0
    for j in range(4):
        x0, x1, x2, x3 = b[j, 0], b[j, 1], b[j, 2], b[j, 3]
        e0 = x0 * p00 + x1 * p01 + x2 * p02 + x3 * p03
        e1 = x0 * p01 + x1 * p11 + x2 * p12 + x3 * p13
        e2 = x0 * p02 + x1 * p12 + x2 * p22 + x3 * p23
        e3 = x0 * p03 + x1 * p13 + x2 * p23 + x3 * p33
        for k in range(j, 4):
            out[n] += e0 * b[k, 0] + e1 * b[k, 1] + e2 * b[k, 2] + e3 * b[k, 3]
            n += 1


def _smooth_covariance(
    p: np.ndarray, c: np.ndarray, h: float, f: np.ndarray, following: np.ndarray, rest: np.ndarray
) -> None:
    """Replace p by (1 - cF) p (1 - cF)' + c (Q + following) c': a sum of positive parts, no digits lost."""
    for j in range(4):
        x0, x1, x2, x3 = c[j, 0], c[j, 1], c[j, 2], c[j, 3]
        rest[j, 0] = -x0
        rest[j, 1] = -(x0 * f[0] + x1 * f[3] + x2 * f[6] + x3 * f[9])
        rest[j, 2] = -(x0 * f[1] + x1 * f[4] + x2 * f[7] + x3 * f[10])
        rest[j, 3] = -(x0 * f[2] + x1 * f[5] + x2 * f[8] + x3 * f[11])
        rest[j, j] += 1.0
    before = _triangle(p)
    p[:] = 0.0
    _add_congruence(rest, before, p)
    w = following
    h2 = h * h
    h3, h4 = h2 * h, h2 * h2
    with_noise = (
        w[0] + h3 * h4 / 252,
        w[1] + h3 * h3 / 72,
        w[2] + h2 * h3 / 30,
        w[3] + h4 / 24,
        w[4] + h2 * h3 / 20,
        w[5] + h4 / 8,
        w[6] + h3 / 6,
        w[7] + h3 / 3,
        w[8] + h2 / 2,
        w[9] + h,
    )
    _add_congruence(c, with_noise, p)


def _triangle(p: np.ndarray) -> tuple:
    """Read a covariance [10] from an array."""
    return (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9])


def _put(p: tuple, out: np.ndarray) -> None:
    for k in range(10):
        out[k] = p[k]


def smooth(
    model: FilterModel, ratio: float, tangents: tuple | None, inverse_intensity: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Posterior of the curve at all stations, for noise variance ratio/weight and q = 1.

    Parameters are those of `filtering.innovations`.

    Returns
    -------
    mean
        State of each coordinate, [n, 3 coordinates, 4].
    covariance
        Posterior covariance of one coordinate, upper triangle, [n, 10].
    gain
        Smoother gains [n - 1, 4, 4]: Cov(state i, state i+1) = gain i times covariance i+1.
    """
    u, y, weight, transition, ends = model.u, model.y, model.weight, model.transition, model.ends
    n = len(u)
    m = np.empty((n, 3, 4))
    covariance, predicted = np.empty((n, 10)), np.empty((n, 10))
    for c in range(3):
        for j in range(4):
            m[0, c, j] = model.start[c, j]
    p = initial_covariance(ends, ratio)
    for i in range(n):
        if i > 0:
            p = predict_covariance(p, transition[i], u[i] - u[i - 1])
            _put(p, predicted[i])
            predict_mean(m[i - 1], transition[i], m[i])
        if tangents is not None:
            variance = tangents[1][i] * inverse_intensity
            if variance > 0.0:
                update_mean_by_tangent(p, m[i], tangents[0][i], variance)
                p = update_by_tangent(p, variance)
        if weight[i] > 0.0:
            s = p[0] + ratio / weight[i]
            v0, v1, v2 = y[i, 0] - m[i, 0, 0], y[i, 1] - m[i, 1, 0], y[i, 2] - m[i, 2, 0]
            for j in range(4):
                k = p[j] / s
                m[i, 0, j] += k * v0
                m[i, 1, j] += k * v1
                m[i, 2, j] += k * v2
            p = update_by_position(p, ratio / weight[i])
        _put(p, covariance[i])
    p, _, _ = update_by_end(p, m[n - 1], ends[2] * ratio, ends[3] * ratio)
    _put(p, covariance[n - 1])
    gain = np.empty((max(n - 1, 0), 4, 4))
    d, rest = np.empty((3, 4)), np.empty((4, 4))
    for i in range(n - 2, -1, -1):
        g = gain[i]
        _gain(_triangle(covariance[i]), transition[i + 1], _triangle(predicted[i + 1]), g)
        predict_mean(m[i], transition[i + 1], d)
        for c in range(3):
            d0, d1 = m[i + 1, c, 0] - d[c, 0], m[i + 1, c, 1] - d[c, 1]
            d2, d3 = m[i + 1, c, 2] - d[c, 2], m[i + 1, c, 3] - d[c, 3]
            for j in range(4):
                m[i, c, j] += g[j, 0] * d0 + g[j, 1] * d1 + g[j, 2] * d2 + g[j, 3] * d3
        _smooth_covariance(covariance[i], g, u[i + 1] - u[i], transition[i + 1], covariance[i + 1], rest)
    return m, covariance, gain


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
        h, c2, c3, stiffness = (
            u[i] - u[i - 1],
            coupling[i, 0],
            coupling[i, 1],
            coupling[i, 0] + coupling[i, 2],
        )
        f = out[i]
        f[:] = 0.0
        # columns on T, a, b of the k-th derivative of T
        x0, x1, x2, y0, y1, y2, z0, z1, z2 = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, -c2, 0.0, 1.0
        power, size = 1.0, stiffness * h * h + abs(c3) * h * h * h
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
                -c3 * x0 - stiffness * y0,
                -c3 * x1 - stiffness * y1,
                -c3 * x2 - stiffness * y2,
            )
            power = after
            if k >= 3 and size * power < 1e-15:
                break
        f[9] += c2 * f[3]
        f[10] += c2 * f[4]
        f[11] += c2 * f[5]
    return out


def prior_along_curve(
    u: np.ndarray,
    y: np.ndarray,
    weight: np.ndarray,
    ratio: float,
    q: float,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Stations, coupling, variances at the ends and tangents for the next pass; docs/model.md (20) to (22).

    Returns
    -------
    u, coupling, ends, tangent
        Feet of the points where stations are not known [n], and what `filtering.transitions` [n, 3] and
        `filtering.innovations` [4], [n, 3] take.
    """
    n = len(u)
    coupling, tangent, feet = np.zeros((n, 3)), np.empty((n, 3)), np.empty(n)
    bends, rates, growth_at_end = 0.0, 0.0, 0.0
    bend_integral, rate_integral = 0.0, 0.0
    arc, speed_before = 0.0, 0.0
    bend_before, rate_before = 0.0, 0.0
    for i in range(n):
        m = mean[i]
        speed = max(math.sqrt(m[0, 1] ** 2 + m[1, 1] ** 2 + m[2, 1] ** 2), 1e-12)
        a_along, b_along, off = 0.0, 0.0, 0.0
        for c in range(3):
            tangent[i, c] = m[c, 1] / speed
            a_along += m[c, 2] * tangent[i, c]
            b_along += m[c, 3] * tangent[i, c]
            off += (y[i, c] - m[c, 0]) * tangent[i, c]
        square, rate, growth = 0.0, 0.0, 0.0
        for c in range(3):
            a = (m[c, 2] - a_along * tangent[i, c]) / speed**2
            b = (m[c, 3] - b_along * tangent[i, c]) / speed**3
            square += a * a
            rate += b * b
            growth += a * b
        p22, p23, p33 = covariance[i, 7], covariance[i, 8], covariance[i, 9]
        kappa_square = min(max(square - 0.75 * q * p22, 0.0), PRIOR.sharpest**2)
        coupling[i, 0] = kappa_square
        coupling[i, 1] = min(max(growth / max(square, 1e-300), -PRIOR.change), PRIOR.change) * kappa_square
        whole_bend, whole_rate = square + 2.0 * q * p22, rate + 2.0 * q * p33
        bends += whole_bend / n
        rates += whole_rate / n
        if i > 0:
            h = u[i] - u[i - 1]
            arc += 0.5 * (speed + speed_before) * h
            bend_integral += 0.5 * (whole_bend + bend_before) * h
            rate_integral += 0.5 * (whole_rate + rate_before) * h
        if i == 0:
            growth_at_end -= growth + 2.0 * q * p23
        elif i == n - 1:
            growth_at_end += growth + 2.0 * q * p23
        bend_before, rate_before, speed_before = whole_bend, whole_rate, speed
        feet[i] = arc + off
    omega_square = min(
        max((rate_integral - growth_at_end) / max(bend_integral, 1e-300), 0.0), PRIOR.change**2
    )
    for i in range(n - 1, 0, -1):
        coupling[i, 0] = 0.5 * (coupling[i, 0] + coupling[i - 1, 0])
        coupling[i, 1] = 0.5 * (coupling[i, 1] + coupling[i - 1, 1])
        coupling[i, 2] = omega_square
    coupling[0, 2] = omega_square
    noise = max(ratio * q, PRIOR.rounding**2)
    ends = np.array(
        [
            PRIOR.vague * covariance[0, 0] / ratio,
            PRIOR.vague * covariance[0, 4] / ratio,
            (ROUNDING.relative**2 + 0.5 * bends) / noise,
            (ROUNDING.relative**2 + 0.5 * rates) / noise,
        ]
    )
    if known:
        return u, coupling, ends, tangent
    feet = isotonic_regression(feet, np.maximum(weight, ROUNDING.relative))
    first = feet[0]
    for i in range(n):
        feet[i] += PRIOR.rounding * i - first
    return feet, coupling, ends, tangent

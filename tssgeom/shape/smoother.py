"""The quintic smoothing spline, bent along the route, in state-space form.

The prior of a route says that its curvature vector, carried along without twist, wanders like Brownian
motion of intensity q: r''' = -κ² r' + white noise (docs/model.md (20)). With κ = 0 the posterior mean is the
quintic smoothing spline; with κ² from a previous pass circles cost nothing, and an error in κ² only shifts
points along the route. A Kalman filter and a Rauch-Tung-Striebel smoother give mean and covariance in time
linear in the number of stations; there are no knots, and a station that was not seen is simply not used.

The state at a station is position, first and second derivative; its 3 by 3 covariance is shared by x, y and
z and stored as its upper triangle: 11, 12, 13, 22, 23, 33.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_VAGUE = 1e4  # variance of the prior at the first station over that of three points
_DIFFUSE = 3  # innovations spent on the unknown position and derivatives at the first station


@njit(cache=True, nogil=True)
def _transition(h: float, kappa2: float, f: np.ndarray) -> None:
    """Step of r''' = -κ² r': r += f0 r' + f1 r'', r' = f2 r' + f0 r'', r'' = f3 r' + f2 r''."""
    x = kappa2 * h * h
    if x < 1e-8:
        f[0], f[1], f[2], f[3] = h * (1 - x / 6), h * h * (0.5 - x / 24), 1 - x / 2, -kappa2 * h
        return
    k = math.sqrt(kappa2)
    half = math.sin(0.5 * k * h)
    f[0] = math.sin(k * h) / k
    f[1] = 2 * half * half / kappa2
    f[2] = 1 - 2 * half * half
    f[3] = -kappa2 * f[0]


@njit(cache=True, nogil=True)
def _add_wander(h: float, out: np.ndarray, p: np.ndarray) -> None:
    """Add Q, the covariance that white noise of intensity 1 brings over a step h: out = p + Q."""
    h2, h3 = h * h, h * h * h
    out[0] = p[0] + h2 * h3 / 20
    out[1] = p[1] + h2 * h2 / 8
    out[2] = p[2] + h3 / 6
    out[3] = p[3] + h3 / 3
    out[4] = p[4] + h2 / 2
    out[5] = p[5] + h


@njit(cache=True, nogil=True)
def _predict(p: np.ndarray, h: float, f: np.ndarray, out: np.ndarray, a: np.ndarray) -> None:
    """Carry covariance `p` over a step: out = F p F' + Q, a = F p (row by row)."""
    f0, f1, f2, f3 = f[0], f[1], f[2], f[3]
    a[0] = p[0] + f0 * p[1] + f1 * p[2]
    a[1] = p[1] + f0 * p[3] + f1 * p[4]
    a[2] = p[2] + f0 * p[4] + f1 * p[5]
    a[3] = f2 * p[1] + f0 * p[2]
    a[4] = f2 * p[3] + f0 * p[4]
    a[5] = f2 * p[4] + f0 * p[5]
    a[6] = f3 * p[1] + f2 * p[2]
    a[7] = f3 * p[3] + f2 * p[4]
    a[8] = f3 * p[4] + f2 * p[5]
    out[0] = a[0] + f0 * a[1] + f1 * a[2]
    out[1] = f2 * a[1] + f0 * a[2]
    out[2] = f3 * a[1] + f2 * a[2]
    out[3] = f2 * a[4] + f0 * a[5]
    out[4] = f3 * a[4] + f2 * a[5]
    out[5] = f3 * a[7] + f2 * a[8]
    _add_wander(h, out, out)


@njit(cache=True, nogil=True)
def _carry(m: np.ndarray, f: np.ndarray, out: np.ndarray) -> None:
    """Carry the mean of all coordinates over a step; `out` may be `m`."""
    for c in range(3):
        first, second = m[c, 1], m[c, 2]
        out[c, 0] = m[c, 0] + f[0] * first + f[1] * second
        out[c, 1] = f[2] * first + f[0] * second
        out[c, 2] = f[3] * first + f[2] * second


@njit(cache=True, nogil=True)
def _update(p: np.ndarray, variance: float) -> float:
    """Use an observation of the position with the given variance: p becomes the posterior; returns S."""
    s = p[0] + variance
    k2, k3, shrink = p[1] / s, p[2] / s, variance / s
    p[3] -= k2 * p[1]
    p[4] -= k2 * p[2]
    p[5] -= k3 * p[2]
    p[0] *= shrink
    p[1] *= shrink
    p[2] *= shrink
    return s


@njit(cache=True, nogil=True)
def _start(
    u: np.ndarray, y: np.ndarray, weight: np.ndarray, ratio: float, p: np.ndarray, m: np.ndarray
) -> None:
    """Vague prior at the first station, centred on the parabola through three points about a spacing apart.

    Its variance is so far above the error of that parabola that it carries no information, and no more,
    so that no digits are lost when the points come in.
    """
    first, second, third = -1, -1, -1
    for i in range(len(u)):
        if weight[i] <= 0.0:
            continue
        if first < 0:
            first = i
        elif second < 0 and u[i] > u[first] + 0.7:
            second = i
        elif second >= 0 and third < 0 and u[i] > u[second] + 0.7:
            third = i
    if third < 0:
        third = len(u) - 1
        second = (first + third) // 2
    a, b = u[second] - u[first], u[third] - u[second]
    back = u[0] - u[first]
    for c in range(3):
        slope, next_slope = (y[second, c] - y[first, c]) / a, (y[third, c] - y[second, c]) / b
        bend = 2.0 * (next_slope - slope) / (a + b)
        m[c, 2] = bend
        m[c, 1] = slope - 0.5 * bend * a + bend * back
        m[c, 0] = y[first, c] + (slope - 0.5 * bend * a) * back + 0.5 * bend * back * back
    vague = _VAGUE * (ratio + max(a, b) ** 5)
    p[:] = 0.0
    p[0], p[3], p[5] = vague, vague, vague


@njit(cache=True, nogil=True)
def innovations(
    u: np.ndarray,
    y: np.ndarray,
    weight: np.ndarray,
    kappa2: np.ndarray,
    tangent: np.ndarray,
    planar: bool,
    ratio: float,
    out: np.ndarray,
) -> tuple[float, float, int]:
    """Filter forward, for noise variance ratio/weight and q = 1.

    Parameters
    ----------
    u, y, weight
        Stations [n], points [n, 3] and weights [n] (0: not seen), all lengths in units of the mean spacing.
    kappa2
        Squared curvature on the interval before each station [n].
    tangent, planar
        Where planar, only the part of an innovation normal to the tangent [n, 3] counts.
    ratio
        λ, the noise variance per intensity of the third derivative.
    out
        Filled with the innovations over their standard deviations [n, 3], or empty if they are not wanted.

    Returns
    -------
    log_s, squares, n
        Sum of the logarithms of the n innovation variances, and of the squared standardised innovations.
    """
    p, q, a, f = np.empty(6), np.empty(6), np.empty(9), np.empty(4)
    m = np.empty((3, 3))
    _start(u, y, weight, ratio, p, m)
    log_s, squares, used = 0.0, 0.0, 0
    v = np.empty(3)
    for i in range(len(u)):
        if i > 0:
            _transition(u[i] - u[i - 1], kappa2[i], f)
            _predict(p, u[i] - u[i - 1], f, q, a)
            p, q = q, p
            _carry(m, f, m)
        if weight[i] <= 0.0:
            continue
        k1, k2, k3 = p[0], p[1], p[2]
        s = _update(p, ratio / weight[i])
        along = 0.0
        for c in range(3):
            v[c] = y[i, c] - m[c, 0]
            m[c, 0] += k1 / s * v[c]
            m[c, 1] += k2 / s * v[c]
            m[c, 2] += k3 / s * v[c]
            along += v[c] * tangent[i, c]
        used += 1
        if used <= _DIFFUSE:
            continue
        log_s += math.log(s)
        for c in range(3):
            part = v[c] - along * tangent[i, c] if planar else v[c]
            squares += part * part / s
            if len(out):
                out[i, c] = part / math.sqrt(s)
    return log_s, squares, used - _DIFFUSE


@njit(cache=True, nogil=True)
def _gain(a: np.ndarray, p: np.ndarray, c: np.ndarray) -> None:
    """Smoother gain c = (F p_filtered)' p_predicted^-1 by Cholesky; `a` holds F p_filtered row by row."""
    l11 = math.sqrt(p[0])
    l21, l31 = p[1] / l11, p[2] / l11
    l22 = math.sqrt(max(p[3] - l21 * l21, 1e-300))
    l32 = (p[4] - l31 * l21) / l22
    l33 = math.sqrt(max(p[5] - l31 * l31 - l32 * l32, 1e-300))
    for j in range(3):
        z1 = a[j] / l11
        z2 = (a[3 + j] - l21 * z1) / l22
        z3 = (a[6 + j] - l31 * z1 - l32 * z2) / l33
        x3 = z3 / l33
        x2 = (z2 - l32 * x3) / l22
        c[j, 2] = x3
        c[j, 1] = x2
        c[j, 0] = (z1 - l21 * x2 - l31 * x3) / l11


@njit(cache=True, nogil=True)
def _add_congruence(b: np.ndarray, p: np.ndarray, out: np.ndarray) -> None:
    """Add b p b' to the triangle `out`, for full b and triangle p."""
    n = 0
    for j in range(3):
        e0 = b[j, 0] * p[0] + b[j, 1] * p[1] + b[j, 2] * p[2]
        e1 = b[j, 0] * p[1] + b[j, 1] * p[3] + b[j, 2] * p[4]
        e2 = b[j, 0] * p[2] + b[j, 1] * p[4] + b[j, 2] * p[5]
        for k in range(j, 3):
            out[n] += e0 * b[k, 0] + e1 * b[k, 1] + e2 * b[k, 2]
            n += 1


@njit(cache=True, nogil=True)
def _smooth_covariance(
    p: np.ndarray, c: np.ndarray, h: float, f: np.ndarray, following: np.ndarray, rest: np.ndarray
) -> None:
    """Replace p by (1 - cF) p (1 - cF)' + c (Q + following) c': a sum of positive parts, no digits lost."""
    for j in range(3):
        rest[j, 0] = -c[j, 0]
        rest[j, 1] = -(c[j, 0] * f[0] + c[j, 1] * f[2] + c[j, 2] * f[3])
        rest[j, 2] = -(c[j, 0] * f[1] + c[j, 1] * f[0] + c[j, 2] * f[2])
        rest[j, j] += 1.0
    before = p.copy()
    p[:] = 0.0
    _add_congruence(rest, before, p)
    _add_wander(h, before, following)
    _add_congruence(c, before, p)


@njit(cache=True, nogil=True)
def smooth(
    u: np.ndarray, y: np.ndarray, weight: np.ndarray, kappa2: np.ndarray, ratio: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Posterior of the curve at all stations, for noise variance ratio/weight and q = 1.

    Returns
    -------
    mean
        Position, first and second derivative of each coordinate, [n, 3 coordinates, 3].
    covariance
        Posterior covariance of one coordinate, upper triangle, [n, 6].
    gain
        Smoother gains [n - 1, 3, 3]: Cov(state i, state i+1) = gain i times covariance i+1.
    """
    n = len(u)
    m = np.empty((n, 3, 3))
    p, predicted = np.empty((n, 6)), np.empty((n, 6))
    a, f = np.empty((n, 9)), np.empty((n, 4))
    _start(u, y, weight, ratio, p[0], m[0])
    for i in range(n):
        if i > 0:
            h = u[i] - u[i - 1]
            _transition(h, kappa2[i], f[i])
            _predict(p[i - 1], h, f[i], predicted[i], a[i])
            p[i] = predicted[i]
            _carry(m[i - 1], f[i], m[i])
        if weight[i] > 0.0:
            k1, k2, k3 = p[i, 0], p[i, 1], p[i, 2]
            s = _update(p[i], ratio / weight[i])
            for c in range(3):
                v = (y[i, c] - m[i, c, 0]) / s
                m[i, c, 0] += k1 * v
                m[i, c, 1] += k2 * v
                m[i, c, 2] += k3 * v
    gain = np.empty((max(n - 1, 0), 3, 3))
    d, rest = np.empty((3, 3)), np.empty((3, 3))
    for i in range(n - 2, -1, -1):
        g = gain[i]
        _gain(a[i + 1], predicted[i + 1], g)
        _carry(m[i], f[i + 1], d)
        for c in range(3):
            d0, d1, d2 = m[i + 1, c, 0] - d[c, 0], m[i + 1, c, 1] - d[c, 1], m[i + 1, c, 2] - d[c, 2]
            for j in range(3):
                m[i, c, j] += g[j, 0] * d0 + g[j, 1] * d1 + g[j, 2] * d2
        _smooth_covariance(p[i], g, u[i + 1] - u[i], f[i + 1], p[i + 1], rest)
    return m, p, gain


@njit(cache=True, nogil=True)
def _criterion(log_s: float, squares: float, n: int, dimensions: int, ratio: float, variance: float) -> float:
    """-2 ln of the restricted likelihood; `variance` is the known noise variance, or 0 where unknown."""
    if variance > 0.0:
        q = variance / ratio
        return dimensions * (n * math.log(q) + log_s) + squares / q
    return dimensions * (n * math.log(max(squares, 1e-280) / (dimensions * n)) + log_s)


@njit(cache=True, nogil=True)
def best_ratio(
    u: np.ndarray,
    y: np.ndarray,
    weight: np.ndarray,
    kappa2: np.ndarray,
    tangent: np.ndarray,
    planar: bool,
    variance: float,
) -> tuple[float, float]:
    """Smoothing ratio λ of greatest restricted likelihood, and the intensity q that goes with it.

    The search takes every decade from interpolation to one parabola through all points, then narrows by
    golden section around the best. `variance` is the known noise variance in units of the mean spacing, or 0
    where it is unknown.
    """
    dimensions, none = 2 if planar else 3, np.empty((0, 3))
    top = 6.0 * math.log10(len(u)) + 1.0
    best, best_value = -8.0, np.inf
    x = -8.0
    while x <= top:
        log_s, squares, n = innovations(u, y, weight, kappa2, tangent, planar, 10.0**x, none)
        value = _criterion(log_s, squares, n, dimensions, 10.0**x, variance)
        if value < best_value:
            best, best_value = x, value
        x += 1.0
    lo, hi = best - 1.0, best + 1.0
    for _ in range(12):
        a, b = lo + 0.381966 * (hi - lo), lo + 0.618034 * (hi - lo)
        log_a, squares_a, n = innovations(u, y, weight, kappa2, tangent, planar, 10.0**a, none)
        log_b, squares_b, n = innovations(u, y, weight, kappa2, tangent, planar, 10.0**b, none)
        value_a = _criterion(log_a, squares_a, n, dimensions, 10.0**a, variance)
        value_b = _criterion(log_b, squares_b, n, dimensions, 10.0**b, variance)
        if value_a < value_b:
            hi = b
        else:
            lo = a
    ratio = 10.0 ** (0.5 * (lo + hi))
    log_s, squares, n = innovations(u, y, weight, kappa2, tangent, planar, ratio, none)
    return ratio, (variance / ratio if variance > 0.0 else squares / (dimensions * n))

"""The filter of a route and the search for its smoothness in plain Python, as oracle of the core."""

from __future__ import annotations

import math

import numpy as np

from tssgeom.core.constants_route import PRIOR, SEARCH
from tssgeom.route.spline.problem import FilterModel

_DIFFUSE = 2


def predict_covariance(p: tuple, f: np.ndarray, h: float) -> tuple:
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


def update_by_position(p: tuple, variance: float) -> tuple:
    """Covariance after the position was observed with the given variance."""
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


def update_by_tangent(p: tuple, variance: float) -> tuple:
    """Covariance after the direction was observed with the given variance; docs/model.md (90)."""
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


def update_mean_by_tangent(p: tuple, m: np.ndarray, tangent: np.ndarray, variance: float) -> np.ndarray:
    """Update the mean [3, 4] by an observed direction [3]; returns the innovation [3]."""
    s = p[4] + variance
    off = tangent - m[:, 1]
    for c in range(3):
        m[c, 0] += p[1] / s * off[c]
        m[c, 1] += p[4] / s * off[c]
        m[c, 2] += p[5] / s * off[c]
        m[c, 3] += p[6] / s * off[c]
    return off


def predict_mean(m: np.ndarray, f: np.ndarray, out: np.ndarray) -> None:
    """Carry the mean of all coordinates [3, 4] over a step; `out` may be `m`."""
    for c in range(3):
        t, a, b = m[c, 1], m[c, 2], m[c, 3]
        out[c, 0] = m[c, 0] + f[0] * t + f[1] * a + f[2] * b
        out[c, 1] = f[3] * t + f[4] * a + f[5] * b
        out[c, 2] = f[6] * t + f[7] * a + f[8] * b
        out[c, 3] = f[9] * t + f[10] * a + f[11] * b


def initial_covariance(ends: np.ndarray, ratio: float) -> tuple:
    """Covariance before the first point is observed."""
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


def update_by_end(
    p: tuple, m: np.ndarray, variance_a: float, variance_b: float
) -> tuple[tuple, float, np.ndarray]:
    """Update by the prior of the last station: a and b are zero with the given variances.

    Returns
    -------
    covariance, determinant, whitened
        After the update; determinant of the covariance of the two innovations, and these in units of their
        standard deviations [2, 3]. `m` becomes the mean after the update.
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


def innovations(
    model: FilterModel,
    ratio: float,
    out: np.ndarray,
    tangents: tuple | None,
    inverse_intensity: float,
) -> tuple[float, float, int]:
    """Filter forward, for noise variance ratio/weight and q = 1.

    Parameters
    ----------
    model
        Points and prior.
    ratio
        λ, the noise variance per intensity of the fourth derivative.
    out
        Filled with the innovations over their standard deviations [n, 3], or empty if they are not wanted.
    tangents, inverse_intensity
        Sensed directions, if any, and 1/q, in which their variances are counted.

    Returns
    -------
    log_s, squares, n
        Sum of the logarithms of the n innovation variances, of points and directions, less what the prior of
        the ends would be worth without any point, and sum of the squared standardised innovations.
    """
    u, y, weight, transition, ends = model.u, model.y, model.weight, model.transition, model.ends
    curve_tangent, across_only = model.curve_tangent, model.across_only
    m = model.start.copy()
    p = initial_covariance(ends, ratio)
    log_s, squares, used = 0.0, 0.0, 0
    product = 1.0
    # whether the first innovations went into the unknown position and direction
    position_known, direction_known = False, False
    for i in range(len(u)):
        if i > 0:
            p = predict_covariance(p, transition[i], u[i] - u[i - 1])
            predict_mean(m, transition[i], m)
        if tangents is not None:
            variance = tangents[1][i] * inverse_intensity
            if variance > 0.0:
                s = p[4] + variance
                off = update_mean_by_tangent(p, m, tangents[0][i], variance)
                p = update_by_tangent(p, variance)
                used += 1
                if direction_known:
                    along = np.dot(off, curve_tangent[i]) if across_only else 0.0
                    log_s += math.log(s)
                    squares += (np.dot(off, off) - along * along) / s
                direction_known = True
        if weight[i] <= 0.0:
            continue
        s = p[0] + ratio / weight[i]
        v0, v1, v2 = y[i, 0] - m[0, 0], y[i, 1] - m[1, 0], y[i, 2] - m[2, 0]
        for j in range(4):
            k = p[j] / s
            m[0, j] += k * v0
            m[1, j] += k * v1
            m[2, j] += k * v2
        p = update_by_position(p, ratio / weight[i])
        used += 1
        if not (position_known and direction_known):
            direction_known, position_known = position_known or direction_known, True
            continue
        product *= s
        if product > 1e100 or product < 1e-100:
            log_s += math.log(product)
            product = 1.0
        if across_only:
            along = v0 * curve_tangent[i, 0] + v1 * curve_tangent[i, 1] + v2 * curve_tangent[i, 2]
            v0 -= along * curve_tangent[i, 0]
            v1 -= along * curve_tangent[i, 1]
            v2 -= along * curve_tangent[i, 2]
        squares += (v0 * v0 + v1 * v1 + v2 * v2) / s
        if len(out):
            root = math.sqrt(s)
            out[i, 0], out[i, 1], out[i, 2] = v0 / root, v1 / root, v2 / root
    va, vb, length = ends[2] * ratio, ends[3] * ratio, u[-1] - u[0]
    p, determinant, white = update_by_end(p, m, va, vb)
    for k in range(2):
        along = np.dot(white[k], curve_tangent[-1]) if across_only else 0.0
        squares += np.dot(white[k], white[k]) - along * along
    # the same determinant for a route of which no point was observed
    p22 = 2.0 * va + vb * length**2 + length**3 / 3.0
    p23, p33 = vb * length + length**2 / 2.0, 2.0 * vb + length
    log_s += math.log(product) + math.log(determinant) - math.log(p22 * p33 - p23 * p23)
    return log_s, squares, used - _DIFFUSE


def _criterion(model: FilterModel, variance: float, tangents: tuple | None, x: float) -> float:
    """-2 ln of the posterior of λ = 10^x, the noise known or put where it is likeliest; (21)."""
    ratio, dimensions = 10.0**x, 2 if model.across_only else 3
    log_s, squares, n = _innovations(model, variance, tangents, ratio)
    q = _intensity(squares, dimensions * n, ratio, variance)
    return dimensions * (n * math.log(q) + log_s) + squares / q + SEARCH.price_per_decade * x


def _innovations(
    model: FilterModel, variance: float, tangents: tuple | None, ratio: float
) -> tuple[float, float, int]:
    """Filter as `innovations` does, q following from λ and the noise where directions are sensed."""
    not_wanted = np.empty((0, 3))
    if tangents is None:
        return innovations(model, ratio, not_wanted, None, 0.0)
    return innovations(model, ratio, not_wanted, tangents, ratio / variance)


def _intensity(squares: float, values: int, ratio: float, variance: float) -> float:
    """Intensity that goes with a known noise variance, or the likeliest one above rounding."""
    least = PRIOR.rounding**2
    return variance / ratio if variance > 0.0 else max(squares / max(values, 1), least / ratio)


def best_ratio(
    model: FilterModel, variance: float, guess: float, tangents: tuple | None
) -> tuple[float, float, float, float, int]:
    """Smoothing ratio λ of greatest restricted likelihood, its intensity q, and `innovations` there.

    Parameters
    ----------
    model
        As `innovations` takes it.
    variance
        Known noise variance in units of the mean spacing, or 0 where it is unknown.
    guess
        λ to begin with; where it is not positive, everything from interpolation to one cubic through all
        points is tried.
    tangents
        As `innovations` takes them; the variance is not 0 then.
    """
    width = SEARCH.fine
    if guess > 0.0:
        x = min(max(math.log10(guess), SEARCH.least), SEARCH.most)
    else:
        x, width = SEARCH.least, SEARCH.coarse
        best = np.inf
        trial, top = SEARCH.least, min(8.0 * math.log10(len(model.u)) + 1.0, SEARCH.most)
        while trial <= top:
            value = _criterion(model, variance, tangents, trial)
            if value < best:
                x, best = trial, value
            trial += SEARCH.coarse
    left = _criterion(model, variance, tangents, x - width)
    middle = _criterion(model, variance, tangents, x)
    right = _criterion(model, variance, tangents, x + width)
    while True:
        while True:
            if left < middle and left <= right and x > SEARCH.least:
                x -= width
                left, middle, right = _criterion(model, variance, tangents, x - width), left, middle
            elif right < middle and x < SEARCH.most:
                x += width
                left, middle, right = middle, right, _criterion(model, variance, tangents, x + width)
            else:
                break
        if width <= SEARCH.fine:
            break
        width = max(0.5 * width, SEARCH.fine)
        left = _criterion(model, variance, tangents, x - width)
        right = _criterion(model, variance, tangents, x + width)
    bend = left - 2.0 * middle + right
    if bend > 0.0:
        x += min(max(0.5 * width * (left - right) / bend, -width), width)
    ratio = 10.0**x
    log_s, squares, n = _innovations(model, variance, tangents, ratio)
    values = (2 if model.across_only else 3) * n
    return ratio, _intensity(squares, values, ratio, variance), log_s, squares, n

"""The prior of a route that bends with it: how a state moves on, and what it is linearised along.

The prior says that the rate of the curvature vector, carried along without twist, wanders like Brownian
motion of intensity q and is drawn back against the curvature (docs/model.md (20)). With κ = 0 the posterior
mean is the smoothing spline of degree seven; with κ², κκ' and ω² from a previous pass circles and helices
cost nothing.

The state at a station is r, r' = T, T' = a, and b with a' = b - κ² T, b' = -κκ' T - ω² a + w. Transitions are
kept without the first column, which is that of the unit matrix: rows r, T, a, b on T, a, b.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.route.spline.filtering import FAST
from tssgeom.statistics import isotonic_regression


class SplinePrior(NamedTuple):
    """What the prior of a smooth route may follow. Lengths in spacings of the points."""

    sharpest: float = 1.5
    """Greatest turn from point to point that the prior follows [rad]; chosen."""
    change: float = 0.5
    """Greatest relative change of curvature, or turn of its plane [rad], from point to point; chosen."""
    noise_share: float = 0.375
    """Noise in the posterior variance of the curvature [1]; derived: 3/8, docs/model.md (24)."""
    least_bend: float = 1e-18
    """Least variance of a and b of (20) at both ends [spacing^-2, spacing^-4]; chosen: rounding."""
    rounding: float = 1e-6
    """Least noise [spacing]; chosen: less is rounding, not truth, to a filter of four states."""
    vague: float = 1e4
    """Variance of position and direction at the first station over that of the last pass or guess [1];
    chosen."""
    vague_bend: float = 4.0
    """Variance of a and b at both ends over that of the first guess [1]; chosen."""
    guess_points: int = 9
    """Points between whose chords the first guess of the curvature is taken [1]; chosen."""
    least_step: float = 1e-7
    """Least distance of neighbouring stations whose feet coincide [spacing]; chosen: rounding."""
    least_weight: float = 1e-6
    """Weight of an outlier where stations are put in order [1]; chosen: small, but not 0."""


PRIOR = SplinePrior()
_TERMS = 30  # of a Taylor series: beyond them no step that a route takes gains a digit


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


@njit(cache=True, nogil=True, error_model="numpy")
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
        kappa_square = min(max(square - 2.0 * PRIOR.noise_share * q * p22, 0.0), PRIOR.sharpest**2)
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
            (PRIOR.least_bend + 0.5 * bends) / noise,
            (PRIOR.least_bend + 0.5 * rates) / noise,
        ]
    )
    if known:
        return u, coupling, ends, tangent
    feet = isotonic_regression(feet, np.maximum(weight, PRIOR.least_weight))
    first = feet[0]
    for i in range(n):
        feet[i] += PRIOR.least_step * i - first
    return feet, coupling, ends, tangent

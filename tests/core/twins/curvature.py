"""Curvature and its errors in plain Python, as oracle of the core."""

from __future__ import annotations

import math

import numpy as np

from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_route import ANGLE_ERRORS as ERRORS

_SINGULAR = 1e-13


def _profile(
    s: np.ndarray,
    bend: np.ndarray,
    tangent: np.ndarray,
    covariance: np.ndarray,
    gain: np.ndarray,
    freedom: float,
    noise: float,
    known: bool,
    shared_angle_error: float,
    station: np.ndarray,
    tangent_share: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Curvature, angle, standard error of the curvature and variance of the angle at each node."""
    n = len(s)
    kappa, phi, se = np.empty(n), np.zeros(n), np.empty(n)
    rectified = np.zeros(n)
    share = _noise_share(freedom, tangent_share)
    excess, whole, peak, highest = 0.0, 0.0, 0, 0.0
    for i in range(n):
        square, v = bend[i, 0] ** 2 + bend[i, 1] ** 2 + bend[i, 2] ** 2, covariance[i, 7]
        kappa[i] = _without_noise(square, v * share)
        se[i] = math.sqrt(v)
        before, excess = excess, math.sqrt(square + v) - math.sqrt(square)
        if i > 0:
            h = s[i] - s[i - 1]
            phi[i] = phi[i - 1] + 0.5 * (kappa[i] + kappa[i - 1]) * h
            rectified[i] = rectified[i - 1] + 0.5 * ERRORS.rectified * (excess + before) * h
            rate = _rate(bend[i - 1], bend[i], tangent[i]) / (h * h)
            whole += rate / (n - 1)
            if rate > highest:
                peak, highest = i, rate
    window = s[n - 1] / max(freedom, ERRORS.few_parameters)
    lost = ERRORS.lost * max(math.sqrt(highest) - ERRORS.typical_peak * math.sqrt(whole), 0.0) * window**2
    turn = phi[n - 1] / (len(station) - 1)
    relative = shared_angle_error**2 + (ERRORS.natural_ends * turn**4 + ROUNDING.relative) ** 2
    uneven = ERRORS.sparse * _uneven_turns(s, phi, station) / max(phi[n - 1], 1e-300)
    relative += min(uneven, ERRORS.most_sparse) ** 2
    normal, slant = _sensitivity(bend, tangent, known)
    variance, _ = _angle_covariance(s, covariance, gain, normal, slant, np.array([0, n - 1]))
    factor = _unknown_prior(freedom)
    for i in range(1, n):
        variance[i] = variance[i] * factor + relative * phi[i] ** 2 + rectified[i] ** 2
        if not known:
            variance[i] += noise**2 * (kappa[0] ** 2 + kappa[i] ** 2)
        if i >= peak:
            variance[i] += lost**2
    return kappa, phi, se, variance


def _uneven_turns(s: np.ndarray, phi: np.ndarray, station: np.ndarray) -> float:
    """Sum up what the turn from point to point changes by, times its fourth power [rad⁵]."""
    total, before, reached, k = 0.0, -1.0, 0.0, 0
    for i in range(1, len(station)):
        while k < len(s) - 1 and s[k] < station[i]:
            k += 1
        turn, reached = phi[k] - reached, phi[k]
        if before >= 0.0:
            square = max(turn, before) ** 2
            total += abs(turn - before) * square * square
        before = turn
    return total


def _bridge(
    s: np.ndarray,
    tangent: np.ndarray,
    station: np.ndarray,
    kappa: np.ndarray,
    phi: np.ndarray,
    variance: np.ndarray,
) -> None:
    """Where points are missing, go halfway from the spline's angle to the least that the ends need.

    What lies in a wide interval is a guess, and a smooth prior swings: anything between the two is as likely.
    The arrays are changed in place; docs/model.md (26).
    """
    longest = ERRORS.unobserved * station[-1] / (len(station) - 1)
    for i in range(1, len(station)):
        if station[i] - station[i - 1] < longest:
            continue
        first, last = np.searchsorted(s, station[i - 1]), np.searchsorted(s, station[i])
        last = min(last, len(s) - 1)
        turn, least, along = phi[last] - phi[first], 0.0, 0.0
        for c in range(3):
            along += tangent[first, c] * tangent[last, c]
        least = math.acos(min(max(along, -1.0), 1.0))
        share = max(0.5 * (turn + least), least) / max(turn, 1e-300)
        se, begun = abs(turn - least) / math.sqrt(12.0), phi[first]
        for k in range(first, len(s)):
            part = min((s[k] - s[first]) / (s[last] - s[first]), 1.0)
            variance[k] += (part * se) ** 2
            if k <= last:
                kappa[k] *= share
                phi[k] = begun + share * (phi[k] - begun)
            else:
                phi[k] += (share - 1.0) * turn


def _rate(before: np.ndarray, here: np.ndarray, tangent: np.ndarray) -> float:
    """Square of the change of the curvature vector across the tangent."""
    square, along = 0.0, 0.0
    for c in range(3):
        change = here[c] - before[c]
        square += change * change
        along += change * tangent[c]
    return max(square - along * along, 0.0)


def _sensitivity(bend: np.ndarray, tangent: np.ndarray, known: bool) -> tuple[np.ndarray, np.ndarray]:
    """Change dφ/ds by an error of a, and by one of T: with known stations a faster curve turns less."""
    normal, slant = np.empty_like(bend), np.empty_like(bend)
    power = 2.0 if known else 1.0
    for i in range(len(bend)):
        kappa = math.sqrt(bend[i, 0] ** 2 + bend[i, 1] ** 2 + bend[i, 2] ** 2)
        for c in range(3):
            normal[i, c] = bend[i, c] / (kappa + 1e-300)
            slant[i, c] = -power * kappa * tangent[i, c]
    return normal, slant


def _unknown_prior(freedom: float) -> float:
    """Factor on variances for a prior that was itself estimated from few parameters; docs/model.md (26)."""
    return 1.0 + (ERRORS.few_parameters / freedom) ** 2


def _noise_share(freedom: float, tangent_share: float) -> float:
    """Part of the posterior variance of the curvature that is noise; docs/model.md (24), (93)."""
    least = 3.0 + tangent_share
    return (least + (8.0 - least) * min(3.0 / freedom, 1.0) ** 2) / 8.0


def _without_noise(square: float, noise: float) -> float:
    """Magnitude of the curvature vector less what noise adds to its square; docs/model.md (25).

    Well above the noise only the component across the bend lengthens the vector; near zero both do.
    """
    components = 1.0 + 2.0 * noise / (square + 2.0 * noise + 1e-300)
    return math.sqrt(max(square - components * noise, 0.0))


def _times_triangle(g: np.ndarray, p: np.ndarray, out: np.ndarray) -> None:
    """Put g p into `out`, for full g [4, 4] and triangle p [10]."""
    for j in range(4):
        x0, x1, x2, x3 = g[j, 0], g[j, 1], g[j, 2], g[j, 3]
        out[j, 0] = x0 * p[0] + x1 * p[1] + x2 * p[2] + x3 * p[3]
        out[j, 1] = x0 * p[1] + x1 * p[4] + x2 * p[5] + x3 * p[6]
        out[j, 2] = x0 * p[2] + x1 * p[5] + x2 * p[7] + x3 * p[8]
        out[j, 3] = x0 * p[3] + x1 * p[6] + x2 * p[8] + x3 * p[9]


def _forward(cross: np.ndarray, p: np.ndarray, out: np.ndarray) -> None:
    """Put cross' p^-1 into `out`: how the next state follows from this one, all points given."""
    l00 = math.sqrt(p[0])
    l10, l20, l30 = p[1] / l00, p[2] / l00, p[3] / l00
    l11 = math.sqrt(max(p[4] - l10 * l10, _SINGULAR * p[4]))
    l21, l31 = (p[5] - l20 * l10) / l11, (p[6] - l30 * l10) / l11
    l22 = math.sqrt(max(p[7] - l20 * l20 - l21 * l21, _SINGULAR * p[7]))
    l32 = (p[8] - l30 * l20 - l31 * l21) / l22
    l33 = math.sqrt(max(p[9] - l30 * l30 - l31 * l31 - l32 * l32, _SINGULAR * p[9]))
    i00, i11, i22, i33 = 1.0 / l00, 1.0 / l11, 1.0 / l22, 1.0 / l33
    for j in range(4):
        z0 = cross[0, j] * i00
        z1 = (cross[1, j] - l10 * z0) * i11
        z2 = (cross[2, j] - l20 * z0 - l21 * z1) * i22
        z3 = (cross[3, j] - l30 * z0 - l31 * z1 - l32 * z2) * i33
        x3 = z3 * i33
        x2 = (z2 - l32 * x3) * i22
        x1 = (z1 - l21 * x2 - l31 * x3) * i11
        out[j, 3], out[j, 2], out[j, 1] = x3, x2, x1
        out[j, 0] = (z0 - l10 * x1 - l20 * x2 - l30 * x3) * i00


def _angle_covariance(
    s: np.ndarray,
    covariance: np.ndarray,
    gain: np.ndarray,
    normal: np.ndarray,
    slant: np.ndarray,
    breaks: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Carry the covariance of the state with every piece's angle along the route (a Markov process).

    An error of the curve changes dφ/ds by normal times that of a, plus slant times that of T.
    """
    n, pieces = len(s), len(breaks) - 1
    variance, out = np.zeros(n), np.zeros((pieces, pieces))
    with_state = np.zeros((pieces, 3, 4))  # of each piece's angle so far with the state, by coordinate
    cross, forward, carried = np.empty((4, 4)), np.empty((4, 4)), np.empty(4)
    m = 0
    for k in range(1, n):
        while k > breaks[m + 1]:
            m += 1
        p, q = covariance[k - 1], covariance[k]
        _times_triangle(gain[k - 1], q, cross)
        _forward(cross, p, forward)
        half = 0.5 * (s[k] - s[k - 1])
        total = 0.0
        for c in range(3):
            a, b = half * slant[k - 1, c], half * normal[k - 1, c]
            d, e = half * slant[k, c], half * normal[k, c]
            total += a * a * p[4] + 2.0 * a * b * p[5] + b * b * p[7]
            total += d * d * q[4] + 2.0 * d * e * q[5] + e * e * q[7]
            total += 2.0 * (a * (d * cross[1, 1] + e * cross[1, 2]) + b * (d * cross[2, 1] + e * cross[2, 2]))
        out[m, m] += total
        for j in range(m + 1):
            shared = 0.0
            for c in range(3):
                a, b = half * slant[k - 1, c], half * normal[k - 1, c]
                d, e = half * slant[k, c], half * normal[k, c]
                w = with_state[j, c]
                for i in range(4):
                    f = forward[i]
                    carried[i] = f[0] * w[0] + f[1] * w[1] + f[2] * w[2] + f[3] * w[3]
                shared += a * w[1] + b * w[2] + d * carried[1] + e * carried[2]
                if j == m:
                    carried[0] += a * cross[1, 0] + b * cross[2, 0] + d * q[1] + e * q[2]
                    carried[1] += a * cross[1, 1] + b * cross[2, 1] + d * q[4] + e * q[5]
                    carried[2] += a * cross[1, 2] + b * cross[2, 2] + d * q[5] + e * q[7]
                    carried[3] += a * cross[1, 3] + b * cross[2, 3] + d * q[6] + e * q[8]
                w[0], w[1], w[2], w[3] = carried[0], carried[1], carried[2], carried[3]
            total += 2.0 * shared
            out[j, m] += shared
            out[m, j] += shared
        variance[k] = max(variance[k - 1] + total, 0.0)
    return variance, out


def _length_variance(s: np.ndarray, bend: np.ndarray, covariance: np.ndarray, gain: np.ndarray) -> float:
    """Variance of the length between the ends, from the covariance of all positions, node by node."""
    n, full = len(s), np.empty((len(s), 4, 4))
    for k in range(n):
        full[k][np.triu_indices(4)] = covariance[k]
        full[k] = np.triu(full[k]) + np.triu(full[k], 1).T
    step = np.diff(s)
    weight = np.concatenate(([0.0], step)) + np.concatenate((step, [0.0]))
    weight = 0.5 * weight[:, None] * bend
    positions = np.empty((n, n))
    for j in range(n):
        between = full[j]
        for i in range(j, -1, -1):
            if i < j:
                between = gain[i] @ between
            positions[i, j] = positions[j, i] = between[0, 0]
    return float(np.einsum("ic,ij,jc->", weight, positions, weight))

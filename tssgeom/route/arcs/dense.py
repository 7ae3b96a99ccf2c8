"""Normal equations of a few dozen parameters: solved and inverted by Cholesky, each in its own unit."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

LEAST_INFORMATION = 1e-13
"""Least information on a parameter beside the others, of its own [1]: below it the others determine all of
it, but for rounding."""


@njit(cache=True, nogil=True)
def factor(matrix: np.ndarray, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """Cholesky factor [m, m] of the matrix scaled to unit diagonal plus `damping`, and the units [m]."""
    m = len(matrix)
    lower, unit = np.zeros((m, m)), np.empty(m)
    for a in range(m):
        unit[a] = 1.0 / math.sqrt(max(matrix[a, a], 1e-30))
    for a in range(m):
        for b in range(a + 1):
            rest = matrix[a, b] * unit[a] * unit[b]
            for c in range(b):
                rest -= lower[a, c] * lower[b, c]
            if a == b:
                lower[a, a] = math.sqrt(max(rest + damping, LEAST_INFORMATION))
            else:
                lower[a, b] = rest / lower[b, b]
    return lower, unit


@njit(cache=True, nogil=True)
def solve(lower: np.ndarray, unit: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve the factored equations for one right-hand side [m]."""
    m = len(right)
    x = np.empty(m)
    for a in range(m):
        x[a] = right[a] * unit[a]
        for c in range(a):
            x[a] -= lower[a, c] * x[c]
        x[a] /= lower[a, a]
    for a in range(m - 1, -1, -1):
        for c in range(a + 1, m):
            x[a] -= lower[c, a] * x[c]
        x[a] /= lower[a, a]
    for a in range(m):
        x[a] *= unit[a]
    return x


@njit(cache=True, nogil=True)
def inverse(lower: np.ndarray, unit: np.ndarray) -> np.ndarray:
    """Inverse of the factored matrix [m, m]."""
    m = len(lower)
    root = np.zeros((m, m))  # of the inverse: lower^-1
    for b in range(m):
        root[b, b] = 1.0 / lower[b, b]
        for a in range(b + 1, m):
            total = 0.0
            for c in range(b, a):
                total += lower[a, c] * root[c, b]
            root[a, b] = -total / lower[a, a]
    out = np.empty((m, m))
    for a in range(m):
        for b in range(a + 1):
            total = 0.0
            for c in range(a, m):
                total += root[c, a] * root[c, b]
            out[a, b] = total * unit[a] * unit[b]
            out[b, a] = out[a, b]
    return out


@njit(cache=True, nogil=True)
def propagated(lower: np.ndarray, unit: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Covariance [r, r] of r values of gradient [r, m], by the inverse of the factored matrix [m, m]."""
    r, m = gradient.shape
    half, share = np.empty((r, m)), 1.0 / np.diag(lower)
    for i in range(r):
        for a in range(m):
            value = gradient[i, a] * unit[a]
            for c in range(a):
                value -= lower[a, c] * half[i, c]
            half[i, a] = value * share[a]
    out = np.empty((r, r))
    for i in range(r):
        for j in range(i + 1):
            total = 0.0
            for a in range(m):
                total += half[i, a] * half[j, a]
            out[i, j] = out[j, i] = total
    return out


@njit(cache=True, nogil=True)
def saved_by_more(
    lower: np.ndarray,
    unit: np.ndarray,
    gradient: np.ndarray,
    cross: np.ndarray,
    own: np.ndarray,
    slope: np.ndarray,
) -> float:
    """Return what d more parameters save of the cost, the m factored ones fitted with them.

    Parameters
    ----------
    lower, unit, gradient
        Factor of the m parameters and their gradient [m], near zero where they are at their best.
    cross, own, slope
        Information between the m and the d parameters [m, d], of the d among themselves [d, d], and their
        gradient [d].
    """
    left, rest = schur_complement(lower, unit, gradient, cross, own, slope)
    step = solve(*factor(left, 1e-12), rest)
    saved = 0.0
    for e in range(len(rest)):
        saved += step[e] * rest[e]
    return saved


@njit(cache=True, nogil=True)
def schur_complement(
    lower: np.ndarray,
    unit: np.ndarray,
    gradient: np.ndarray,
    cross: np.ndarray,
    own: np.ndarray,
    slope: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return information [d, d] and gradient [d] of d more parameters, the m factored ones fitted with them.

    Parameters as in `saved_by_more`.
    """
    m, d = cross.shape
    half, left, rest = np.empty((m, d + 1)), own.copy(), slope.copy()
    for e in range(d + 1):
        for a in range(m):
            value = (cross[a, e] if e < d else gradient[a]) * unit[a]
            for c in range(a):
                value -= lower[a, c] * half[c, e]
            half[a, e] = value / lower[a, a]
    for e in range(d):
        for a in range(m):
            rest[e] -= half[a, e] * half[a, d]
            for f in range(d):
                left[e, f] -= half[a, e] * half[a, f]
        left[e, e] = max(left[e, e], 1e-12 * own[e, e])
    return left, rest

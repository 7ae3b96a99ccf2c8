"""How much the curvature rate wanders: the smoothing ratio of greatest restricted likelihood."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tssgeom.shape.filtering import FAST, innovations

_COARSE = 2.0  # decades of λ between the first trials
_FINE = 0.4  # half width of the last parabola in decades: a twentieth of the smoother's window
_LEAST = -8.0
_MOST = 20.0
_ROUNDING = 1e-12  # variance of points that are exact, in units of the spacing
_WIGGLY = 1.0  # -2 ln of the prior of λ by decade: no route is taken for exactly linear in curvature


@njit(**FAST)
def _criterion(
    u: np.ndarray,
    y: np.ndarray,
    weight: np.ndarray,
    step: np.ndarray,
    start: np.ndarray,
    ends: np.ndarray,
    tangent: np.ndarray,
    planar: bool,
    variance: float,
    x: float,
) -> float:
    """-2 ln of the posterior of λ = 10^x, the noise known or put where it is likeliest; (21)."""
    ratio, dimensions = 10.0**x, 2 if planar else 3
    log_s, squares, n = innovations(u, y, weight, step, start, ends, tangent, planar, ratio, np.empty((0, 3)))
    q = _intensity(squares, dimensions * n, ratio, variance)
    return dimensions * (n * math.log(q) + log_s) + squares / q + _WIGGLY * x


@njit(**FAST)
def _intensity(squares: float, values: int, ratio: float, variance: float) -> float:
    """Intensity that goes with a known noise variance, or the likeliest one above rounding."""
    return variance / ratio if variance > 0.0 else max(squares / max(values, 1), _ROUNDING / ratio)


@njit(**FAST)
def best_ratio(
    u: np.ndarray,
    y: np.ndarray,
    weight: np.ndarray,
    step: np.ndarray,
    start: np.ndarray,
    ends: np.ndarray,
    tangent: np.ndarray,
    planar: bool,
    variance: float,
    guess: float,
) -> tuple[float, float, float, float, int]:
    """Smoothing ratio λ of greatest restricted likelihood, its intensity q, and `innovations` there.

    Parameters
    ----------
    u, y, weight, step, start, ends, tangent, planar
        As `innovations` takes them.
    variance
        Known noise variance in units of the mean spacing, or 0 where it is unknown.
    guess
        λ to begin with; where it is not positive, everything from interpolation to one cubic through all
        points is tried.
    """
    given = (u, y, weight, step, start, ends, tangent, planar, variance)
    width = _FINE
    if guess > 0.0:
        x = min(max(math.log10(guess), _LEAST), _MOST)
    else:
        x, width = _LEAST, _COARSE
        best = np.inf
        trial, top = _LEAST, min(8.0 * math.log10(len(u)) + 1.0, _MOST)
        while trial <= top:
            value = _criterion(*given, trial)
            if value < best:
                x, best = trial, value
            trial += _COARSE
    left, middle, right = _criterion(*given, x - width), _criterion(*given, x), _criterion(*given, x + width)
    while True:
        for _ in range(40):
            if left < middle and left <= right and x > _LEAST:
                x -= width
                left, middle, right = _criterion(*given, x - width), left, middle
            elif right < middle and x < _MOST:
                x += width
                left, middle, right = middle, right, _criterion(*given, x + width)
            else:
                break
        if width <= _FINE:
            break
        width = max(0.5 * width, _FINE)
        left, right = _criterion(*given, x - width), _criterion(*given, x + width)
    bend = left - 2.0 * middle + right
    if bend > 0.0:
        x += min(max(0.5 * width * (left - right) / bend, -width), width)
    ratio = 10.0**x
    log_s, squares, n = innovations(u, y, weight, step, start, ends, tangent, planar, ratio, np.empty((0, 3)))
    return ratio, _intensity(squares, (2 if planar else 3) * n, ratio, variance), log_s, squares, n

"""How much the curvature rate wanders: the smoothing ratio of greatest restricted likelihood."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from tssgeom.route.spline.filtering import FAST, innovations

_COARSE = 2.0  # decades of λ between the first trials
_FINE = 0.4  # half width of the last parabola in decades: a twentieth of the smoother's window
_LEAST = -8.0
_MOST = 20.0
_ROUNDING = 1e-12  # variance of points that are exact, in units of the spacing
_NOISE_STEP = 1.0  # ln of the noise variance between the first trials
_NOISES = tuple(math.log(10.0**-k) for k in (10, 8, 6, 5, 4, 3, 2))  # first trials, in units of the spacing
_NOISE_SETTLED = 0.05
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
    aim: np.ndarray | None,
    blur: np.ndarray | None,
    x: float,
) -> float:
    """-2 ln of the posterior of λ = 10^x, the noise known or put where it is likeliest; (21)."""
    ratio, dimensions = 10.0**x, 2 if planar else 3
    log_s, squares, n = _innovations(
        u, y, weight, step, start, ends, tangent, planar, variance, aim, blur, ratio
    )
    q = _intensity(squares, dimensions * n, ratio, variance)
    return dimensions * (n * math.log(q) + log_s) + squares / q + _WIGGLY * x


@njit(**FAST)
def _innovations(
    u: np.ndarray,
    y: np.ndarray,
    weight: np.ndarray,
    step: np.ndarray,
    start: np.ndarray,
    ends: np.ndarray,
    tangent: np.ndarray,
    planar: bool,
    variance: float,
    aim: np.ndarray | None,
    blur: np.ndarray | None,
    ratio: float,
) -> tuple[float, float, int]:
    """Filter as `innovations` does, q following from λ and the noise where directions are sensed."""
    none = np.empty((0, 3))
    if blur is None:
        return innovations(u, y, weight, step, start, ends, tangent, planar, ratio, none)
    per_q = ratio / variance
    return innovations(u, y, weight, step, start, ends, tangent, planar, ratio, none, aim, blur, per_q)


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
    aim: np.ndarray | None = None,
    blur: np.ndarray | None = None,
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
    aim, blur
        As `innovations` takes them; the variance is not 0 then.
    """
    given = (u, y, weight, step, start, ends, tangent, planar, variance, aim, blur)
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
    log_s, squares, n = _innovations(*given, ratio)
    return ratio, _intensity(squares, (2 if planar else 3) * n, ratio, variance), log_s, squares, n


def best_noise(
    given: tuple[Any, ...], likely: float, guess: float, aim: np.ndarray, blur: np.ndarray
) -> tuple[float, float, float, float, int]:
    """λ and q where they are likeliest beside directions of known noise; docs/model.md (92).

    Parameters
    ----------
    given
        u, y, weight, step, start, ends, tangent, planar, as `innovations` takes them.
    likely
        Noise variance to begin with, of which `ends` are multiples.
    guess, aim, blur
        As `best_ratio` takes them.

    Returns
    -------
    As `best_ratio`.
    """
    u, y, weight, step, start, ends, tangent, planar = given
    dimensions = 2 if planar else 3

    def at(x: float, guess: float) -> tuple[float, tuple[float, float, float, float, int]]:
        variance = math.exp(x)
        own = ends * (likely / variance)
        found = best_ratio(u, y, weight, step, start, own, tangent, planar, variance, guess, aim, blur)
        ratio, q, log_s, squares, n = found
        return dimensions * (n * math.log(q) + log_s) + squares / q + _WIGGLY * math.log10(ratio), found

    x, width = math.log(likely), _NOISE_STEP
    if guess <= 0.0:
        x = min((x, *_NOISES), key=lambda trial: at(trial, 0.0)[0])
    least, best = at(x, guess)
    while width > _NOISE_SETTLED:
        trials = [(*at(x + way * width, best[0]), x + way * width) for way in (-1.0, 1.0)]
        value, found, there = min(trials, key=lambda trial: trial[0])
        if value < least and there > math.log(_ROUNDING):
            x, least, best = there, value, found
        else:
            width *= 0.4
    return best

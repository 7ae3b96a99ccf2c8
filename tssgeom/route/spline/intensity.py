"""How much the curvature rate wanders: the smoothing ratio of greatest restricted likelihood."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.route.spline.filtering import FAST, FilterModel, SensedTangents, innovations
from tssgeom.route.spline.prior import PRIOR


class RatioSearch(NamedTuple):
    """Where the smoothing ratio λ is searched, and how closely. λ in decades, of units of the spacing."""

    least: float = -8.0
    """Least λ [decades]: interpolation; chosen."""
    most: float = 20.0
    """Greatest λ [decades]: one cubic through a thousand points and more; chosen."""
    coarse: float = 2.0
    """Distance of the first trials [decades]; chosen."""
    fine: float = 0.4
    """Half width of the last parabola [decades]; derived: a twentieth of the smoother's window."""
    steps: int = 40
    """Most steps of one width [1]; derived: more than there are on the whole range."""
    price_per_decade: float = 1.0
    """-2 ln of the prior of λ by decade [1]; chosen: no route is taken for exactly linear in curvature."""
    first_noise: tuple[float, ...] = tuple(math.log(10.0**-k) for k in (10, 8, 6, 5, 4, 3, 2))
    """First trials of the noise variance beside directions [ln spacing²]; chosen."""
    noise_step: float = 1.0
    """Distance of the next trials of it [ln]; chosen."""
    noise_converged: float = 0.05
    """Distance at which its search ends [ln]; chosen: 2.5 % of the standard deviation."""


SEARCH = RatioSearch()


@njit(**FAST)
def _criterion(model: FilterModel, variance: float, tangents: SensedTangents | None, x: float) -> float:
    """-2 ln of the posterior of λ = 10^x, the noise known or put where it is likeliest; (21)."""
    ratio, dimensions = 10.0**x, 2 if model.across_only else 3
    log_s, squares, n = _innovations(model, variance, tangents, ratio)
    q = _intensity(squares, dimensions * n, ratio, variance)
    return dimensions * (n * math.log(q) + log_s) + squares / q + SEARCH.price_per_decade * x


@njit(**FAST)
def _innovations(
    model: FilterModel, variance: float, tangents: SensedTangents | None, ratio: float
) -> tuple[float, float, int]:
    """Filter as `innovations` does, q following from λ and the noise where directions are sensed."""
    not_wanted = np.empty((0, 3))
    if tangents is None:
        return innovations(model, ratio, not_wanted, None, 0.0)
    return innovations(model, ratio, not_wanted, tangents, ratio / variance)


@njit(**FAST)
def _intensity(squares: float, values: int, ratio: float, variance: float) -> float:
    """Intensity that goes with a known noise variance, or the likeliest one above rounding."""
    least = PRIOR.rounding**2
    return variance / ratio if variance > 0.0 else max(squares / max(values, 1), least / ratio)


@njit(**FAST)
def best_ratio(
    model: FilterModel, variance: float, guess: float, tangents: SensedTangents | None
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
        for _ in range(SEARCH.steps):
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


def best_noise(
    model: FilterModel, likely: float, guess: float, tangents: SensedTangents
) -> tuple[float, float, float, float, int]:
    """λ and q where they are likeliest beside directions of known noise; docs/model.md (92).

    Parameters
    ----------
    model
        As `innovations` takes it.
    likely
        Noise variance to begin with, of which `model.ends` are multiples.
    guess, tangents
        As `best_ratio` takes them.

    Returns
    -------
    As `best_ratio`.
    """
    dimensions = 2 if model.across_only else 3

    def at(x: float, guess: float) -> tuple[float, tuple[float, float, float, float, int]]:
        variance = math.exp(x)
        own = model._replace(ends=model.ends * (likely / variance))
        best = best_ratio(own, variance, guess, tangents)
        ratio, q, log_s, squares, n = best
        deviance = dimensions * (n * math.log(q) + log_s) + squares / q
        return deviance + SEARCH.price_per_decade * math.log10(ratio), best

    x, width = math.log(likely), SEARCH.noise_step
    if guess <= 0.0:
        x = min((x, *SEARCH.first_noise), key=lambda trial: at(trial, 0.0)[0])
    least, best = at(x, guess)
    while width > SEARCH.noise_converged:
        trials = [(*at(x + way * width, best[0]), x + way * width) for way in (-1.0, 1.0)]
        value, trial, there = min(trials, key=lambda trial: trial[0])
        if value < least and there > math.log(PRIOR.rounding**2):
            x, least, best = there, value, trial
        else:
            width *= 0.4
    return best

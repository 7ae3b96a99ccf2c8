"""One route sensed several times: its angle, and the size and length of the errors; docs/model.md (165)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.fft import dct, idct
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from tssgeom.arrays import Matrix, Points, Vector, read_only, rows_at
from tssgeom.core.constants_route import STAIRCASE
from tssgeom.errors import ShapeError
from tssgeom.route.error_posterior import GRID
from tssgeom.route.resolution import LIMITS as RESOLUTION
from tssgeom.route.resolution import at_resolution, left_of_waves, sampled_bend
from tssgeom.route.route_fit import RouteFit, SharedErrors


@dataclass(frozen=True, slots=True)
class RepeatLimits:
    """How repeated lines are compared."""

    smoothing: int = 9
    """Neighbouring waves over which the power of the errors is averaged. Chosen."""
    most_difference: float = 0.1
    """Difference of two lengths over their mean above which lines are of different routes [1]. Chosen."""
    least_agreement: float = 0.5
    """Correlation of two bends at the coarsest resolution below which they are. Chosen."""

    @property
    def tried(self) -> int:
        """Resolutions, from the shortest errors that are alike to the longest: four to an octave."""
        return 1 + round(4.0 * math.log2(GRID.longest / GRID.shortest))


LIMITS = RepeatLimits()


class Repeated(NamedTuple):
    """What lines of one route have in common, and how they differ."""

    line: int
    """The line that stands for all: of those that run as the first one, that of the most usual length."""
    fit: RouteFit
    """Its fit with the angle of all."""
    shared: SharedErrors
    """Variances beside those of the fit."""
    error: float
    """Root mean square error of a coordinate of one line [m]."""
    error_length: float
    """Distance over which errors are alike [m]."""


def common_route(fits: Sequence[RouteFit]) -> Repeated:
    """Estimate a route and the errors of its lines from several of them; model.md (165).

    Lines may run either way, and each may have coordinates of its own.

    Parameters
    ----------
    fits
        A fit to each line, which covers the route from end to end [k >= 2].

    Raises
    ------
    ShapeError
        Where there is one line only, or where their lengths or bends differ too much to be one route.
    """
    if len(fits) < 2:
        raise ShapeError("one line of the route: give two or more, each sensed by itself")
    length = np.array([fit.arcs.total_length for fit in fits])
    mean_length = float(length.mean())
    turn, reversed_ = _aligned([sampled_bend(fit) * fit.arcs.total_length for fit in fits], length)
    power = _error_power(turn)
    mean = turn.mean(axis=0)
    rng = np.random.default_rng(0)
    draws = rng.standard_normal((GRID.draws, *mean.shape)) * np.sqrt(power / len(fits))[:, None]
    share = np.geomspace(GRID.shortest, GRID.longest, LIMITS.tried)
    angle = np.array([_angle(mean, at) for at in share])
    noisy = np.array([[_angle(mean + one, at) for one in draws] for at in share])
    bias, spread = noisy.mean(axis=1) - angle, noisy.std(axis=1)
    corrected = np.maximum(angle - bias, 0.0)
    over = [
        np.interp(np.log(share * x), np.log(share), corrected)
        for x in (1 / RESOLUTION.octave, RESOLUTION.octave)
    ]
    square = spread**2 + bias**2 + (over[0] - over[1]) ** 2
    own = sum(fit.arcs.total_angle_se**2 for fit in fits) / len(fits) ** 2  # few may agree
    square = np.maximum(square, own) * (len(fits) / (len(fits) - 1))
    best = int(np.argmin(square))
    line = int(np.argmin(np.where(reversed_, np.inf, np.abs(length - mean_length))))
    fit, _ = at_resolution(fits[line], float(share[best]) * mean_length)
    fit = _with_total(fit, float(corrected[best]))
    of_length = float(length.var(ddof=1)) / len(fits)
    error, error_length = _differences(fits, reversed_)
    return Repeated(line, fit, SharedErrors(float(square[best]), of_length), error, error_length)


def _with_total(fit: RouteFit, angle: float) -> RouteFit:
    """Return a fit whose angles add up to another one [rad], and without errors of its own of them."""
    share = angle / max(fit.arcs.total_angle, 1e-12)
    k = len(fit.arcs.length)
    covariance = np.array(fit.arcs.covariance)
    covariance[k:] = 0.0
    covariance[:, k:] = 0.0
    turned = read_only(fit.arcs.angle * share)
    arcs = replace(
        fit.arcs, angle=turned, covariance=read_only(covariance), form_variance=0.0, model_variance=0.0
    )
    return fit.scaled(share, arcs)


def _aligned(turn: Sequence[Matrix], length: Vector) -> tuple[Matrix, list[bool]]:
    """Turn the bends of all lines to that of the first; returns their waves [k, n, 2], and which run back."""
    first = _waves(turn[0])
    waves, back = [first], [False]
    coarse = left_of_waves(len(first), GRID.longest)[:, None] ** 2
    for i, one in enumerate(turn[1:], start=1):
        if abs(length[i] - length[0]) > LIMITS.most_difference * float(length.mean()):
            raise ShapeError(
                f"line {i + 1} is {1e3 * length[i]:.4g} mm long, the first {1e3 * length[0]:.4g} mm: "
                "give lines of one route, from end to end"
            )
        ways = [
            _rotated(_waves(one), first, coarse),
            _rotated(_waves(one[::-1] * (1.0, -1.0)), first, coarse),
        ]
        agreement, best = max(ways, key=lambda way: way[0])
        if agreement < LIMITS.least_agreement and float(np.linalg.norm(first)) > 0.0:
            raise ShapeError(
                f"line {i + 1} bends otherwise than the first (correlation {agreement:.2f}): give lines of "
                "one route, from end to end"
            )
        waves.append(best)
        back.append(agreement == ways[1][0])
    return np.array(waves), back


def _rotated(waves: Matrix, first: Matrix, weight: Matrix) -> tuple[float, Matrix]:
    """Rotate both components alike to those of the first line; returns also the correlation of both."""
    a, b = weight * waves, weight * first
    along, aside = float(np.sum(a * b)), float(a[:, 0] @ b[:, 1] - a[:, 1] @ b[:, 0])
    size = math.hypot(along, aside)
    c, s = (along / size, aside / size) if size > 0.0 else (1.0, 0.0)
    correlation = size / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-300)
    return correlation, waves @ np.array([[c, s], [-s, c]])


def _error_power(turn: Matrix) -> Vector:
    """Power of the errors of one line in each wave, from the differences of the lines [n]."""
    square = np.sum((turn - turn.mean(axis=0)) ** 2, axis=(0, 2)) / (2 * (len(turn) - 1))
    smooth = uniform_filter1d(square, LIMITS.smoothing, mode="nearest")
    return np.maximum(smooth, 0.0)  # rounding may leave less than none


def _waves(turn: Matrix) -> Matrix:
    return np.asarray(dct(turn, axis=0, norm="ortho"))


def _angle(waves: Matrix, share: float) -> float:
    kept = np.asarray(idct(waves * left_of_waves(len(waves), share)[:, None], axis=0, norm="ortho"))
    return float(np.linalg.norm(kept, axis=1).mean())


def _differences(fits: Sequence[RouteFit], back: Sequence[bool]) -> tuple[float, float]:
    """Root mean square of the errors of a coordinate, and the distance over which they are alike [m]."""
    lines = [_even(fit)[::-1] if run_back else _even(fit) for fit, run_back in zip(fits, back, strict=True)]
    first = lines[0] - lines[0].mean(axis=0)
    moved = [first]
    for line in lines[1:]:
        centred = line - line.mean(axis=0)
        moved.append(Rotation.align_vectors(first, centred)[0].apply(centred))
    off = np.array(moved) - np.mean(moved, axis=0)
    k, n = off.shape[:2]
    error = math.sqrt(float(np.sum(off**2)) / (3 * n * (k - 1)))
    power = np.abs(np.fft.fft(off, 2 * n, axis=1)) ** 2
    correlation = np.fft.ifft(power.sum(axis=(0, 2))).real[:n]
    correlation /= max(float(correlation[0]), 1e-300)
    ends = np.flatnonzero(correlation < math.exp(-0.5))
    step = fits[0].arcs.total_length / n
    return error, step * float(ends[0] if len(ends) else n)


def _even(fit: RouteFit) -> Points:
    route = fit.route
    at = np.linspace(0.0, float(route.s[-1]), STAIRCASE.most_cells)
    return rows_at(at, route.s, route.position)

"""What the curvature of a route may do between few points, a priori; docs/model.md (229), (235)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import CHANCE
from tssgeom.route.error_posterior import GRID


@dataclass(frozen=True, slots=True)
class Oscillation:
    """Which waves of the curvature are tried."""

    typical: float = 6.0
    """Half waves over a route [1]. Chosen: routes of tendons have two to twelve bends."""
    decades: float = 0.3
    """Standard deviation of their logarithm [decades]. Chosen: 1.5 to 24 in nineteen of twenty routes."""
    sharper: float = 1e3
    """Intensity of the rate of the curvature over that of the curvature [1]. Derived: waves of a fifth of the
    route."""
    coherent: float = 2.0
    """Waves over which amplitude and phase are alike [1]. Chosen: arcs that alternate differ in size."""


OSCILLATION = Oscillation()
_FEWEST = 2.0  # half waves over the route: bends that alternate are two at least
_MOST = 2.0  # half waves from point to point, where a route may bend to one side and back
_FORMS = (math.pi / 4.0, 1.0, math.pi**2 / 8.0)
"""Turn of bends that alternate over that of a sine of the same first harmonic, each as likely: at points
alone, a sine, arcs [1]; docs/model.md (254)."""
_BETWEEN = 4.0 / (4.0 - math.pi)
"""What a sine turns, over what it turns more than its chords from bend to bend [1]."""
_THIRD = 1.0 / 27.0
"""Third harmonic of the route over the first one, where arcs alternate [1]: 1/3 in curvature, with a ninth of
the displacement."""

_SURE = 30.0  # a harmonic over its error, above which no other form has any probability


class Form(NamedTuple):
    """What bends turn beside sines of the same first harmonic; docs/model.md (254), (271)."""

    ratio: Vector
    """Turn over that of sines [draws]."""
    between: Vector
    """Turn beyond that of the chords between points, over that of sines [draws]."""

    def turn(self, of_sines: Vector, of_chords: Vector) -> Vector:
        """Return what bends turn [rad] where sines, and the chords from point to point, turn so much."""
        hidden = np.maximum(of_sines - of_chords, 0.0)
        return self.ratio * of_sines + (self.between - 1.0) * hidden


class Prior(NamedTuple):
    """Independent components of the curvature."""

    scaled: Matrix
    """Curvature by those of intensity 1 [cells, r]."""
    fixed: Matrix
    """Curvature by those whose size is known beforehand [cells, f]."""
    half_waves: float = 0.0
    """Half waves over the route, 0 where it does not oscillate."""
    log_share: float = 0.0
    """ln of its probability beforehand among priors that are alike but for their half waves."""


def cells() -> Vector:
    """Return the middle of each cell, over the length of the route."""
    return (np.arange(GRID.nodes) + 0.5) / GRID.nodes


def at_points(station: Vector) -> Prior:
    """Return turns at the inner points alone, each of a variance like the length that it stands for."""
    cell = np.minimum((station[1:-1] / station[-1] * GRID.nodes).astype(np.int64), GRID.nodes - 1)
    scaled = np.zeros((GRID.nodes, len(cell)))
    scaled[cell, np.arange(len(cell))] = GRID.nodes * np.sqrt(0.5 * (station[2:] - station[:-2]))
    return Prior(scaled, np.zeros((GRID.nodes, 0)))


def walk(order: int, turn: float) -> Prior:
    """Curvature that is a random walk, or whose rate is one; at the start of the size of all turns [rad]."""
    size = OSCILLATION.sharper ** (0.5 * (order - 1))
    return Prior(size * _integrated(order), turn * cells()[:, None] ** np.arange(order))


def oscillations(points: int) -> tuple[Prior, ...]:
    """Return curvature that oscillates, by the wave lengths that points do not exclude; (229), (270)."""
    none = np.zeros((GRID.nodes, 0))
    half_waves = _FEWEST * _apart(points) ** np.arange(GRID.lengths)
    share = -0.5 * (np.log10(half_waves / OSCILLATION.typical) / OSCILLATION.decades) ** 2
    share -= math.log(np.exp(share).sum())
    return tuple(
        Prior(_oscillating(float(one)), none, float(one), float(log_share))
        for one, log_share in zip(half_waves, share, strict=True)
    )


def _apart(points: float) -> float:
    """Return the ratio of neighbouring wave lengths that are tried."""
    most = _MOST * max(points - 1.0, 1.0)
    return max(most / _FEWEST, 1.0) ** (1.0 / (GRID.lengths - 1))


@cache
def _oscillating(half_waves: float) -> Matrix:
    """Components of curvature of variance 1 with so many half waves, at the cells [cells, r]."""
    phase = math.pi * half_waves * np.abs(cells()[:, None] - cells())
    value, vector = np.linalg.eigh(np.cos(phase) * np.exp(-phase / (2.0 * math.pi * OSCILLATION.coherent)))
    return vector * np.sqrt(np.maximum(value, 0.0))


@cache
def _integrated(order: int) -> Matrix:
    """White noise of intensity 1 that was integrated once or twice, at the cells [cells, cells]."""
    u = cells()
    least, most = np.minimum(u[:, None], u), np.maximum(u[:, None], u)
    value, vector = np.linalg.eigh(least if order == 1 else least**2 * (most / 2.0 - least / 6.0))
    return vector * np.sqrt(np.maximum(value, 0.0))


def form_of(
    half_waves: float, bend: np.ndarray, points: float, noise: float, rng: np.random.Generator
) -> Form:
    """Return what bends turn over sines of the same first harmonic, for each draw; (254), (271).

    It is 1 where the points show the form, by the third harmonic, for all waves that are as near. Where these
    are too few for it, but accurate, only what bends turn between them is hidden.

    Parameters
    ----------
    half_waves
        Half waves over the route, 0 where the prior does not oscillate.
    bend
        Draws of the curvature [cells, 2, draws].
    points, noise
        Number of points, and their noise over the length of the route [1].
    rng
        Generator of the forms that points do not show.
    """
    none = np.ones(bend.shape[2])
    if half_waves == 0.0:
        return Form(none, none)
    size = np.sqrt(2.0 * np.mean(np.sum(bend**2, axis=1), axis=0)) / (math.pi * half_waves) ** 2
    clear = _THIRD * size * math.sqrt(0.5 * points) > CHANCE.clear * noise
    dense = 3.0 * half_waves * math.sqrt(_apart(points)) <= points - 1.0
    form = rng.choice(_FORMS, bend.shape[2])
    between = none if dense else 1.0 + _BETWEEN * (form - 1.0)
    return Form(np.where(clear, none, form), np.where(clear, between, none))


def hidden_form(bend: Matrix, s: Vector, points: int, noise: float) -> float:
    """Return the standard deviation of Φ of a smooth fit from the form of its bends [rad]; (258).

    A smooth fit takes a sine for a bend of which many points show no more than the first harmonic.

    Parameters
    ----------
    bend, s
        Curvature along two axes that are carried without twist [n, 2] [1/m], and arc length [n] [m].
    points, noise
        Number of points along the route, and their noise [m].
    """
    main = bend @ np.linalg.eigh(bend.T @ bend)[1][:, -1]
    begin = np.concatenate(([0], 1 + np.flatnonzero(np.diff(main < 0.0))))
    cell = np.diff(s, prepend=s[0], append=s[-1])
    cell = 0.5 * (cell[1:] + cell[:-1])
    turn = np.abs(np.add.reduceat(main * cell, begin))
    length = np.add.reduceat(cell, begin)
    third = _THIRD * turn * length / (2.0 * math.pi)
    error = max(noise, 1e-300) / np.sqrt(0.5 * points * length / float(s[-1] - s[0]))
    excess = np.minimum(third / error, _SURE)
    return float(np.std(_FORMS) * np.sum(turn / np.cosh(0.25 * excess**2)))

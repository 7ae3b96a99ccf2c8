"""The library on top of a model: a linear look at every variant, then refits through the model.

Source: docs/model.md (107), (110).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import FitError, SettingsError
from tssgeom.identify.problem import Fit, Free, Problem, columns, freed, refined
from tssgeom.identify.variants import Variant


@dataclass(frozen=True, slots=True)
class Look:
    """What a straight-line view of one variant says."""

    variant: Variant
    column: Vector
    """[rows + k] Weighed change for one unit of amplitude, off friction and compliance."""
    amplitude: float
    """That the readings want, in the parameter's unit."""
    gain: float
    """How much χ² would fall [1]."""
    size: float
    """Length of the weighed change at typical size, what friction and compliance make of it taken off [1]."""
    raw: float
    """The same with it."""


@dataclass(frozen=True, slots=True)
class Screen:
    """The straight-line view of a library."""

    looks: tuple[Look, ...]
    base: Matrix
    """[rows + k, 2 + free] Columns of the model so far."""
    residual: Vector
    """[rows + k] Of the model so far, off those columns."""


def screen(problem: Problem, fit: Fit, tried: Sequence[Variant]) -> Screen:
    """Look at every variant on top of a fitted model; docs/model.md (107)."""
    base = columns(problem, fit.at, fit.left)
    frame, _ = np.linalg.qr(base)
    residual = fit.residual - frame @ (frame.T @ fit.residual)
    looks = []
    for variant in tried:
        told = _look(problem, fit, variant, frame, residual)
        if told is not None:
            looks.append(told)
    return Screen(tuple(looks), base, residual)


def _look(problem: Problem, fit: Fit, variant: Variant, frame: Matrix, residual: Vector) -> Look | None:
    amplitude = getattr(variant.effect, variant.amplitude)
    try:
        left = problem.left(replace(fit.at, effects=(*fit.at.effects, variant.effect)))
    except (FitError, SettingsError):  # the effect at this size and that model do not go together
        return None
    whole = problem.weighing.weighed((fit.left - left) / amplitude)
    column = whole - frame @ (frame.T @ whole)
    square = float(column @ column)
    wanted = float(column @ residual) / square if square > 0.0 else 0.0
    if variant.positive and wanted < 0.0:
        wanted = 0.0
    typical = abs(variant.effect.parameters[variant.amplitude].typical)
    sizes = typical * math.sqrt(square), typical * float(np.linalg.norm(whole))
    return Look(variant, column, wanted, wanted**2 * square, *sizes)


def refit(problem: Problem, fit: Fit, look: Look, base: Matrix, passes: int = 6) -> Fit | None:
    """Refit the model with one more effect from where the straight line points; None where that fails."""
    told = look.variant.effect.parameters[look.variant.amplitude]
    limit = 3.0 * abs(told.typical)
    amplitude = float(np.clip(look.amplitude, -limit, limit)) or 0.1 * told.typical
    which = len(fit.at.effects)
    length = max(reading.route.arcs.total_length for reading in problem.stack.readings)
    effect = look.variant.sized(amplitude)
    free: tuple[Free, ...] = (*fit.at.free, *freed(effect, which, length, look.variant.free))
    start = replace(fit.at, effects=(*fit.at.effects, effect), free=free)
    try:
        return refined(problem, start, base, passes)
    except (FitError, SettingsError):
        return None

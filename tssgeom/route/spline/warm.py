"""A fit that begins with that of the same route a moment ago, in one pass."""

from __future__ import annotations

import math
from typing import NamedTuple

from tssgeom import core
from tssgeom.arrays import Vector
from tssgeom.core.constants_route import PASSES, SEARCH
from tssgeom.route.observations import Shape, noise_price, on_chords
from tssgeom.route.route import Route
from tssgeom.route.spline.posterior import deviance, scaled_variance, warmed
from tssgeom.route.spline.problem import LastPass
from tssgeom.route.spline.spline import Spline, rows_for, spline_of

_UNLIKELY = -4.0 * math.log(PASSES.representative)
"""Difference in -2 ln of the posterior above which the noise of the last fit is not kept [1]. Derived: what
lets one fit stand for all, twice, since both fits estimated their noise."""


class _Pass(NamedTuple):
    """One pass over a shape that begins with the last one."""

    spline: Spline | None
    """None where the last λ, noise or weights no longer hold."""
    criterion: float
    """-2 ln of the posterior of its λ and noise, up to what all passes over the same points share."""


def warm(
    shape: Shape, noise: float | None, last: Spline | None, growth: float = 1.0, index: Vector | None = None
) -> Spline | None:
    """Fit the same route a moment after the last fit in one pass; None where that no longer holds.

    The noise variance may have changed by a factor between 1 and `growth`. `index` are the counts in the
    sensed sequence of the points of the last fit; without it they are those of the shape.
    """
    if last is None or last.shared_angle_error:
        return None
    before = last.memory if index is None else last.memory.on(index, shape.index)
    if before is None:
        return None
    if last.by_chords and shape.stations is None:
        shape = on_chords(shape, before.weight)
    same = (shape.stations is not None) == before.stations_known
    same &= (shape.directions is None) == (before.tangents is None)
    if len(shape.points) != len(before.u) or not same:
        return None
    one_pass = _pass_of_core if shape.directions is None else _pass_in_parts
    moved = one_pass(shape, noise, before, growth)
    if moved.spline is None and noise is None and shape.is_of_few:
        kept = one_pass(shape, before.noise * math.sqrt(growth), before, growth)
        if kept.criterion - moved.criterion < _UNLIKELY:
            moved = kept
    return None if moved.spline is None else moved.spline.averaged_as(last)


def _criterion(deviance: float, ratio: float, variance: float, length: float) -> float:
    """-2 ln of the posterior of λ and of a noise [m²] of a route of this length [m]; docs/model.md (292)."""
    if not (ratio > 0.0 and variance > 0.0):
        return math.inf
    likelihood = deviance - 4.0 * math.log(variance)  # the evidence prices both ends with it
    return (
        likelihood + SEARCH.price_per_decade * math.log10(ratio) + noise_price(math.sqrt(variance) / length)
    )


def _pass_in_parts(shape: Shape, noise: float | None, last: LastPass, growth: float) -> _Pass:
    """Make the pass in Python, where the core does not: directions were sensed."""
    problem, solution, held = warmed(shape, noise, last, growth)
    spacing = last.spacing
    least, length = deviance(problem, solution, spacing), float(problem.model.u[-1]) * spacing
    criterion = _criterion(least, solution.ratio, solution.variance * spacing**2, length)
    return _Pass(spline_of(shape, problem, solution, spacing) if held else None, criterion)


def _pass_of_core(shape: Shape, noise: float | None, last: LastPass, growth: float) -> _Pass:
    """Make the pass and its spline in one call of the core."""
    n, spacing = len(shape.points), last.spacing
    variance = scaled_variance(noise, spacing)
    result, u, y, mean, state, count, *nodes, pieces = core.spline_frame(
        shape.points,
        last.u,
        last.y,
        last.weight,
        last.mean,
        last.covariance,
        last.ratio,
        last.intensity,
        growth,
        spacing,
        variance,
        shape.stations,
        rows_for(n),
    )
    ratio, intensity, freedom, least, held = result.tolist()
    criterion = _criterion(least, ratio, ratio * intensity * spacing**2, float(u[-1]) * spacing)
    if not held:
        return _Pass(None, criterion)
    s, vectors, covariance, gain, station, residual, joints = nodes
    for array in (s, vectors, covariance, gain, station, residual, joints):
        array.flags.writeable = False
    position, tangent, bend = vectors
    route = Route(
        s=s[:count],
        position=position[:count],
        tangent=tangent[:count],
        curvature_vector=bend[:count],
        noise=math.sqrt(ratio * intensity) * spacing,
        weight=last.weight,
        station=station,
        residual=residual,
    )
    spline = Spline(
        route=route,
        covariance=covariance[:count],
        gain=gain[: count - 1],
        freedom=freedom,
        deviance=least,
        stations_known=last.stations_known,
        memory=LastPass(u, y, last.weight, mean, state, ratio, intensity, spacing, last.stations_known, None),
        joints=joints[: pieces + 1],
    )
    return _Pass(spline, criterion)

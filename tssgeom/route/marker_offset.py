"""Markers beside the centre line: the route through where they would be on it; docs/model.md (155)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector, read_only
from tssgeom.core.constants_arcs import CHAIN_FIT
from tssgeom.errors import FitError, ShapeError
from tssgeom.route.model_choice import added_variance, model_probabilities
from tssgeom.route.observations import Shape, on_chords
from tssgeom.route.route import Route, carried
from tssgeom.route.spline.fit import fit
from tssgeom.route.tracking import TrackedFit, follow, model_checked


@dataclass(frozen=True, slots=True)
class MarkerRounds:
    """How the axes at the markers are determined."""

    step: float = 0.5
    """Share of the change of the points that is made at once [1]. Chosen: all of it may swing."""
    converged: float = 1e-3
    """Change at which they have converged [largest offset]. Chosen."""
    rolls: int = 12
    """Roll angles that are tried where none is known. Chosen: 30° apart."""


ROUNDS = MarkerRounds()


def follow_markers(
    shape: Shape,
    noise: float | None,
    offset_mm: Sequence[Sequence[float]],
    axis: Sequence[float] | None,
    last: TrackedFit | None = None,
) -> tuple[Shape, TrackedFit]:
    """Fit a route to markers beside it; returns where they would be on the centre line, and the fit.

    The axes across the route are carried along it without twist. Where the roll of the first is not known,
    Φ is averaged over the rolls by their evidence.

    Parameters
    ----------
    shape, noise
        Validated markers, and the noise of their coordinates [m]; estimated where None.
    offset_mm
        Where each marker that may be sensed sits: along two axes across the route, then along it [n, 3] [mm].
    axis
        Direction of the first of these axes at the first marker, in the coordinates of the points [3]; None
        where it is not known.
    last
        Result of the last frame of a stream.

    Raises
    ------
    ShapeError
        Where a marker has no offset.
    FitError
        Where no route goes through the points.
    """
    if shape.index[-1] >= len(offset_mm):
        sensed = int(shape.index[-1]) + 1
        raise ShapeError(
            f"{sensed} markers, {len(offset_mm)} offsets: give [shape] marker_offset_mm a row for each marker"
        )
    offset = 1e-3 * np.array(offset_mm, dtype=np.float64)[shape.index.astype(np.int64)]
    last = None if last is None else model_checked(last)  # once: two fits start from it
    if axis is not None:
        return _fitted(shape, noise, offset, np.array(axis, dtype=np.float64), last)
    if last is not None and last.marker_axis is not None:
        return _fitted(shape, noise, offset, last.marker_axis, last)
    return _over_rolls(shape, noise, offset)


def _over_rolls(shape: Shape, noise: float | None, offset: Matrix) -> tuple[Shape, TrackedFit]:
    """Likeliest roll, with the variance of Φ from not knowing it."""
    chord = shape.points[1] - shape.points[0]
    first, second = core.normals(chord / np.linalg.norm(chord))
    fits = list[tuple[Shape, TrackedFit]]()
    for roll in 2.0 * math.pi * np.arange(ROUNDS.rolls) / ROUNDS.rolls:
        axis = math.cos(roll) * first + math.sin(roll) * second
        try:
            fits.append(_fitted(shape, noise, offset, axis, None))
        except FitError:
            continue
    if not fits:
        raise FitError(
            "no roll of the markers gives a route: check [shape] marker_offset_mm, or give marker_axis"
        )
    evidence = np.array([one.fit.log_evidence for _, one in fits])
    angle = np.array([one.fit.arcs.total_angle for _, one in fits])
    own = np.array([one.fit.arcs.total_angle_se**2 for _, one in fits])
    k = int(np.argmax(evidence))
    points, best = fits[k]
    more = added_variance(model_probabilities(evidence), angle, own, float(angle[k]), float(own[k]))
    by_models = best.by_models._replace(angle=best.by_models.angle + more)
    return points, replace(best, fit=best.fit.with_angle_variance(more), by_models=by_models)


def _fitted(
    shape: Shape, noise: float | None, offset: Matrix, axis: Vector, last: TrackedFit | None
) -> tuple[Shape, TrackedFit]:
    """Move the points onto the route and fit it in turn, until both agree."""
    if last is None:
        aside = _straight(shape, offset, axis)
        limit = ROUNDS.converged * float(np.abs(offset).max())
        for _ in range(CHAIN_FIT.most_steps):  # a route of 250° takes thirty
            route = fit(on_chords(_less(shape, aside)), noise).route
            change = _aside(route, shape, offset, axis) - aside
            if float(np.abs(change).max()) <= limit:
                break
            aside += ROUNDS.step * change
    else:
        aside = _aside(last.fit.route, shape, offset, axis)
    # axes from a whole fit differ a little from those that the rounds end with
    tracked = follow(_less(shape, aside), noise, last)
    on_line = _less(shape, _aside(tracked.fit.route, shape, offset, axis))
    return on_line, replace(follow(on_line, noise, last), marker_axis=axis)


def _less(shape: Shape, aside: Points) -> Shape:
    return replace(shape, points=read_only(shape.points - aside))


def _straight(shape: Shape, offset: Matrix, axis: Vector) -> Points:
    """Offsets on a straight route from the first to the last marker [n, 3] [m]."""
    chord = shape.points[-1] - shape.points[0]
    if shape.directions is not None and not np.isnan(shape.directions[0]).any():
        chord = shape.directions[0]
    tangent = np.tile(chord / np.linalg.norm(chord), (len(offset), 1))
    return _on_axes(tangent, carried_axis(tangent, axis), offset)


def _aside(route: Route, shape: Shape, offset: Matrix, axis: Vector) -> Points:
    """Offsets of the markers on a fitted route [n, 3] [m]."""
    station = route.station
    if len(station) != len(shape.points):  # a marker came or was lost
        station = np.linspace(0.0, route.s[-1], len(shape.points))
    at = np.searchsorted(route.s, station - 1e-12 * route.s[-1]).clip(0, len(route.s) - 1)
    return _on_axes(route.tangent[at], carried_axis(route.tangent, axis)[at], offset)


def _on_axes(tangent: Points, first: Points, offset: Matrix) -> Points:
    axes = np.stack((first, np.cross(tangent, first), tangent), axis=1)
    return np.einsum("ij,ijk->ik", offset, axes).astype(np.float64)


def carried_axis(tangent: Points, axis: Vector) -> Points:
    """Return an axis carried along unit tangents [n, 3] without twist, normal to each [n, 3].

    Raises ShapeError where the axis lies along the first tangent.
    """
    first = axis - (axis @ tangent[0]) * tangent[0]
    if np.linalg.norm(first) < _LEAST_ACROSS * np.linalg.norm(axis):
        raise ShapeError(
            "[shape] marker_axis lies along the route at the first marker: give a direction across it"
        )
    return carried(tangent, first / np.linalg.norm(first))


_LEAST_ACROSS = 0.1  # of the axis: within 6° of the route it determines no direction across it; chosen

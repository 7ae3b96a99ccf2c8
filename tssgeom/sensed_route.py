"""The route of one frame, fitted from that of the last frame on, with the errors that all frames share."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Points, read_only
from tssgeom.errors import FitError, ShapeError
from tssgeom.frame import Frame, fit_frame, with_shared_errors_of
from tssgeom.mechanism import GivenRoute
from tssgeom.rig import Rig
from tssgeom.route.observations import Shape
from tssgeom.route.resolution import SharedErrors
from tssgeom.route.route_fit import LITTLE, LOST, RouteFit
from tssgeom.route.synthetic import chain, positions
from tssgeom.route.time_filter import PointFilter
from tssgeom.route.tracking import NotWarmError, TrackedFit

_UNSURE = 0.2  # standard error of Φ over Φ below which that is known well enough [1]; chosen


class StatedRoute(NamedTuple):
    """Points that stand for the route of a rig in frames without a shape. All are chosen."""

    parts: int = 16
    """Equal parts of an even bend, and of bends that nobody knows, each with a share of the angle [1]: with
    eight the play of a pair that bends behind a straight sixteenth of its sheath was 18 standard errors
    off."""
    turn: float = 0.3
    """By how much the plane turns from part to part [rad]: a route of many turns does not meet itself."""


STATED = StatedRoute()
_POINTS = 8 * STATED.parts + 1  # eight chords a part: curvature is read off seven points within it


class SensedRoute(NamedTuple):
    """The route of a frame, as a tendon needs it."""

    shape: Shape
    tracked: TrackedFit
    fit: RouteFit
    """The fit at its resolution."""
    shared: SharedErrors
    """Errors beside its own, which other frames have too."""


def sensed_route(
    frame: Frame, rig: Rig, last: TrackedFit | None = None, points: PointFilter | None = None
) -> SensedRoute:
    """Fit the route of a frame, from that of the `last` one; no tendon is needed, and none is moved.

    Where the last one showed nothing of Φ, the fit from nothing stays if it shows more. `NotWarmError` is
    raised where a fit from nothing is needed, and the last one is to be `warm_only`. A frame without points
    has the route that the rig states.

    Raises ShapeError where the points cannot be a route; FitError where they give no finite curve.
    """
    if not len(frame.points) and frame.curvatures is None:
        frame = replace(frame, points=_points_of(rig.route))
    if (
        last is None
        or frame.curvatures is not None
        or math.hypot(last.fit.arcs.total_angle_se, last.errors.angle) < LOST
    ):
        return _sensed(frame, rig, last, points)
    if last.warm_only:
        raise NotWarmError
    try:
        anew = _sensed(frame, rig, None, points)
    except FitError:
        return _sensed(frame, rig, last, points)
    with suppress(FitError):
        further = _sensed(frame, rig, last, points)
        return min(anew, further, key=lambda one: one.fit.arcs.total_angle_se**2 + one.shared.angle)
    return anew


def _sensed(frame: Frame, rig: Rig, last: TrackedFit | None, points: PointFilter | None) -> SensedRoute:
    shape, tracked = fit_frame(frame, rig, last, points)
    fit, shared = with_shared_errors_of(frame, rig, tracked)
    return SensedRoute(
        shape, tracked, _with_little_known(fit, frame, beside_route=bool(rig.shape.marker_offset_mm)), shared
    )


def _with_little_known(fit: RouteFit, frame: Frame, *, beside_route: bool) -> RouteFit:
    """Return a fit with a warning where it shows little of Φ; that of base and tip alone says so already."""
    arcs = fit.arcs
    if arcs.method == "tip" or arcs.total_angle_se <= max(LITTLE, _UNSURE * arcs.total_angle):
        return fit
    few = f"Φ is hardly known, its standard error is {math.degrees(arcs.total_angle_se):.0f}°: sense more "
    if frame.curvatures is not None:
        return fit.warned(f"{few}gratings, or state curvature_noise_per_m")
    beside = "" if beside_route else ", and marker_offset_mm where markers sit beside the route"
    return fit.warned(f"{few}points, or directions; state noise_mm{beside}")


@lru_cache(maxsize=8)
def _points_of(given: GivenRoute) -> Points:
    """Return points on a route with the length, the angle and the bends that a rig states [n, 3] [m]."""
    if given.length_m is None or given.angle_rad is None:
        raise ShapeError("no points: give them, or [route] length_m and angle_rad in the rig")
    share = np.array(given.bends or (1.0,) * STATED.parts)
    part = np.full(len(share), given.length_m / len(share))
    bent = chain(
        part,
        given.angle_rad * share / share.sum() / part,
        STATED.turn * np.arange(len(share), dtype=np.float64),
    )
    return read_only(positions(bent, np.linspace(0.0, given.length_m, _POINTS)))

"""The route of one frame, fitted from that of the last frame on, with the errors that all frames share."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import read_only, rows_at
from tssgeom.core.constants_route import PASSES
from tssgeom.errors import FitError, ShapeError
from tssgeom.frame import Frame, in_order, with_rows
from tssgeom.plausibility.frames import require_one_target
from tssgeom.rig import Rig, Source
from tssgeom.route.directions import NOISE_PRIOR as DIRECTION_NOISE
from tssgeom.route.directions import estimated_noise, unit_directions
from tssgeom.route.error_posterior import NO_POSTERIOR
from tssgeom.route.fibre.follow import FibreReading, follow_fibre
from tssgeom.route.fibre.sensed import clean_fibre
from tssgeom.route.geometry import measure
from tssgeom.route.marker_offset import follow_markers
from tssgeom.route.noise import contradicted as contradicted_noise
from tssgeom.route.noise import noise_left
from tssgeom.route.observations import MIN_POINTS, Shape, clean
from tssgeom.route.observations import NOISE_PRIOR as POINT_NOISE
from tssgeom.route.route_fit import LITTLE, LOST, NO_ERRORS, RouteFit, SharedErrors
from tssgeom.route.shared_errors import posterior_of_source, with_hidden_errors, with_shared_errors
from tssgeom.route.synthetic import stated_points
from tssgeom.route.time_filter import PointFilter, begun, filtered
from tssgeom.route.tip import TipReadings, fit_tip
from tssgeom.route.tracking import NotWarmError, TrackedFit, follow
from tssgeom.tendon.capstan import check_tension

_UNSURE = 0.2  # standard error of Φ over Φ below which that is known well enough [1]; chosen
_ASTRAY = 2.0  # noise of a warm fit over that of the first one, above which it lost few points [1]; chosen
_ERRORS_EVERY = 64  # frames between two estimates of what errors that neighbours share mean [1]; chosen

_NOISE_OF_POINTS = "noise_mm is that of points, and a fibre does not use it: state curvature_noise_per_m"
_NO_RIG = Rig()  # states nothing of what senses a route


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
        frame = replace(frame, points=stated_points(rig.route))
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
    fit, shared = tracked.fit, NO_ERRORS
    if frame.curvatures is None:
        gain = rig.shape.angle_gain_sd
        fit, shared = with_shared_errors(fit, *_source(frame, rig), tracked.errors, gain)
    fit = _with_little_known(fit, frame, beside_route=bool(rig.shape.marker_offset_mm))
    return SensedRoute(shape, tracked, fit, shared)


def fit_frame(
    frame: Frame, rig: Rig, last: TrackedFit | None = None, now: PointFilter | None = None
) -> tuple[Shape, TrackedFit]:
    """Return points and fitted route: of a fibre from its curvatures, of points from the last frame on.

    The points are filtered in time, by `now` where it is given, else by the filter of the last frame.

    Raises ShapeError where the points cannot be a route; FitError where they give no finite curve.
    """
    if frame.curvatures is not None:
        stated = curvature_noise_of(frame, rig)
        reading = FibreReading(frame.curvatures, frame.stations, frame.time, stated)
        shape, tracked = follow_fibre(reading, last, now, time_filter=rig.shape.time_filter)
        if rig.shape.noise is not None and stated is None:
            tracked = replace(tracked, fit=tracked.fit.warned(_NOISE_OF_POINTS))
        return shape, tracked
    if (ends := _ends(frame, rig)) is not None:
        return _fit_ends(ends)
    stated, given = _noise_that_counts(frame, rig, last), rig.shape
    contradicted = stated is None and last is not None and last.noise_contradicted
    if given.order == "shortest" and frame.stations is None and now is None:  # filtered frames are in order
        frame = in_order(frame, None if last is None else last.fit.route.position[0])
    if now is None and given.time_filter and last is not None and last.filtered is not None:
        now = filtered(last.filtered, frame.points, last.fit.noise, frame.time)
    noise = stated if now is None or stated is None else noise_left(now, stated)
    turn = _direction_noise(rig, last)
    if now is not None:
        frame = replace(frame if now.order is None else with_rows(frame, now.order), points=now.points)
    shape = sensed_points(frame, rig, turn)
    if now is not None and now.warnings:
        shape = replace(shape, warnings=shape.warnings + now.warnings)
    last = None if last is None or (last.fit.chain or last.fit.spline) is None else last
    bounded = noise is None and last is not None and last.noise_bounded
    if bounded and now is not None:
        noise = now.sensed_noise
    of_time = noise is None and last is not None and last.has_noise_of_time
    if of_time and now is not None:
        noise = now.noise
    start = None if last is None else last.start_for(now)
    if last is not None and last.warm_only and start is None:
        raise NotWarmError
    if given.marker_offset_mm:
        shape, tracked = follow_markers(shape, noise, given.marker_offset_mm, given.marker_axis, start)
    else:
        tracked, now_contradicted = _fitted(shape, noise, start, stated if now is None else None)
        contradicted |= now_contradicted
        if now is not None and last is not None and _is_astray(tracked, last, now):
            if last.warm_only:
                raise NotWarmError
            tracked, bounded = TrackedFit.of(measure(shape, now.sensed_noise), shape.index), True
    unknown = given.direction_noise_deg == "estimate" and (last is None or last.direction_noise == 0.0)
    if unknown and tracked.age == 0:
        shape, tracked = _with_direction_noise(shape, noise, tracked)
    if now is None and given.time_filter:
        known = None if contradicted else stated
        now = begun(frame.points, known or tracked.fit.noise, frame.time)
    share = 1.0 if now is None else now.sensed_noise / now.noise
    if now is not None and now.lost is not None:
        tracked = replace(tracked, fit=tracked.fit.with_angle_variance(now.lost.angle_variance))
    fit, errors, source = tracked.fit, NO_POSTERIOR if last is None else last.errors, _source(frame, rig)
    if source != (None, None) and tracked.age % _ERRORS_EVERY == 0:
        errors = posterior_of_source(fit, *source)
    elif tracked.age == 0:
        estimated = stated is None or contradicted
        fit, errors = with_hidden_errors(fit, shape, fit.noise * share if estimated else None)
    if last is None or tracked.age == 0:
        first, left = fit.noise, 0.0 if now is None else now.noise
    else:
        first, left = last.first_noise, last.first_left
    return shape, replace(
        tracked,
        fit=fit,
        filtered=now,
        sensed_over_fitted=share,
        errors=errors,
        first_noise=first,
        first_left=left,
        noise_bounded=bounded,
        noise_of_time=of_time,
        noise_contradicted=contradicted,
        direction_noise=shape.direction_noise,
    )


def _ends(frame: Frame, rig: Rig) -> TipReadings | None:
    """Return base and tip of a frame that has not enough points for a fit, but the length between them."""
    if frame.length is None or frame.directions is None:
        return None
    used = np.flatnonzero(~np.isnan(frame.points).any(axis=1))
    if len(used) not in range(2, MIN_POINTS):
        return None
    unit = unit_directions(frame.directions, frame.points)
    if np.isnan(unit[used[0]]).any():
        return None
    if not (math.isfinite(frame.length) and frame.length > 0.0):
        raise ShapeError(f"the length is {frame.length:g} m: give a finite value > 0 m, or leave it out")
    return TipReadings(
        base=frame.points[used[0]],
        base_direction=unit[used[0]],
        tip=frame.points[used[-1]],
        tip_direction=None if np.isnan(unit[used[-1]]).any() else unit[used[-1]],
        length=frame.length,
        length_noise=rig.shape.length_noise,
        noise=noise_of(frame, rig) or POINT_NOISE.typical * frame.length,
        direction_noise=rig.shape.direction_noise or DIRECTION_NOISE.typical,
    )


def _fit_ends(ends: TipReadings) -> tuple[Shape, TrackedFit]:
    points, index = read_only(np.array([ends.base, ends.tip])), read_only(np.array([0.0, 1.0]))
    return Shape(points, index, None, ()), TrackedFit(fit_tip(ends), index)


def _noise_that_counts(frame: Frame, rig: Rig, last: TrackedFit | None) -> float | None:
    """Return the noise of a coordinate that is stated [m], as long as the points do not contradict it."""
    stated = noise_of(frame, rig)
    if stated is None or last is None or not last.noise_contradicted:
        return stated
    return None if last.fit.noise * last.sensed_over_fitted > stated else stated


def _fitted(
    shape: Shape, noise: float | None, last: TrackedFit | None, stated: float | None
) -> tuple[TrackedFit, bool]:
    """Follow the last route; a new fit is by the noise of the points where that contradicts the stated one.

    Returns also whether it does.
    """
    try:
        tracked = follow(shape, noise, last)
    except FitError:
        fit = None if stated is None else contradicted_noise(shape, stated, None)
        if fit is None:
            raise
        return TrackedFit.of(fit, shape.index), True
    if stated is None or tracked.age > 0:
        return tracked, False
    fit = contradicted_noise(shape, stated, tracked.fit)
    return (tracked, False) if fit is None else (TrackedFit.of(fit, shape.index), True)


def _is_astray(tracked: TrackedFit, last: TrackedFit, now: PointFilter) -> bool:
    """Whether few points are taken for noise that neither the first fit had nor differences in time show."""
    if tracked.age == 0 or last.noise_bounded or not tracked.fit.is_of_few:
        return False
    return tracked.fit.noise > _ASTRAY * max(last.first_noise, now.sensed_noise)


def _source(frame: Frame, rig: Rig) -> tuple[Source | None, float | None]:
    """Return where the points come from, and the resolution [m], as far as they are stated."""
    return rig.shape.source or frame.source, rig.shape.resolution or rig.sheath.shortest_wave


def noise_of(frame: Frame, rig: Rig) -> float | None:
    """Return the noise of a coordinate [m]: that of the rig, else that of the frame, else None.

    Raises ShapeError where that of the frame is not positive and finite.
    """
    return _stated(rig.shape.noise, frame.noise, "m")


def curvature_noise_of(frame: Frame, rig: Rig) -> float | None:
    """Return the noise of a curvature component of a fibre [1/m]; otherwise as `noise_of`."""
    return _stated(rig.shape.curvature_noise_per_m, frame.curvature_noise, "/m")


def _stated(of_rig: float | None, of_frame: float | None, unit: str) -> float | None:
    if of_frame is not None and not (math.isfinite(of_frame) and of_frame > 0.0):
        raise ShapeError(f"the noise is {of_frame:g} {unit}: give a finite value > 0 {unit}, or leave it out")
    return of_frame if of_rig is None else of_rig


def _direction_noise(rig: Rig, last: TrackedFit | None) -> float | None:
    """Return the noise of a component of sensed directions [rad]: stated, or as estimated so far."""
    if rig.shape.direction_noise_deg != "estimate":
        return rig.shape.direction_noise
    return (0.0 if last is None else last.direction_noise) or DIRECTION_NOISE.typical


def _with_direction_noise(shape: Shape, noise: float | None, tracked: TrackedFit) -> tuple[Shape, TrackedFit]:
    """Fit points and directions again, with the noise that the directions of each fit show; (170)."""
    for _ in range(PASSES.most):
        if shape.directions is None:
            break
        route, spline = tracked.fit.route, tracked.fit.spline
        tangent = rows_at(route.station, route.s, route.tangent)
        parameters = 0.0 if spline is None else 2.0 * spline.tangent_share * spline.freedom
        estimate = estimated_noise(shape.directions, tangent, parameters)
        if abs(estimate - shape.direction_noise) < PASSES.same_ratio * shape.direction_noise:
            break
        shape = replace(shape, direction_noise=estimate)
        tracked = replace(TrackedFit.of(measure(shape, noise), shape.index), marker_axis=tracked.marker_axis)
    return shape, tracked


def sensed_points(frame: Frame, rig: Rig, direction_noise: float | None) -> Shape:
    """Check the points of a frame, and what else was sensed of its route.

    The noise of a direction is that of each of its components [rad]; None where they are not to be used.

    Raises ShapeError where the points cannot be a route.
    """
    if frame.directions is None and frame.length is None:
        return clean(frame.points, frame.stations)
    given = rig.shape
    return clean(
        frame.points,
        frame.stations,
        frame.directions,
        direction_noise,
        frame.length,
        given.length_noise,
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


def require_usable(frame: Frame) -> None:
    """Refuse what neither a tendon nor a fit can use, before any fit.

    Raises ShapeError where the points or the fibre cannot be a route, or the noise cannot be; SettingsError
    where the tension is negative or not finite, or there are two targets.
    """
    if frame.curvatures is not None:
        clean_fibre(frame.curvatures, frame.stations)
        curvature_noise_of(frame, _NO_RIG)
    elif _ends(frame, _NO_RIG) is None:
        sensed_points(frame, _NO_RIG, None)
    noise_of(frame, _NO_RIG)
    require_one_target(frame.displacement_target, frame.tension_out_target)
    if frame.tension_in is not None:
        check_tension(frame.tension_in)

"""Presentation of sensed frames, recordings, routes and the results of frames."""

from __future__ import annotations

from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from tssgeom.api.presentation import Drawings, Numbers, Presentation
from tssgeom.io.formats.recording import Recording
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.pieces import Arcs
from tssgeom.route.route import Route
from tssgeom.stream import Frame, FrameResult
from tssgeom.view.wording import with_error

if TYPE_CHECKING:
    import pyarrow as pa

_MOST_PLOTTED = 12
"""Frames of a recording in one plot. Chosen: their lines stay apart."""


def _length(length: float) -> tuple[str, str]:
    return "L", f"{1e3 * length:.1f} mm"


def _angle(angle: float, error: float) -> tuple[str, str]:
    return "Φ", f"{with_error(angle, error, 4)} rad"


def _geometry(arcs: Arcs) -> Numbers:
    count = len(arcs.length)
    pieces = "1 piece" if count == 1 else f"{count} pieces"
    return [_length(arcs.total_length), _angle(arcs.total_angle, arcs.total_angle_se), ("", pieces)]


def _result(result: FrameResult) -> Numbers:
    ends, length_and_angle = result.transmission, _geometry(result.arcs)[:2]
    numbers = [
        *length_and_angle,
        ("T_in", f"{ends.tension_in:.2f} N"),
        ("T_out", f"{with_error(ends.tension_out, ends.tension_out_se, 2)} N"),
        ("δ", f"{with_error(1e3 * ends.elongation, 1e3 * ends.elongation_se, 3)} mm"),
    ]
    if result.command is not None:
        numbers.append(("x_in command", f"{1e3 * result.command.displacement_in:.3f} mm"))
    return numbers


def _frame(frame: Frame) -> Numbers:
    missing = int(np.isnan(frame.points).any(axis=1).sum())
    kind = "gratings" if frame.curvatures is not None else "points"
    count = f"{len(frame.points)} {kind}"
    numbers = [("", count + (f", {missing} missing" if missing and frame.curvatures is None else ""))]
    numbers.append(("t", f"{frame.time:g} s"))
    if frame.tension_in is not None:
        numbers.append(("T_in", f"{frame.tension_in:.2f} N"))
    return numbers


def _recording(recording: Recording) -> Numbers:
    frames = "1 frame" if recording.frame_count == 1 else f"{recording.frame_count} frames"
    return [("", frames), ("", recording.kind), ("", f"read in {recording.unit}")]


def _route_length(route: Route) -> Numbers:
    return [
        _length(float(route.s[-1])),
        ("", f"{len(route.s)} nodes"),
        ("noise", f"{1e3 * route.noise:.3g} mm"),
    ]


def _profile(profile: CurvatureProfile) -> Numbers:
    most = f"{float(profile.kappa.max()):.3g} 1/m"
    return [
        _length(profile.length),
        _angle(profile.total_angle, profile.total_angle_se),
        ("greatest κ", most),
    ]


def _frames_table(result: FrameResult) -> pa.Table:
    from tssgeom.io.results.geometry import frames_table

    return frames_table([result])


def _points_table(frames: list[Any] | Recording, *, timed: bool) -> pa.Table:
    from tssgeom.io.results.geometry import points_table

    return points_table(frames, timed=timed)


def _nodes_table(route: Route | None, profile: CurvatureProfile | None) -> pa.Table:
    from tssgeom.io.results.geometry import nodes_table

    return nodes_table(route, profile)


def _segments_table(arcs: Arcs) -> pa.Table:
    from tssgeom.io.results.geometry import segments_table

    return segments_table(arcs)


def _result_object(result: FrameResult) -> Any:
    from tssgeom.io.results.shapes import shape_summary

    return shape_summary(str(result.frame.id), result)


def _along(route: Route | None, profile: CurvatureProfile | None, arcs: Arcs | None) -> Drawings:
    from tssgeom.view.figures.route import draw_points
    from tssgeom.view.figures.shapes import draw_angle, draw_curvature

    drawings: dict[str, Any] = {}
    if profile is not None or arcs is not None:
        drawings["curvature"] = partial(draw_curvature, profile=profile, arcs=arcs)
    if profile is not None:
        drawings["angle"] = partial(draw_angle, profile=profile, arcs=arcs)
    if route is not None:
        drawings["route"] = partial(draw_points, frames=[route.position], label="Route")
    return drawings


def _of_result(result: FrameResult) -> Drawings:
    from tssgeom.view.figures.route import draw_route
    from tssgeom.view.figures.shapes import draw_resolution, draw_tension

    return {
        "tension": partial(draw_tension, result=result),
        **_along(None, result.profile, result.arcs),
        "route": partial(draw_route, result=result),
        "resolution": partial(draw_resolution, result=result),
        "points": _of_frame(result.frame)["points"],
    }


def _of_frame(frame: Frame) -> Drawings:
    from tssgeom.view.figures.route import draw_components, draw_points

    if frame.curvatures is None:
        return {"points": partial(draw_points, frames=[frame.points], label="Sensed points")}
    count = len(frame.curvatures)
    stations = np.arange(count, dtype=np.float64) if frame.stations is None else frame.stations
    return {"points": partial(draw_components, stations=stations, curvatures=frame.curvatures)}


def _of_recording(recording: Recording) -> Drawings:
    from tssgeom.view.figures.route import draw_points

    stride = -(-recording.frame_count // _MOST_PLOTTED) or 1
    frames = [each for each in islice(recording, 0, None, stride) if isinstance(each, Frame)]
    if frames and frames[0].curvatures is not None:
        return _of_frame(frames[0])
    label = f"Sensed points of {len(frames)} of {recording.frame_count} frames, the last ones yellow"
    label = "Sensed points" if recording.frame_count == 1 else label
    return {"points": partial(draw_points, frames=[each.points for each in frames], label=label)}


PRESENTATIONS = {
    "FrameResult": Presentation(_result, _frames_table, _of_result, _result_object),
    "Frame": Presentation(
        _frame,
        lambda frame: _points_table([frame], timed=True),
        _of_frame,
        heading=lambda frame: str(frame.id),
    ),
    "Recording": Presentation(
        _recording,
        lambda recording: _points_table(recording, timed=recording.timed),
        _of_recording,
        heading=lambda recording: recording.name,
    ),
    "Arcs": Presentation(_geometry, _segments_table, lambda arcs: _along(None, None, arcs)),
    "Route": Presentation(
        _route_length, lambda route: _nodes_table(route, None), lambda route: _along(route, None, None)
    ),
    "CurvatureProfile": Presentation(
        _profile, lambda profile: _nodes_table(None, profile), lambda profile: _along(None, profile, None)
    ),
    "RouteFit": Presentation(
        lambda fit: _geometry(fit.arcs),
        lambda fit: _nodes_table(fit.route, fit.profile),
        lambda fit: _along(fit.route, fit.profile, fit.arcs),
    ),
}

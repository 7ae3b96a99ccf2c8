"""A recording of two recordings: the same views side by side, one scale and one time, and the difference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from tssgeom.arrays import Vector
from tssgeom.view import colours
from tssgeom.view.quantities import ELONGATION, TENSION_IN, TENSION_OUT, TIMELINE
from tssgeom.view.samples import Ranges, ranges
from tssgeom.view.scene.blueprint import chart, layout, plot, space_view
from tssgeom.view.scene.charts import (
    Axis,
    Box,
    Chart,
    Sender,
    send_axes,
    send_curvature_chart,
    send_slip_front,
    send_tension_chart,
)
from tssgeom.view.scene.compare.difference import Difference, aligned, comparison, difference, table
from tssgeom.view.scene.compare.reading import Side, read_side
from tssgeom.view.scene.labels import Camera, label_positions
from tssgeom.view.scene.run import camera_of, send_line
from tssgeom.view.scene.space import label_texts, send_labels, send_piece_names, send_route, send_scale_bar
from tssgeom.view.scene.writer import recording_file

_TEXT_SCALE = 1.6  # of text beside the route: the views of both are lower than one alone
_COLOURS = {"a": colours.FIRST, "b": colours.SECOND}
_CHART_BOX = Box(width=1.9, text=0.12, unitless=True)
_BOTH_BOX = Box(width=3.1, text=0.115)


def write_comparison(path: Path, first: Path, second: Path) -> None:
    """Write a recording that shows two others, A and B, side by side.

    Parameters
    ----------
    path
        The `.rrd` file; an older one gives way only when it is done.
    first, second
        Recordings of analyse, batch, simulate or live.

    Raises
    ------
    SourceError
        Where one of them cannot be used, or the file cannot be written.
    """
    a, b = aligned(*_with_distinct_names(read_side(first), read_side(second), first, second))
    sides, change = {"a": a, "b": b}, difference(a, b)
    cameras = _one_scale({key: camera_of(side.frames) for key, side in sides.items()})
    names = {key: f"{key.upper()} · {side.name}" for key, side in sides.items()}
    limits = ranges([*a.frames, *b.frames], [*a.pieces, *b.pieces])
    views = _blueprint(names, cameras, change, limits.tension)
    with recording_file(path, f"{a.name} and {b.name}", views) as recording:
        send_piece_names(Sender(recording, None), [*a.pieces, *b.pieces])
        for key, side in sides.items():
            _send_side(recording, key, side, limits)
            _send_labels(Sender(recording, side.time, below=f"{key}/"), side, cameras[key])
        _send_difference(recording, a, b, change, limits)


def _one_scale(cameras: Mapping[str, Camera]) -> dict[str, Camera]:
    """Return cameras at one distance, so that equal lengths are equally long in both views."""
    half = {
        name: max(getattr(camera, name) for camera in cameras.values())
        for name in ("half_width", "half_height", "half_depth")
    }
    return {key: replace(camera, **half) for key, camera in cameras.items()}


def _with_distinct_names(a: Side, b: Side, first: Path, second: Path) -> tuple[Side, Side]:
    """Add to two sides of the same name the folders in which they differ."""
    if a.name != b.name:
        return a, b
    folders = zip(first.resolve().parts[-2::-1], second.resolve().parts[-2::-1], strict=False)
    one, other = next(((one, other) for one, other in folders if one != other), ("", ""))
    if not one:
        return a, b
    return replace(a, name=f"{a.name} of {one}"), replace(b, name=f"{b.name} of {other}")


def _send_side(recording: rr.RecordingStream, key: str, side: Side, limits: Ranges) -> None:
    """Copy the entities that stay as they are, and draw anew what depends on the common scales."""
    recording.send_chunks([part.with_entity_path(f"/{key}{part.entity_path}") for part in side.parts])
    sender = Sender(recording, side.time, below=f"{key}/")
    send_route(sender, side.frames, limits.tension)
    if side.time is not None:
        send_slip_front(sender, side.frames, side.fronts, limits, _CHART_BOX)
    send_tension_chart(sender, side.frames, side.pieces, limits, _CHART_BOX)
    send_curvature_chart(sender, side.frames, side.pieces, limits, _CHART_BOX)
    if side.time is not None:
        name = key.upper()
        for entity, quantity, column, colour in (
            ("tension_in", TENSION_IN, "tension_in_N", colours.AXIS),
            ("tension_out", TENSION_OUT, "tension_out_N", _COLOURS[key]),
            ("elongation", ELONGATION, "elongation_m", _COLOURS[key]),
        ):
            title = f"{quantity.symbol} of {name} [{quantity.unit}]"
            send_line(sender, entity, quantity, side.numbers[column], name=title, colour=colour)


def _send_labels(sender: Sender, side: Side, camera: Camera) -> None:
    """Write the labels anew, that of the scale too: in a lower view they need more room."""
    send_scale_bar(sender, camera, _TEXT_SCALE)
    located = [
        label_positions(camera, frame, arcs, _TEXT_SCALE)
        for frame, arcs in zip(side.frames, side.pieces, strict=True)
    ]
    ends = zip(side.numbers["tension_in_N"], side.numbers["tension_out_N"], side.pieces, strict=True)
    send_labels(sender, located, [label_texts(float(near), float(far), arcs) for near, far, arcs in ends])


def _send_difference(
    recording: rr.RecordingStream, a: Side, b: Side, change: Difference | None, limits: Ranges
) -> None:
    still = Sender(recording, None, below="difference/")
    still.constant_text("words", comparison(a, b, change))
    still.constant_text("table", table(a, b))
    _send_both(still, a, b, limits)
    if change is None:
        return
    sender = Sender(recording, change.time)
    for entity, quantity, column in (
        ("tension_out", TENSION_OUT, "tension_out_N"),
        ("elongation", ELONGATION, "elongation_m"),
    ):
        values = quantity.factor * change.values[column]
        sender.line(f"difference/{entity}", f"Δ{quantity.label}", colours.WHITE, values)


def _send_both(still: Sender, a: Side, b: Side, limits: Ranges) -> None:
    """Draw both tensions at the greatest pull over arc length in one chart, and B less A."""
    ends = {"a": a.frames[a.peak], "b": b.frames[b.peak]}
    s = np.linspace(0.0, min(float(frame.s[-1]) for frame in ends.values()), 128)
    change = ends["b"].tension_at(s) - ends["a"].tension_at(s)
    tension = Axis(max(limits.tension, change.max()), "N", min(0.0, float(change.min())))
    chart = Chart(Axis(1e3 * limits.length, "mm"), tension, _BOTH_BOX)
    send_axes(still, "tension", chart)
    for key, frame in ends.items():
        line = chart.position(1e3 * frame.s, frame.tension)
        still.constant(f"tension/{key}", _line(line, _COLOURS[key], 2.0))
    still.constant("tension/apart", _line(chart.position(1e3 * s, change), colours.WHITE, 1.2))


def _line(line: Vector, colour: tuple[int, int, int], radius: float) -> rr.LineStrips2D:
    return rr.LineStrips2D([line], colors=[colour], radii=rr.Radius.ui_points(radius), draw_order=10)


def _blueprint(
    names: Mapping[str, str], cameras: Mapping[str, Camera], change: Difference | None, tension: float
) -> rrb.Blueprint:
    """Arrange the views; one time line moves both columns. The plot of tensions ends at `tension` [N]."""
    columns = rrb.Horizontal(*(_column(side, names[side], cameras[side]) for side in ("a", "b")))
    text = rrb.TextDocumentView(origin="difference/words", name="What differs")
    numbers = rrb.TextDocumentView(origin="difference/table", name="At the greatest pull of each")
    below = (
        rrb.Horizontal(text, numbers, _both(), column_shares=[30, 20, 50])
        if change is None
        else rrb.Horizontal(text, numbers, *_plots(tension), column_shares=[26, 20, 27, 27])
    )
    state = "hidden" if change is None else "collapsed"
    time = rrb.TimePanel(state=state, timeline=TIMELINE, play_state="paused", loop_mode="all")
    return layout(rrb.Vertical(columns, below, row_shares=[65, 35]), time)


def _column(side: str, name: str, camera: Camera) -> rrb.Container:
    charts = rrb.Horizontal(
        chart(f"{side}/tension", "Tension T [N] against s [mm]", _CHART_BOX),
        chart(f"{side}/curvature", "Curvature κ ± s.e. [1/m] against s [mm]", _CHART_BOX),
    )
    space = space_view(f"{name}: route coloured by tension [N]", camera, below=f"{side}/")
    return rrb.Vertical(space, charts, row_shares=[66, 34])


def _both() -> rrb.Spatial2DView:
    title = "Tension T [N] against arc length s [mm]: A blue, B orange, B less A white"
    return chart("difference/tension", title, _BOTH_BOX)


def _plots(top: float) -> list[rrb.Container]:
    tension = [f"{side}/series/{name}" for name in ("tension_in", "tension_out") for side in ("a", "b")]
    stretch = [f"{side}/series/elongation" for side in ("a", "b")]
    return [
        rrb.Vertical(
            plot("T_out [N] over time: A blue, B orange; T_in grey", tension, top=top),
            plot("T_out of B less that of A [N]", ["difference/tension_out"]),
        ),
        rrb.Vertical(
            plot(f"{ELONGATION.label} over time: A blue, B orange", stretch),
            plot("δ of B less that of A [mm]", ["difference/elongation"]),
        ),
    ]

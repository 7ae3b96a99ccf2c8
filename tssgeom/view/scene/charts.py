"""Tension and curvature against arc length, drawn as lines in 2-D views of a Rerun recording."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from tssgeom.arrays import Vector
from tssgeom.route.pieces import Arcs
from tssgeom.view import colours
from tssgeom.view.samples import Drawn, Ranges, evenly, staircase
from tssgeom.view.scene.chart import Axis, Box, Chart
from tssgeom.view.scene.columns import Sender, lines_2d, segments_2d, strips_2d

_BAR_STEPS = 64
_CHART_NODES = 128


def send_tension_chart(
    sender: Sender, frames: Sequence[Drawn], pieces: Sequence[Arcs], limits: Ranges, box: Box
) -> None:
    """Draw the tension in its own colours, the bar that explains them as its axis, the pieces below."""
    chart = Chart(Axis(1e3 * limits.length, "mm"), Axis(limits.tension, "N"), box)
    send_axes(sender, "tension", chart)
    _send_colour_bar(sender, chart)
    nodes = [evenly(len(frame.s), _CHART_NODES) for frame in frames]
    heights = [frame.tension[chosen] for frame, chosen in zip(frames, nodes, strict=True)]
    lines = [
        chart.place(1e3 * frame.s[chosen], height)
        for frame, chosen, height in zip(frames, nodes, heights, strict=True)
    ]
    middles = np.concatenate([0.5 * (height[:-1] + height[1:]) for height in heights])
    columns = rr.LineStrips2D.columns(
        strips=segments_2d(lines), colors=colours.tension_rgba32(middles, limits.tension)
    )
    sender.constant("tension/curve", _style(radii=rr.Radius.ui_points(2.5), draw_order=20))
    sender.send("tension/curve", columns, [len(line) - 1 for line in lines])
    _send_piece_strip(sender, "tension/pieces", chart, pieces)


def send_curvature_chart(
    sender: Sender, frames: Sequence[Drawn], pieces: Sequence[Arcs], limits: Ranges, box: Box
) -> None:
    """Draw the sensed curvature with its standard error, and the pieces as a staircase."""
    chart = Chart(Axis(1e3 * limits.length, "mm"), Axis(limits.kappa, "/m"), box)
    send_axes(sender, "curvature", chart)
    _send_error_bars(sender, chart, frames)
    nodes = [evenly(len(frame.s), _CHART_NODES) for frame in frames]
    lines = [
        chart.place(1e3 * frame.s[chosen], frame.kappa[chosen])
        for frame, chosen in zip(frames, nodes, strict=True)
    ]
    sender.constant(
        "curvature/sensed", _style(radii=rr.Radius.ui_points(1.0), colors=colours.SENSED, draw_order=10)
    )
    sender.send("curvature/sensed", rr.LineStrips2D.columns(strips=lines_2d(lines)))
    _send_staircase(sender, chart, pieces)


def _style(**fields: object) -> rr.LineStrips2D:
    return rr.LineStrips2D.from_fields(**fields)  # pyright: ignore[reportArgumentType]


def _send_error_bars(sender: Sender, chart: Chart, frames: Sequence[Drawn]) -> None:
    bars = [_error_bars(chart, frame) for frame in frames]
    style = _style(radii=rr.Radius.ui_points(1.6), colors=colours.BAND, draw_order=5)
    sender.constant("curvature/standard_error", style)
    columns = rr.LineStrips2D.columns(strips=strips_2d(np.concatenate(bars)))
    sender.send("curvature/standard_error", columns, [len(strips) for strips in bars])


def _error_bars(chart: Chart, frame: Drawn) -> Vector:
    """Upright strips [m, 2, 2] between κ − s.e. and κ + s.e., dense enough to be seen as a band."""
    chosen = evenly(len(frame.s), _CHART_NODES)
    s, kappa, spread = 1e3 * frame.s[chosen], frame.kappa[chosen], frame.kappa_se[chosen]
    return np.stack([chart.place(s, kappa - spread), chart.place(s, kappa + spread)], axis=1)


def _send_staircase(sender: Sender, chart: Chart, pieces: Sequence[Arcs]) -> None:
    steps = [staircase(arcs) for arcs in pieces]
    places = np.concatenate([chart.place(1e3 * s, kappa) for s, kappa in steps])
    _send_piece_lines(sender, "curvature/pieces", places.reshape(-1, 2, 2), pieces)


def _send_piece_strip(sender: Sender, entity: str, chart: Chart, pieces: Sequence[Arcs]) -> None:
    """Show the pieces by their colours along the foot of a chart."""
    along = np.concatenate([staircase(arcs)[0] for arcs in pieces])
    _send_piece_lines(sender, entity, chart.place(1e3 * along, 0.0).reshape(-1, 2, 2), pieces)


def _send_piece_lines(sender: Sender, entity: str, strips: Vector, pieces: Sequence[Arcs]) -> None:
    counts = [len(arcs.length) for arcs in pieces]
    numbers = np.concatenate([np.arange(count) for count in counts])
    columns = rr.LineStrips2D.columns(strips=strips_2d(strips), class_ids=numbers)
    style = _style(radii=rr.Radius.ui_points(2.5), draw_order=15, show_labels=False)
    sender.constant(entity, style)
    sender.send(entity, columns, counts)


def send_axes(sender: Sender, entity: str, chart: Chart) -> None:
    """Draw the grid of a chart and the numbers along its axes."""
    if not sender.repeats:
        return
    grid = rr.LineStrips2D(chart.grid(), colors=[colours.GRID], radii=rr.Radius.ui_points(0.6), draw_order=1)
    sender.constant(f"{entity}/grid", grid)
    places, texts = chart.numbers()
    labels = rr.Points2D(
        places, radii=0.0, labels=texts, colors=[colours.WHITE], show_labels=True, draw_order=30
    )
    sender.constant(f"{entity}/numbers", labels)


def _send_colour_bar(sender: Sender, chart: Chart) -> None:
    """Draw the bar of colours along the tension axis, so that its numbers are the bar's too."""
    if not sender.repeats:
        return
    edges = np.linspace(0.0, chart.y.top, _BAR_STEPS + 1)
    line = chart.place(0.0, edges) - [0.32 * chart.box.text, 0.0]
    bar = rr.LineStrips2D(
        segments_2d([line]),
        colors=colours.tension_rgba32(0.5 * (edges[:-1] + edges[1:]), chart.y.top),
        radii=rr.Radius.ui_points(4.0),
        draw_order=2,
    )
    sender.constant("tension/colour_bar", bar)

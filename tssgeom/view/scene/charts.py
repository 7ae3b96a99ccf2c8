"""Columns for Rerun, many frames without a Python object for each number, and charts against arc length."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from tssgeom.arrays import Matrix, Vector
from tssgeom.route.pieces import Arcs
from tssgeom.view import colours
from tssgeom.view.quantities import COUNT, TIMELINE
from tssgeom.view.samples import Ranges, RouteSamples, evenly, staircase


@dataclass(frozen=True, slots=True)
class Sender:
    """Sends the rows of a run to one recording: a row a frame, or one row without time for a static shape."""

    recording: rr.RecordingStream
    time: NDArray[np.float64] | None
    """Time of each row [s], or its number on the timeline `COUNT`; None for a static shape."""
    timeline: str = TIMELINE
    since: float | None = None
    """Time from which on the constants hold [s]; None: always."""
    repeats: bool = True
    """Whether constants are sent at all; otherwise they were sent before, and still hold."""
    below: str = ""
    """Path below which all entities stand, with a slash at its end."""

    def send(
        self, entity: str, columns: rr.ComponentColumnList, lengths: Sequence[int] | None = None
    ) -> None:
        """Send `columns`, of which each row takes the next of `lengths` (by default one) instances."""
        rows = columns if lengths is None else columns.partition(lengths)
        self.recording.send_columns(self.below + entity, indexes=self._indexes(), columns=rows, strict=True)

    def constant(self, entity: str, archetype: rr.AsComponents) -> None:
        """Send a value that is the same in every frame."""
        if not self.repeats:
            return
        if self.since is not None:
            self.recording.set_time(TIMELINE, duration=self.since)
        self.recording.log(self.below + entity, archetype, static=self.since is None, strict=True)

    def line(
        self, entity: str, name: str, colour: tuple[int, int, int], values: Vector, width: float = 2.0
    ) -> None:
        """Send a line over time; its name, its colour and its width hold for all of it."""
        self.constant(entity, rr.SeriesLines(names=name, colors=[colour], widths=[width]))
        self.send(entity, rr.Scalars.columns(scalars=np.asarray(values, np.float64)))

    def always(self, entity: str, archetype: rr.AsComponents) -> None:
        """Send a value that holds for the whole recording, also before `since`; the last one counts."""
        if self.repeats:
            self.recording.log(self.below + entity, archetype, static=True, strict=True)

    def constant_text(self, entity: str, markdown: str) -> None:
        """Send a text that is the same in every frame."""
        self.constant(entity, rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN))

    def _indexes(self) -> list[rr.TimeColumn]:
        if self.time is None:
            return []
        if self.timeline == COUNT:
            return [rr.TimeColumn(COUNT, sequence=self.time.astype(np.int64))]
        return [rr.TimeColumn(self.timeline, duration=self.time)]


def segments_3d(polylines: Sequence[NDArray[np.float64]]) -> pa.Array:
    """Two-point strips [Σ(n−1), 2, 3] of polylines [n, 3], ready for `LineStrips3D`."""
    return _strips(_pairs(polylines), rr.components.LineStrip3DBatch._ARROW_DATATYPE)


def segments_2d(polylines: Sequence[NDArray[np.float64]]) -> pa.Array:
    """Two-point strips [Σ(n−1), 2, 2] of polylines [n, 2], ready for `LineStrips2D`."""
    return _strips(_pairs(polylines), rr.components.LineStrip2DBatch._ARROW_DATATYPE)


def strips_2d(pairs: NDArray[np.float64]) -> pa.Array:
    """Two-point strips from points [m, 2, 2], ready for `LineStrips2D`."""
    return _strips(pairs, rr.components.LineStrip2DBatch._ARROW_DATATYPE)


def lines_2d(polylines: Sequence[NDArray[np.float64]]) -> pa.Array:
    """One strip of one colour from each polyline [n, 2], ready for `LineStrips2D`."""
    ends = np.cumsum([0, *(len(line) for line in polylines)])
    return _cut(np.concatenate(polylines), ends, rr.components.LineStrip2DBatch._ARROW_DATATYPE)


def _pairs(polylines: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in polylines])


def _strips(pairs: NDArray[np.float64], arrow_type: pa.DataType) -> pa.Array:
    return _cut(pairs, np.arange(0, 2 * len(pairs) + 1, 2), arrow_type)


def _cut(points: NDArray[np.float64], ends: NDArray[np.intp], arrow_type: pa.DataType) -> pa.Array:
    """Cut points into strips that end at the indices `ends`."""
    numbers = pa.array(np.ascontiguousarray(points, dtype=np.float32).ravel())
    inner = pa.FixedSizeListArray.from_arrays(numbers, type=arrow_type.value_type)
    return pa.ListArray.from_arrays(pa.array(ends.astype(np.int32)), inner, type=arrow_type)


_LABEL_DROP = 0.6
"""Rerun writes a label below its point, by this part of a line of text."""


@dataclass(frozen=True, slots=True)
class Box:
    """Size of a chart of height 1, chosen so that it fills its view on a common screen."""

    width: float
    """Width over height."""
    text: float
    """Height of a line of text over the height of the box."""
    unitless: bool = False
    """Whether the numbers omit their unit: in a small chart it stands in the title alone."""

    @property
    def x_range(self) -> list[float]:
        """Horizontal range of the view, numbers and margins included."""
        return [-3.1 * self.text, self.width + 2.0 * self.text]

    @property
    def y_range(self) -> list[float]:
        """Vertical range of the view downwards, numbers and margins included."""
        return [-0.8 * self.text, 1.0 + 1.7 * self.text]


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis from its bottom, 0 or less, to its top, with a unit."""

    top: float
    unit: str
    bottom: float = 0.0

    def share(self, value: Vector | float) -> Vector:
        """Return how far along the axis values are [1]; those beyond an edge are held at it."""
        return np.clip((np.asarray(value) - self.bottom) / (self.top - self.bottom), 0.0, 1.0)

    @property
    def ticks(self) -> Vector:
        """Four to eight plain numbers from the bottom to the top; 0 is one of them."""
        rough = (self.top - self.bottom) / 5
        unit = 10.0 ** math.floor(math.log10(rough))
        least = (0.8 if self.bottom else 0.85) * rough  # with both signs fewer multiples fit
        step = next(m * unit for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * unit >= least)
        below = math.floor(-self.bottom / step * (1 + 1e-9))
        return np.round(np.arange(-step * below, self.top * (1 + 1e-9), step), 12) + 0.0  # no -0

    @property
    def labels(self) -> list[str]:
        """The numbers with their unit."""
        return [f"{value:g} {self.unit}" for value in self.ticks]


@dataclass(frozen=True, slots=True)
class Chart:
    """A box of a plane whose y axis points down, for values from the bottom of each axis to its top."""

    x: Axis
    y: Axis
    box: Box

    def position(self, x: Vector | float, y: Vector | float) -> Vector:
        """Positions [n, 2] of values in the plane; values beyond an edge are held at it."""
        across, down = self.box.width * self.x.share(x), 1.0 - self.y.share(y)
        return np.column_stack(np.broadcast_arrays(across, down))

    def grid(self) -> list[Vector]:
        """Lines across the box at every tick, each [2, 2]."""
        upright = [self.position(x, np.array([self.y.bottom, self.y.top])) for x in self.x.ticks]
        level = [self.position(np.array([self.x.bottom, self.x.top]), y) for y in self.y.ticks]
        return [*upright, *level]

    def numbers(self) -> tuple[Vector, list[str]]:
        """Positions [n, 2] and texts of the numbers along both axes."""
        text = self.box.text
        below = self.position(self.x.ticks, self.y.bottom) + np.array([0.0, 0.35 * text])
        beside = self.position(self.x.bottom, self.y.ticks) - np.array([1.9 * text, _LABEL_DROP * text])
        texts = [*self.x.labels, *self.y.labels]
        return np.vstack([below, beside]), [text.split()[0] for text in texts] if self.box.unitless else texts


_BAR_STEPS = 64
_CHART_NODES = 128


def send_tension_chart(
    sender: Sender, frames: Sequence[RouteSamples], pieces: Sequence[Arcs], limits: Ranges, box: Box
) -> None:
    """Draw the tension in its colours, their bar along the tension axis, and the pieces along the foot."""
    chart = Chart(Axis(1e3 * limits.length, "mm"), Axis(limits.tension, "N"), box)
    send_axes(sender, "tension", chart)
    _send_colour_bar(sender, chart)
    nodes = [evenly(len(frame.s), _CHART_NODES) for frame in frames]
    heights = [frame.tension[chosen] for frame, chosen in zip(frames, nodes, strict=True)]
    lines = [
        chart.position(1e3 * frame.s[chosen], height)
        for frame, chosen, height in zip(frames, nodes, heights, strict=True)
    ]
    middles = np.concatenate([0.5 * (height[:-1] + height[1:]) for height in heights])
    columns = rr.LineStrips2D.columns(
        strips=segments_2d(lines), colors=colours.tension_rgba32(middles, limits.tension)
    )
    sender.constant("tension/curve", _style(radii=rr.Radius.ui_points(2.5), draw_order=20))
    sender.send("tension/curve", columns, [len(line) - 1 for line in lines])
    _send_piece_strip(sender, chart, pieces)


def send_curvature_chart(
    sender: Sender, frames: Sequence[RouteSamples], pieces: Sequence[Arcs], limits: Ranges, box: Box
) -> None:
    """Draw the sensed curvature with its standard error, and the pieces as a staircase."""
    chart = Chart(Axis(1e3 * limits.length, "mm"), Axis(limits.kappa, "/m"), box)
    send_axes(sender, "curvature", chart)
    _send_error_bars(sender, chart, frames)
    nodes = [evenly(len(frame.s), _CHART_NODES) for frame in frames]
    lines = [
        chart.position(1e3 * frame.s[chosen], frame.kappa[chosen])
        for frame, chosen in zip(frames, nodes, strict=True)
    ]
    sender.constant(
        "curvature/sensed", _style(radii=rr.Radius.ui_points(1.0), colors=colours.SENSED, draw_order=10)
    )
    sender.send("curvature/sensed", rr.LineStrips2D.columns(strips=lines_2d(lines)))
    _send_staircase(sender, chart, pieces)


def _style(**fields: object) -> rr.LineStrips2D:
    return rr.LineStrips2D.from_fields(**fields)  # pyright: ignore[reportArgumentType]


def _send_error_bars(sender: Sender, chart: Chart, frames: Sequence[RouteSamples]) -> None:
    bars = [_error_bars(chart, frame) for frame in frames]
    style = _style(radii=rr.Radius.ui_points(1.6), colors=colours.BAND, draw_order=5)
    sender.constant("curvature/standard_error", style)
    columns = rr.LineStrips2D.columns(strips=strips_2d(np.concatenate(bars)))
    sender.send("curvature/standard_error", columns, [len(strips) for strips in bars])


def _error_bars(chart: Chart, frame: RouteSamples) -> Vector:
    """Upright strips [m, 2, 2] between κ − s.e. and κ + s.e., dense enough to form a band."""
    chosen = evenly(len(frame.s), _CHART_NODES)
    s, kappa, spread = 1e3 * frame.s[chosen], frame.kappa[chosen], frame.kappa_se[chosen]
    return np.stack([chart.position(s, kappa - spread), chart.position(s, kappa + spread)], axis=1)


def _send_staircase(sender: Sender, chart: Chart, pieces: Sequence[Arcs]) -> None:
    steps = [staircase(arcs) for arcs in pieces]
    corners = np.concatenate([chart.position(1e3 * s, kappa) for s, kappa in steps])
    _send_piece_lines(sender, "curvature/pieces", corners.reshape(-1, 2, 2), pieces)


def _send_piece_strip(sender: Sender, chart: Chart, pieces: Sequence[Arcs]) -> None:
    """Show the pieces by their colours along the foot of a chart."""
    along = np.concatenate([staircase(arcs)[0] for arcs in pieces])
    _send_piece_lines(sender, "tension/pieces", chart.position(1e3 * along, 0.0).reshape(-1, 2, 2), pieces)


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
    positions, texts = chart.numbers()
    labels = rr.Points2D(
        positions, radii=0.0, labels=texts, colors=[colours.WHITE], show_labels=True, draw_order=30
    )
    sender.constant(f"{entity}/numbers", labels)


def _send_colour_bar(sender: Sender, chart: Chart) -> None:
    """Draw the bar of colours along the tension axis, whose numbers it shares."""
    if not sender.repeats:
        return
    edges = np.linspace(0.0, chart.y.top, _BAR_STEPS + 1)
    line = chart.position(0.0, edges) - [0.32 * chart.box.text, 0.0]
    bar = rr.LineStrips2D(
        segments_2d([line]),
        colors=colours.tension_rgba32(0.5 * (edges[:-1] + edges[1:]), chart.y.top),
        radii=rr.Radius.ui_points(4.0),
        draw_order=2,
    )
    sender.constant("tension/colour_bar", bar)


_STILL = 1e-6  # of the greatest tension: a change below it is none


def send_slip_front(
    sender: Sender, frames: Sequence[RouteSamples], fronts: Sequence[float], limits: Ranges, box: Box
) -> None:
    """Mark the front [m] on the route of each frame, and as an upright line in the chart of tension."""
    positions = np.concatenate(
        [frame.at(np.array([front])) for frame, front in zip(frames, fronts, strict=True)]
    )
    style = rr.Points3D.from_fields(colors=colours.FRONT, radii=rr.Radius.ui_points(9.0))
    sender.constant("route/slip_front", style)
    sender.send("route/slip_front", rr.Points3D.columns(positions=positions))
    chart = Chart(Axis(1e3 * limits.length, "mm"), Axis(limits.tension, "N"), box)
    uprights = np.stack([_upright(chart, 1e3 * front, limits.tension) for front in fronts])
    line = rr.LineStrips2D.from_fields(colors=colours.FRONT, radii=rr.Radius.ui_points(1.2), draw_order=12)
    sender.constant("tension/slip_front", line)
    sender.send("tension/slip_front", rr.LineStrips2D.columns(strips=strips_2d(uprights)))


def slid_up_to(tension: Matrix, s: Vector) -> list[float]:
    """Return the arc length up to which the tendon slid at each moment [m]: the last node of changed tension.

    Parameters
    ----------
    tension
        Tension at every moment and node [n, m] [N].
    s
        Arc length of the nodes [m].
    """
    moved = np.abs(np.diff(tension, axis=0)) > _STILL * max(float(tension.max()), 1e-300)
    last = [int(np.flatnonzero(row)[-1]) if row.any() else 0 for row in moved]
    return [0.0, *s[last].tolist()]


def _upright(chart: Chart, s_mm: float, top: float) -> Vector:
    return chart.position(np.array([s_mm, s_mm]), np.array([0.0, top]))

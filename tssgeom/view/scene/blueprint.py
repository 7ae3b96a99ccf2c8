"""Layout of a recording in the Rerun viewer: its views, their sizes and cameras, and the time panel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import rerun as rr
import rerun.blueprint as rrb

from tssgeom.view import colours
from tssgeom.view.quantities import COUNT, TIMELINE
from tssgeom.view.scene.charts import Box
from tssgeom.view.scene.labels import Camera

BACKGROUND = rrb.Background(color=colours.BACKGROUND)
_IN_SPACE = ("route", "sensed", "joints", "labels", "lumen", "scale")
_LEGEND = 0.26
"""Room for a legend before the first sample, over the span of all; chosen: two fifths of a screen of 1280 px,
less the numbers of the axis, have the longest name of a quantity there."""
Span = tuple[float, float]
"""First and last time of a run [s], or count of its samples."""


class ChartBoxes(NamedTuple):
    """Sizes of both charts against arc length."""

    tension: Box
    curvature: Box


def chart_boxes(*, timed: bool) -> ChartBoxes:
    """Give sizes that fill the views of `blueprint`; a run leaves less height to each chart."""
    if timed:
        return ChartBoxes(Box(width=3.9, text=0.145), Box(width=4.7, text=0.18))
    return ChartBoxes(Box(width=1.75, text=0.065), Box(width=1.75, text=0.065))


def blueprint(
    name: str,
    camera: Camera,
    *,
    timed: bool,
    live: bool = False,
    moving: bool = True,
    tension: float | None = None,
    span: Span | None = None,
    more: rrb.Container | None = None,
) -> rrb.Blueprint:
    """Arrange the views of a shape, or of a run with its series and its timeline; `live` shows the newest.

    The plot of tensions ends at `tension` [N] where that is known; that of the curve angle is left out where
    the route is not `moving`. Where the `span` of the run is known, legends stand before it. `more` is a
    second tab.
    """
    views = _run_views(name, camera, tension, span, moving=moving) if timed else _shape_views(name, camera)
    if more is not None:
        views.name = name
        views = rrb.Tabs(views, more)
    return layout(views, time_panel(timed=timed, live=live))


def _shape_views(name: str, camera: Camera) -> rrb.Container:
    left = rrb.Vertical(_space(name, camera), _texts(), row_shares=[68, 32])
    right = rrb.Vertical(*_charts(timed=False))
    return rrb.Horizontal(left, right, column_shares=[6, 4])


def _run_views(
    name: str, camera: Camera, tension: float | None, span: Span | None, *, moving: bool
) -> rrb.Container:
    left = rrb.Vertical(_space(name, camera, "; slip front in pink"), _texts(), row_shares=[66, 34])
    series = _series(tension, span)[: 3 if moving else 2]
    right = rrb.Vertical(*_charts(timed=True), *series, row_shares=[26, 22, 20, 16, 16][: 2 + len(series)])
    return rrb.Horizontal(left, right, column_shares=[58, 42])


def _space(name: str, camera: Camera, more: str = "") -> rrb.Spatial3DView:
    title = f"{name}: route coloured by tension [N], pieces with angle and radius{more}"
    return space_view(title, camera)


def _charts(*, timed: bool) -> tuple[rrb.Spatial2DView, rrb.Spatial2DView]:
    boxes = chart_boxes(timed=timed)
    return (
        chart("tension", "Tension T [N] against arc length s [mm]", boxes.tension),
        chart("curvature", "Curvature κ ± s.e. [1/m] and pieces against arc length s [mm]", boxes.curvature),
    )


def _texts() -> rrb.Container:
    summary = rrb.TextDocumentView(origin="summary", name="Summary")
    table = rrb.TextDocumentView(origin="table", name="Pieces of constant curvature")
    return rrb.Horizontal(summary, table, column_shares=[5, 6])


def _series(tension: float | None, span: Span | None) -> list[rrb.TimeSeriesView]:
    tensions = ["series/tension_in", "series/tension_out", "series/tension_out_measured"]
    angles = ["series/angle", "series/angle_least", "series/angle_most"]
    elongations = ["series/elongation", "series/elongation_measured"]
    return [
        plot("Tension [N] against time [s]", tensions, top=tension, named=True, span=span),
        plot("Elongation δ [mm] against time [s]", elongations, named=True, span=span),
        plot("Accumulated curve angle Φ ± s.e. [°] against time [s]", angles, named=True, span=span),
    ]


def layout(views: rrb.Container, time: rrb.TimePanel) -> rrb.Blueprint:
    """Return the layout of a recording: its views and the panel of its time, everything else folded away."""
    return rrb.Blueprint(
        views,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        time,
        auto_views=False,
        auto_layout=False,
    )


def time_panel(*, timed: bool = True, live: bool = False, timeline: str = TIMELINE) -> rrb.TimePanel:
    """Return the panel of a timeline, stopped at its beginning; `live` follows the newest frame."""
    if live:
        return rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following")
    if not timed:
        return rrb.TimePanel(state="hidden")
    return rrb.TimePanel(state="collapsed", timeline=timeline, play_state="paused", loop_mode="all")


def space_view(
    title: str, camera: Camera, parts: Sequence[str] = _IN_SPACE, *, below: str = ""
) -> rrb.Spatial3DView:
    """Return a view of those parts of a recording that stand in space, `below` an entity."""
    return rrb.Spatial3DView(
        name=title,
        contents=[f"{below}{part}/**" for part in parts],
        background=BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind="Orbital", position=camera.eye, look_target=camera.target, eye_up=camera.up
        ),
    )


def chart(entity: str, title: str, box: Box) -> rrb.Spatial2DView:
    """Return the view of a chart that is drawn in a box."""
    return rrb.Spatial2DView(
        origin=entity,
        name=title,
        background=BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=box.x_range, y_range=box.y_range),
    )


def plot(
    title: str,
    contents: list[str],
    *,
    top: float | None = None,
    named: bool = False,
    span: Span | None = None,
) -> rrb.TimeSeriesView:
    """Return a view of lines over time, from 0 to `top` where that is given.

    Where the lines are `named`, a legend stands in the view instead of its title bar, before the `span` of
    the lines where that is given.
    """
    return rrb.TimeSeriesView(
        name=title,
        contents=contents,
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=None if named else False),
        titlebar=False if named else None,
        axis_x=beside_legend(span),
        axis_y=from_zero(top),
    )


def beside_legend(span: Span | None, timeline: str = TIMELINE) -> rrb.archetypes.TimeAxis | None:
    """Return an axis of time with room for a legend before the lines; None for what the viewer fits."""
    if span is None or span[1] <= span[0]:
        return None
    first, last = span[0] - _LEGEND * (span[1] - span[0]), span[1]
    at = rr.encodings.TimeRangeBoundary.absolute
    begin, end = (
        (at(seq=round(first)), at(seq=round(last)))
        if timeline == COUNT
        else (at(seconds=first), at(seconds=last))
    )
    return rrb.archetypes.TimeAxis(view_range=rr.encodings.TimeRange(start=begin, end=end))


def from_zero(top: float | None) -> rrb.ScalarAxis | None:
    """Return an axis from 0 to its top, so that 0 and a number stand at it; None for what the viewer fits.

    The viewer writes few numbers, in steps of powers of ten: of 2 to 18 it writes 10 alone, of 0 to 8 only 0
    where there is little room. So an axis that a power of ten at most doubles ends there.
    """
    if top is None:
        return None
    power = 10.0 ** math.ceil(math.log10(top)) if top > 0 else 0.0
    most = power if power < 2.0 * top else top
    return rrb.ScalarAxis(range=(-0.05 * most, 1.05 * most))

"""Layout of a recording in the Rerun viewer: its views, their sizes and cameras, and the time panel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import rerun.blueprint as rrb

from tssgeom.view import colours
from tssgeom.view.quantities import TIMELINE
from tssgeom.view.scene.camera import Camera
from tssgeom.view.scene.charts import Box

BACKGROUND = rrb.Background(color=colours.BACKGROUND)
_IN_SPACE = ("route", "sensed", "joints", "labels", "lumen", "scale")


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
    more: rrb.Container | None = None,
) -> rrb.Blueprint:
    """Arrange the views of a shape, or of a run with its series and its timeline; `live` shows the newest.

    The plot of tensions ends at `tension` [N] where that is known; that of the curve angle is left out where
    the route is not `moving`. `more` is a second tab.
    """
    views = _run_views(name, camera, tension, moving=moving) if timed else _shape_views(name, camera)
    if more is not None:
        views.name = name
        views = rrb.Tabs(views, more)
    return layout(views, time_panel(timed=timed, live=live))


def _shape_views(name: str, camera: Camera) -> rrb.Container:
    left = rrb.Vertical(_space(name, camera), _texts(), row_shares=[68, 32])
    right = rrb.Vertical(*_charts(timed=False))
    return rrb.Horizontal(left, right, column_shares=[6, 4])


def _run_views(name: str, camera: Camera, tension: float | None, *, moving: bool) -> rrb.Container:
    left = rrb.Vertical(_space(name, camera, "; slip front in pink"), _texts(), row_shares=[66, 34])
    series = _series(tension)[: 3 if moving else 2]
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


def _series(tension: float | None) -> list[rrb.TimeSeriesView]:
    tensions = ["series/tension_in", "series/tension_out", "series/tension_out_measured"]
    angles = ["series/angle", "series/angle_least", "series/angle_most"]
    elongations = ["series/elongation", "series/elongation_measured"]
    return [
        plot("Tension [N] against time [s]", tensions, top=tension, named=True),
        plot("Elongation δ [mm] against time [s]", elongations, named=True),
        plot("Accumulated curve angle Φ ± s.e. [°] against time [s]", angles, named=True),
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
        return rrb.TimePanel(state="collapsed", timeline=timeline, play_state="following")
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
    title: str, contents: list[str], *, top: float | None = None, named: bool = False
) -> rrb.TimeSeriesView:
    """Return a view of lines over time, from 0 to `top` where that is given.

    Where the lines are `named`, a legend stands in the view instead of its title bar.
    """
    return rrb.TimeSeriesView(
        name=title,
        contents=contents,
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=None if named else False),
        titlebar=False if named else None,
        axis_y=from_zero(top),
    )


def from_zero(top: float | None) -> rrb.ScalarAxis | None:
    """Return an axis from 0 to its top, so that 0 and a number stand at it; None for what the viewer fits.

    The viewer writes few numbers, in steps of powers of ten: of 2 to 18 it writes 10 alone.
    """
    return None if top is None else rrb.ScalarAxis(range=(-0.05 * top, 1.05 * top))

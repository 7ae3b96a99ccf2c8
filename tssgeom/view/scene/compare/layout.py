"""What the viewer shows of two recordings: a column each with the same views, and below what differs."""

from __future__ import annotations

import rerun.blueprint as rrb

from tssgeom.view import colours
from tssgeom.view.quantities import ELONGATION, TIMELINE
from tssgeom.view.scene.blueprint import chart, from_zero
from tssgeom.view.scene.camera import Camera
from tssgeom.view.scene.chart import Box
from tssgeom.view.scene.compare.difference import Difference

CHART_BOX = Box(width=1.9, text=0.12, bare=True)
BOTH_BOX = Box(width=3.1, text=0.115)


def blueprint(
    names: dict[str, str], cameras: dict[str, Camera], gap: Difference | None, tension: float
) -> rrb.Blueprint:
    """Lay out the views; one time line moves both columns. The plot of tensions ends at `tension` [N]."""
    columns = rrb.Horizontal(*(_column(side, names[side], cameras[side]) for side in ("a", "b")))
    words = rrb.TextDocumentView(origin="difference/words", name="What differs")
    table = rrb.TextDocumentView(origin="difference/table", name="At the greatest pull of each")
    below = (
        rrb.Horizontal(words, table, _both(), column_shares=[30, 20, 50])
        if gap is None
        else rrb.Horizontal(words, table, *_plots(tension), column_shares=[26, 20, 27, 27])
    )
    state = "hidden" if gap is None else "collapsed"
    return rrb.Blueprint(
        rrb.Vertical(columns, below, row_shares=[65, 35]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state=state, timeline=TIMELINE, play_state="paused", loop_mode="all"),
        auto_views=False,
        auto_layout=False,
    )


def _column(side: str, name: str, seen: Camera) -> rrb.Container:
    space = rrb.Spatial3DView(
        name=f"{name}: route coloured by tension [N]",
        contents=[f"{side}/{part}/**" for part in ("route", "sensed", "joints", "labels", "lumen", "scale")],
        background=rrb.Background(color=colours.BACKGROUND),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind="Orbital", position=seen.eye, look_target=seen.target, eye_up=seen.up
        ),
    )
    charts = rrb.Horizontal(
        chart(f"{side}/tension", "Tension T [N] against s [mm]", CHART_BOX),
        chart(f"{side}/curvature", "Curvature κ ± s.e. [1/m] against s [mm]", CHART_BOX),
    )
    return rrb.Vertical(space, charts, row_shares=[66, 34])


def _both() -> rrb.Spatial2DView:
    title = "Tension T [N] against arc length s [mm]: A blue, B orange, difference white"
    return chart("difference/tension", title, BOTH_BOX)


def _plots(top: float) -> list[rrb.Container]:
    tension = [f"{side}/series/{name}" for name in ("tension_in", "tension_out") for side in ("a", "b")]
    stretch = [f"{side}/series/elongation" for side in ("a", "b")]
    return [
        rrb.Vertical(
            _plot("T_out [N] over time: A blue, B orange; T_in grey", tension, top),
            _plot("T_out of B less that of A [N]", ["difference/tension_out"]),
        ),
        rrb.Vertical(
            _plot(f"{ELONGATION.label} over time: A blue, B orange", stretch),
            _plot("δ of B less that of A [mm]", ["difference/elongation"]),
        ),
    ]


def _plot(title: str, contents: list[str], top: float | None = None) -> rrb.TimeSeriesView:
    legend = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=False)
    return rrb.TimeSeriesView(name=title, contents=contents, plot_legend=legend, axis_y=from_zero(top))

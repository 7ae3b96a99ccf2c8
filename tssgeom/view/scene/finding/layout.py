"""What the viewer shows of a finding when it opens: two views of the route, two charts, words and lines."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb

from tssgeom.identify.finding import Finding
from tssgeom.view import colours
from tssgeom.view import finding_wording as words
from tssgeom.view.figures.finding import models
from tssgeom.view.quantities import COUNT
from tssgeom.view.scene.blueprint import Span, beside_legend, from_zero
from tssgeom.view.scene.charts import Box
from tssgeom.view.scene.finding.lines import column, plotted_channels
from tssgeom.view.scene.finding.replay import Replay, friction_map

TENSION_BOX = MISFIT_BOX = Box(width=1.9, text=0.1)


_ROUTE = ["route/**", "joints/**", "labels/**", "scale/**"]


def blueprint(finding: Finding, displayed: Replay) -> rrb.Blueprint:
    """Arrange the views; one slider over the samples of all runs moves them together."""
    learnt = friction_map(finding) is not None
    along = "Friction μ along the route, learnt" if learnt else "What this route misses, before [rad/m]"
    charted = "Friction μ ± s.e." if learnt else "Missing curve angle ± s.e. [rad/m]"
    spaces = rrb.Horizontal(
        _space(_ROUTE, "Route coloured by tension [N]; slip front in pink", displayed),
        _space(["blame/**"], along, displayed),
    )
    charts = rrb.Horizontal(
        _chart("tension", "Tension T [N] against arc length s [mm]", TENSION_BOX),
        _chart("missing", f"{charted} against s [mm]", MISFIT_BOX),
    )
    text = rrb.Horizontal(
        rrb.TextDocumentView(origin="summary", name="What is missing"),
        rrb.TextDocumentView(origin="table", name="Which run this is"),
        column_shares=[6, 5],
    )
    left = rrb.Vertical(spaces, charts, text, row_shares=[38, 30, 32])
    right = rrb.Vertical(*_plots(finding, displayed.tension))
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[56, 44]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=COUNT, play_state="paused", loop_mode="all"),
        auto_views=False,
        auto_layout=False,
    )


def _space(contents: list[str], title: str, displayed: Replay) -> rrb.Spatial3DView:
    observed = displayed.camera
    return rrb.Spatial3DView(
        contents=contents,
        name=title,
        background=rrb.Background(color=colours.BACKGROUND),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind="Orbital", position=observed.eye, look_target=observed.target, eye_up=observed.up
        ),
    )


def _chart(origin: str, title: str, box: Box) -> rrb.Spatial2DView:
    return rrb.Spatial2DView(
        origin=origin,
        name=title,
        background=rrb.Background(color=colours.BACKGROUND),
        visual_bounds=rrb.VisualBounds2D(x_range=box.x_range, y_range=box.y_range),
    )


def _plots(finding: Finding, tension: float) -> list[rrb.TimeSeriesView]:
    """Arrange the channel with the largest misfit, and below it what is left of each channel."""
    channels = [(name, words.channel(name)) for name in plotted_channels(finding)]
    name, widest = channels[0]
    most = max(float(np.nanmax(each.measured.get(name, 0.0), initial=0.0)) for each in finding.traces)
    top = max(tension, most) if widest.unit == "N" else None
    span = 0.0, float(sum(len(each.time) for each in finding.traces) - 1)
    title = f"{widest.label} over the samples of all runs"
    first = _plot("channel", title, span, legend=True, axis=from_zero(top))
    left = [
        _plot(
            f"left/{name}",
            f"Δ{reported.label}, measured less simulated, ± 2σ of the sensors",
            span,
            legend=k == 0,
            axis=_of_residuals(finding, name, reported.factor),
        )
        for k, (name, reported) in enumerate(channels)
    ]
    return [first, *left]


def _of_residuals(finding: Finding, name: str, factor: float) -> rrb.ScalarAxis:
    """Return an axis that the residuals fill; where the noise is larger for a moment, its band leaves it."""
    measured, sigma = (column(finding.traces, when, name) for when in ("measured", "sigma"))
    left = [np.abs(measured - column(finding.traces, when, name)) for when in models(finding)]
    most = factor * max(2.0 * float(np.nanmedian(sigma)), float(np.nanmax(left)))
    return rrb.ScalarAxis(range=(-1.1 * most, 1.1 * most))


def _plot(
    origin: str, title: str, span: Span, *, legend: bool, axis: rrb.ScalarAxis | None
) -> rrb.TimeSeriesView:
    corner = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=legend)
    across = beside_legend(span, COUNT)
    return rrb.TimeSeriesView(origin=origin, name=title, plot_legend=corner, axis_x=across, axis_y=axis)

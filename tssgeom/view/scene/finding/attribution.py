"""The curve angle that each route misses, against arc length, in a 2-D view of a recording."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from tssgeom.view import colours
from tssgeom.view.scene.charts import Axis, Box, Chart, send_axes
from tssgeom.view.scene.columns import Sender, segments_2d, strips_2d
from tssgeom.view.scene.finding.replay import Replay

_STEPS = 48


def send_misfit_chart(runs: Sender, displayed: Replay, bends_m: Sequence[float], box: Box) -> None:
    """Draw what is missing with its standard error, in its own colours; what is too much lies at the foot.

    Upright lines stand where bends were detected, `bends_m`.
    """
    chart = Chart(Axis(1e3 * displayed.length, "mm"), Axis(displayed.misfit, ""), box)
    send_axes(runs, "missing", chart)
    if bends_m:
        uprights = [chart.position(1e3 * at, np.array([0.0, displayed.misfit])) for at in bends_m]
        line = rr.LineStrips2D(
            uprights, colors=[colours.AFTER], radii=rr.Radius.ui_points(1.2), draw_order=15
        )
        runs.constant("missing/found", line)
    _send_colour_bar(runs, chart, displayed.misfit)
    each = displayed.stretches
    bars = [
        np.stack(
            [chart.position(1e3 * one.s, one.misfit + side * one.misfit_se) for side in (-1.0, 1.0)], axis=1
        )
        for one in each
    ]
    band = rr.LineStrips2D.from_fields(radii=rr.Radius.ui_points(2.4), colors=colours.BAND, draw_order=5)
    runs.constant("missing/standard_error", band)
    runs.send(
        "missing/standard_error",
        rr.LineStrips2D.columns(strips=strips_2d(np.concatenate(bars))),
        [len(bar) for bar in bars],
    )
    lines = [chart.position(1e3 * one.s, one.misfit) for one in each]
    middles = np.concatenate([0.5 * (one.misfit[:-1] + one.misfit[1:]) for one in each])
    style = rr.LineStrips2D.from_fields(radii=rr.Radius.ui_points(2.5), draw_order=20)
    runs.constant("missing/curve", style)
    columns = rr.LineStrips2D.columns(
        strips=segments_2d(lines), colors=colours.misfit_rgba32(middles, displayed.misfit)
    )
    runs.send("missing/curve", columns, [len(line) - 1 for line in lines])


def _send_colour_bar(runs: Sender, chart: Chart, top: float) -> None:
    steps = np.linspace(0.0, top, _STEPS + 1)
    line = chart.position(0.0, steps) - np.array([0.012 * chart.box.width, 0.0])
    bar = rr.LineStrips2D.from_fields(
        strips=segments_2d([line]),
        colors=colours.misfit_rgba32(0.5 * (steps[:-1] + steps[1:]), top),
        radii=rr.Radius.ui_points(4.0),
        draw_order=8,
    )
    runs.constant("missing/colour_bar", bar)

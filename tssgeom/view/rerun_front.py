"""The slip front in a Rerun recording: up to where the tendon slid when the drive last moved."""

from __future__ import annotations

import numpy as np
import rerun as rr

from tssgeom.arrays import Vector
from tssgeom.view import colours
from tssgeom.view.chart import Axis, Box, Chart
from tssgeom.view.columns import Sender, strips_2d
from tssgeom.view.run import Run


def send_slip_front(sender: Sender, run: Run, box: Box) -> None:
    """Mark the front on the route of each frame, and as an upright line in the chart of tension."""
    _send_place(sender, run)
    _send_line(sender, run, box)


def _send_place(sender: Sender, run: Run) -> None:
    pairs = zip(run.frames, run.fronts, strict=True)
    places = np.concatenate([frame.at(np.array([front])) for frame, front in pairs])
    style = rr.Points3D.from_fields(colors=colours.FRONT, radii=rr.Radius.ui_points(9.0))
    sender.constant("route/slip_front", style)
    sender.send("route/slip_front", rr.Points3D.columns(positions=places))


def _send_line(sender: Sender, run: Run, box: Box) -> None:
    limits = run.ranges
    chart = Chart(Axis(1e3 * limits.length, "mm"), Axis(limits.tension, "N"), box)
    uprights = np.stack([_upright(chart, 1e3 * front, limits.tension) for front in run.fronts])
    style = rr.LineStrips2D.from_fields(colors=colours.FRONT, radii=rr.Radius.ui_points(1.2), draw_order=12)
    sender.constant("tension/slip_front", style)
    sender.send("tension/slip_front", rr.LineStrips2D.columns(strips=strips_2d(uprights)))


def _upright(chart: Chart, s_mm: float, top: float) -> Vector:
    return chart.place(np.array([s_mm, s_mm]), np.array([0.0, top]))

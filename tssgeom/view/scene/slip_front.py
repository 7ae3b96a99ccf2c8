"""The slip front in a Rerun recording: up to where the tendon slid when the drive last moved."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from tssgeom.arrays import Matrix, Vector
from tssgeom.view import colours
from tssgeom.view.samples import Drawn, Ranges
from tssgeom.view.scene.chart import Axis, Box, Chart
from tssgeom.view.scene.columns import Sender, strips_2d

_STILL = 1e-6  # of the greatest tension: a change below it is none


def send_slip_front(
    sender: Sender, frames: Sequence[Drawn], fronts: Sequence[float], limits: Ranges, box: Box
) -> None:
    """Mark the front [m] on the route of each frame, and as an upright line in the chart of tension."""
    places = np.concatenate(
        [frame.at(np.array([front])) for frame, front in zip(frames, fronts, strict=True)]
    )
    style = rr.Points3D.from_fields(colors=colours.FRONT, radii=rr.Radius.ui_points(9.0))
    sender.constant("route/slip_front", style)
    sender.send("route/slip_front", rr.Points3D.columns(positions=places))
    chart = Chart(Axis(1e3 * limits.length, "mm"), Axis(limits.tension, "N"), box)
    uprights = np.stack([_upright(chart, 1e3 * front, limits.tension) for front in fronts])
    line = rr.LineStrips2D.from_fields(colors=colours.FRONT, radii=rr.Radius.ui_points(1.2), draw_order=12)
    sender.constant("tension/slip_front", line)
    sender.send("tension/slip_front", rr.LineStrips2D.columns(strips=strips_2d(uprights)))


def slid_up_to(tension: Matrix, s: Vector) -> list[float]:
    """Return how far the tendon slid up to each moment [m]: to the last node whose tension changed.

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
    return chart.place(np.array([s_mm, s_mm]), np.array([0.0, top]))

"""Figure of commands: where they bring the distal end, with 95 % bounds, beside the target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from tssgeom.arrays import Vector
from tssgeom.tendon.command import Command
from tssgeom.tendon.command_error import MOST_OUTSIDE, bound
from tssgeom.view.figures.plots import BLUE, INK, ORANGE, PAGE, figure, legend_below, titles

_BAND = "#c9dcea"
_HEIGHT = 3.3  # inch; chosen: two rows and a legend


def command_figure(time: Vector, target: Vector, commands: Sequence[Command], *, by_tension: bool) -> Figure:
    """Draw the distal end over time and its target, and mark what is cut, waits or is out of tolerance.

    `target` is [n] the movement of the load [m], or with `by_tension` the distal tension [N].
    """
    if by_tension:
        name, factor = "T_out [N]", 1.0
        reached = np.array([each.tension_reached for each in commands])
        error = np.array([bound(each.tension_out_se) for each in commands])
    else:
        name, factor = "x_out [mm]", 1e3
        reached = np.array([each.displacement_reached for each in commands])
        error = np.array([bound(each.displacement_out_se) for each in commands])
    with figure((PAGE, _HEIGHT)) as drawing:
        axes, below = drawing.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
        low, high = factor * (reached - error), factor * (reached + error)
        axes.fill_between(time, low, high, color=_BAND, linewidth=0, label="95 % bounds")
        axes.plot(time, factor * reached, color=BLUE, linewidth=1.4, label="commanded")
        axes.plot(time, factor * target, color=INK, linestyle=(0, (4, 1.5)), linewidth=1.0, label="target")
        left = factor * (reached - target)
        below.fill_between(time, left - factor * error, left + factor * error, color=_BAND, linewidth=0)
        below.plot(time, left, color=BLUE, linewidth=1.2)
        marks = (
            ("cut by a limit", "v", [bool(each.limited) for each in commands]),
            ("waits", "s", [each.waits for each in commands]),
            ("out of tolerance", "x", [(each.out_of_tolerance or 0.0) > MOST_OUTSIDE for each in commands]),
        )
        for label, marker, flagged in marks:
            if any(flagged):
                at = np.flatnonzero(flagged)
                style = {"color": ORANGE, "marker": marker, "markersize": 3.0, "linestyle": "none"}
                axes.plot(time[at], factor * reached[at], label=label, **style)
        axes.margins(x=0.02)
        titles(axes, "Where the commands bring the distal end; below, its distance from the target", "", name)
        titles(below, "", "time t [s]", f"less target\n[{'N' if by_tension else 'mm'}]")
        legend_below(drawing, axes, 6)
        drawing.align_ylabels([axes, below])
    return drawing

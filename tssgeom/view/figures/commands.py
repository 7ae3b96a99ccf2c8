"""Figures of commands beside their target, and of what an added curve gains and costs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tssgeom.arrays import Vector
from tssgeom.tendon.command import Command
from tssgeom.tendon.command_error import MOST_OUTSIDE, bound
from tssgeom.tendon.design import Tried
from tssgeom.view.figures.plots import (
    BAND,
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PAGE,
    SOFT,
    figure,
    legend_below,
    note,
    titles,
)
from tssgeom.view.quantities import DISPLACEMENT_IN, DISPLACEMENT_OUT, TENSION_IN, TENSION_OUT, TIME, Quantity

_ACROSS = "angle of the added curve β [°]"


_HEIGHT = 4.4  # inch; chosen: three rows and a legend


def command_figure(time: Vector, target: Vector, commands: Sequence[Command], *, by_tension: bool) -> Figure:
    """Draw the drive and the distal end over time, and mark what is cut, waits or is out of tolerance.

    `target` is [n] the movement of the load [m], or with `by_tension` the distal tension [N].
    """
    with figure((PAGE, _HEIGHT)) as drawing:
        drive, axes, below = drawing.subplots(3, 1, sharex=True, height_ratios=(1.6, 1.6, 1.0))
        draw_drive(drive, time, commands, by_tension=by_tension)
        draw_commands(axes, time, target, commands, by_tension=by_tension)
        draw_missed(below, time, target, commands, by_tension=by_tension)
        axes.set_title("Where they bring the distal end; below, its distance from the target")
        below.set_title("")
        for each in (drive, axes):
            each.set_xlabel("")
        legend_below(drawing, axes, 6)
        drawing.align_ylabels([drive, axes, below])
    return drawing


def draw_drive(axes: Axes, time: Vector, commands: Sequence[Command], *, by_tension: bool) -> Axes:
    """Draw the commands themselves: tensions of the drive for targets of tension, else displacements."""
    of = TENSION_IN if by_tension else DISPLACEMENT_IN
    values = [each.tension_in if by_tension else each.displacement_in for each in commands]
    axes.plot(time, of.factor * np.array(values), color=of.ink, linewidth=1.2)
    titles(axes, "Commands of the drive", TIME.title, of.label)
    return axes


def draw_commands(
    axes: Axes, time: Vector, target: Vector, commands: Sequence[Command], *, by_tension: bool
) -> Axes:
    """Draw where commands bring the distal end, with 95 % bounds, beside the target; as `command_figure`."""
    of, reached, error = _reached(commands, by_tension=by_tension)
    axes.fill_between(time, reached - error, reached + error, color=BAND, linewidth=0, label="95 % bounds")
    axes.plot(time, reached, color=BLUE, linewidth=1.4, label="commanded")
    wanted = of.factor * target
    axes.plot(time, wanted, color=INK, linestyle=(0, (4, 1.5)), linewidth=1.0, label="target")
    marks = (
        ("cut by a limit", "v", [bool(each.limited) for each in commands]),
        ("waits", "s", [each.waits for each in commands]),
        ("out of tolerance", "x", [(each.out_of_tolerance or 0.0) > MOST_OUTSIDE for each in commands]),
    )
    for label, marker, flagged in marks:
        if any(flagged):
            at = np.flatnonzero(flagged)
            style = {"color": ORANGE, "marker": marker, "markersize": 3.0, "linestyle": "none"}
            axes.plot(time[at], reached[at], label=label, **style)
    axes.margins(x=0.02)
    titles(axes, "Where the commands bring the distal end", TIME.title, of.label)
    return axes


def draw_missed(
    axes: Axes, time: Vector, target: Vector, commands: Sequence[Command], *, by_tension: bool
) -> Axes:
    """Draw how far from the target commands bring the distal end, with 95 % bounds; as `command_figure`."""
    of, reached, error = _reached(commands, by_tension=by_tension)
    left = reached - of.factor * target
    axes.fill_between(time, left - error, left + error, color=BAND, linewidth=0, label="95 % bounds")
    axes.plot(time, left, color=BLUE, linewidth=1.2)
    titles(axes, "Distal end less target", TIME.title, f"less target\n[{of.unit}]")
    return axes


def _reached(commands: Sequence[Command], *, by_tension: bool) -> tuple[Quantity, Vector, Vector]:
    """Return what the target is of, what is reached and its 95 % bound, in the unit of the picture."""
    if by_tension:
        of, values = TENSION_OUT, [(each.tension_reached, each.tension_out_se) for each in commands]
    else:
        of, values = DISPLACEMENT_OUT, [(e.displacement_reached, e.displacement_out_se) for e in commands]
    reached, error = np.array([(value, bound(se)) for value, se in values]).T
    return of, of.factor * reached, of.factor * error


def remedy_figure(tried: Sequence[Tried], tolerance: float | None, percentile: float) -> Figure:
    """Draw the changes that perturbations make, and the price, over the angle of the curve."""
    beta = np.degrees([each.curve.angle for each in tried])
    with figure((PAGE, 2.9)) as drawing:
        gain, out, own = drawing.subplots(1, 3)
        gain.plot(beta, [1e3 * each.disturbed.pull for each in tried], color=BLUE, label="end of the pull")
        gain.plot(
            beta,
            [1e3 * each.disturbed.elongation[-1] for each in tried],
            color=ORANGE,
            linestyle=(0, (5, 1.5)),
            label="end of the release",
        )
        gain.axhline(1e3 * tried[0].disturbed.pull, color=SOFT, linewidth=0.9)
        note(
            gain,
            "pull, same T_out",
            (0.98 * beta[-1], 1e3 * tried[0].disturbed.pull),
            xytext=(0, -2),
            textcoords="offset points",
            ha="right",
            va="top",
        )
        _mark_tolerance(gain, tolerance, float(beta[-1]))
        out.plot(beta, [each.price.tension_out for each in tried], color=GREEN)
        own.plot(beta, [1e3 * each.price.own_elongation for each in tried], color=GREEN)
        gain.legend(loc="upper right", borderaxespad=0.0, bbox_to_anchor=(1.0, 0.9))
        titles(gain, "(a) Effect of unknown bends", _ACROSS, f"|Δδ|, percentile {percentile:g} [mm]")
        titles(out, "(b) Price: distal tension", _ACROSS, "T_out at the end of the pull [N]")
        titles(own, "(c) Price: own elongation", _ACROSS, "δ of the added curve [mm]")
        for axes in (gain, out, own):
            axes.set_xlim(0, beta[-1])
            axes.set_xticks(np.arange(0, beta[-1] + 1, 360))
            axes.set_ylim(0, None)
    return drawing


def _mark_tolerance(axes: Axes, tolerance: float | None, right: float) -> None:
    if tolerance is None:
        return
    axes.axhline(1e3 * tolerance, color=INK, linewidth=0.9, linestyle=(0, (1, 1.5)))
    note(axes, "tolerance", (0.98 * right, 1e3 * tolerance), ha="right", va="bottom", color=INK)

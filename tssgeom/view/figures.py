"""Figures of the report as small SVG texts: route, tension, curvature, and a run against time."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from tssgeom.arrays import Vector
from tssgeom.shape.arcs import Arcs
from tssgeom.stream import FrameResult
from tssgeom.view import colours
from tssgeom.view.camera import camera
from tssgeom.view.drawn import Drawn, Ranges, drawn, evenly, ranges, staircase
from tssgeom.view.plots import inline_svg
from tssgeom.view.report_entry import Series

_NODES = 128
_MOMENTS = 500
_WIDTH = 11.4
_INK = "#1d2330"
_SOFT = "#8a93a3"
_TENSION = "#26828e"
_ELONGATION = "#d55e00"
_RC: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "tssgeom",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.edgecolor": _SOFT,
    "axes.labelcolor": _INK,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e8ebf0",
    "xtick.color": _SOFT,
    "ytick.color": _SOFT,
    "xtick.labelcolor": _INK,
    "ytick.labelcolor": _INK,
    "path.simplify_threshold": 0.3,
}


def shape_figure(result: FrameResult) -> str:
    """Draw a route coloured by tension, and its tension and curvature along arc length, as SVG."""
    frame = drawn(result, _NODES)
    limits = ranges([frame], [result.arcs])
    with mpl.rc_context(_RC):
        figure = Figure(figsize=(_WIDTH, 3.1), layout="constrained")
        route, tension, curvature = figure.subplots(1, 3, width_ratios=[1.25, 1.0, 1.0])
        _draw_route(route, frame, result.arcs, limits)
        _draw_tension(tension, frame, limits)
        _draw_curvature(curvature, frame, result.arcs, limits)
        return inline_svg(figure)


def run_figure(run: Series) -> str:
    """Draw tensions and elongation against time, and both against the proximal tension, as SVG."""
    chosen = evenly(len(run.time), _MOMENTS)
    time, tension_in, tension_out = run.time[chosen], run.tension_in[chosen], run.tension_out[chosen]
    elongation = 1e3 * run.elongation[chosen]
    with mpl.rc_context(_RC):
        figure = Figure(figsize=(_WIDTH, 2.5), layout="constrained")
        axes = figure.subplots(1, 4, width_ratios=[1.5, 1.5, 1.0, 1.0])
        _line(axes[0], time, tension_in, "T_in", _INK)
        _line(axes[0], time, tension_out, "T_out", _TENSION)
        axes[0].legend(frameon=False, loc="upper right", ncols=2, borderaxespad=0.0)
        axes[0].margins(y=0.2)
        _line(axes[1], time, elongation, "δ", _ELONGATION)
        _line(axes[2], tension_in, tension_out, "T_out", _TENSION)
        _line(axes[3], tension_in, elongation, "δ", _ELONGATION)
        _titles(axes[0], "Tension over time", "time [s]", "tension [N]")
        _titles(axes[1], "Elongation over time", "time [s]", "δ [mm]")
        _titles(axes[2], "Transmission", "T_in [N]", "T_out [N]")
        _titles(axes[3], "Elongation", "T_in [N]", "δ [mm]")
        return inline_svg(figure)


def _line(axes: Axes, x: Vector, y: Vector, label: str, colour: str) -> None:
    axes.plot(x, y, color=colour, linewidth=1.2, label=label)


def _titles(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title)
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def _draw_route(axes: Axes, frame: Drawn, arcs: Arcs, limits: Ranges) -> None:
    """Draw the route as seen square to the plane in which it spreads most, with a bar for its size."""
    view = camera(frame.position, frame.position[-1] - frame.position[0])
    screen = 1e3 * np.column_stack([view.across, view.up])
    flat = frame.position @ screen
    _coloured(axes, flat, frame.tension, limits.tension, 4.0)
    joints = frame.at(arcs.s_start) @ screen
    shades = [colours.css(colours.piece_rgb(number)) for number in range(len(joints))]
    axes.scatter(*joints.T, s=34, c=shades, edgecolors=_INK, linewidths=0.6, zorder=4)
    _name_ends(axes, flat)
    bar, length = view.scale_bar(below=0.14)
    axes.plot(*(bar @ screen).T, color=_SOFT, linewidth=1.5)
    axes.annotate(
        length, bar.mean(axis=0) @ screen, xytext=(0, -3), textcoords="offset points", ha="center", va="top"
    )
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.12)
    axes.set_axis_off()
    axes.set_title("Route coloured by tension, pieces begin at the dots")


def _name_ends(axes: Axes, flat: Vector) -> None:
    """Write the names of both ends beyond them, in the direction in which the route leaves."""
    inner = min(8, len(flat) - 1)
    ways = flat[[0, -1]] - flat[[inner, -1 - inner]]
    for text, place, way in zip(("proximal", "distal"), flat[[0, -1]], ways, strict=True):
        across, up = 9.0 * way / max(float(np.linalg.norm(way)), 1e-300)
        side = "left" if across > 3 else "right" if across < -3 else "center"
        level = "bottom" if up > 3 else "top" if up < -3 else "center"
        axes.annotate(
            text,
            place,
            xytext=(across, up),
            textcoords="offset points",
            color=_INK,
            ha=side,
            va=level,
            zorder=5,
            bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.0},
        )


def _draw_tension(axes: Axes, frame: Drawn, limits: Ranges) -> None:
    _coloured(axes, np.column_stack([1e3 * frame.s, frame.tension]), frame.tension, limits.tension, 3.2)
    steps = np.linspace(0.0, limits.tension, 41)
    left = np.column_stack([np.full(len(steps), -0.035e3 * limits.length), steps])
    _coloured(axes, left, steps, limits.tension, 6.0, outline=0.0)
    axes.set_xlim(-0.05e3 * limits.length, 1.02e3 * limits.length)
    axes.set_ylim(0.0, 1.06 * limits.tension)
    _titles(axes, "Tension along the tendon", "arc length s [mm]", "tension T [N]")


def _draw_curvature(axes: Axes, frame: Drawn, arcs: Arcs, limits: Ranges) -> None:
    s, low, high = 1e3 * frame.s, frame.kappa - frame.kappa_se, frame.kappa + frame.kappa_se
    axes.fill_between(s, np.maximum(low, 0.0), high, color="#d5dae3", linewidth=0)
    axes.plot(s, frame.kappa, color="#5b6474", linewidth=1.0)
    along, height = staircase(arcs)
    steps = np.column_stack([1e3 * along, height]).reshape(-1, 2, 2)
    shades = [colours.css(colours.piece_rgb(number)) for number in range(len(steps))]
    axes.add_collection(LineCollection(list(steps), colors=_INK, linewidths=4.0, zorder=3))
    axes.add_collection(LineCollection(list(steps), colors=shades, linewidths=2.6, zorder=4))
    axes.set_xlim(-0.02e3 * limits.length, 1.02e3 * limits.length)
    axes.set_ylim(0.0, limits.kappa)
    _titles(axes, "Curvature ± s.e. and pieces", "arc length s [mm]", "curvature κ [1/m]")


def _coloured(
    axes: Axes, line: Vector, tension: Vector, top: float, width: float, *, outline: float = 1.4
) -> None:
    """Draw a line in the colours of its tension, with a dark outline that keeps yellow visible on white."""
    if outline:
        axes.plot(*line.T, color=_INK, linewidth=width + outline, solid_capstyle="round", zorder=2)
    strips = list(np.stack([line[:-1], line[1:]], axis=1))
    shades = colours.tension_rgb(0.5 * (tension[:-1] + tension[1:]), top)
    axes.add_collection(LineCollection(strips, colors=shades, linewidths=width, capstyle="round", zorder=3))

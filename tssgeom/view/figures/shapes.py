"""Figures of a shape or a run: each draws on axes, and is a figure for print too."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import LogLocator, NullFormatter

from tssgeom.arrays import Vector
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.pieces import Arcs
from tssgeom.route.resolution import angle_over_resolution
from tssgeom.statistics import NORMAL_95
from tssgeom.stream import FrameResult
from tssgeom.view.figures.plots import CALENDAR, INK, SMALLEST, SOFT, note, panels, titles
from tssgeom.view.figures.route import NODES, coloured, draw_dots, route_figure, shades
from tssgeom.view.figures.runs import time_figure, transmission_figure
from tssgeom.view.quantities import ANGLE, ARC_LENGTH, CURVATURE_AT, TENSION_AT
from tssgeom.view.report.entry import Series
from tssgeom.view.samples import evenly, round_up, route_samples, staircase, tension_se, top_of_curvature
from tssgeom.view.wording import angle_with_error, with_error

_HEIGHT = 2.3  # inch
_RESOLUTIONS = 0.01, 0.5  # of the route, the shortest and the longest wave that are drawn
_LONG_TITLE = 36  # letters, beyond which a time before it does not fit 85 mm
_BAND, _SENSED = "#d5dae3", "#5b6474"


def figures_of(result: FrameResult, series: Series | None) -> Mapping[str, Callable[[], Figure]]:
    """Return the functions that draw each figure, by name: of one frame, and of a run over its history."""
    figures = {
        "route": partial(route_figure, result),
        "tension": partial(tension_figure, result),
        "curvature": partial(curvature_figure, result),
        "resolution": partial(resolution_figure, result),
    }
    if series is None or len(series.time) < 2:
        return figures
    figures = {name: partial(_at_time, draw, result.frame.time) for name, draw in figures.items()}
    over_drive = {"transmission": partial(transmission_figure, series)} if series.driven else {}
    return figures | over_drive | {"time": partial(time_figure, series)}


def _at_time(draw: Callable[[], Figure], time: float) -> Figure:
    """Draw a figure of one moment of a run, and state its time [s], in the title where there is one."""
    drawing = draw()
    stated = f"{time:.3f} s" if abs(time) > CALENDAR else f"{time:.6g} s"
    first = drawing.axes[0]
    title = first.get_title(loc="left")
    if not title:
        first.set_title(stated, loc="right", fontsize=SMALLEST, color=SOFT)
    for text in first.findobj(Text):
        if isinstance(text, Text) and title and text.get_text() == title:
            begin = title[0].lower() if title[0].isascii() else title[0]
            apart = "\n" if len(title) > _LONG_TITLE else " "
            text.set_text(f"At {stated}:{apart}{begin}{title[1:]}")
    return drawing


def tension_figure(result: FrameResult) -> Figure:
    """Draw the tension along the tendon, with the standard error that comes from the geometry."""
    with panels(_HEIGHT, 1) as (drawing, (axes,)):
        draw_tension(axes, result)
    return drawing


def curvature_figure(result: FrameResult) -> Figure:
    """Draw curvature and accumulated curve angle, both with their standard errors, and the pieces."""
    with panels(_HEIGHT, 2) as (drawing, (curvature, angle)):
        draw_curvature(curvature, result.profile, result.arcs)
        draw_angle(angle, result.profile, result.arcs)
    return drawing


def resolution_figure(result: FrameResult) -> Figure:
    """Draw Φ over the resolution at which it is taken, and the Φ ± s.e. of the result."""
    with panels(_HEIGHT, 1) as (drawing, (axes,)):
        draw_resolution(axes, result)
    return drawing


def draw_tension(axes: Axes, result: FrameResult) -> Axes:
    """Draw the tension along the tendon, with the standard error that comes from the geometry."""
    frame = route_samples(result, NODES)
    ends, top = result.transmission, round_up(float(frame.tension.max()))
    s, spread = ARC_LENGTH.factor * frame.s, tension_se(result, frame)
    axes.fill_between(s, frame.tension - spread, frame.tension + spread, color=_BAND, linewidth=0)
    coloured(axes, np.column_stack([s, frame.tension]), frame.tension, top, 1.5, outline=0.8)
    text = f"T_out = {with_error(ends.tension_out, ends.tension_out_se, 2)} N"
    free = 0.06 if frame.tension[-1] > 0.5 * top else 0.96
    note(axes, text, (s[-1], free * top), ha="right", color=INK)
    _limit(axes, float(frame.s[-1]))
    axes.set_ylim(0.0, 1.06 * top)
    titles(axes, "Tension ± s.e. along the tendon", ARC_LENGTH.title, TENSION_AT.title)
    return axes


def draw_curvature(axes: Axes, profile: CurvatureProfile | None, arcs: Arcs | None) -> Axes:
    """Draw the curvature along a route with its standard error, and the pieces; either may be None."""
    named = [name for name, one in (("Curvature ± s.e.", profile), ("pieces", arcs)) if one is not None]
    if profile is not None:
        _draw_band(axes, profile, profile.kappa, profile.kappa_se)
        _limit(axes, profile.length)
    if arcs is not None:
        _limit(axes, arcs.total_length)
        along, height = staircase(arcs)
        lines = list(np.column_stack([ARC_LENGTH.factor * along, height]).reshape(-1, 2, 2))
        axes.add_collection(LineCollection(lines, colors=INK, linewidths=3.0, zorder=3))
        axes.add_collection(LineCollection(lines, colors=shades(len(lines)), linewidths=2.0, zorder=4))
    axes.set_ylim(0.0, top_of_curvature([profile] if profile else [], [arcs] if arcs else []))
    titles(axes, " and ".join(named).capitalize(), ARC_LENGTH.title, CURVATURE_AT.title)
    return axes


def draw_angle(axes: Axes, profile: CurvatureProfile, arcs: Arcs | None) -> Axes:
    """Draw the accumulated curve angle along a route with its standard error, and where its pieces begin."""
    _draw_band(axes, profile, ANGLE.factor * profile.phi, ANGLE.factor * profile.phi_se)
    if arcs is not None:
        joints = ANGLE.factor * np.cumsum([0.0, *arcs.angle[:-1]])
        draw_dots(axes, np.column_stack([ARC_LENGTH.factor * arcs.s_start, joints]))
    _limit(axes, profile.length)
    axes.set_ylim(0.0, None)
    of = profile if arcs is None else arcs
    total = angle_with_error(of.total_angle, of.total_angle_se)
    titles(axes, f"Curve angle ± s.e.; Φ = {total}", ARC_LENGTH.title, ANGLE.title)
    return axes


def draw_resolution(axes: Axes, result: FrameResult) -> Axes:
    """Draw Φ over the resolution at which it is taken, and the Φ with 95 % interval of the result."""
    fit, arcs = result.tracked.fit, result.arcs
    resolution = arcs.total_length * np.geomspace(*_RESOLUTIONS, 60)
    angle = ANGLE.factor * angle_over_resolution(fit, resolution)
    at = ARC_LENGTH.factor * (result.fit.resolution or resolution[0])
    axes.plot(ARC_LENGTH.factor * resolution, angle, color=_SENSED, linewidth=1.2)
    total, error = ANGLE.factor * arcs.total_angle, ANGLE.factor * arcs.total_angle_se
    axes.errorbar([at], [total], yerr=[NORMAL_95 * error], color=INK, marker="o", markersize=4, capsize=3)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_ylim(0.0, 1.1 * max(float(angle.max()), total + NORMAL_95 * error, 1.0))
    text = angle_with_error(arcs.total_angle, arcs.total_angle_se)
    titles(axes, f"Φ over resolution; Φ = {text}", "shortest wave that counts [mm]", ANGLE.title)
    return axes


def _draw_band(axes: Axes, profile: CurvatureProfile, value: Vector, error: Vector) -> None:
    kept = evenly(len(profile.s), NODES)
    s, value, error = ARC_LENGTH.factor * profile.s[kept], value[kept], error[kept]
    axes.fill_between(s, np.maximum(value - error, 0.0), value + error, color=_BAND, linewidth=0)
    axes.plot(s, value, color=_SENSED, linewidth=1.0)


def _limit(axes: Axes, length: float) -> None:
    axes.set_xlim(-0.02 * ARC_LENGTH.factor * length, 1.02 * ARC_LENGTH.factor * length)

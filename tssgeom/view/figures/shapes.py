"""Figures of a shape or a run, each drawn alike in the report and for print."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from tssgeom.arrays import Vector
from tssgeom.route.pieces import Arcs
from tssgeom.route.resolution import angle_over_resolution
from tssgeom.stream import FrameResult
from tssgeom.view import colours
from tssgeom.view.figures.plots import (
    BLUE,
    COLUMN,
    INK,
    MEASURED,
    ORANGE,
    PAGE,
    SOFT,
    figure,
    note,
    panels,
    titles,
)
from tssgeom.view.quantities import (
    ANGLE,
    ARC_LENGTH,
    CURVATURE_AT,
    ELONGATION,
    TENSION_AT,
    TENSION_IN,
    TENSION_OUT,
    TIME,
    Quantity,
)
from tssgeom.view.report.entry import Series, moments, strokes
from tssgeom.view.samples import RouteSamples, ranges, round_up, route_samples, staircase, tension_se
from tssgeom.view.scene.camera import camera
from tssgeom.view.wording import angle_with_error, with_error

_NODES = 128  # of a route, enough for a line of this size
_HEIGHT, _RUN_HEIGHT = 2.3, 2.4  # inch
_SHADES = 64
_RESOLUTIONS = 0.01, 0.5  # of the route, the shortest and the longest wave that are drawn
_BAND, _SENSED = "#d5dae3", "#5b6474"
_PALE = 0.25  # opacity of a standard error
_NAME_OFFSET = 7.0  # of the name of an end from it [pt]
_STROKES = {1.0: ("pulling", BLUE), -1.0: ("releasing", ORANGE)}


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
    return figures | {
        "transmission": partial(transmission_figure, series),
        "time": partial(time_figure, series),
    }


def route_figure(result: FrameResult) -> Figure:
    """Draw a route coloured by tension, projected to the plane in which it spreads most."""
    frame = route_samples(result, _NODES)
    top = round_up(float(frame.tension.max()))
    with figure((COLUMN, _HEIGHT)) as drawing:
        drawing.set_layout_engine("none")
        axes = drawing.add_axes((0.02, 0.28, 0.96, 0.62))
        _draw_route(axes, frame, result.arcs, top)
        _draw_colour_bar(drawing, top)
    return drawing


def _draw_colour_bar(drawing: Figure, top: float) -> None:
    """Draw the scale of the colours; few enough of them that the bar is made of lines and no image."""
    colour_map = ListedColormap(colours.tension_rgb(np.linspace(0.0, top, _SHADES), top))
    bar = drawing.colorbar(
        ScalarMappable(Normalize(0.0, top), colour_map),
        cax=drawing.add_axes((0.07, 0.18, 0.86, 0.03)),
        orientation="horizontal",
    )
    bar.set_label(TENSION_AT.title)
    bar.solids.set(rasterized=False, edgecolor="face")  # pyright: ignore[reportOptionalMemberAccess]
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue, reportAttributeAccessIssue]


def _draw_route(axes: Axes, frame: RouteSamples, arcs: Arcs, brightest: float) -> None:
    """Draw the line, the beginnings of its pieces, the names of its ends, and a scale bar."""
    view = camera(frame.position, frame.position[-1] - frame.position[0])
    screen = ARC_LENGTH.factor * np.column_stack([view.across, view.up])
    flat = frame.position @ screen
    high = ARC_LENGTH.factor * view.view_height
    _coloured(axes, flat, frame.tension, brightest, 3.2)
    joints = frame.at(arcs.s_start) @ screen
    _draw_dots(axes, joints)
    names = _name_ends(axes, flat)
    bar, length = view.scale_bar(below=0.18)
    axes.plot(*(bar @ screen).T, color=SOFT, linewidth=1.5)
    axes.annotate(
        length, bar.mean(axis=0) @ screen, xytext=(0, -3), textcoords="offset points", ha="center", va="top"
    )
    axes.set_aspect("equal", adjustable="datalim")
    low, top = (bar[0] @ screen)[1] - 0.06 * high, flat[:, 1].max() + 0.14 * high
    left, right = _limits_across(axes, flat, names)
    axes.update_datalim([(left, low), (right, top)])
    axes.margins(x=0.02, y=0.0)
    axes.set_axis_off()
    axes.set_title("Route; its pieces begin at the dots")


def _name_ends(axes: Axes, flat: Vector) -> list[Annotation]:
    """Write the names of both ends beyond them, in the directions in which the route ends."""
    inner = min(8, len(flat) - 1)
    directions = flat[[0, -1]] - flat[[inner, -1 - inner]]
    names = list[Annotation]()
    for text, end, outward in zip(("proximal", "distal"), flat[[0, -1]], directions, strict=True):
        across, up = _NAME_OFFSET * outward / max(float(np.linalg.norm(outward)), 1e-300)
        side = "left" if across > 3 else "right" if across < -3 else "center"
        level = "bottom" if up > 3 else "top" if up < -3 else "center"
        name = axes.annotate(
            text,
            end,
            xytext=(across, up),
            textcoords="offset points",
            color=INK,
            ha=side,
            va=level,
            zorder=5,
            bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.0},
        )
        names.append(name)
    return names


def _limits_across(axes: Axes, flat: Vector, names: list[Annotation]) -> tuple[float, float]:
    """Return limits of the horizontal axis between which the names of both ends lie inside [mm]."""
    ends, boxes = flat[[0, -1], 0], [name.get_window_extent() for name in names]
    pixels = axes.transData.transform(flat[[0, -1]])[:, 0]
    left, right = pixels - [box.x0 for box in boxes], [box.x1 for box in boxes] - pixels
    low, high = float(flat[:, 0].min()), float(flat[:, 0].max())
    free = axes.bbox.width - max(0.0, left.max()) - max(0.0, right.max())
    pixel = (high - low) / free  # no smaller than it will be
    return min(low, (ends - left * pixel).min()), max(high, (ends + right * pixel).max())


def tension_figure(result: FrameResult) -> Figure:
    """Draw the tension along the tendon, with the standard error that comes from the geometry."""
    frame = route_samples(result, _NODES)
    ends, top = result.transmission, round_up(float(frame.tension.max()))
    s, spread = ARC_LENGTH.factor * frame.s, tension_se(result, frame)
    with panels((COLUMN, _HEIGHT), 1) as (drawing, (axes,)):
        axes.fill_between(s, frame.tension - spread, frame.tension + spread, color=_BAND, linewidth=0)
        _coloured(axes, np.column_stack([s, frame.tension]), frame.tension, top, 1.5, outline=0.8)
        text = f"T_out = {with_error(ends.tension_out, ends.tension_out_se, 2)} N"
        free = 0.06 if frame.tension[-1] > 0.5 * top else 0.96
        note(axes, text, (s[-1], free * top), ha="right", color=INK)
        axes.set_xlim(-0.02 * s[-1], 1.02 * s[-1])
        axes.set_ylim(0.0, 1.06 * top)
        titles(axes, "Tension ± s.e. along the tendon", ARC_LENGTH.title, TENSION_AT.title)
    return drawing


def curvature_figure(result: FrameResult) -> Figure:
    """Draw curvature and accumulated curve angle, both with their standard errors, and the pieces."""
    frame, arcs = route_samples(result, _NODES), result.arcs
    s = ARC_LENGTH.factor * frame.s
    with panels((PAGE, _HEIGHT), 2) as (drawing, (curvature, angle)):
        _draw_band(curvature, s, frame.kappa, frame.kappa_se)
        along, height = staircase(arcs)
        _draw_pieces(curvature, np.column_stack([ARC_LENGTH.factor * along, height]).reshape(-1, 2, 2))
        curvature.set_ylim(0.0, ranges([frame], [arcs]).kappa)
        titles(curvature, "Curvature ± s.e. and pieces", ARC_LENGTH.title, CURVATURE_AT.title)
        _draw_band(angle, s, ANGLE.factor * frame.phi, ANGLE.factor * frame.phi_se)
        joints = ANGLE.factor * np.cumsum([0.0, *arcs.angle[:-1]])
        _draw_dots(angle, np.column_stack([ARC_LENGTH.factor * arcs.s_start, joints]))
        angle.set_ylim(0.0, None)
        total = angle_with_error(arcs.total_angle, arcs.total_angle_se)
        titles(angle, f"Curve angle ± s.e.; Φ = {total}", ARC_LENGTH.title, ANGLE.title)
        for axes in (curvature, angle):
            axes.set_xlim(-0.02 * s[-1], 1.02 * s[-1])
    return drawing


def resolution_figure(result: FrameResult) -> Figure:
    """Draw Φ over the resolution at which it is taken, and the Φ ± s.e. of the result."""
    fit, arcs = result.tracked.fit, result.arcs
    resolution = arcs.total_length * np.geomspace(*_RESOLUTIONS, 60)
    angle = ANGLE.factor * angle_over_resolution(fit, resolution)
    at = ARC_LENGTH.factor * (result.fit.resolution or resolution[0])
    with panels((COLUMN, _HEIGHT), 1) as (drawing, (axes,)):
        axes.plot(ARC_LENGTH.factor * resolution, angle, color=_SENSED, linewidth=1.2)
        total, error = ANGLE.factor * arcs.total_angle, ANGLE.factor * arcs.total_angle_se
        axes.errorbar([at], [total], yerr=[1.96 * error], color=INK, marker="o", markersize=4, capsize=3)
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_ylim(0.0, 1.1 * max(float(angle.max()), total + 1.96 * error, 1.0))
        total_text = angle_with_error(arcs.total_angle, arcs.total_angle_se)
        titles(axes, f"Φ over resolution; Φ = {total_text}", "shortest wave that counts [mm]", ANGLE.title)
    return drawing


def _draw_band(axes: Axes, s: Vector, value: Vector, error: Vector) -> None:
    axes.fill_between(s, np.maximum(value - error, 0.0), value + error, color=_BAND, linewidth=0)
    axes.plot(s, value, color=_SENSED, linewidth=1.0)


def _draw_pieces(axes: Axes, steps: Vector) -> None:
    lines = list(steps)
    axes.add_collection(LineCollection(lines, colors=INK, linewidths=3.0, zorder=3))
    axes.add_collection(LineCollection(lines, colors=_shades(len(lines)), linewidths=2.0, zorder=4))


def _draw_dots(axes: Axes, joints: Vector) -> None:
    """Mark where each piece begins, in its colour."""
    axes.scatter(*joints.T, s=20, c=_shades(len(joints)), edgecolors=INK, linewidths=0.6, zorder=4)


def _shades(count: int) -> list[str]:
    return [colours.css(colours.piece_rgb(number)) for number in range(count)]


def _coloured(
    axes: Axes, line: Vector, tension: Vector, top: float, width: float, *, outline: float = 1.4
) -> None:
    """Draw a line in the colours of its tension, with a dark outline that keeps yellow visible on white."""
    axes.plot(*line.T, color=INK, linewidth=width + outline, solid_capstyle="round", zorder=2)
    strips = list(np.stack([line[:-1], line[1:]], axis=1))
    shades = colours.tension_rgb(0.5 * (tension[:-1] + tension[1:]), top)
    axes.add_collection(LineCollection(strips, colors=shades, linewidths=width, capstyle="round", zorder=3))


def transmission_figure(run: Series) -> Figure:
    """Draw output tension and elongation over input tension, with their standard errors."""
    chosen = moments(run)
    across = run.tension_in[chosen]
    with panels((PAGE, _RUN_HEIGHT), 2) as (drawing, row):
        for axes, (quantity, value, error, measured) in zip(row, _responses(run), strict=True):
            factor = quantity.factor
            _draw_strokes(axes, across, factor * value[chosen], factor * error[chosen])
            if measured is not None:
                _draw_measured(axes, across, factor * measured[chosen])
            titles(axes, f"{quantity.words.capitalize()} ± s.e.", TENSION_IN.title, quantity.title)
            axes.set_xlim(0.0, None)
            axes.set_ylim(min(0.0, axes.get_ylim()[0]), None)
        row[1].legend(loc="lower right")
    return drawing


def time_figure(run: Series) -> Figure:
    """Draw tensions and elongation against time, with their standard errors."""
    chosen = moments(run)
    time = run.time[chosen]
    with panels((PAGE, _RUN_HEIGHT), 2) as (drawing, (tension, stretch)):
        tension.plot(time, run.tension_in[chosen], color=TENSION_IN.ink, linewidth=1.1, label="T_in")
        for axes, (quantity, value, error, measured) in zip((tension, stretch), _responses(run), strict=True):
            middle, half, ink = quantity.factor * value[chosen], quantity.factor * error[chosen], quantity.ink
            axes.fill_between(time, middle - half, middle + half, color=ink, alpha=_PALE, linewidth=0)
            axes.plot(time, middle, color=ink, linewidth=1.1, label=quantity.symbol)
            if measured is not None:
                _draw_measured(axes, time, quantity.factor * measured[chosen])
        titles(tension, "Tension ± s.e. over time", TIME.title, "tension T [N]")
        titles(stretch, "Elongation ± s.e. over time", TIME.title, ELONGATION.title)
        tension.margins(y=0.2)
        tension.legend(loc="upper right", ncols=3, borderaxespad=0.0)
    return drawing


def _responses(run: Series) -> list[tuple[Quantity, Vector, Vector, Vector | None]]:
    return [
        (TENSION_OUT, run.tension_out, run.tension_out_se, run.tension_out_measured),
        (ELONGATION, run.elongation, run.elongation_se, run.elongation_measured),
    ]


def _draw_strokes(axes: Axes, across: Vector, value: Vector, error: Vector) -> None:
    """Draw pulls and releases in their colours; the legend names each kind once."""
    named = set[float]()
    for begin, end in strokes(across):
        part = slice(begin, end + 1)
        direction = 1.0 if across[end] >= across[begin] else -1.0
        name, colour = _STROKES[direction]
        axes.fill_between(
            across[part],
            (value - error)[part],
            (value + error)[part],
            color=colour,
            alpha=_PALE,
            linewidth=0,
        )
        label = "_" if direction in named else name
        axes.plot(across[part], value[part], color=colour, linewidth=1.2, label=label, zorder=3)
        named.add(direction)


def _draw_measured(axes: Axes, across: Vector, value: Vector) -> None:
    axes.plot(
        across,
        value,
        zorder=2,
        **MEASURED,
    )

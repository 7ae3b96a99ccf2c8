"""Charts of one input on the page of a batch: its route, tension, curvature, and a run over its history."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Vector
from tssgeom.route.resolution import angle_over_resolution
from tssgeom.statistics import NORMAL_95
from tssgeom.stream import FrameResult
from tssgeom.view import colours
from tssgeom.view.end_names import ENDS, end_names, leader
from tssgeom.view.quantities import ANGLE, ARC_LENGTH, ELONGATION, TENSION_IN, TENSION_OUT, Quantity
from tssgeom.view.report.chart import ABOVE, BELOW, HEIGHT, LEFT, RIGHT, WIDTH, Chart, limits_of
from tssgeom.view.report.entry import Series, moments, strokes
from tssgeom.view.samples import (
    RouteSamples,
    at_edge,
    evenly,
    ranges,
    round_up,
    route_samples,
    staircase,
    tension_se,
)
from tssgeom.view.scene.labels import camera
from tssgeom.view.wording import angle_with_error, with_error

_NODES = 96  # of a route, enough for a line of this size
_SHADES = 32  # of a tension along a route, few enough for a small page
_MOMENTS = 250  # of a run
_MOST_MARKS = 60  # of measured values; chosen: circles that are no line
_RESOLUTIONS = 0.01, 0.5  # of the route: the shortest and the longest wave in the chart
_BAND, _SENSED, _INK, _SOFT = "#d5dae3", "#5b6474", "#1d2330", "#697386"
_PULL, _RELEASE = "#0072b2", "#d55e00"
_PALE = 0.25  # opacity of a standard error


def shape_charts(result: FrameResult, series: Series | None) -> list[str]:
    """Return the charts of one frame, and of a run over its history, as SVG."""
    charts = [_route(result), _tension(result), *_curvature(result), _resolution(result)]
    if series is not None and len(series.time) > 1:
        charts += [*(_transmission(series) if series.driven else ()), *_over_time(series)]
    return [chart.svg() for chart in charts]


def _route(result: FrameResult) -> Chart:
    """Draw a route coloured by tension, projected to the plane in which it spreads most."""
    frame = route_samples(result, _NODES)
    view = camera(frame.position, frame.position[-1] - frame.position[0])
    plane = ARC_LENGTH.factor * np.column_stack([view.across, view.up])
    flat, joints = frame.position @ plane, frame.at(result.arcs.s_start) @ plane
    low, high = flat.min(axis=0), flat.max(axis=0)
    middle, inner = 0.5 * (low + high), np.array([WIDTH - 60.0, HEIGHT - 110.0])
    per_pixel = max(float(np.max((high - low) / inner)), 1e-9)
    half = 0.5 * per_pixel * np.array([WIDTH - LEFT - RIGHT, HEIGHT - ABOVE - BELOW])
    limits = [(float(middle[k] - half[k]), float(middle[k] + half[k])) for k in (0, 1)]
    chart = Chart("Route by tension; dots: its pieces", limits[0], limits[1])
    chart.shaded(flat[:, 0], flat[:, 1], shades(frame), 4.0)
    chart.dots(
        joints[:, 0], joints[:, 1], [colours.css(colours.piece_rgb(k)) for k in range(len(joints))], 3.5
    )
    up = chart.pixels(flat[:, 0], flat[:, 1]) * (1.0, -1.0) + (0.0, HEIGHT)
    half, low, high = np.array([25.0, 7.0]), np.array([0.0, 24.0]), np.array([WIDTH, HEIGHT - 18.0])
    for text, end, at in zip(ENDS, up[[0, -1]], end_names(up, low, high, half), strict=True):
        if (line := leader(end, at, half)) is not None:
            chart.stroke(line * (1.0, -1.0) + (0.0, HEIGHT), _SOFT)
        chart.text(float(at[0]), HEIGHT - float(at[1]) + 4.0, text, anchor="middle", kind="n")
    bar = round_up(0.18 * per_pixel * WIDTH)
    begin = chart.pixels(limits[0][0], 0.0)[0, 0]
    foot = HEIGHT - 14.0
    chart.line(*chart_line(chart, begin, begin + bar / per_pixel, foot), _SOFT, 1.5)
    chart.text(begin + bar / per_pixel + 6.0, foot + 4.0, f"{bar:g} mm")
    return chart


def chart_line(chart: Chart, left: float, right: float, y: float) -> tuple[Vector, Vector]:
    """Return the values at two pixels of one height."""
    box_left, top, box_right, bottom = chart.box
    share = (np.array([left, right]) - box_left) / (box_right - box_left)
    height = (bottom - y) / (bottom - top)
    x = chart.x[0] + share * (chart.x[1] - chart.x[0])
    return x, np.full(2, chart.y[0] + height * (chart.y[1] - chart.y[0]))


def shades(frame: RouteSamples) -> list[str]:
    """Return the colour of the tension between neighbouring nodes."""
    top = round_up(float(frame.tension.max()))
    middles = 0.5 * (frame.tension[:-1] + frame.tension[1:])
    stepped = top * np.rint(middles / top * _SHADES) / _SHADES
    return [
        colours.css(tuple(rgb))
        for rgb in np.rint(255 * colours.tension_rgb(stepped, top)).astype(int).tolist()
    ]


def _along(result: FrameResult) -> tuple[RouteSamples, Vector, tuple[float, float]]:
    frame = route_samples(result, _NODES)
    s = ARC_LENGTH.factor * frame.s
    return frame, s, (0.0, 1.01 * float(s[-1]))


def _tension(result: FrameResult) -> Chart:
    frame, s, across = _along(result)
    ends, spread = result.transmission, tension_se(result, frame)
    chart = Chart("Tension along the tendon ± s.e.", across, limits_of(frame.tension + spread))
    chart.axes("s [mm]", "T [N]")
    chart.band(s, frame.tension - spread, frame.tension + spread, _BAND)
    chart.shaded(s, frame.tension, shades(frame), 2.0)
    text = f"T_out = {with_error(ends.tension_out, ends.tension_out_se, 2)} N"
    free = 0.05 if frame.tension[-1] > 0.5 * frame.tension.max() else 0.9
    chart.note(float(s[-1]), free * chart.y[1], text, anchor="end")
    return chart


def _curvature(result: FrameResult) -> Iterator[Chart]:
    """Draw curvature and accumulated angle, both with their standard errors, and the pieces."""
    frame, s, across = _along(result)
    arcs = result.arcs
    chart = Chart("Curvature ± s.e. and pieces", across, (0.0, ranges([frame], [arcs]).kappa))
    chart.axes("s [mm]", "κ [1/m]")
    _band(chart, s, frame.kappa, frame.kappa_se)
    along, height = staircase(arcs)
    for number, step in enumerate(np.column_stack([ARC_LENGTH.factor * along, height]).reshape(-1, 2, 2)):
        chart.shaded(step[:, 0], step[:, 1], [colours.css(colours.piece_rgb(number))], 2.2)
    yield chart
    phi, spread = ANGLE.factor * frame.phi, ANGLE.factor * frame.phi_se
    total = angle_with_error(arcs.total_angle, arcs.total_angle_se)
    chart = Chart(f"Φ = {total}", across, limits_of(phi + spread))
    chart.axes("s [mm]", "curve angle ± s.e. [°]")
    _band(chart, s, phi, spread)
    joints = ANGLE.factor * np.cumsum([0.0, *arcs.angle[:-1]])
    dots = [colours.css(colours.piece_rgb(k)) for k in range(len(joints))]
    chart.dots(ARC_LENGTH.factor * arcs.s_start, joints, dots, 3.5)
    yield chart


def _band(chart: Chart, x: Vector, value: Vector, error: Vector) -> None:
    chart.band(x, np.maximum(value - error, 0.0), np.minimum(value + error, chart.y[1]), _BAND)
    chart.line(x, np.minimum(value, chart.y[1]), _SENSED, 1.0)


def _resolution(result: FrameResult) -> Chart:
    """Draw Φ over the resolution at which it is taken, and the Φ ± s.e. of the result."""
    arcs, fit = result.arcs, result.tracked.fit
    resolution = arcs.total_length * np.geomspace(*_RESOLUTIONS, 24)
    angle = ANGLE.factor * angle_over_resolution(fit, resolution)
    total, error = ANGLE.factor * arcs.total_angle, NORMAL_95 * ANGLE.factor * arcs.total_angle_se
    at = np.log10(ARC_LENGTH.factor * (result.fit.resolution or float(resolution[0])))
    across = np.log10(ARC_LENGTH.factor * resolution)
    limits = (min(float(across[0]), at) - 0.05, max(float(across[-1]), at) + 0.05)
    chart = Chart("Φ over resolution; dot: ± 95 %", limits, limits_of(angle, np.array([total + error, 1.0])))
    decades = [(math.log10(m * 10.0**k), f"{m * 10.0**k:g}") for k in range(-6, 7) for m in (1, 2, 5)]
    chart.axes("shortest wave [mm]", "Φ [°]",
               x_ticks=[one for one in decades if limits[0] <= one[0] <= limits[1]])  # fmt: skip
    chart.line(across, angle, _SENSED)
    chart.line(np.array([at, at]), np.array([total - error, total + error]), _INK, 1.5)
    chart.dots(np.array([at]), np.array([total]), [_INK], 3.5)
    return chart


def _responses(
    run: Series, chosen: NDArray[np.intp]
) -> Iterator[tuple[Quantity, Vector, Vector, list[Vector]]]:
    """Yield T_out, δ and, where it changes, Φ: quantity, mean, standard error, measured if at all."""
    for quantity, value, error, measured in (
        (TENSION_OUT, run.tension_out, run.tension_out_se, run.tension_out_measured),
        (ELONGATION, run.elongation, run.elongation_se, run.elongation_measured),
        (ANGLE, run.angle, run.angle_se, None),
    ):
        if value is None or error is None:
            continue
        observed = [] if measured is None else [quantity.factor * at_edge(measured[chosen], value[chosen])]
        yield quantity, quantity.factor * value[chosen], quantity.factor * error[chosen], observed


def _transmission(run: Series) -> Iterator[Chart]:
    """Draw output tension and elongation over input tension, pulls and releases in their colours."""
    chosen = moments(run, _MOMENTS)
    across = run.tension_in[chosen]
    for quantity, middle, half, observed in itertools.islice(_responses(run, chosen), 2):
        limits = limits_of(middle - half, middle + half, *observed)
        chart = Chart(f"{quantity.words.capitalize()} ± s.e. over T_in", limits_of(across), limits)
        chart.axes(TENSION_IN.label, quantity.label)
        for begin, end in strokes(across):
            part = slice(begin, end + 1)
            colour = _PULL if across[end] >= across[begin] else _RELEASE
            chart.band(across[part], (middle - half)[part], (middle + half)[part], colour, _PALE)
            chart.line(across[part], middle[part], colour)
        _measured(chart, across, observed)
        chart.legend(
            [("pulling", _PULL), ("releasing", _RELEASE), *([("measured", _INK)] if observed else [])]
        )
        yield chart


def _over_time(run: Series) -> Iterator[Chart]:
    """Draw tensions, elongation and, of a route that moves, curve angle against time."""
    chosen = moments(run, _MOMENTS)
    time = run.time[chosen]
    across = limits_of(time, zero=False, room=0.0)
    for quantity, middle, half, observed in _responses(run, chosen):
        drive = [run.tension_in[chosen]] if quantity is TENSION_OUT else []
        limits = limits_of(middle - half, middle + half, *observed, *drive, zero=quantity != ANGLE)
        title = "Tensions" if drive else quantity.words.capitalize()
        chart = Chart(f"{title} ± s.e. over time", across, limits)
        chart.axes("t [s]", "T [N]" if drive else quantity.label)
        for line in drive:
            chart.line(time, line, TENSION_IN.ink, 1.0)
        chart.band(time, middle - half, middle + half, quantity.ink, _PALE)
        chart.line(time, middle, quantity.ink)
        _measured(chart, time, observed)
        names = [("T_in", TENSION_IN.ink)] if drive else []
        names += [(quantity.symbol, quantity.ink), *([("measured (circles)", _INK)] if observed else [])]
        if len(names) > 1:  # one line is named by its axis
            chart.legend(names)
        yield chart


def _measured(chart: Chart, x: Vector, observed: list[Vector]) -> None:
    for values in observed:
        kept = np.flatnonzero(np.isfinite(values))
        kept = kept[evenly(len(kept), _MOST_MARKS)]
        chart.dots(x[kept], values[kept], [_INK] * len(kept), 1.8, hollow=True)

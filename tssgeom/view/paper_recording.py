"""A Rerun recording of the paper: setups A and B under one pull and release, and its curves."""

from __future__ import annotations

import math
from pathlib import Path
from uuid import uuid4

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from tssgeom.arrays import Points, Vector
from tssgeom.shape.synthetic import Course, places, setup_a, setup_b
from tssgeom.tendon import paper
from tssgeom.tendon.history import History, driven, profiles
from tssgeom.view import colours
from tssgeom.view.camera import Camera, camera
from tssgeom.view.chart import Axis, Box, Chart
from tssgeom.view.columns import Sender, segments_3d
from tssgeom.view.drawn import evenly
from tssgeom.view.language import FIRST, SECOND, TIMELINE

_NODES = 160
_MOMENTS = 240
_BOX = Box(width=1.55, text=0.095)
_FORCES = {"a": ("A", FIRST), "b": ("B", SECOND)}


def write_paper_recording(path: Path) -> None:
    """Write the recording; the time is that of a drive which makes the pull in 15 s.

    Parameters
    ----------
    path
        The `.rrd` file, written in place.
    """
    cycle = paper.cycle()
    chosen = cycle[np.union1d(evenly(len(cycle), _MOMENTS), [np.argmax(cycle)])]
    time = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(chosen)))))  # 1 N/s
    routes = {"a": setup_a(), "b": setup_b()}
    with rr.RecordingStream("tssgeom: paper", recording_id=uuid4()) as recording:
        path.touch()
        sender = Sender(recording, time)
        cameras = {name: _send_route(sender, name, course, chosen) for name, course in routes.items()}
        recording.save(path, default_blueprint=_blueprint(cameras))
        recording.send_recording_name("paper, figures 4 to 8")
        for name, route in (("a", paper.SETUP_A), ("b", paper.SETUP_B)):
            _send_ends(sender, name, driven(chosen, route, paper.RIG))
        _send_half_circle(sender, driven(chosen, paper.HALF_CIRCLE, paper.RIG), time)
        _send_scaling(sender)


def _send_route(sender: Sender, name: str, course: Course, tension_in: Vector) -> Camera:
    """Draw a route in the colours of its tension at every moment."""
    s = np.linspace(0.0, course.total_length, _NODES)
    line = places(course, s)
    kappa = np.linalg.norm(course.bend, axis=1)
    edges = np.concatenate(([0.0], np.cumsum(course.length)))
    phi = np.interp(s, edges, np.concatenate(([0.0], np.cumsum(kappa * course.length))))
    tension = profiles(tension_in, phi, paper.RIG)
    middles = 0.5 * (tension[:, :-1] + tension[:, 1:])
    seen = camera(line, line[-1] - line[0])
    sender.constant(
        f"{name}/route",
        rr.LineStrips3D.from_fields(strips=segments_3d([line]), radii=rr.Radius.ui_points(4.0)),
    )
    shades = rr.LineStrips3D.columns(colors=colours.tension_rgba32(middles.ravel(), paper.PEAK))
    sender.send(f"{name}/route", shades, [_NODES - 1] * len(tension_in))
    _send_names(sender, name, line, tension[:, -1], tension_in)
    bar, text = seen.scale_bar(0.02)
    bar = bar + 0.5 * seen.half_width * seen.across  # beside the name of the proximal end
    sender.constant(
        f"{name}/scale", rr.LineStrips3D([bar], colors=[colours.AXIS], radii=rr.Radius.ui_points(1.5))
    )
    sender.constant(f"{name}/scale/length", _text_3d(bar.mean(axis=0, keepdims=True), [text]))
    return seen


def _send_names(sender: Sender, name: str, line: Points, out: Vector, tension_in: Vector) -> None:
    texts = [
        text
        for t_in, t_out in zip(tension_in, out, strict=True)
        for text in (f"proximal · T_in {t_in:.1f} N", f"distal · T_out {t_out:.1f} N")
    ]
    sender.constant(
        f"{name}/ends", rr.Points3D.from_fields(radii=0.0, colors=colours.WHITE, show_labels=True)
    )
    moments = len(tension_in)
    columns = rr.Points3D.columns(positions=np.tile(line[[0, -1]], (moments, 1)), labels=texts)
    sender.send(f"{name}/ends", columns, [2] * moments)


def _text_3d(where: Points, texts: list[str]) -> rr.Points3D:
    return rr.Points3D(where, radii=0.0, labels=texts, colors=[colours.WHITE], show_labels=True)


def _send_ends(sender: Sender, name: str, run: History) -> None:
    word, colour = _FORCES[name]
    _series(sender, f"tension_out_{name}", f"T_out of {word} [N]", colour, run.tension_out)
    _series(sender, f"elongation_{name}", f"δ of {word} [mm]", colour, 1e3 * run.elongation)
    chart = Chart(Axis(16.0, "N"), Axis(1.6, "mm"), _BOX)
    if name == "a":
        _send_axes(sender, "figure_6", chart)
    _send_curve(sender, f"figure_6/{name}", chart.place(run.tension_in, 1e3 * run.elongation), colour)


def _send_half_circle(sender: Sender, run: History, time: Vector) -> None:
    """Send what figures 4 and 5 show."""
    _series(sender, "tension_in", "T_in [N]", colours.TENSION_IN, run.tension_in)
    _series(sender, "tension_out_half", "T_out of the half circle [N]", colours.TENSION_OUT, run.tension_out)
    _series(sender, "elongation_half", "δ of the half circle [mm]", colours.TENSION_OUT, 1e3 * run.elongation)
    for name, values, top, unit in (
        ("figure_5a", run.tension_out, 10.0, "N"),
        ("figure_5b", 1e3 * run.elongation, 2.0, "mm"),
    ):
        chart = Chart(Axis(16.0, "N"), Axis(top, unit), _BOX)
        _send_axes(sender, name, chart)
        _send_curve(sender, f"{name}/curve", chart.place(run.tension_in, values), colours.TENSION_OUT)


def _send_scaling(sender: Sender) -> None:
    """Send S over the angle of the added curve, as figure 8 shows it."""
    chart = Chart(Axis(720.0, "°"), Axis(1.0, ""), _BOX)
    _send_axes(sender, "figure_8", chart)
    angle = np.linspace(0.0, 4 * math.pi, 120)
    for number, friction in enumerate(paper.FRICTIONS):
        line = chart.place(np.degrees(angle), paper.scaling_factor(angle, friction))
        drawing = rr.LineStrips2D(
            [line], colors=[colours.piece_rgb(number)], radii=rr.Radius.ui_points(1.6), draw_order=10
        )
        sender.constant(f"figure_8/mu_{1e3 * friction:.0f}", drawing)
        name = rr.Points2D(
            line[[30 + 22 * number]] - [0.0, 0.13],
            radii=0.0,
            labels=[f"μ = {friction:g}"],
            colors=[colours.piece_rgb(number)],
            show_labels=True,
            draw_order=30,
        )
        sender.constant(f"figure_8/mu_{1e3 * friction:.0f}/name", name)


def _send_axes(sender: Sender, entity: str, chart: Chart) -> None:
    grid = rr.LineStrips2D(chart.grid(), colors=[colours.GRID], radii=rr.Radius.ui_points(0.6), draw_order=1)
    sender.constant(f"{entity}/grid", grid)
    where, texts = chart.numbers()
    numbers = rr.Points2D(
        where, radii=0.0, labels=texts, colors=[colours.WHITE], show_labels=True, draw_order=30
    )
    sender.constant(f"{entity}/numbers", numbers)


def _send_curve(sender: Sender, entity: str, line: Vector, colour: tuple[int, int, int]) -> None:
    """Draw a whole curve, and a dot on it that moves with the time."""
    drawing = rr.LineStrips2D([line], colors=[colour], radii=rr.Radius.ui_points(1.6), draw_order=10)
    sender.constant(entity, drawing)
    dot = rr.Points2D.from_fields(colors=colour, radii=rr.Radius.ui_points(5.0), draw_order=20)
    sender.constant(f"{entity}/now", dot)
    sender.send(f"{entity}/now", rr.Points2D.columns(positions=line))


def _series(sender: Sender, entity: str, name: str, colour: tuple[int, int, int], values: Vector) -> None:
    sender.constant(f"series/{entity}", rr.SeriesLines(names=name, colors=[colour], widths=[2.0]))
    sender.send(f"series/{entity}", rr.Scalars.columns(scalars=values))


def _blueprint(cameras: dict[str, Camera]) -> rrb.Blueprint:
    spaces = rrb.Horizontal(*(_space(name, seen) for name, seen in cameras.items()))
    charts = (
        _chart("figure_6", "Fig. 6: δ [mm] against T_in [N]; A blue, B orange"),
        _chart("figure_5a", "Fig. 5a: T_out [N] against T_in [N], half circle"),
        _chart("figure_5b", "Fig. 5b: δ [mm] against T_in [N], half circle"),
        _chart("figure_8", "Fig. 8: S [1] against β [°] of the added curve"),
    )
    series = rrb.Horizontal(
        _plot(
            "Tension [N] against time [s], 1 N/s",
            ["tension_in", "tension_out_a", "tension_out_b", "tension_out_half"],
        ),
        _plot("Elongation δ [mm]", ["elongation_a", "elongation_b", "elongation_half"]),
    )
    return rrb.Blueprint(
        rrb.Vertical(spaces, rrb.Horizontal(*charts), series, row_shares=[46, 29, 25]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused", loop_mode="all"),
        auto_views=False,
        auto_layout=False,
    )


def _space(name: str, seen: Camera) -> rrb.Spatial3DView:
    words = {"a": "Setup A: half circle, then loop", "b": "Setup B: loop, then half circle"}
    return rrb.Spatial3DView(
        origin=name,
        name=f"{words[name]}; tension 0 (dark) to 15 N (yellow)",
        background=rrb.Background(color=colours.BACKGROUND),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind="Orbital", position=seen.eye, look_target=seen.target, eye_up=seen.up
        ),
    )


def _chart(entity: str, title: str) -> rrb.Spatial2DView:
    return rrb.Spatial2DView(
        origin=entity,
        name=title,
        background=rrb.Background(color=colours.BACKGROUND),
        visual_bounds=rrb.VisualBounds2D(x_range=_BOX.x_range, y_range=_BOX.y_range),
    )


def _plot(title: str, names: list[str]) -> rrb.TimeSeriesView:
    legend = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)
    return rrb.TimeSeriesView(name=title, contents=[f"series/{name}" for name in names], plot_legend=legend)

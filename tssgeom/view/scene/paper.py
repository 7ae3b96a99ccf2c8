"""A Rerun recording of the paper: setups A and B under one pull and release, and its curves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from tssgeom.arrays import Vector
from tssgeom.route.pieces import Arcs
from tssgeom.route.synthetic import Course, positions, setup_a, setup_b
from tssgeom.tendon import paper
from tssgeom.tendon.history import History, driven, profiles
from tssgeom.view import colours
from tssgeom.view.quantities import ELONGATION, TENSION_IN, TENSION_OUT
from tssgeom.view.samples import Ranges, RouteSamples, evenly
from tssgeom.view.scene.blueprint import chart, layout, plot, space_view, time_panel
from tssgeom.view.scene.charts import (
    Axis,
    Box,
    Chart,
    Sender,
    send_axes,
    send_slip_front,
    send_tension_chart,
    slid_up_to,
)
from tssgeom.view.scene.labels import Camera, camera, label_positions
from tssgeom.view.scene.run import send_line
from tssgeom.view.scene.space import (
    label_texts,
    send_joints,
    send_labels,
    send_piece_names,
    send_route,
    send_scale_bar,
)
from tssgeom.view.scene.writer import recording_file

_NODES = 160  # of a route
_MOMENTS = 240  # of the cycle
_BOX = Box(width=1.55, text=0.095)
_ALONG = Box(width=1.55, text=0.095, unitless=True)
_TEXT_SCALE = 1.7  # of text beside the route: the views of both setups are lower than one alone
_ROUTES = ("a", "b", "half")
_SETUPS = {"a": ("A", colours.FIRST), "b": ("B", colours.SECOND)}
_LIMITS = Ranges(tension=paper.PEAK, length=0.5, kappa=1.0)


@dataclass(frozen=True, slots=True)
class _Setup:
    """One of the two setups at every moment of the cycle."""

    arcs: Arcs
    run: History
    frames: Sequence[RouteSamples]
    camera: Camera


def write_paper_recording(path: Path) -> None:
    """Write the recording; the time is that of a drive which makes the pull in 15 s.

    An older file gives way only when the new one is done.

    Raises SourceError where the file cannot be written.
    """
    cycle = paper.cycle()
    drive = cycle[np.union1d(evenly(len(cycle), _MOMENTS), [np.argmax(cycle)])]
    time = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(drive)))))  # 1 N/s
    setups = {"a": _setup(setup_a(), paper.SETUP_A, drive), "b": _setup(setup_b(), paper.SETUP_B, drive)}
    views = _blueprint({name: setup.camera for name, setup in setups.items()})
    with recording_file(path, "paper, figures 4 to 8", views, application="tssgeom: paper") as recording:
        sender = Sender(recording, time)
        send_piece_names(sender, [setup.arcs for setup in setups.values()])
        for name, setup in setups.items():
            _send_route(replace(sender, below=f"{name}/"), setup)
            _send_ends(sender, name, setup.run)
        _send_half_circle(sender, driven(drive, paper.HALF_CIRCLE, paper.RIG))
        _send_scaling(sender)
        sender.constant_text("summary", _words(setups["a"].run, setups["b"].run))


def _setup(course: Course, arcs: Arcs, tension_in: Vector) -> _Setup:
    """Pull and release the tendon on a route whose pieces are known."""
    s = np.linspace(0.0, course.total_length, _NODES)
    phi = np.interp(s, np.append(arcs.s_start, arcs.total_length), np.cumsum([0.0, *arcs.angle]))
    line, zero = positions(course, s), np.zeros(_NODES)
    rows = profiles(tension_in, phi, paper.RIG)
    frames = [RouteSamples(s, line, row, phi, zero, zero, zero) for row in rows]
    return _Setup(arcs, driven(tension_in, arcs, paper.RIG), frames, camera(line, line[-1] - line[0]))


def _send_route(sender: Sender, setup: _Setup) -> None:
    """Draw a route and its tension at every moment, as every command does."""
    frames, pieces = setup.frames, [setup.arcs] * len(setup.frames)
    still = replace(sender, time=None)
    send_scale_bar(still, setup.camera, _TEXT_SCALE)
    send_joints(still, frames[:1], pieces[:1])
    send_route(sender, frames, paper.PEAK)
    labels = label_positions(setup.camera, frames[0], setup.arcs, _TEXT_SCALE)
    texts = [label_texts(float(frame.tension[0]), float(frame.tension[-1]), setup.arcs) for frame in frames]
    send_labels(sender, [labels] * len(frames), texts)
    send_tension_chart(sender, frames, pieces, _LIMITS, _ALONG)
    tension = np.array([frame.tension for frame in frames])
    send_slip_front(sender, frames, slid_up_to(tension, frames[0].s), _LIMITS, _ALONG)


def _words(a: History, b: History) -> str:
    """Describe the recording, as markdown."""
    peak = int(np.argmax(a.tension_in))
    out, first, second = a.tension_out[peak], 1e3 * a.elongation[peak], 1e3 * b.elongation[peak]
    return "\n\n".join(
        [
            "Setups **A** and **B** have the same bends in another order: a half circle and a loop, "
            f"Φ = 540° in both. Pulled to T_in = {paper.PEAK:.0f} N, both give T_out = {out:.2f} N "
            "at every moment, as only Φ counts.",
            f"The elongation depends on the order: **δ = {first:.3f} mm in A and {second:.3f} mm in B**, as "
            "the gentle bend at the beginning of A keeps more of the tendon at a high tension.",
            "Pink: up to there the tendon slides at this moment; beyond, it sticks. Until the front of a "
            "release comes through, T_out stands still. Green: the half circle alone.",
        ]
    )


def _send_ends(sender: Sender, name: str, run: History) -> None:
    word, colour = _SETUPS[name]
    _send_response(sender, name, word, colour, run)
    chart = Chart(Axis(16.0, "N"), Axis(1.6, "mm"), _BOX)
    if name == "a":
        send_axes(sender, "figure_6", chart)
    _send_curve(sender, f"figure_6/{name}", chart.position(run.tension_in, 1e3 * run.elongation), colour)


def _send_half_circle(sender: Sender, run: History) -> None:
    """Send the curves of figures 4 and 5."""
    send_line(sender, "tension_in", TENSION_IN, run.tension_in)
    _send_response(sender, "half", "the half circle", TENSION_OUT.rgb, run)
    for name, values, top, unit in (
        ("figure_5a", run.tension_out, 10.0, "N"),
        ("figure_5b", 1e3 * run.elongation, 2.0, "mm"),
    ):
        chart = Chart(Axis(16.0, "N"), Axis(top, unit), _BOX)
        send_axes(sender, name, chart)
        _send_curve(sender, f"{name}/curve", chart.position(run.tension_in, values), TENSION_OUT.rgb)


def _send_scaling(sender: Sender) -> None:
    """Send S over the angle of the added curve, the curves of figure 8."""
    chart = Chart(Axis(720.0, "°"), Axis(1.0, ""), _BOX)
    send_axes(sender, "figure_8", chart)
    angle = np.linspace(0.0, 4 * math.pi, 120)
    for number, friction in enumerate(paper.FRICTIONS):
        line = chart.position(np.degrees(angle), paper.scaling_factor(angle, friction))
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


def _send_curve(sender: Sender, entity: str, line: Vector, colour: tuple[int, int, int]) -> None:
    """Draw a whole curve, and a dot on it that moves with the time."""
    drawing = rr.LineStrips2D([line], colors=[colour], radii=rr.Radius.ui_points(1.6), draw_order=10)
    sender.constant(entity, drawing)
    dot = rr.Points2D.from_fields(colors=colour, radii=rr.Radius.ui_points(5.0), draw_order=20)
    sender.constant(f"{entity}/now", dot)
    sender.send(f"{entity}/now", rr.Points2D.columns(positions=line))


def _send_response(sender: Sender, name: str, word: str, colour: tuple[int, int, int], run: History) -> None:
    """Send output tension and elongation of one route against time."""
    for entity, quantity, values in (
        ("tension_out", TENSION_OUT, run.tension_out),
        ("elongation", ELONGATION, run.elongation),
    ):
        title = f"{quantity.symbol} of {word} [{quantity.unit}]"
        send_line(sender, f"{entity}_{name}", quantity, values, name=title, colour=colour)


def _blueprint(cameras: dict[str, Camera]) -> rrb.Blueprint:
    titles = {"a": "Setup A: half circle, then loop", "b": "Setup B: loop, then half circle"}
    parts = ("route", "joints", "labels", "scale")
    spaces = rrb.Horizontal(
        *(
            space_view(f"{titles[name]}: route coloured by tension [N]", view, parts, below=f"{name}/")
            for name, view in cameras.items()
        )
    )
    along = [
        chart(f"{name}/tension", f"{name.upper()}: tension T [N] against s [mm]", _ALONG) for name in cameras
    ]
    charts = (
        chart("figure_6", "Fig. 6: δ [mm] against T_in [N]; A blue, B orange", _BOX),
        chart("figure_5a", "Fig. 5a: T_out [N] against T_in [N], half circle", _BOX),
        chart("figure_5b", "Fig. 5b: δ [mm] against T_in [N], half circle", _BOX),
        chart("figure_8", "Fig. 8: S [1] against β [°] of the added curve", _BOX),
    )
    series = rrb.Vertical(
        plot(
            "T [N] over time [s]: T_in white, A blue, B orange",
            [f"series/{name}" for name in ("tension_in", *(f"tension_out_{one}" for one in _ROUTES))],
        ),
        plot("δ [mm] over time [s]", [f"series/elongation_{one}" for one in _ROUTES]),
    )
    text = rrb.TextDocumentView(origin="summary", name="Summary")
    middle, last = rrb.Horizontal(*along, charts[0], charts[3]), rrb.Horizontal(text, series, *charts[1:3])
    return layout(rrb.Vertical(spaces, middle, last, row_shares=[40, 29, 31]), time_panel())

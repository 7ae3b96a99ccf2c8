"""The recording of `discover`: the tendon through every run, what it misses, and what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from tssgeom.arrays import Vector, rows_at
from tssgeom.identify.finding import Finding, Trace
from tssgeom.identify.misfit import measured_channels
from tssgeom.view import colours
from tssgeom.view import finding_wording as words
from tssgeom.view.figures.finding import models
from tssgeom.view.figures.heat_map import bends
from tssgeom.view.quantities import COUNT, TENSION_IN
from tssgeom.view.samples import Ranges
from tssgeom.view.scene.blueprint import Span, beside_legend, chart, from_zero, layout, space_view, time_panel
from tssgeom.view.scene.charts import (
    Axis,
    Box,
    Chart,
    Sender,
    segments_2d,
    segments_3d,
    send_axes,
    send_slip_front,
    send_tension_chart,
    strips_2d,
)
from tssgeom.view.scene.finding.replay import Replay, friction_map, replay
from tssgeom.view.scene.labels import label_positions
from tssgeom.view.scene.space import label_texts, send_joints, send_labels, send_piece_names, send_scale_bar
from tssgeom.view.scene.writer import recording_file

BOX = Box(width=1.9, text=0.1)
_ROUTE = ("route", "joints", "labels", "scale")
_MOST_CHANNELS = 3
_SIGMAS = 2.0
_COLOURS = {"measured": colours.MEASURED, "before": colours.BEFORE, "after": colours.AFTER}
_LARGER = 2.0  # text beside the route, in views that are lower than one alone


def write_finding_recording(path: Path, finding: Finding) -> None:
    """Write the recording; an older file gives way only when it is done.

    Raises SourceError where the file cannot be written.
    """
    displayed = replay(finding)
    name = finding.campaign.name
    views, application = blueprint(finding, displayed), f"tssgeom discover: {name}"
    with recording_file(path, name, views, application=application) as recording:
        runs = Sender(recording, np.array([float(each.first) for each in displayed.stretches]), COUNT)
        rows = np.concatenate([each.first + each.rows for each in displayed.stretches]).astype(float)
        moments = Sender(recording, rows, COUNT)
        samples = Sender(recording, np.arange(float(sum(len(t.time) for t in finding.traces))), COUNT)
        _send_route(runs, moments, displayed)
        _send_misfit(runs, finding, displayed)
        _send_charts(runs, moments, finding, displayed)
        _send_lines(samples, finding)
        _send_words(runs, finding)


def _send_route(runs: Sender, moments: Sender, displayed: Replay) -> None:
    """Draw the route in the colours of its tension: where it is once a run, the colours at every row."""
    each = displayed.stretches
    runs.constant("route", rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(3.5)))
    strips = rr.LineStrips3D.columns(strips=segments_3d([stretch.position for stretch in each]))
    runs.send("route", strips, [len(stretch.s) - 1 for stretch in each])
    frames = [frame for stretch in each for frame in stretch.frames()]
    middles = [0.5 * (frame.tension[:-1] + frame.tension[1:]) for frame in frames]
    shades = colours.tension_rgba32(np.concatenate(middles), displayed.tension)
    moments.send("route", rr.LineStrips3D.columns(colors=shades), [len(middle) for middle in middles])
    locations = [label_positions(displayed.camera, one.frames()[0], one.arcs, _LARGER) for one in each]
    send_joints(runs, [one.frames()[0] for one in each], [one.arcs for one in each])
    for sender in (runs, replace(runs, below="blame/")):
        send_scale_bar(sender, displayed.camera, _LARGER)
    rows = [
        (location, label_texts(near, far, one.arcs))
        for one, location in zip(each, locations, strict=True)
        for near, far in one.trace.tension[one.rows][:, [0, -1]].tolist()
    ]
    send_labels(moments, [location for location, _ in rows], [texts for _, texts in rows])


def _send_misfit(runs: Sender, finding: Finding, displayed: Replay) -> None:
    """Draw the route in the colours of what it misses, and mark the detected bends."""
    each = displayed.stretches
    runs.constant("blame/route", rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(3.5)))
    middles = np.concatenate([0.5 * (stretch.misfit[:-1] + stretch.misfit[1:]) for stretch in each])
    columns = rr.LineStrips3D.columns(
        strips=segments_3d([stretch.position for stretch in each]),
        colors=colours.misfit_rgba32(middles, displayed.misfit),
    )
    runs.send("blame/route", columns, [len(stretch.s) - 1 for stretch in each])
    result = bends(finding.effects)
    if result:
        style = rr.Points3D.from_fields(
            radii=rr.Radius.ui_points(8.0), colors=colours.AFTER, show_labels=True
        )
        runs.constant("blame/found", style)
        locations = [rows_at(result, stretch.s, stretch.position) for stretch in each]
        texts = [f"hidden bend, s = {1e3 * at:.0f} mm" for _ in each for at in result]
        marks = rr.Points3D.columns(positions=np.concatenate(locations), labels=texts)
        runs.send("blame/found", marks, [len(result)] * len(each))


def _send_charts(runs: Sender, moments: Sender, finding: Finding, displayed: Replay) -> None:
    frames = [frame for stretch in displayed.stretches for frame in stretch.frames()]
    pieces = [stretch.arcs for stretch in displayed.stretches for _ in stretch.rows]
    limits = Ranges(displayed.tension, displayed.length, 1.0)
    send_piece_names(runs, pieces)
    send_tension_chart(moments, frames, pieces, limits, BOX)
    fronts = [front for stretch in displayed.stretches for front in stretch.fronts()]
    send_slip_front(moments, frames, fronts, limits, BOX)
    _send_misfit_chart(runs, displayed, bends(finding.effects))


_STEPS = 48


def _send_misfit_chart(runs: Sender, displayed: Replay, bends_m: Sequence[float]) -> None:
    """Draw what is missing with its standard error, in its own colours; what is too much lies at the foot.

    Upright lines stand where bends were detected, `bends_m`.
    """
    chart = Chart(Axis(1e3 * displayed.length, "mm"), Axis(displayed.misfit, ""), BOX)
    send_axes(runs, "missing", chart)
    if bends_m:
        uprights = [chart.position(1e3 * at, np.array([0.0, displayed.misfit])) for at in bends_m]
        line = rr.LineStrips2D(
            uprights, colors=[colours.AFTER], radii=rr.Radius.ui_points(1.2), draw_order=15
        )
        runs.constant("missing/found", line)
    _send_colour_bar(runs, chart, displayed.misfit)
    each = displayed.stretches
    bars = [
        np.stack(
            [chart.position(1e3 * one.s, one.misfit + side * one.misfit_se) for side in (-1.0, 1.0)], axis=1
        )
        for one in each
    ]
    band = rr.LineStrips2D.from_fields(radii=rr.Radius.ui_points(2.4), colors=colours.BAND, draw_order=5)
    runs.constant("missing/standard_error", band)
    runs.send(
        "missing/standard_error",
        rr.LineStrips2D.columns(strips=strips_2d(np.concatenate(bars))),
        [len(bar) for bar in bars],
    )
    lines = [chart.position(1e3 * one.s, one.misfit) for one in each]
    middles = np.concatenate([0.5 * (one.misfit[:-1] + one.misfit[1:]) for one in each])
    style = rr.LineStrips2D.from_fields(radii=rr.Radius.ui_points(2.5), draw_order=20)
    runs.constant("missing/curve", style)
    columns = rr.LineStrips2D.columns(
        strips=segments_2d(lines), colors=colours.misfit_rgba32(middles, displayed.misfit)
    )
    runs.send("missing/curve", columns, [len(line) - 1 for line in lines])


def _send_colour_bar(runs: Sender, chart: Chart, top: float) -> None:
    steps = np.linspace(0.0, top, _STEPS + 1)
    line = chart.position(0.0, steps) - np.array([0.012 * chart.box.width, 0.0])
    bar = rr.LineStrips2D.from_fields(
        strips=segments_2d([line]),
        colors=colours.misfit_rgba32(0.5 * (steps[:-1] + steps[1:]), top),
        radii=rr.Radius.ui_points(4.0),
        draw_order=8,
    )
    runs.constant("missing/colour_bar", bar)


def _send_words(runs: Sender, finding: Finding) -> None:
    """Send the verdict for all time, and for each run what it is and what its channels leave."""
    verdict = rr.TextDocument(verdict_words(finding), media_type=rr.MediaType.MARKDOWN)
    runs.constant("summary", verdict)
    runs.constant("table", rr.TextDocument.from_fields(media_type=rr.MediaType.MARKDOWN))
    runs.send("table", rr.TextDocument.columns(text=[run_words(trace) for trace in finding.traces]))


def verdict_words(finding: Finding) -> str:
    """Say the verdict, the effects with their numbers, and what to measure next, as markdown."""
    lines = [f"### {words.VERDICTS[finding.verdict].capitalize()}", finding.sentence]
    for each in finding.effects:
        for name, reported in zip(each.names, each.parameters, strict=True):
            numbers = ", ".join(
                f"{words.parameter(key)} {words.displayed(value)}" for key, value in reported.items()
            )
            lines += [f"- **{words.plain(name)}**: {numbers}"] if numbers else []
    lines += [
        f"- tied ({tie.gauge}): {', '.join(map(words.plain, tie.names))}"
        for tie in words.effect_ties(finding)
    ]
    lines += [f"- next: {step}" for step in words.next_steps(finding)[:2]]
    return "\n\n".join(lines)


def run_words(trace: Trace) -> str:
    """Return the run of the moment and the misfit of each channel, as markdown."""
    kept = "held out from every fit" if trace.held_out else "fitted"
    rows = [
        f"| {words.channel(name).label} | {_rms(trace, name, 'before')} | {_rms(trace, name, 'after')} |"
        for name in trace.measured
    ]
    head = f"### Run {trace.run}\n\nOn route {trace.route}; {kept}.\n"
    return "\n".join([head, "| left, rms | before | after |", "|---|--:|--:|", *rows])


def _rms(trace: Trace, name: str, when: str) -> str:
    left = words.channel(name).factor * (trace.measured[name] - getattr(trace, when)[name])
    return f"{float(np.sqrt(np.nanmean(left**2))):.3g}"


def blueprint(finding: Finding, displayed: Replay) -> rrb.Blueprint:
    """Arrange the views; one slider over the samples of all runs moves them together."""
    learnt = friction_map(finding) is not None
    along = "Friction μ along the route, learnt" if learnt else "What this route misses, before [rad/m]"
    charted = "Friction μ ± s.e." if learnt else "Missing curve angle ± s.e. [rad/m]"
    spaces = rrb.Horizontal(
        space_view("Route coloured by tension [N]; slip front in pink", displayed.camera, _ROUTE),
        space_view(along, displayed.camera, ["blame"]),
    )
    charts = rrb.Horizontal(
        chart("tension", "Tension T [N] against arc length s [mm]", BOX),
        chart("missing", f"{charted} against s [mm]", BOX),
    )
    text = rrb.Horizontal(
        rrb.TextDocumentView(origin="summary", name="What is missing"),
        rrb.TextDocumentView(origin="table", name="Which run this is"),
        column_shares=[6, 5],
    )
    left = rrb.Vertical(spaces, charts, text, row_shares=[38, 30, 32])
    right = rrb.Vertical(*_plots(finding, displayed.tension))
    views = rrb.Horizontal(left, right, column_shares=[56, 44])
    return layout(views, time_panel(timeline=COUNT))


def _plots(finding: Finding, tension: float) -> list[rrb.TimeSeriesView]:
    """Arrange the channel with the largest misfit, and below it what is left of each channel."""
    channels = [(name, words.channel(name)) for name in _plotted_channels(finding)]
    name, widest = channels[0]
    most = max(float(np.nanmax(each.measured.get(name, 0.0), initial=0.0)) for each in finding.traces)
    top = max(tension, most) if widest.unit == "N" else None
    span = 0.0, float(sum(len(each.time) for each in finding.traces) - 1)
    title = f"{widest.label} over the samples of all runs"
    first = _plot("channel", title, span, legend=True, axis=from_zero(top))
    left = [
        _plot(
            f"left/{name}",
            f"Δ{reported.label}, measured less simulated, ± 2σ of the sensors",
            span,
            legend=k == 0,
            axis=_of_residuals(finding, name, reported.factor),
        )
        for k, (name, reported) in enumerate(channels)
    ]
    return [first, *left]


def _of_residuals(finding: Finding, name: str, factor: float) -> rrb.ScalarAxis:
    """Return an axis that the residuals fill; where the noise is larger for a moment, its band leaves it."""
    measured, sigma = (_column(finding.traces, when, name) for when in ("measured", "sigma"))
    left = [np.abs(measured - _column(finding.traces, when, name)) for when in models(finding)]
    most = factor * max(2.0 * float(np.nanmedian(sigma)), float(np.nanmax(left)))
    return rrb.ScalarAxis(range=(-1.1 * most, 1.1 * most))


def _plot(
    origin: str, title: str, span: Span, *, legend: bool, axis: rrb.ScalarAxis | None
) -> rrb.TimeSeriesView:
    corner = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=legend)
    across = beside_legend(span, COUNT)
    return rrb.TimeSeriesView(origin=origin, name=title, plot_legend=corner, axis_x=across, axis_y=axis)


def _plotted_channels(finding: Finding) -> list[str]:
    """Return the channels that are plotted, the one with the largest misfit before first."""
    misfit = finding.misfit
    reported = misfit.before[words.judged_runs(misfit)]
    known = [name for name in measured_channels(finding.traces) if name in reported]
    return sorted(known, key=lambda name: -reported[name] / misfit.noise[name])[:_MOST_CHANNELS]


def _send_lines(samples: Sender, finding: Finding) -> None:
    """Send the channel with the largest misfit, what is left of each, and the proximal tension."""
    traces = finding.traces
    pull = np.concatenate([trace.tension_in for trace in traces])
    samples.line("series/tension_in", "T_in of the model [N]", TENSION_IN.rgb, pull)
    channels = _plotted_channels(finding)
    for order, when in enumerate(("measured", *models(finding))):
        values = words.channel(channels[0]).factor * _column(traces, when, channels[0])
        samples.line(f"channel/line_{order}", when, _COLOURS[when], values, 3.0 if order == 0 else 1.5)
    for name in channels:
        _send_left(samples, finding, name)


def _send_left(samples: Sender, finding: Finding, name: str) -> None:
    """Send measured less simulated, in the order in which the lines are drawn."""
    traces, factor = finding.traces, words.channel(name).factor
    spread = _SIGMAS * factor * _column(traces, "sigma", name)
    samples.line(f"left/{name}/line_0", "− 2σ of the sensors", colours.AXIS, -spread, 1.0)
    samples.line(f"left/{name}/line_1", "+ 2σ of the sensors", colours.AXIS, spread, 1.0)
    for order, when in enumerate(models(finding), start=2):
        left = factor * (_column(traces, "measured", name) - _column(traces, when, name))
        samples.line(f"left/{name}/line_{order}", when, _COLOURS[when], left, 1.5)


def _column(traces: Sequence[Trace], when: str, name: str) -> Vector:
    """Return a channel over the samples of all runs [SI], NaN where a run lacks it."""
    parts = [getattr(trace, when).get(name, np.full(len(trace.time), np.nan)) for trace in traces]
    return np.concatenate(parts)

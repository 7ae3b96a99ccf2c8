"""Figures of a finding: readings and predictions, residuals, laws with their bands, and the candidates."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tssgeom.arrays import Vector
from tssgeom.channel_names import unit_of, words_of
from tssgeom.identify.finding import Candidate, Finding, LawCurve, Trace
from tssgeom.identify.misfit import measured_channels
from tssgeom.identify.verdict import OVER, variable
from tssgeom.view import finding_wording as words
from tssgeom.view.figures.plots import (
    BAND,
    BLUE,
    INK,
    ORANGE,
    PAGE,
    figure,
    legend_below,
    measured,
    panels,
    titles,
)

_SCALES = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3), "rad": ("°", 180.0 / math.pi), "N·m": ("mN·m", 1e3)}
_COLUMNS = 2
_FEW = 8  # points that are marked; chosen


MOST = 10
_PALE = "#c3c9d4"
_LINEAR = 20.0  # ΔBIC up to which the axis is linear [1]; chosen: thresholds of clean campaigns are below


_SPREAD = "#d9dee6"
_HELD = "#f6f3e6"
_ACROSS = ("tension_out_N", "elongation_m", "displacement_out_m", "tension_in_N")
"""What is drawn against the proximal tension, the first two that were measured."""
_MOST_PANELS = 2
_MEASURED, _USUAL = 99.0, 80.0  # percentiles of residual and noise that its axis shows; chosen: no spikes
_SIGMAS = 2.0
_MOST_TIMED = 8  # runs whose span of time is written; chosen: more would touch on 170 mm
_RUNS = "runs, one after the other; each from its beginning to its end"
_STYLES: Mapping[str, Any] = {"before": {"color": ORANGE}, "after": {"color": BLUE}}


def judged(finding: Finding) -> Trace:
    """Return the run of the figures of a finding: the first that was held out, else the first."""
    return next((trace for trace in finding.traces if trace.held_out), finding.traces[0])


def transmission_figure(finding: Finding) -> Figure:
    """Draw what answers over what drives, measured, before and after, of one run.

    Of one tendon that is output tension and elongation over input tension.
    """
    trace = judged(finding)
    channels = displayed_channels(trace)
    with panels(3.3, len(channels)) as (drawing, row):
        for axes, name in zip(row, channels, strict=True):
            draw_loops(axes, finding, name)
        legend_below(drawing, row[0])
    return drawing


def models(finding: Finding) -> dict[str, str]:
    """Return the models that are drawn and what they are called; without an effect there is only one."""
    return {"before": "before", "after": "after"} if finding.effects else {"after": "model"}


def displayed_channels(trace: Trace) -> list[str]:
    """Return the channels that are drawn over the drive; the input tension where only that was measured."""
    if trace.drive is not None:
        return list(trace.measured)[:_MOST_PANELS]
    observed = [name for name in _ACROSS if name in trace.measured]
    return [name for name in observed if name != "tension_in_N"][:_MOST_PANELS] or observed[:1]


def draw_loops(axes: Axes, finding: Finding, name: str) -> Axes:
    """Draw one channel over the drive, measured, before and after, of the run that judges."""
    trace, drawn, factor = judged(finding), models(finding), words.channel(name).factor
    drive = words.channel("tension_in_N" if trace.drive is None else trace.drive[0])
    measured(axes, _across(trace, "measured"), factor * trace.measured[name])
    across, after, spread = _across(trace, "after"), trace.after[name], _SIGMAS * trace.sigma[name]
    for start, stop in _strokes(across):
        low, high = (factor * (after + side)[start:stop] for side in (-spread, spread))
        label = "_" if start else f"{drawn['after']} ± 2σ of the sensors"
        axes.fill_between(across[start:stop], low, high, color=BAND, linewidth=0, zorder=1, label=label)
    for when, title in drawn.items():
        values = factor * getattr(trace, when)[name]
        axes.plot(_across(trace, when), values, label=title, linewidth=1.2, zorder=4, **_STYLES[when])
    titles(axes, f"{words.channel(name).symbol} over {drive.symbol}", drive.title, words.channel(name).label)
    return axes


def _across(trace: Trace, when: str) -> Vector:
    """Return the input tension that was measured, or that a model gives [N]; of a machine its drive."""
    if trace.drive is not None:
        return words.channel(trace.drive[0]).factor * trace.drive[1]
    return getattr(trace, when).get("tension_in_N", trace.tension_in)


def _strokes(across: Vector) -> list[tuple[int, int]]:
    """Cut a run where its input turns, so that a band is drawn along each stroke."""
    step = np.sign(np.diff(across))
    turns = np.flatnonzero(step[1:] * step[:-1] < 0) + 1
    edges = [0, *turns.tolist(), len(across) - 1]
    return [(a, b + 1) for a, b in itertools.pairwise(edges) if b > a]


def residual_figure(finding: Finding) -> Figure:
    """Draw measured less simulated over all runs, before and after, in a row for each channel."""
    channels = measured_channels(finding.traces)
    with figure((PAGE, 0.8 + 1.15 * len(channels))) as drawing:
        rows = drawing.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0]
        for axes, name in zip(rows, channels, strict=True):
            draw_residual(axes, finding, name)
            axes.set_xlabel("")
        legend_below(drawing, rows[0])
        rows[-1].set_xlabel(_RUNS)
        _name_runs(rows[0], finding.traces)
        drawing.align_ylabels(rows.tolist())
    return drawing


def draw_residual(axes: Axes, finding: Finding, name: str) -> Axes:
    """Draw measured less simulated of one channel over all runs, before and after."""
    reported, traces, drawn = words.channel(name), finding.traces, models(finding)
    displayed = [(k, trace) for k, trace in enumerate(traces) if name in trace.measured]
    for k, trace in displayed:
        _draw_run(axes, k, trace, name, drawn if k == displayed[0][0] else dict.fromkeys(drawn, "_"))
    for k, trace in enumerate(traces):
        axes.axvspan(k, k + 1, color=_HELD if trace.held_out else "white", linewidth=0, zorder=0)
    top = 1.25 * max(_most(trace, name) for _, trace in displayed)
    axes.set_ylim(-top, top)
    axes.set_xlim(0, len(traces))
    axes.set_xticks(range(len(traces) + 1), [""] * (len(traces) + 1))
    if len(traces) <= _MOST_TIMED:
        spans = [f"0 to {np.ptp(trace.time):.3g} s" for trace in traces]
        axes.set_xticks([k + 0.5 for k in range(len(traces))], spans, minor=True)
        axes.tick_params(which="minor", length=0)
    axes.set_ylabel(f"Δ{reported.symbol} [{reported.unit}]")
    axes.set_xlabel(_RUNS)
    return axes


def _draw_run(axes: Axes, first: int, trace: Trace, name: str, drawn: Mapping[str, str]) -> None:
    factor = words.channel(name).factor
    across = first + (trace.time - trace.time[0]) / max(float(trace.time[-1] - trace.time[0]), 1e-300)
    sigma = factor * _SIGMAS * trace.sigma[name]
    label = "_" if "_" in drawn.values() else "±2σ of the sensors"
    axes.fill_between(across, -sigma, sigma, color=_SPREAD, linewidth=0, zorder=1, label=label)
    for when, title in drawn.items():
        left = factor * (trace.measured[name] - getattr(trace, when)[name])
        axes.plot(across, left, color=_STYLES[when]["color"], linewidth=0.9, zorder=2, label=title)


def _most(trace: Trace, name: str) -> float:
    """Return how far the axis of a residual has to reach, rare peaks left out."""
    left = np.abs(trace.measured[name] - trace.before[name])
    reach = max(np.nanpercentile(left, _MEASURED), 2.0 * float(np.nanpercentile(trace.sigma[name], _USUAL)))
    return words.channel(name).factor * float(reach)


def _name_runs(axes: Axes, traces: Sequence[Trace]) -> None:
    for k, trace in enumerate(traces):
        said = not trace.held_out or "held-out" in trace.run  # a run of which some cycles are held out
        text = trace.run if said else f"{trace.run} (held out)"
        axes.annotate(
            text,
            (k + 0.5, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=8.0,
            color=INK,
        )


def missing_figure(finding: Finding) -> Figure:
    """Draw the fitted friction over what it may depend on, where no effect was identified."""
    shapes = finding.missing_shapes
    with panels(2.6, len(shapes)) as (drawing, row):
        for axes, shape in zip(row, shapes, strict=True):
            axes.fill_between(
                shape.x,
                shape.friction - _SIGMAS * shape.se,
                shape.friction + _SIGMAS * shape.se,
                color=BAND,
                linewidth=0,
            )
            axes.plot(shape.x, shape.friction, color=BLUE, marker="o", markersize=3)
            axes.axhline(finding.base["friction"].value, color=ORANGE, linestyle=(0, (4, 1.5)), linewidth=1.1)
            name, unit = words_of(shape.over), unit_of(shape.over)
            titles(
                axes,
                f"explains {100 * shape.explains:.0f} %\nof the misfit",
                f"{name} [{unit}]" if unit else name,
                "friction μ ± 2 s.e. [1]" if axes is row[0] else "",
            )
    return drawing


def listed_candidates(finding: Finding) -> tuple[Candidate, ...]:
    """Return the first candidates of the ranking, and what acts where it is not among them."""
    first = finding.ranking[:MOST]
    names = {name for each in first for name in each.names}
    return (*(each for each in finding.effects if not names.intersection(each.names)), *first)


def ranking_figure(finding: Finding) -> Figure:
    """Draw the evidence for each candidate, and what it has to pass."""
    with figure((PAGE, 0.75 + 0.24 * len(listed_candidates(finding)))) as drawing:
        legend_below(drawing, draw_ranking(drawing.subplots(), finding))
    return drawing


def draw_ranking(axes: Axes, finding: Finding) -> Axes:
    """Draw the evidence for each of the first candidates, held-out runs included, and its threshold."""
    candidates = listed_candidates(finding)
    rows = range(len(candidates))
    gains = [each.evidence.total if math.isfinite(each.evidence.total) else 0.0 for each in candidates]
    shades = [BLUE if words.is_selected(finding, each) else _PALE for each in candidates]
    axes.barh(rows, gains, color=shades, height=0.7)
    for k, each in enumerate(candidates):
        bar = [each.evidence.threshold] * 2
        axes.plot(bar, [k - 0.45, k + 0.45], color=ORANGE, linewidth=1.6, label="_" if k else "threshold")
        end, style = (max(gains[k], 0.0), k), {"va": "center", "fontsize": 7.5}
        axes.annotate(
            words.total(each.evidence).replace("-", "\N{MINUS SIGN}"),
            end,
            xytext=(3, 0),
            textcoords="offset points",
            **style,
        )
    axes.set_yticks(rows, [words.candidate(each) for each in candidates])
    axes.invert_yaxis()
    if max(map(abs, axes.get_xlim())) > _LINEAR:  # else a logarithm has no round numbers there
        axes.set_xscale("symlog", linthresh=_LINEAR)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.grid(visible=False, axis="y")
    titles(axes, "What each effect gains, refitted through the model", f"{words.TOTAL} [1]", "")
    return axes


def laws_of(finding: Finding) -> list[Candidate]:
    """Return what of a finding is a law with a curve."""
    return [each for each in finding.effects if each.law is not None and len(each.law.x) > 1]


def law_figure(finding: Finding) -> Figure:
    """Draw every law over its support with its 95 % band, beside what the rig file has there."""
    laws = laws_of(finding)
    rows = -(-len(laws) // _COLUMNS)
    with figure((PAGE, 2.9 * rows)) as drawing:
        axes = drawing.subplots(rows, min(len(laws), _COLUMNS), squeeze=False).ravel()
        for one, each in zip(axes, laws, strict=False):
            _draw(one, each, finding)
        for one in axes[len(laws) :]:
            one.set_visible(False)
    return drawing


def _draw(axes: Axes, each: Candidate, finding: Finding) -> None:
    law = each.law
    assert law is not None
    name, x, unit = _abscissa(each.names[0], law)
    label, y_unit, factor = _ordinate(each, law)
    beside, base, whole = np.zeros(len(x)), "base model", "law"
    if each.names[0] == "load_over_position" and law.unit == "N·m":
        beside, base = finding.rig.end.stiffness_Nm_per_rad * law.x, "stiffness alone"
        whole = "stiffness and law"
    low, value, high = (factor * (each + beside) for each in (law.low, law.value, law.high))
    axes.fill_between(x, low, high, color=BAND, linewidth=0, label="95 % band")
    style = {"marker": "o", "markersize": 3} if len(x) < _FEW else {}
    axes.plot(x, value, color=BLUE, linewidth=1.4, label=whole, **style)
    known = factor * beside
    if each.names[0].startswith("friction_over"):
        known, base = np.full(len(x), finding.nominal["friction"]), "rig file"
    if each.names[0] == "strain_over_time":
        known, base = np.full(len(x), finding.nominal["compliance_per_N"]), "rig file"
    axes.plot(x, known, color=ORANGE, linestyle=(0, (4, 1.5)), linewidth=1.1, label=base)
    axes.margins(x=0.02)
    axes.legend(loc="best")
    titles(axes, words.candidate(each), f"{name} [{unit}]", f"{label} [{y_unit}]")


def _abscissa(name: str, law: LawCurve) -> tuple[str, Vector, str]:
    if law.over in OVER:
        what, si = variable(name, law.over)
    else:
        quantity = words.channel(law.over)
        return f"true {quantity.symbol}", quantity.factor * law.x, quantity.unit
    unit, factor = _SCALES.get(si, (si, 1.0))
    return what, factor * law.x, unit


def _ordinate(each: Candidate, law: LawCurve) -> tuple[str, str, float]:
    name = each.names[0]
    if name.startswith("friction_over"):
        return "friction μ", "1", 1.0
    if name == "strain_over_tension":
        return "strain beside the linear one", "1", 1.0
    unit, factor = _SCALES.get(law.unit, (law.unit, 1.0))
    if name == "strain_over_time":
        return "creep compliance J", "1/N", 1.0
    if name == "load_over_position" and law.over == "joint_angle_rad":
        return "torque against the joint", unit, factor
    what = "reading less truth" if name.startswith("sensor") else "path beside the linear one"
    return what, unit, factor

"""Figures of the calibration of a machine: what each channel read and what the model gives."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tssgeom.arrays import Vector
from tssgeom.identify.calibrated_pieces import CalibratedPiece
from tssgeom.identify.machine_estimates import MachineCalibration, MachineEstimate
from tssgeom.identify.machine_run import MachineRun
from tssgeom.statistics import NORMAL_95
from tssgeom.tendon.machine_simulation import drive_channels
from tssgeom.view import colours
from tssgeom.view.figures.plots import (
    BAND,
    BLUE,
    MEASURED,
    PAGE,
    SOFT,
    figure,
    legend_below,
    measured,
    titles,
)
from tssgeom.view.quantities import TIME, quantity

_HEIGHT = 1.9
"""Of the two rows of one channel [inch]."""
_ROW = 1.2
"""Of one kind of channel of a run [inch]."""
_NUMBER, _OF_TENDON = re.compile(r"_\d+(?=_)"), re.compile(r" of tendon \d+$")
_MANY = 5  # tendons: their names fill two columns beside a row
_LETTERS = 14
"""Letters in a line beside a row; chosen: a ninth of the width has so many."""


def computed_figure(
    name: str, channels: Mapping[str, Vector], readings: Mapping[str, Vector], given: str = "of the run"
) -> Figure:
    """Draw what a machine does over time: a row for each kind of channel, with the readings of a run.

    `channels` has `time_s` and what is computed, `readings` what was measured or wanted then, all [n] in the
    unit of their names; `given` names them.
    """
    time = channels["time_s"]
    rows = dict[str, list[str]]()
    errors = {each.replace("_se_", "_"): values for each, values in channels.items() if "_se_" in each}
    for each in channels:
        if "_se_" not in each and each not in ("time_s", "out_of_tolerance"):
            rows.setdefault(_NUMBER.sub("", each), []).append(each)
    with figure((PAGE, _ROW * len(rows) + 0.5)) as drawing:
        every = drawing.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
        for axes, each in zip(every, rows.values(), strict=True):
            for known in errors.keys() & set(each):
                of, bound = quantity(known), NORMAL_95 * errors[known]
                ends = (of.factor * (channels[known] + by) for by in (-bound, bound))
                axes.fill_between(time, *ends, color=BAND, linewidth=0, label="95 % bounds")
            _draw_computed(axes, time, {name: channels[name] for name in each}, readings, given)
        every[0].set_title(name)
        every[-1].set_xlabel(TIME.title)
        drawing.align_ylabels(every)
    return drawing


def _draw_computed(
    axes: Axes, time: Vector, channels: Mapping[str, Vector], readings: Mapping[str, Vector], given: str
) -> None:
    """Draw channels of one kind, such as the tensions of all tendons, and their readings as circles."""
    several, read = len(channels) > 1, [name for name in channels if name in readings]
    for k, (name, values) in enumerate(channels.items()):
        of, colour = quantity(name), colours.TENDONS[k % len(colours.TENDONS)]
        if name in read:
            label = "_" if name != read[0] else given
            measured(axes, time, of.factor * readings[name], label=label)
        axes.plot(time, of.factor * values, color=colour, linewidth=1.2, label=of.symbol)
        axes.set_ylabel(f"{of.symbol.partition(',')[0]} [{of.unit}]" if several else of.label)
    words = _OF_TENDON.sub("", quantity(next(iter(channels))).words)
    heading, ncols = "\n".join(wrap(words, _LETTERS)), 1 if len(channels) < _MANY else 2
    legend = axes.legend(
        loc="upper left", bbox_to_anchor=(1.0, 1.1), title=heading, ncols=ncols, alignment="left"
    )
    if not several and not read:  # its axis names the one line
        for each in (*legend.get_lines(), *legend.get_texts()):
            each.set_visible(False)


def run_figure(fitted: MachineCalibration, which: int) -> Figure:
    """Draw each channel of one run over time, and below it what is left; samples held out are grey."""
    run = fitted.runs[which]
    count = len(run.measured)
    with figure((PAGE, _HEIGHT * count + 0.3)) as drawing:
        rows = drawing.subplots(2 * count, 1, sharex=True, squeeze=False, height_ratios=[2.0, 1.0] * count)
        for name, above, below in zip(run.measured, rows[::2, 0], rows[1::2, 0], strict=True):
            draw_fit(above, fitted, which, name)
            draw_residual(below, fitted, which, name)
        for axes in rows[:, 0]:
            axes.set_title("")
            axes.set_xlabel("")
        rows[0, 0].set_title(f"{run.name}: readings and fit; below, residuals. Grey: held out in the check")
        legend_below(drawing, rows[0, 0])
        rows[-1, 0].set_xlabel(TIME.title)
    return drawing


def draw_fit(axes: Axes, fitted: MachineCalibration, which: int, name: str) -> Axes:
    """Draw one channel of a run over time, measured and fitted; samples held out are grey."""
    of, run = quantity(name), fitted.runs[which]
    _mark_held_out(axes, run)
    measured(axes, run.given["time_s"], of.factor * run.measured[name])
    model = of.factor * fitted.fitted[which][name]
    axes.plot(run.given["time_s"], model, color=BLUE, linewidth=1.0, label="fitted")
    words = "\n".join(wrap(of.words, _LETTERS))
    titles(axes, f"{run.name}: readings and fit", TIME.title, f"{words}\n{of.label}")
    return axes


def draw_residual(axes: Axes, fitted: MachineCalibration, which: int, name: str) -> Axes:
    """Draw measured less fitted of one channel of a run over time; samples held out are grey."""
    of, run = quantity(name), fitted.runs[which]
    _mark_held_out(axes, run)
    axes.plot(run.given["time_s"], of.factor * (run.measured[name] - fitted.fitted[which][name]), **MEASURED)
    titles(axes, f"{run.name}: residual", TIME.title, f"Δ{of.label}")
    return axes


def _mark_held_out(axes: Axes, run: MachineRun) -> None:
    if run.held_out.any():
        time = run.given["time_s"]
        axes.axvspan(time[run.held_out][0], time[-1], color=SOFT, alpha=0.12, linewidth=0.0)


def loop_figure(fitted: MachineCalibration) -> Figure:
    """Draw the first channel of every run over its drive, measured and fitted: the loops of friction."""
    with figure((PAGE, 3.2)) as drawing:
        legend_below(drawing, draw_loops(drawing.subplots(), fitted))
    return drawing


def draw_loops(axes: Axes, fitted: MachineCalibration) -> Axes:
    """Draw the first channel of every run over its drive, measured and fitted."""
    for k, (run, model) in enumerate(zip(fitted.runs, fitted.fitted, strict=True)):
        drive, answer = drive_channels(run.drive, run.tendons)[0], next(iter(run.measured))
        x, y = quantity(drive), quantity(answer)
        across, hidden = x.factor * run.given[drive], "_" if k else ""  # each named once
        measured(axes, across, y.factor * run.measured[answer], label=f"{hidden}measured")
        axes.plot(across, y.factor * model[answer], color=BLUE, linewidth=1.0, label=f"{hidden}fitted")
        titles(axes, f"{y.symbol} over {x.symbol}", x.title, y.title)
    return axes


def bends_figure(fitted: MachineCalibration) -> Figure:
    """Draw which share of the angle each part of a sheath has, with 95 % intervals, beside an even bend."""
    with figure((PAGE, 2.6)) as drawing:
        legend_below(drawing, draw_bends(drawing.subplots(), fitted))
    return drawing


def draw_bends(axes: Axes, fitted: MachineCalibration) -> Axes:
    """Draw the share of the angle of each part of a sheath with its 95 % interval."""
    parts, length = fitted.bends, fitted.rig.route.length_m or 1.0
    at = 1e3 * length * (np.arange(len(parts)) + 0.5) / len(parts)
    share = 100.0 * np.array([each.value for each in parts])
    low, high = (100.0 * np.array([getattr(each, end) for each in parts]) for end in ("low", "high"))
    axes.bar(at, share, 0.9e3 * length / len(parts), color=BLUE, alpha=0.5, label="share of Φ")
    axes.errorbar(at, share, [share - low, high - share], fmt="none", color=BLUE, label="95 % interval")
    axes.axhline(100.0 / len(parts), color=SOFT, linestyle="--", linewidth=1.0, label="even bend")
    titles(axes, "Where the sheath bends", "distance from the proximal end [mm]", "share of Φ [%]")
    return axes


def course_figure(pieces: Sequence[CalibratedPiece]) -> Figure:
    """Draw every number of the rig that pieces of a log identify over time, with its 95 % interval."""
    numbers: dict[str, list[tuple[CalibratedPiece, MachineEstimate]]] = {}
    for piece in pieces:
        for each in () if piece.fitted is None else piece.fitted.estimates:
            if each.key and each.identified:
                numbers.setdefault(each.key, []).append((piece, each))
    with figure((PAGE, _HEIGHT * max(len(numbers), 1) + 0.5)) as drawing:
        rows = drawing.subplots(max(len(numbers), 1), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (key, known) in zip(rows, numbers.items(), strict=False):
            for passes, colour, label in ((True, BLUE, "95 % interval"), (False, SOFT, "fails its test")):
                those = [pair for pair in known if bool(pair[0].failures) != passes]
                if not those:
                    continue
                middle = [0.5 * (piece.start + piece.end) for piece, _ in those]
                half = [0.5 * (piece.end - piece.start) for piece, _ in those]
                value = np.array([each.value for _, each in those])
                beyond = [value - [each.low for _, each in those], [each.high for _, each in those] - value]
                axes.errorbar(middle, value, beyond, half, fmt="o", color=colour, markersize=3, label=label)
            unit = known[0][1].unit
            titles(axes, "", "", f"{key}\n[{unit}]")
        legend_below(drawing, rows[0])
        rows[-1].set_xlabel("time [s]")
        drawing.align_ylabels(rows.tolist())
    return drawing

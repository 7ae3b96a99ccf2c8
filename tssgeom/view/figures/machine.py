"""Figures of the calibration of a machine: what each channel read and what the model gives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from tssgeom.identify.calibrated_pieces import CalibratedPiece
from tssgeom.identify.machine_estimates import MachineCalibration, MachineEstimate
from tssgeom.tendon.machine_simulation import drive_channels
from tssgeom.view.figures.plots import BLUE, MEASURED, PAGE, SOFT, figure, legend_below, measured, titles

_HEIGHT = 1.9
"""Of the two rows of one channel [inch]."""
_PICTURED = {"rad": ("°", 180.0 / np.pi), "m": ("mm", 1e3), "Nm": ("mN·m", 1e3)}


def pictured(name: str) -> tuple[str, float]:
    """Return the label of a channel in a picture, and how many of its unit make one in SI."""
    stem, _, unit = name.rpartition("_")
    unit_of_picture, factor = _PICTURED.get(unit, (unit, 1.0))
    return f"{stem.replace('_', ' ')} [{unit_of_picture}]", factor


def run_figure(fitted: MachineCalibration, which: int) -> Figure:
    """Draw each channel of one run over time, and below it what is left; samples held out are grey."""
    run, model = fitted.runs[which], fitted.fitted[which]
    time, count = run.given["time_s"], len(run.measured)
    with figure((PAGE, _HEIGHT * count + 0.3)) as drawing:
        rows = drawing.subplots(2 * count, 1, sharex=True, squeeze=False, height_ratios=[2.0, 1.0] * count)
        for name, above, below in zip(run.measured, rows[::2, 0], rows[1::2, 0], strict=True):
            label, factor = pictured(name)
            readings, given = factor * run.measured[name], factor * model[name]
            for axes in (above, below):
                if run.held_out.any():
                    axes.axvspan(time[run.held_out][0], time[-1], color=SOFT, alpha=0.12, linewidth=0.0)
            measured(above, time, readings)
            above.plot(time, given, color=BLUE, linewidth=1.0, label="fitted")
            titles(above, "", "", label)
            below.plot(time, readings - given, **MEASURED)
            titles(below, "", "", f"left [{label.rpartition('[')[2]}")
        rows[0, 0].set_title(
            f"{run.name}: readings and fit; below, what is left. Grey: held out in the check"
        )
        legend_below(drawing, rows[0, 0])
        rows[-1, 0].set_xlabel("time [s]")
    return drawing


def loop_figure(fitted: MachineCalibration) -> Figure:
    """Draw the first channel of every run over its drive, measured and fitted: the loops of friction."""
    with figure((PAGE, 3.2)) as drawing:
        axes = drawing.subplots()
        for run, model in zip(fitted.runs, fitted.fitted, strict=True):
            drive, answer = drive_channels(run.drive, run.tendons)[0], next(iter(run.measured))
            (across, x), (up, y) = pictured(drive), pictured(answer)
            measured(axes, x * run.given[drive], y * run.measured[answer])
            axes.plot(x * run.given[drive], y * model[answer], color=BLUE, linewidth=1.0, label="fitted")
            titles(axes, f"{up} over {across}", across, up)
        handles, labels = axes.get_legend_handles_labels()
        drawing.legend(handles[:2], labels[:2], loc="outside lower center", ncols=2)
    return drawing


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
            titles(axes, "", "", key if unit == "1" else f"{key} [{unit}]")
        legend_below(drawing, rows[0])
        rows[-1].set_xlabel("time [s]")
    return drawing

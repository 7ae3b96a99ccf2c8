"""Figures of a calibration: readings and fit over time, what is left, and both channels over T_in."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tssgeom.identify.calibration import Calibration
from tssgeom.view import finding_wording as words
from tssgeom.view.figures.plots import BLUE, MEASURED, PAGE, SOFT, figure, titles

_COLUMNS = {"tension_out": "tension_out_N", "elongation": "elongation_m"}
_HEIGHT = 2.0
"""Of the two rows of one channel [inch]."""


def fit_figure(fitted: Calibration) -> Figure:
    """Draw each channel over time as measured and fitted, and below it what is left, beside its noise."""
    count = len(fitted.channels)
    with figure((PAGE, _HEIGHT * count + 0.3)) as drawing:
        rows = drawing.subplots(2 * count, 1, sharex=True, squeeze=False, height_ratios=[2.0, 1.0] * count)[
            :, 0
        ]
        for channel, above, below in zip(fitted.channels, rows[::2], rows[1::2], strict=True):
            quantity = words.channel(_COLUMNS[channel.name])
            measured, model = (
                quantity.factor * each[channel.name] for each in (fitted.measured, fitted.fitted)
            )
            above.plot(fitted.time, measured, **MEASURED)
            above.plot(fitted.time, model, color=BLUE, linewidth=1.0, label="fitted")
            titles(above, "", "", quantity.label)
            left, noise = measured - model, quantity.factor * channel.noise
            below.axhspan(-2.0 * noise, 2.0 * noise, color=SOFT, alpha=0.18, linewidth=0.0)
            below.plot(fitted.time, left, **MEASURED)
            titles(below, "", "", f"left [{quantity.label.rpartition('[')[2]}")
        rows[0].set_title("Readings and fit; below, what is left, and ± 2 standard deviations of the noise")
        _legend(drawing, rows[0])
        rows[-1].set_xlabel("time [s]")
    return drawing


def phase_figure(fitted: Calibration) -> Figure:
    """Draw T_out and elongation over T_in, measured and fitted: the loops of friction."""
    with figure((PAGE, 3.0)) as drawing:
        row = drawing.subplots(1, len(fitted.channels), squeeze=False)[0]
        for axes, channel in zip(row, fitted.channels, strict=True):
            quantity = words.channel(_COLUMNS[channel.name])
            counting = np.isfinite(fitted.measured[channel.name])
            measured = quantity.factor * fitted.measured[channel.name][counting]
            axes.plot(fitted.tension_in[counting], measured, **MEASURED)
            axes.plot(
                fitted.tension_in,
                quantity.factor * fitted.fitted[channel.name],
                color=BLUE,
                linewidth=1.0,
                label="fitted",
            )
            titles(axes, f"{quantity.symbol} over T_in", "proximal tension T_in [N]", quantity.label)
        _legend(drawing, row[0])
    return drawing


def _legend(drawing: Figure, axes: Axes) -> None:
    """Write the legend below all axes, where it hides no reading."""
    drawing.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)

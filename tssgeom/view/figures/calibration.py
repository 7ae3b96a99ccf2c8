"""Figures of a calibration: readings and fit over time, what is left, and both channels over T_in."""

from __future__ import annotations

from matplotlib.figure import Figure

from tssgeom.identify.calibration import Calibration
from tssgeom.view import finding_wording as words
from tssgeom.view.figures.plots import (
    BLUE,
    MEASURED,
    PAGE,
    SOFT,
    figure,
    legend_below,
    measured,
    panels,
    titles,
)

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
            readings, model = (
                quantity.factor * each[channel.name] for each in (fitted.measured, fitted.fitted)
            )
            measured(above, fitted.time, readings)
            above.plot(fitted.time, model, color=BLUE, linewidth=1.0, label="fitted")
            titles(above, "", "", quantity.label)
            left, noise = readings - model, quantity.factor * channel.noise
            below.axhspan(-2.0 * noise, 2.0 * noise, color=SOFT, alpha=0.18, linewidth=0.0)
            below.plot(fitted.time, left, **MEASURED)
            titles(below, "", "", f"left [{quantity.label.rpartition('[')[2]}")
        rows[0].set_title("Readings and fit; below, what is left, and ± 2 standard deviations of the noise")
        legend_below(drawing, rows[0])
        rows[-1].set_xlabel("time [s]")
    return drawing


def phase_figure(fitted: Calibration) -> Figure:
    """Draw T_out and elongation over T_in, measured and fitted: the loops of friction."""
    with panels(3.0, len(fitted.channels)) as (drawing, row):
        for axes, channel in zip(row, fitted.channels, strict=True):
            quantity = words.channel(_COLUMNS[channel.name])
            measured(axes, fitted.tension_in, quantity.factor * fitted.measured[channel.name])
            axes.plot(
                fitted.tension_in,
                quantity.factor * fitted.fitted[channel.name],
                color=BLUE,
                linewidth=1.0,
                label="fitted",
            )
            titles(axes, f"{quantity.symbol} over T_in", "proximal tension T_in [N]", quantity.label)
        legend_below(drawing, row[0])
    return drawing

"""Figures of a calibration: readings and fit over time, residuals, and both channels over T_in."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tssgeom.arrays import Vector
from tssgeom.identify.calibration import Calibration
from tssgeom.identify.fit_quality import ChannelFit
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
from tssgeom.view.quantities import TENSION_IN, TIME, quantity

_COLUMNS = {"tension_in": "tension_in_N", "tension_out": "tension_out_N", "elongation": "elongation_m"}
_HEIGHT = 2.0
"""Of the two rows of one channel [inch]."""


def fit_figure(fitted: Calibration) -> Figure:
    """Draw each channel over time as measured and fitted, and below it the residual, beside its noise."""
    count = len(fitted.channels)
    with figure((PAGE, _HEIGHT * count + 0.3)) as drawing:
        ratios = [2.0, 1.0] * count
        rows = drawing.subplots(2 * count, 1, sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
        for channel, above, below in zip(fitted.channels, rows[::2], rows[1::2], strict=True):
            draw_fit(above, fitted, channel)
            draw_residual(below, fitted, channel)
            below.set_ylabel("\n[".join(below.get_ylabel().split(" [")))
        for axes in rows:
            axes.set_title("")
            axes.set_xlabel(TIME.title if axes is rows[-1] else "")
        rows[0].set_title("Readings and fit; below, the residual, and ± 2 standard deviations of the noise")
        legend_below(drawing, rows[0])
        drawing.align_ylabels(rows.tolist())
    return drawing


def phase_figure(fitted: Calibration) -> Figure:
    """Draw T_out and elongation over T_in, measured and fitted: the loops of friction."""
    with panels(3.0, len(fitted.channels)) as (drawing, row):
        for axes, channel in zip(row, fitted.channels, strict=True):
            draw_loop(axes, fitted, channel)
        legend_below(drawing, row[0])
    return drawing


def draw_fit(axes: Axes, fitted: Calibration, channel: ChannelFit) -> Axes:
    """Draw one channel over time, measured and fitted."""
    of = quantity(_COLUMNS[channel.name])
    _draw_both(axes, fitted.time, fitted, channel)
    titles(axes, "Readings and fit", TIME.title, of.label)
    return axes


def draw_residual(axes: Axes, fitted: Calibration, channel: ChannelFit) -> Axes:
    """Draw measured less fitted over time, beside twice the standard deviation of the noise."""
    of = quantity(_COLUMNS[channel.name])
    noise = of.factor * channel.noise
    axes.axhspan(-2.0 * noise, 2.0 * noise, color=SOFT, alpha=0.18, linewidth=0.0)
    left = of.factor * (fitted.measured[channel.name] - fitted.fitted[channel.name])
    axes.plot(fitted.time, left, **MEASURED)
    titles(axes, "Residual, and ± 2 s.d. of the noise", TIME.title, f"Δ{of.label}")
    return axes


def draw_loop(axes: Axes, fitted: Calibration, channel: ChannelFit) -> Axes:
    """Draw one channel over T_in, measured and fitted: the loop of friction."""
    of = quantity(_COLUMNS[channel.name])
    _draw_both(axes, fitted.tension_in, fitted, channel)
    titles(axes, f"{of.symbol} over T_in", TENSION_IN.title, of.label)
    return axes


def _draw_both(axes: Axes, across: Vector, fitted: Calibration, channel: ChannelFit) -> None:
    factor = quantity(_COLUMNS[channel.name]).factor
    measured(axes, across, factor * fitted.measured[channel.name])
    model = factor * fitted.fitted[channel.name]
    axes.plot(across, model, color=BLUE, linewidth=1.0, label="fitted")

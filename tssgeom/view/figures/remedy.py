"""What an added curve of any angle gains and costs, as a figure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tssgeom.tendon.design import Tried
from tssgeom.view.figures.plots import BLUE, GREEN, INK, ORANGE, PAGE, SOFT, figure, note, titles

_ACROSS = "angle of the added curve β [°]"


def remedy_figure(tried: Sequence[Tried], tolerance: float | None, percentile: float) -> Figure:
    """Draw the changes that perturbations make, and the price, over the angle of the curve."""
    beta = np.degrees([each.curve.angle for each in tried])
    with figure((PAGE, 2.9)) as drawing:
        gain, out, own = drawing.subplots(1, 3)
        gain.plot(beta, [1e3 * each.disturbed.pull for each in tried], color=BLUE, label="end of the pull")
        gain.plot(
            beta,
            [1e3 * each.disturbed.elongation[-1] for each in tried],
            color=ORANGE,
            linestyle=(0, (5, 1.5)),
            label="end of the release",
        )
        gain.axhline(1e3 * tried[0].disturbed.pull, color=SOFT, linewidth=0.9)
        note(
            gain,
            "pull, same T_out",
            (0.98 * beta[-1], 1e3 * tried[0].disturbed.pull),
            xytext=(0, -2),
            textcoords="offset points",
            ha="right",
            va="top",
        )
        _mark_tolerance(gain, tolerance, float(beta[-1]))
        out.plot(beta, [each.price.tension_out for each in tried], color=GREEN)
        own.plot(beta, [1e3 * each.price.own_elongation for each in tried], color=GREEN)
        gain.legend(loc="upper right", borderaxespad=0.0, bbox_to_anchor=(1.0, 0.9))
        titles(gain, "(a) Effect of unknown bends", _ACROSS, f"|Δδ|, percentile {percentile:g} [mm]")
        titles(out, "(b) Price: distal tension", _ACROSS, "T_out at the end of the pull [N]")
        titles(own, "(c) Price: own elongation", _ACROSS, "δ of the added curve [mm]")
        for axes in (gain, out, own):
            axes.set_xlim(0, beta[-1])
            axes.set_xticks(np.arange(0, beta[-1] + 1, 360))
            axes.set_ylim(0, None)
    return drawing


def _mark_tolerance(axes: Axes, tolerance: float | None, right: float) -> None:
    if tolerance is None:
        return
    axes.axhline(1e3 * tolerance, color=INK, linewidth=0.9, linestyle=(0, (1, 1.5)))
    note(axes, "tolerance", (0.98 * right, 1e3 * tolerance), ha="right", va="bottom", color=INK)

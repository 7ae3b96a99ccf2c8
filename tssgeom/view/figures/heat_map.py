"""Where measured and simulated disagree: a heat map, and the misfit along each route."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from tssgeom.effects import HiddenBend
from tssgeom.identify.finding import Candidate, Finding
from tssgeom.view import finding_wording as words
from tssgeom.view.figures.plots import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PAGE,
    PURPLE,
    SKY,
    SMALLEST,
    SOFT,
    figure,
    legend_below,
    titles,
)
from tssgeom.view.figures.restyle import subscripts
from tssgeom.view.figures.style import FIXED

_LINES = (BLUE, ORANGE, GREEN, PURPLE, SKY)
_MOST = 1e3
_PALE = 0.18
"""Luminance of a colour from which a number in it is written black; derived: black and white have one
contrast with it, 4.6, by the formula of the W3C."""
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Of red, green and blue, by ITU-R BT.709."""


def heat_figure(finding: Finding) -> Figure:
    """Draw residual power by channel and run over phase and tension; 1 is what the sensors explain."""
    heat = finding.heat
    used = np.flatnonzero(np.isfinite(heat.power).any(axis=0))
    power = heat.power[:, used]
    rows, columns = power.shape
    with figure((PAGE, 1.5 + 0.21 * rows)) as drawing:
        axes = drawing.subplots()
        axes.grid(visible=False)
        scale = LogNorm(1.0, float(np.clip(np.nanmax(power, initial=10.0), 10.0, _MOST)))
        image = axes.pcolormesh(np.maximum(power, 1.0), cmap="cividis", norm=scale, gid=FIXED)
        axes.invert_yaxis()
        for i, j in zip(*np.nonzero(np.isfinite(power)), strict=True):
            value = float(power[i, j])
            ground = np.array(image.cmap(scale(max(value, 1.0)))[:3])
            shade = "black" if _luminance(ground) > _PALE else "white"
            at, style = (j + 0.5, i + 0.5), {"ha": "center", "va": "center", "fontsize": SMALLEST}
            axes.text(*at, _digits(value), color=shade, gid=FIXED, **style)
        axes.set_yticks(np.arange(rows) + 0.5, [subscripts(words.renamed(label)) for label in heat.rows])
        axes.set_xticks(
            np.arange(columns) + 0.5, [words.renamed(heat.columns[k]) for k in used], rotation=35, ha="right"
        )
        axes.tick_params(length=0)
        axes.set_title("Measured less simulated, before: 1 is the noise of the sensors alone")
        axes.set_xlabel("phase of the drive and T_in; empty: no samples")
        bar = drawing.colorbar(image, ax=axes, pad=0.01, fraction=0.04, format="%g")
        bar.set_label("mean square over that of the sensors [1]")
        bar.solids.set(rasterized=False, edgecolor="face", gid=FIXED)  # pyright: ignore[reportOptionalMemberAccess]
    return drawing


def _luminance(rgb: np.ndarray) -> float:
    """Return the relative luminance of a colour of sRGB."""
    linear = np.where(rgb > 0.04045, ((rgb + 0.055) / 1.055) ** 2.4, rgb / 12.92)
    return float(_LUMINANCE @ linear)


def _digits(power: float) -> str:
    return f"{power:.1f}" if power < 10 else f"{power:.0f}"


def along_figure(finding: Finding) -> Figure:
    """Draw the curve angle that each route misses, along its length, and where bends were detected."""
    with figure((PAGE, 2.5)) as drawing:
        axes = drawing.subplots()
        for colour, misfit in zip(_LINES * len(finding.along), finding.along, strict=False):
            s, want = 1e3 * misfit.s_m, misfit.extra_angle_rad_per_m
            low, high = (want + side * misfit.se_rad_per_m for side in (-2.0, 2.0))
            axes.fill_between(s, low, high, color=colour, alpha=0.15, linewidth=0)
            axes.plot(s, want, color=colour, marker="o", markersize=2.5, label=misfit.route)
        for k, arc_length in enumerate(bends(finding.effects)):
            axes.axvline(
                1e3 * arc_length,
                color=INK,
                linewidth=1.0,
                linestyle=(0, (2, 2)),
                label=None if k else "detected bend",
            )
        axes.axhline(0.0, color=SOFT, linewidth=0.8)
        titles(
            axes,
            "Curve angle that is missing, before (± 2 s.e.)",
            "arc length s [mm]",
            "missing angle [rad/m]",
        )
        legend_below(drawing, axes)
    return drawing


def bends(effects: tuple[Candidate, ...]) -> list[float]:
    """Return the arc lengths of the hidden bends that were detected [m]."""
    return [effect.at_m for each in effects for effect in each.effects if isinstance(effect, HiddenBend)]

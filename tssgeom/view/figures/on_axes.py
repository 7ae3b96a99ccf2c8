"""Single plots on the axes that a caller gives: of sensed points, routes, runs, commands and fits."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from tssgeom.arrays import Points, Vector
from tssgeom.identify.calibration import Calibration
from tssgeom.identify.finding import Finding
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.pieces import Arcs
from tssgeom.stream import FrameResult
from tssgeom.view import finding_wording as words
from tssgeom.view.figures.plots import (
    BLUE,
    INK,
    MEASURED,
    ORANGE,
    PAGE,
    SOFT,
    figure,
    note,
    save,
    style,
    titles,
)
from tssgeom.view.quantities import ANGLE, ARC_LENGTH, CURVATURE_AT, TENSION_AT, TIME, quantity
from tssgeom.view.samples import route_samples, staircase, tension_se
from tssgeom.view.scene.camera import camera
from tssgeom.view.wording import angle_with_error, with_error

__all__ = ["SIZE", "figure", "new_axes", "save", "style"]

SIZE = (0.75 * PAGE, 3.0)
"""Of a plot in a notebook [inch]. Chosen: its text is as large as that of the page."""
_BAND = "#d5dae3"
_MOST_CANDIDATES = 10
"""In the plot of a ranking. Chosen: as many as in the report."""
_FIT_COLUMNS = {"tension_out": "tension_out_N", "elongation": "elongation_m"}


def new_axes() -> Axes:
    """Return the axes of a new figure of pyplot, which a notebook shows."""
    return plt.subplots(figsize=SIZE, layout="constrained")[1]


def draw_points(axes: Axes, frames: list[Points], label: str) -> None:
    """Draw sensed points, the missing ones left out, in the plane in which the first frame spreads most."""
    usable = [points[~np.isnan(points).any(axis=1)] for points in frames]
    usable = [points for points in usable if len(points)]
    for k, points in enumerate(usable):
        view = camera(usable[0], usable[0][-1] - usable[0][0])
        flat = 1e3 * points @ np.column_stack([view.across, view.up])
        shade = plt.get_cmap("viridis")(k / max(len(usable) - 1, 1))
        axes.plot(
            *flat.T, color=BLUE if len(usable) == 1 else shade, marker="o", markersize=2.0, linewidth=0.8
        )
        if k == 0:
            axes.plot(*flat[0], color=INK, marker="s", markersize=5.0, linestyle="none", label="proximal end")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend()
    titles(axes, label, "across [mm]", "up [mm]")


def draw_components(axes: Axes, stations: Vector, curvatures: Points) -> None:
    """Draw the curvature components of a fibre along it."""
    for values, name, colour in zip(curvatures.T, ("κ_x", "κ_y"), (BLUE, ORANGE), strict=True):
        axes.plot(1e3 * stations, values, color=colour, marker="o", markersize=2.0, linewidth=0.8, label=name)
    axes.legend()
    titles(axes, "Curvature of the fibre", ARC_LENGTH.title, CURVATURE_AT.title)


def draw_tension(axes: Axes, result: FrameResult) -> None:
    """Draw the tension along the tendon with the standard error that comes from the geometry."""
    frame = route_samples(result)
    s, spread = ARC_LENGTH.factor * frame.s, tension_se(result, frame)
    axes.fill_between(s, frame.tension - spread, frame.tension + spread, color=_BAND, linewidth=0)
    axes.plot(s, frame.tension, color=TENSION_AT.ink)
    ends = result.transmission
    text = f"T_out = {with_error(ends.tension_out, ends.tension_out_se, 2)} N"
    axes.set_ylim(0.0, None)
    note(axes, text, (0.98, 0.05), xycoords="axes fraction", ha="right", color=INK)
    titles(axes, "Tension ± s.e. along the tendon", ARC_LENGTH.title, TENSION_AT.title)


def draw_curvature(axes: Axes, profile: CurvatureProfile | None, arcs: Arcs | None) -> None:
    """Draw curvature along a route with its standard error, and the pieces, as far as they are given."""
    if profile is not None:
        _draw_band(axes, profile.s, profile.kappa, profile.kappa_se, 1.0)
    if arcs is not None:
        along, height = staircase(arcs)
        axes.plot(ARC_LENGTH.factor * along, height, color=BLUE, linewidth=2.0, label="pieces")
    axes.set_ylim(0.0, None)
    titles(axes, "Curvature ± s.e.", ARC_LENGTH.title, CURVATURE_AT.title)


def draw_angle(axes: Axes, profile: CurvatureProfile) -> None:
    """Draw the accumulated curve angle along a route with its standard error."""
    _draw_band(axes, profile.s, profile.phi, profile.phi_se, ANGLE.factor)
    total = angle_with_error(profile.total_angle, profile.total_angle_se)
    titles(axes, f"Curve angle ± s.e.; Φ = {total}", ARC_LENGTH.title, ANGLE.title)


def _draw_band(axes: Axes, s: Vector, value: Vector, error: Vector, factor: float) -> None:
    along = ARC_LENGTH.factor * s
    low, high = factor * np.maximum(value - error, 0.0), factor * (value + error)
    axes.fill_between(along, low, high, color=_BAND, linewidth=0)
    axes.plot(along, factor * value, color=SOFT, linewidth=1.2)


def draw_channels(axes: Axes, time: Vector, channels: dict[str, Vector], measured: dict[str, Vector]) -> None:
    """Draw channels of one unit over time as lines, and what was measured of them as dots."""
    for name in {**channels, **measured}:
        of = quantity(name)
        if name in channels:
            axes.plot(time, of.factor * channels[name], color=of.ink, linewidth=1.2, label=of.symbol)
        if name in measured:
            options = {**MEASURED, "color": of.ink, "label": f"{of.symbol} measured"}
            axes.plot(time, of.factor * measured[name], **options)
    last = quantity(next(reversed({**channels, **measured})))
    axes.legend()
    titles(axes, "", TIME.title, f"{last.words.rpartition(' ')[2]} [{last.unit}]")


def draw_loop(axes: Axes, across: tuple[str, Vector], up: tuple[str, Vector]) -> None:
    """Draw one channel over another."""
    over, of = quantity(across[0]), quantity(up[0])
    axes.plot(over.factor * across[1], of.factor * up[1], color=of.ink, linewidth=1.2)
    titles(axes, f"{of.symbol} over {over.symbol}", over.title, of.title)


def draw_commands(
    axes: Axes, time: Vector, reached: Vector, error: Vector, target: Vector, name: str
) -> None:
    """Draw where commands bring the distal end, with 95 % bounds, beside the target."""
    factor = quantity(name).factor
    low, high = factor * (reached - error), factor * (reached + error)
    axes.fill_between(time, low, high, color=_BAND, linewidth=0, label="95 % bounds")
    axes.plot(time, factor * reached, color=BLUE, label="commanded")
    axes.plot(time, factor * target, color=INK, linestyle=(0, (4, 1.5)), linewidth=1.0, label="target")
    axes.legend()
    titles(axes, "Where the commands bring the distal end", TIME.title, quantity(name).title)


def draw_fit(axes: Axes, fitted: Calibration, name: str) -> None:
    """Draw one channel over time as measured and fitted."""
    of = quantity(_FIT_COLUMNS[name])
    axes.plot(fitted.time, of.factor * fitted.measured[name], **MEASURED)
    axes.plot(fitted.time, of.factor * fitted.fitted[name], color=BLUE, linewidth=1.0, label="fitted")
    axes.legend()
    titles(axes, "Readings and fit", TIME.title, of.title)


def draw_ranking(axes: Axes, finding: Finding) -> None:
    """Draw how much each of the first candidates lowers the information criterion, and its threshold."""
    candidates = finding.ranking[:_MOST_CANDIDATES]
    rows = range(len(candidates))
    axes.barh(rows, [each.evidence.delta_bic for each in candidates], color=BLUE, height=0.7)
    for k, each in enumerate(candidates):
        bound = [each.evidence.threshold] * 2
        axes.plot(bound, [k - 0.45, k + 0.45], color=ORANGE, label="_" if k else "threshold")
    axes.set_yticks(rows, [words.candidate(each) for each in candidates])
    axes.invert_yaxis()
    axes.set_xscale("symlog", linthresh=20.0)
    if candidates:
        axes.legend(loc="lower right")
    titles(axes, "What each effect gains", "ΔBIC [1]", "")

"""Sensed points and fibres on axes, before anything is fitted to them."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes

from tssgeom.arrays import Points, Vector
from tssgeom.view.figures.plots import BLUE, INK, ORANGE, titles
from tssgeom.view.quantities import ARC_LENGTH, CURVATURE_AT
from tssgeom.view.scene.camera import camera


def draw_points(axes: Axes, frames: list[Points], label: str) -> Axes:
    """Draw sensed points, the missing ones left out, in the plane in which the first frame spreads most."""
    usable = [points[~np.isnan(points).any(axis=1)] for points in frames]
    usable = [points for points in usable if len(points)]
    for k, points in enumerate(usable):
        view = camera(usable[0], usable[0][-1] - usable[0][0])
        flat = ARC_LENGTH.factor * points @ np.column_stack([view.across, view.up])
        shade = BLUE if len(usable) == 1 else colormaps["viridis"](k / (len(usable) - 1))
        axes.plot(*flat.T, color=shade, marker="o", markersize=2.0, linewidth=0.8)
        if k == 0:
            axes.plot(*flat[0], color=INK, marker="s", markersize=5.0, linestyle="none", label="proximal end")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend()
    titles(axes, label, "across [mm]", "up [mm]")
    return axes


def draw_components(axes: Axes, stations: Vector, curvatures: Points) -> Axes:
    """Draw the curvature components of a fibre along it."""
    for values, name, colour in zip(curvatures.T, ("κ_x", "κ_y"), (BLUE, ORANGE), strict=True):
        along, style = ARC_LENGTH.factor * stations, {"marker": "o", "markersize": 2.0, "linewidth": 0.8}
        axes.plot(along, values, color=colour, label=name, **style)
    axes.legend()
    titles(axes, "Curvature of the fibre", ARC_LENGTH.title, CURVATURE_AT.title)
    return axes

"""Figure of a route in its main plane, coloured by tension; sensed points and fibres before any fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.stream import FrameResult
from tssgeom.view import colours
from tssgeom.view.end_names import ENDS, end_names, leader
from tssgeom.view.figures.plots import BLUE, COLUMN, INK, ORANGE, SOFT, figure, titles
from tssgeom.view.quantities import ARC_LENGTH, CURVATURE_AT, TENSION_AT
from tssgeom.view.samples import round_down, round_up, route_samples
from tssgeom.view.scene.labels import axis_letters, camera

NODES = 128
"""Nodes of a route in a figure; chosen: enough for a line of this size."""
_HEIGHT = 2.9  # inch
_SHADES = 64
_BORDER, _FOOT = np.array([44.0, 17.0]), np.array([0.0, 26.0])
"""Room beside and above the route for the names of its ends, and height of the strip below it for scale bar
and axes of space [pt]; as all sizes here chosen by eye on the sample shapes."""
_NAME, _TRIAD = np.array([24.0, 6.0]), 13.0
"""Half of the size of the name of an end, and length of the axes [pt]."""


def route_figure(result: FrameResult) -> Figure:
    """Draw a route coloured by tension, projected to the plane in which it spreads most."""
    with figure((COLUMN, _HEIGHT)) as drawing:
        drawing.set_layout_engine("none")
        draw_route(drawing.add_axes((0.02, 0.2, 0.96, 0.71)), result)
    return drawing


def draw_route(axes: Axes, result: FrameResult) -> Axes:
    """Draw the line in the colours of its tension, its pieces, its ends, a scale bar and a triad of axes."""
    frame = route_samples(result, NODES)
    view = camera(frame.position, frame.position[-1] - frame.position[0])
    plane = np.column_stack([view.across, view.up])
    flat = ARC_LENGTH.factor * frame.position @ plane
    top = round_up(float(frame.tension.max()))
    axes.set_title("Route; its pieces begin at the dots")
    axes.set_axis_off()
    _draw_colour_bar(axes, top)
    per_point, corner, size = _limits(axes, flat)
    axes.set_aspect("equal", adjustable="box")
    coloured(axes, flat, frame.tension, top, 3.2)
    draw_dots(axes, ARC_LENGTH.factor * frame.at(result.arcs.s_start) @ plane)
    on_paper = (flat - corner) / per_point
    letters = _draw_triad(axes, corner + per_point * np.array([size[0] - 26.0, 6.0]), plane, per_point)
    middles = end_names(on_paper, _FOOT, size, _NAME, (letters - corner) / per_point)
    for text, end, at in zip(ENDS, on_paper[[0, -1]], middles, strict=True):
        if (line := leader(end, at, _NAME)) is not None:
            axes.plot(*(corner + per_point * line).T, color=SOFT, linewidth=0.6, zorder=1)
        x, y = (corner + per_point * at).tolist()
        axes.text(x, y, text, color=INK, ha="center", va="center", zorder=5)
    length = round_down(0.25 * size[0] * per_point)
    bar = corner + per_point * np.array([[6.0, 16.0], [6.0, 16.0]]) + np.array([[0.0, 0.0], [length, 0.0]])
    axes.plot(*bar.T, color=SOFT, linewidth=1.5)
    foot = bar.mean(axis=0) - (0.0, 4.0 * per_point)
    axes.text(float(foot[0]), float(foot[1]), f"{length:g} mm", ha="center", va="top")
    return axes


def _limits(axes: Axes, flat: Vector) -> tuple[float, Vector, Vector]:
    """Set limits with room for names; return mm per point, the lower left corner [mm] and the size [pt]."""
    drawing = axes.get_figure(root=True)
    assert drawing is not None
    drawing.draw_without_rendering()  # the layout gives the axes their size
    size = np.array([axes.bbox.width, axes.bbox.height]) * 72.0 / drawing.dpi
    low, high = flat.min(axis=0), flat.max(axis=0)
    inner = np.maximum(size - 2.0 * _BORDER - _FOOT, 10.0)
    per_point = max(float(np.max((high - low) / inner)), 1e-9)
    corner = 0.5 * (low + high) - 0.5 * per_point * (size + _FOOT)
    axes.set_xlim(corner[0], corner[0] + per_point * size[0])
    axes.set_ylim(corner[1], corner[1] + per_point * size[1])
    return per_point, corner, size


def _draw_triad(axes: Axes, foot: Vector, plane: Matrix, per_point: float) -> Matrix:
    """Draw the directions of x, y and z on the picture, above `foot`; return the positions of the letters.

    A short one has its letter opposite.
    """
    letters = axis_letters(plane, _TRIAD, 5.0, np.array([8.0, 8.0]))
    origin = foot - (0.0, per_point * min(0.0, float(letters[:, 1].min())))
    for name, direction, at in zip("xyz", plane, letters, strict=True):
        tip = origin + _TRIAD * per_point * direction
        axes.plot(*np.stack([origin, tip]).T, color=SOFT, linewidth=1.0, solid_capstyle="round")
        x, y = (origin + per_point * at).tolist()
        axes.text(x, y, name, color=SOFT, fontsize=7.0, ha="center", va="center")
    return origin + per_point * letters


def _draw_colour_bar(axes: Axes, top: float) -> None:
    """Draw the scale of the colours; few enough of them that the bar is made of lines and no image."""
    drawing = axes.get_figure(root=True)
    assert drawing is not None
    colour_map = ListedColormap(colours.tension_rgb(np.linspace(0.0, top, _SHADES), top))
    bar = drawing.colorbar(
        ScalarMappable(Normalize(0.0, top), colour_map),
        cax=axes.inset_axes((0.05, -0.08, 0.9, 0.035)),
        orientation="horizontal",
    )
    bar.set_label(TENSION_AT.title)
    bar.solids.set(rasterized=False, edgecolor="face")  # pyright: ignore[reportOptionalMemberAccess]
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue, reportAttributeAccessIssue]


def draw_dots(axes: Axes, joints: Vector) -> None:
    """Mark where each piece begins, in its colour."""
    axes.scatter(*joints.T, s=20, c=shades(len(joints)), edgecolors=INK, linewidths=0.6, zorder=4)


def shades(count: int) -> Sequence[str]:
    """Return the colours of so many pieces."""
    return [colours.css(colours.piece_rgb(number)) for number in range(count)]


def coloured(
    axes: Axes, line: Vector, tension: Vector, top: float, width: float, *, outline: float = 1.4
) -> None:
    """Draw a line in the colours of its tension, with a dark outline that keeps yellow visible on white."""
    axes.plot(*line.T, color=INK, linewidth=width + outline, solid_capstyle="round", zorder=2)
    strips = list(np.stack([line[:-1], line[1:]], axis=1))
    rgb = colours.tension_rgb(0.5 * (tension[:-1] + tension[1:]), top)
    axes.add_collection(LineCollection(strips, colors=rgb, linewidths=width, capstyle="round", zorder=3))


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

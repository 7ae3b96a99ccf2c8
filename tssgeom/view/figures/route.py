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
from tssgeom.view.figures.plots import BLUE, COLUMN, INK, ORANGE, SOFT, figure, titles
from tssgeom.view.quantities import ARC_LENGTH, CURVATURE_AT, TENSION_AT
from tssgeom.view.samples import round_down, round_up, route_samples
from tssgeom.view.scene.camera import camera

NODES = 128
"""Nodes of a route in a figure; chosen: enough for a line of this size."""
_HEIGHT = 2.9  # inch
_SHADES = 64
_ENDS = "proximal", "distal"
_BORDER, _FOOT = np.array([44.0, 17.0]), np.array([0.0, 26.0])
"""Room beside and above the route for the names of its ends, and height of the strip below it for scale bar
and axes of space [pt]; as all sizes here chosen by eye on the sample shapes."""
_NAME, _CLEAR, _TRIAD = np.array([24.0, 6.0]), 4.0, 13.0
"""Half of the size of the name of an end, its least distance from the route, and length of the axes [pt]."""
_DISTANCES, _DIRECTIONS = (0.5, 8.0, 18.0), 16
"""Distances of a name from its end beyond the least, the best first [pt], and number of its directions."""


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
    for text, end, at in zip(_ENDS, flat[[0, -1]], _names((flat - corner) / per_point, size), strict=True):
        middle = corner + per_point * at
        box = per_point * _NAME
        edge = middle + np.clip(end - middle, -box, box)
        if np.linalg.norm(end - edge) > 8.0 * per_point:
            axes.plot(*np.stack([edge, end]).T, color=SOFT, linewidth=0.6, zorder=1)
        axes.text(float(middle[0]), float(middle[1]), text, color=INK, ha="center", va="center", zorder=5)
    length = round_down(0.25 * size[0] * per_point)
    bar = corner + per_point * np.array([[6.0, 16.0], [6.0, 16.0]]) + np.array([[0.0, 0.0], [length, 0.0]])
    axes.plot(*bar.T, color=SOFT, linewidth=1.5)
    foot = bar.mean(axis=0) - (0.0, 4.0 * per_point)
    axes.text(float(foot[0]), float(foot[1]), f"{length:g} mm", ha="center", va="top")
    _draw_triad(axes, corner + per_point * np.array([size[0] - 26.0, 6.0]), plane, per_point)
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


def _names(line: Vector, size: Vector) -> list[Vector]:
    """Choose the middles of the names of both ends [pt], off the route, off each other and inside."""
    half, inner = _NAME, min(8, len(line) - 1)
    turns = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    unit = np.column_stack([np.cos(turns), np.sin(turns)])
    chosen = list[Vector]()
    for end, before, opposite in (
        (line[0], line[inner], line[-1]),
        (line[-1], line[-1 - inner], line[0]),
    ):
        outward = (end - before) / max(float(np.linalg.norm(end - before)), 1e-300)
        reach = np.min((half + _CLEAR) / np.maximum(np.abs(unit), 1e-9), axis=1)
        middles = np.concatenate([end + unit * (reach + d)[:, None] for d in _DISTANCES])
        covered = (np.abs(middles[:, None] - line) < half + _CLEAR).all(axis=2).sum(axis=1)
        collides = [(np.abs(middles - other) < 2.0 * half + 2.0).all(axis=1) for other in chosen]
        outside = ((middles < half + _FOOT) | (middles > size - half)).any(axis=1)
        turned = np.tile(1.0 - unit @ outward, len(_DISTANCES))
        far = np.repeat(np.arange(len(_DISTANCES)), len(unit))
        ambiguous = _off_box(opposite - middles, half) < 2.0 * _off_box(end - middles, half)
        cost = covered + 1e3 * (np.sum(collides, axis=0) + outside) + 30.0 * ambiguous
        cost += 0.1 * turned + 0.3 * far
        chosen.append(middles[int(np.argmin(cost))])
    return chosen


def _off_box(points: Matrix, half: Vector) -> Vector:
    """Return the distances of points [n, 2] from a box about the origin."""
    return np.linalg.norm(np.maximum(np.abs(points) - half, 0.0), axis=1)


def _draw_triad(axes: Axes, foot: Vector, plane: Matrix, per_point: float) -> None:
    """Draw the directions of x, y and z on the picture, above `foot`; a short one has its letter opposite."""
    letters = list[Vector]()
    for direction in plane:
        away = direction if np.linalg.norm(direction) > 0.45 else -plane.sum(axis=0)
        away = away / np.linalg.norm(away)
        at = _TRIAD * direction + 5.0 * away
        while any(np.abs(at - other).max() < 8.0 for other in letters):
            at = at + 2.0 * away
        letters.append(at)
    origin = foot - (0.0, per_point * min(0.0, min(float(at[1]) for at in letters)))
    for name, direction, at in zip("xyz", plane, letters, strict=True):
        tip = origin + _TRIAD * per_point * direction
        axes.plot(*np.stack([origin, tip]).T, color=SOFT, linewidth=1.0, solid_capstyle="round")
        x, y = (origin + per_point * at).tolist()
        axes.text(x, y, name, color=SOFT, fontsize=7.0, ha="center", va="center")


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

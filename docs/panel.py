"""A panel of the picture of machines: tendons, sheaths, pulleys, and the names beside them."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

from tssgeom.arrays import Matrix

INK, GREY, BAND, PALE, EDGE = "#1d2330", "#5b6474", "#eef2f7", "#ffffff", "#aab6c6"
FIRST, SECOND, THIRD = "#2f5d8a", "#c8742a", "#5d8a4a"
READ = "#a3195b"
WIDE, HIGH, SMALL = 10.0, 5.9, 7.0  # of a panel, in its own units; size of letters [pt]
Side = Literal["left", "center", "right"]
Spot = Sequence[float] | np.ndarray


class Panel:
    """One machine, in units of a tenth of the panel's width, and the names that are written in it."""

    def __init__(self, axes: Axes, title: str, kinds: str) -> None:
        self.axes = axes
        self.keys: list[str] = []
        self.channels: list[str] = []
        axes.set(xlim=(0.0, WIDE), ylim=(0.0, HIGH), aspect="equal")
        axes.axis("off")
        axes.add_patch(
            FancyBboxPatch(
                (0.12, 0.12),
                WIDE - 0.24,
                HIGH - 0.24,
                boxstyle="round,pad=0,rounding_size=0.18",
                fc=BAND,
                lw=0,
                zorder=-2,
            )
        )
        axes.text(0.4, HIGH - 0.52, title, size=9.0, weight="bold", color=INK, va="center")
        axes.text(0.4, HIGH - 0.98, kinds, size=6.4, family="monospace", color=GREY, va="center")

    def write(self, x: float, y: float, text: str, colour: str, ha: Side = "center") -> None:
        """Write words, or a name in the letters of code."""
        family = "monospace" if "_" in text or "." in text else "sans-serif"
        self.axes.text(x, y, text, size=SMALL, color=colour, family=family, ha=ha, va="center", zorder=9)

    def key(self, x: float, y: float, name: str, ha: Side = "center", to: Sequence[float] = ()) -> None:
        """Write a key of the rig file, with a thin line to what it means."""
        self.keys.append(name)
        self.write(x, y, name, INK, ha)
        if to:
            self.axes.plot(to[::2], to[1::2], color=GREY, lw=0.6, zorder=8)

    def channel(self, x: float, y: float, name: str, ha: Side = "center", at: Sequence[float] = ()) -> None:
        """Write a channel of a run, with a dot where it is measured."""
        self.channels.append(name)
        self.write(x, y, name, READ, ha)
        if at:
            self.axes.scatter(*at, s=13, color=READ, lw=0, zorder=8)

    def line(self, points: Matrix | Sequence[Sequence[float]], colour: str = INK, wide: float = 1.5) -> None:
        """Draw a line through points [n, 2]."""
        self.axes.plot(*np.transpose(points), color=colour, lw=wide, solid_capstyle="round", zorder=5)

    def sheath(self, points: Matrix, colour: str) -> None:
        """Draw a tendon in its sheath, with a fitting at both ends."""
        for wide, shade in ((7.5, EDGE), (5.8, PALE)):
            self.axes.plot(*points.T, color=shade, lw=wide, solid_capstyle="butt", zorder=3)
        self.line(points, colour)
        for x, y in points[[0, -1]]:
            self.axes.add_patch(Rectangle((x - 0.07, y - 0.21), 0.14, 0.42, color=GREY, lw=0, zorder=4))

    def arrow(self, start: Spot, end: Spot, colour: str = INK) -> None:
        """Draw a straight arrow."""
        style = {"arrowstyle": "-|>", "color": colour, "lw": 0.9, "shrinkA": 0, "shrinkB": 0}
        self.axes.annotate(
            "", (end[0], end[1]), (start[0], start[1]), arrowprops={**style, "mutation_scale": 7}, zorder=7
        )

    def turn(self, centre: Spot, radius: float, start: float, end: float, colour: str) -> None:
        """Draw an arrow along an arc from one angle to another [deg]."""
        arc = on_circle(centre, radius, np.linspace(start, end, 40))
        self.axes.plot(*arc[:-2].T, color=colour, lw=0.9, zorder=7)
        self.arrow(arc[-3], arc[-1], colour)

    def pulley(self, centre: Spot, radius: float, spoke: float) -> None:
        """Draw a pulley with its radius at an angle [deg]."""
        self.axes.add_patch(Circle((centre[0], centre[1]), radius, fc=PALE, ec=INK, lw=1.0, zorder=4))
        self.axes.add_patch(Circle((centre[0], centre[1]), 0.07, color=INK, lw=0, zorder=6))
        self.line(np.vstack([centre, on_circle(centre, radius, np.array([spoke]))]), GREY, 0.8)

    def wall(self, x: float, y: float, half: float = 0.5) -> None:
        """Draw ground to the right of x."""
        self.line([[x, y - half], [x, y + half]], INK, 1.2)
        for k in np.linspace(-half, half - 0.2, 5):
            self.line([[x + 0.2, y + k + 0.2], [x, y + k]], GREY, 0.7)


def on_circle(centre: Spot, radius: float, degrees: np.ndarray) -> Matrix:
    """Return points on a circle [n, 2]."""
    turn = np.radians(degrees)
    return np.asarray(centre) + radius * np.column_stack([np.cos(turn), np.sin(turn)])


def arch(start: float, end: float, foot: float, height: float) -> Matrix:
    """Return a bent route from left to right that is level at both ends [n, 2]."""
    share = np.linspace(0.0, 1.0, 80)
    return np.column_stack([start + (end - start) * share, foot + height * np.sin(np.pi * share) ** 2])


def spring(start: float, end: float, y: float, half: float = 0.2) -> Matrix:
    """Return a zigzag from left to right [n, 2]."""
    x = np.concatenate([[start], np.linspace(start + 0.25, end - 0.25, 12), [end]])
    return np.column_stack([x, y + half * np.array([0, 0, *([1, -1] * 5), 0, 0])])

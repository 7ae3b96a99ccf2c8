"""Small charts of a page as SVG text: axes, lines, bands, bars and dots.

One takes a few milliseconds to write. Matplotlib, which draws the figures for print, takes a quarter of a
second for each.
"""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.view.quantities import SYMBOL

Limits = tuple[float, float]
Ticks = Sequence[tuple[float, str]]

WIDTH, HEIGHT = 250.0, 208.0  # of a chart: five stand side by side on a page of 1400 px [px]
LEFT, RIGHT, ABOVE, BELOW = 42.0, 10.0, 36.0, 36.0  # from its edges to its box [px]
_LETTER = 6.6  # greatest width of a figure [px]
_ACROSS, _UP = 48.0, 30.0  # least spacing of numbers on the horizontal and the vertical axis [px]


@dataclass(slots=True)
class Chart:
    """A chart that is written part by part; `svg` closes it."""

    title: str
    x: Limits
    y: Limits
    _parts: list[str] = field(default_factory=list)

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom of the box between the axes [px]."""
        return LEFT, ABOVE, WIDTH - RIGHT, HEIGHT - BELOW

    def pixels(self, x: Vector | float, y: Vector | float) -> Vector:
        """Positions [n, 2] of values on the page, from its upper left corner [px]; none lies far outside."""
        left, top, right, bottom = self.box
        across = left + (right - left) * (np.asarray(x) - self.x[0]) / (self.x[1] - self.x[0])
        up = bottom - (bottom - top) * (np.asarray(y) - self.y[0]) / (self.y[1] - self.y[0])
        high, wide = 10.0 * HEIGHT, 10.0 * WIDTH
        pair = np.broadcast_arrays(np.clip(across, -wide, wide), np.clip(up, -high, high))
        return np.column_stack(pair)

    def axes(self, x_title: str, y_title: str, *, x_ticks: Ticks | None = None) -> None:
        """Draw the grid, and numbers and titles of both axes."""
        left, top, right, bottom = self.box
        across = ticks(self.x, (right - left) / _ACROSS) if x_ticks is None else x_ticks
        for value, label in across:
            at = self.pixels(value, self.y[0])[0, 0]
            self._parts.append(f'<path class="g" d="M{at:.1f} {bottom:.1f}V{top:.1f}"/>')
            fits = at + 0.5 * _LETTER * len(label) < WIDTH
            self.text(at if fits else WIDTH - 1, bottom + 15, label, anchor="middle" if fits else "end")
        for value, label in ticks(self.y, (bottom - top) / _UP):
            at = self.pixels(self.x[0], value)[0, 1]
            self._parts.append(f'<path class="g" d="M{left:.1f} {at:.1f}H{right:.1f}"/>')
            self.text(left - 5, at + 3.5, label, anchor="end")
        self.text(right, HEIGHT - 6, x_title, anchor="end")
        self.text(2, ABOVE - 9, y_title)

    def text(self, x: float, y: float, text: str, *, anchor: str = "start", kind: str = "") -> None:
        """Write a text at a position of the page [px]; `kind` is a class of the style."""
        options = f' class="{kind}"' if kind else ""
        self._parts.append(
            f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{options}>{lowered(text)}</text>'
        )

    def note(self, x: float, y: float, text: str, *, anchor: str = "start", kind: str = "n") -> None:
        """Write a text at a value."""
        across, up = self.pixels(x, y)[0]
        self.text(float(across), float(up), text, anchor=anchor, kind=kind)

    def line(self, x: Vector, y: Vector, colour: str, width: float = 1.2) -> None:
        """Draw a line through values; it is interrupted where one is not finite."""
        style = f'stroke="{colour}" stroke-width="{width:g}"'
        self._parts.append(f'<path d="{path(self.pixels(x, y))}" {style}/>')

    def stroke(self, points: Vector, colour: str) -> None:
        """Draw a thin line through positions of the page [n, 2] [px]."""
        self._parts.append(f'<path d="{path(points)}" stroke="{colour}" stroke-width=".7"/>')

    def band(self, x: Vector, low: Vector, high: Vector, colour: str, opacity: float = 1.0) -> None:
        """Fill between two lines."""
        ring = np.concatenate([self.pixels(x, low), self.pixels(x, high)[::-1]])
        self._parts.append(f'<path d="{path(ring)}z" fill="{colour}" fill-opacity="{opacity:g}"/>')

    def shaded(self, x: Vector, y: Vector, shades: Sequence[str], width: float) -> None:
        """Draw a line of which each stretch between neighbours has its colour, on a dark outline."""
        points = self.pixels(x, y)
        self.line(x, y, "#1d2330", width + 1.2)
        begin = 0
        for end in range(1, len(shades) + 1):
            if end == len(shades) or shades[end] != shades[begin]:
                style = f'stroke="{shades[begin]}" stroke-width="{width:g}"'
                self._parts.append(f'<path d="{path(points[begin : end + 1])}" {style}/>')
                begin = end

    def dots(
        self, x: Vector, y: Vector, colours: Sequence[str], radius: float, *, hollow: bool = False
    ) -> None:
        """Draw a dot, or a circle, at each value."""
        for (across, up), colour in zip(self.pixels(x, y), colours, strict=True):
            if math.isfinite(across + up):
                style = f'fill="none" stroke="{colour}" stroke-width=".7"' if hollow else f'fill="{colour}"'
                self._parts.append(f'<circle cx="{across:.1f}" cy="{up:.1f}" r="{radius:g}" {style}/>')

    def bars(self, edges: Vector, heights: Vector, colour: str) -> None:
        """Draw the bars of a histogram between its edges [n + 1]."""
        base = self.pixels(0.0, self.y[0])[0, 1]
        for low, high, top in zip(self.pixels(edges, 0.0)[:-1, 0], self.pixels(edges, 0.0)[1:, 0],
                                  self.pixels(0.0, heights)[:, 1], strict=True):  # fmt: skip
            if top < base:
                self._parts.append(
                    f'<rect x="{low:.1f}" y="{top:.1f}" width="{max(high - low - 1.0, 1.0):.1f}" '
                    f'height="{base - top:.1f}" fill="{colour}"/>'
                )

    def legend(self, names: Sequence[tuple[str, str]]) -> None:
        """Write names in their colours above the box, where no line goes, beside the title of its axis."""
        right = self.box[2]
        spans = "".join(
            f'<tspan fill="{colour}" dx="{6 if number else 0}">{lowered(name)}</tspan>'
            for number, (name, colour) in enumerate(names)
        )
        position = f'x="{right:.1f}" y="{ABOVE - 9:.1f}" text-anchor="end"'
        self._parts.append(f'<text class="n" {position}>{spans}</text>')

    def svg(self) -> str:
        """Return the chart as an element of a page."""
        title = html.escape(self.title)
        return (
            f'<svg class="chart" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" aria-label="{title}">'
            f'<text class="t" x="2" y="13">{lowered(self.title)}</text>{"".join(self._parts)}</svg>'
        )


def lowered(text: str) -> str:
    """Write a text with its subscripts for SVG."""
    below = '<tspan class="sub" dy="2.5">{}</tspan><tspan dy="-2.5">\N{ZERO WIDTH SPACE}</tspan>'
    return SYMBOL.sub(lambda one: one[1] + below.format(one[2] + (one[3] or "")), html.escape(text))


def path(points: Vector) -> str:
    """Write points [n, 2] as the data of a path; it begins anew after each that is not finite."""
    data, pen = list[str](), "M"
    for across, up in points.tolist():
        if math.isfinite(across + up):
            data.append(f"{pen}{across:.1f} {up:.1f}")
            pen = "L"
        else:
            pen = "M"
    return "".join(data)


def ticks(limits: Limits, most: float) -> list[tuple[float, str]]:
    """Return round numbers between two limits, at most about so many, each with its text."""
    low, high = limits
    rough = (high - low) / max(most, 1.0)
    unit = 10.0 ** math.floor(math.log10(rough))
    step = next(m * unit for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * unit >= rough * (1 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    values = [step * k for k in range(first, last + 1)]
    digits = next(d for d in range(9) if d == 8 or all(abs(round(v, d) - v) < 1e-6 * step for v in values))
    if max(map(abs, values), default=0.0) >= 1e5:
        return [(value, f"{value:.3g}") for value in values]
    return [(value, f"{value:z.{digits}f}") for value in values]


def limits_of(*values: Vector, zero: bool = True, room: float = 0.06) -> Limits:
    """Return limits that hold all finite values with some room, and 0 where wanted."""
    every = np.concatenate([np.asarray(one, dtype=np.float64).ravel() for one in values])
    every = every[np.isfinite(every)]
    low, high = (float(every.min()), float(every.max())) if len(every) else (0.0, 1.0)
    if zero:
        low, high = min(low, 0.0), max(high, 0.0)
    if high - low <= 1e-9 * max(abs(low), abs(high), 1e-12):
        half = 0.05 * abs(high) or 1.0
        low, high = (low, high + 2 * half) if zero else (low - half, high + half)
    margin = room * (high - low)
    return (low if zero and low == 0.0 else low - margin), (high if zero and high == 0.0 else high + margin)

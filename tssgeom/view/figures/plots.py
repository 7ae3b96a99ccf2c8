"""Figures for print: one style, each written as PDF, SVG and PNG."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from tssgeom.arrays import Vector
from tssgeom.view import colours
from tssgeom.view.figures.restyle import restyle
from tssgeom.view.figures.style import used
from tssgeom.view.quantities import TIME
from tssgeom.view.samples import evenly

INK, SOFT, FAINT = colours.TENSION_IN, "#697386", "#e8ebf0"
BLUE, ORANGE, PURPLE = colours.TENSION_OUT, colours.ELONGATION, colours.ANGLE
GREEN, SKY = "#009e73", "#56b4e9"
"""Colours of Okabe and Ito (purple darkened), distinct on white to colour-blind people too."""
BAND = "#c9dcea"
"""Of what lies within bounds."""

MEASURED: Any = {
    "linestyle": "none",
    "marker": "o",
    "markersize": 3.0,
    "markerfacecolor": "none",
    "markeredgecolor": INK,
    "markeredgewidth": 0.6,
    "zorder": 6,
    "label": "measured",
}
"""Style of measured values, open circles, for `Axes.plot`."""
_MOST_MARKS = 90  # of one axes; chosen: circles of 3 pt do not touch over 170 mm

COLUMN, PAGE = 85 / 25.4, 170 / 25.4
"""Widths of a column and of a page of a journal, 85 mm and 170 mm [inch]."""
PAPER_COLUMN, PAPER_PAGE = 88 / 25.4, 180 / 25.4
"""The same in the style `paper`, 88 mm and 180 mm [inch]; chosen: one and two columns of many journals."""

NOTEBOOK = (0.75 * PAGE, 3.0)
"""Size of a plot in a notebook [inch]. Chosen: its text is as large as that of the page."""

FORMATS = ("pdf", "svg", "png")
VECTOR = FORMATS[:2]
SMALLEST = 7.0
"""Smallest text of a figure [pt]."""
_DPI = 200
CALENDAR = 1e5
"""Times beyond this are of a calendar [s]; chosen: a day and more, after which no run begins."""
_RC: Any = {
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "tssgeom",
    "font.family": "sans-serif",
    "font.size": 8.0,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # no axis is on top; else matplotlib measures every label for it
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
    "legend.handlelength": 2.4,
    "lines.linewidth": 1.6,
    "path.simplify_threshold": 0.3,
    "text.color": INK,
    "xtick.color": SOFT,
    "xtick.labelsize": 7.5,
    "ytick.color": SOFT,
    "ytick.labelsize": 7.5,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
}


@contextmanager
def style() -> Iterator[None]:
    """Draw in the common style."""
    with mpl.rc_context(_RC):
        yield


def new_axes() -> Axes:
    """Return the axes of a new figure of pyplot, which a notebook shows."""
    import matplotlib.pyplot as plt

    return plt.subplots(figsize=NOTEBOOK, layout="constrained")[1]


@contextmanager
def figure(size: tuple[float, float]) -> Iterator[Figure]:
    """Yield a figure of `size` [inch] to draw on, in the style in use."""
    width, height = size
    if used() == "paper":
        width = PAPER_COLUMN if width == COLUMN else PAPER_PAGE
    with mpl.rc_context(_RC):
        drawing = Figure(figsize=(width, height), layout="constrained")
        yield drawing
        for axes in drawing.axes:
            if axes.get_xlabel() == TIME.title and abs(axes.get_xlim()[0]) > CALENDAR:
                _count_from_first(axes)
        restyle(drawing)


class _FromFirst(MaxNLocator):
    """Ticks that are round numbers after a first time [s]."""

    def __init__(self, first: float) -> None:
        super().__init__(nbins="auto", steps=[1, 2, 2.5, 5, 10])
        self.first = first

    def tick_values(self, vmin: float, vmax: float) -> Any:
        """Return the ticks between two times [s]."""
        return self.first + np.asarray(super().tick_values(vmin - self.first, vmax - self.first))


def _count_from_first(axes: Axes) -> None:
    """Label times of a calendar by the seconds after the first, which is stated."""
    first = axes.dataLim.x0
    axes.xaxis.set_major_locator(_FromFirst(first))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda time, _: f"{round(time - first, 6):g}"))
    axes.set_xlabel(f"{TIME.title} after {first:.3f} s")


@contextmanager
def panels(height: float, count: int) -> Iterator[tuple[Figure, list[Axes]]]:
    """Yield a figure with axes side by side, one below the other in a column of a journal [inch]."""
    stacked = used() == "paper" and count > 1
    size = (COLUMN, count * height) if stacked or count == 1 else (PAGE, height)
    with figure(size) as drawing:
        rows = drawing.subplots(count if stacked else 1, 1 if stacked else count, squeeze=False)
        yield drawing, rows.ravel().tolist()


def measured(axes: Axes, across: Vector, value: Vector, **style: Any) -> None:
    """Mark measured values by open circles, so few that they are no line; the model is the line."""
    finite = np.flatnonzero(np.isfinite(value) & np.isfinite(across))
    if len(finite):
        kept = finite[evenly(len(finite), _MOST_MARKS)]
        axes.plot(across[kept], value[kept], **{**MEASURED, **style})


def legend_below(drawing: Figure, axes: Axes, columns: int = 4) -> None:
    """Write the legend of one axes below all of them, where it hides no value; in a column in two rows."""
    columns = columns if drawing.get_figwidth() > 0.7 * PAGE else 2
    drawing.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=columns)


def save(drawing: Figure, path: Path) -> None:
    """Write a figure in the format of its file's ending; the same figure gives the same bytes.

    A PDF holds its fonts, and the letters of an SVG are outlines: both are the same on every machine.
    """
    content, kind = io.BytesIO(), path.suffix[1:]  # on a full disk matplotlib's writers raise what they like
    with mpl.rc_context({**_RC, "svg.fonttype": "path"}):
        drawing.savefig(content, format=kind, dpi=_DPI, metadata=_METADATA[kind])
    path.write_bytes(content.getvalue())


def markup(drawing: Figure) -> str:
    """Write a figure in the common style as SVG for the inside of a page."""
    with mpl.rc_context(_RC):
        return inline_svg(drawing)


def inline_svg(drawing: Figure) -> str:
    """Write a figure as SVG for the inside of a page: without header, and without ids that could collide."""
    stream = io.StringIO()
    _position_axes(drawing)
    drawing.savefig(stream, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    text = re.sub(r' id="[A-Za-z0-9.]+_\d+"', "", text[text.index("<svg") :])
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    return _TAG.sub(_with_short_coordinates, text).replace("\n", " ")


def _position_axes(drawing: Figure) -> None:
    """Position the axes of a figure; matplotlib would draw it whole for that, and again to write it."""
    engine = drawing.get_layout_engine()
    if engine is not None:
        FigureCanvasSVG(drawing)
        engine.execute(drawing)
        drawing.set_layout_engine("none")


_TAG = re.compile(r"<[^>]+>")
_COORDINATES = re.compile(r' (?:d|x|y)="[^"]*"|translate\([^)]*\)')
_LONG_NUMBER = re.compile(r"(\d+\.\d{2})\d+")


def _with_short_coordinates(tag: re.Match[str]) -> str:
    """Write coordinates to a hundredth of a point; numbers in texts and in scales keep every digit."""
    return _COORDINATES.sub(lambda part: _LONG_NUMBER.sub(r"\1", part[0]), tag[0])


_METADATA: dict[str, Any] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}, "png": {}}


def titles(axes: Axes, title: str, across: str, up: str) -> None:
    """Write the title and, with their units, the names of both axes."""
    axes.set_title(title)
    axes.set_xlabel(across)
    axes.set_ylabel(up)


def note(axes: Axes, text: str, at: tuple[float, float], **style: Any) -> None:
    """Write a remark at a point given in values of the axes."""
    options: dict[str, Any] = {"fontsize": 7.5, "color": SOFT, "ha": "left", "va": "center"}
    axes.annotate(text, at, **{**options, **style})

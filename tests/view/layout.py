"""What is wrong with the layout of a figure: texts that overlap or leave it, and panels without content."""

import itertools

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

_SHARED = 1.0
"""Overlap of two texts that is no fault [pt]: boxes of letters are higher than the letters."""


def boxes(drawing: Figure) -> list[tuple[str, Bbox]]:
    """Return every text of a figure that is visible, and its box [pt]."""
    canvas = FigureCanvasAgg(drawing)
    canvas.draw()
    to_points = 72.0 / drawing.dpi
    texts = list[tuple[str, Bbox]]()
    for text in _texts(drawing):
        box = text.get_window_extent(canvas.get_renderer())
        texts.append((text.get_text(), Bbox(box.get_points() * to_points)))
    return texts


def _texts(drawing: Figure) -> list[Text]:
    """Return the texts that are visible; the numbers of ticks only where these lie on their axis."""
    ticks = dict[int, bool]()
    for axes in drawing.findobj(Axes):
        for axis in (axes.xaxis, axes.yaxis):
            inside = {id(tick) for tick in axis._update_ticks()}
            for tick in (*axis.majorTicks, *axis.minorTicks):
                for label in (tick.label1, tick.label2):
                    ticks[id(label)] = id(tick) in inside and axes.axison and axes.get_visible()
    return [
        text
        for text in drawing.findobj(Text)
        if text.get_visible() and text.get_text().strip() and ticks.get(id(text), True)
    ]


def faults(drawing: Figure) -> list[str]:
    """Return what is wrong, in words."""
    every = boxes(drawing)
    width, height = 72.0 * drawing.get_size_inches()
    outside = [
        f"{text!r} leaves the figure"
        for text, box in every
        if box.x0 < -_SHARED or box.y0 < -_SHARED or box.x1 > width + _SHARED or box.y1 > height + _SHARED
    ]
    overlapping = [
        f"{a!r} and {b!r} overlap"
        for (a, one), (b, other) in itertools.combinations(every, 2)
        if min(one.x1, other.x1) - max(one.x0, other.x0) > _SHARED
        and min(one.y1, other.y1) - max(one.y0, other.y0) > _SHARED
    ]
    empty = [
        f"the panel {axes.get_ylabel()!r} is empty"
        for axes in drawing.axes
        if axes.get_visible() and not axes.has_data()
    ]
    return outside + overlapping + empty

"""What a finished figure becomes in the style in use: subscripts, dark colours, no titles."""

from __future__ import annotations

from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import Collection
from matplotlib.colors import to_hex, to_rgba_array
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text

from tssgeom.view import colours
from tssgeom.view.figures.style import FIXED, used
from tssgeom.view.quantities import SYMBOL


def subscripts(text: str) -> str:
    """Write `T_in` as a symbol with its subscript."""
    return SYMBOL.sub(lambda symbol: rf"$\mathregular{{{symbol[1]}_{{{symbol[2]}{symbol[3] or ''}}}}}$", text)


def restyle(drawing: Figure) -> None:
    """Set subscripts, and give a figure the properties of its style."""
    set_subscripts(drawing)
    if used() == "paper":
        for axes in drawing.axes:
            axes.set_title("", loc="left")
    if used() == "dark":
        _darken(drawing)


def set_subscripts(drawing: Artist) -> None:
    """Write every `T_in` of a figure or of axes with its subscript, also in a legend that is made later."""
    for artist in drawing.findobj():
        if isinstance(artist, Text):
            artist.set_text(subscripts(artist.get_text()))
        elif isinstance(label := artist.get_label(), str):
            artist.set_label(subscripts(label))


def _darken(drawing: Figure) -> None:
    for artist in drawing.findobj():
        _recolour(artist)
    drawing.set_facecolor(colours.css(colours.BACKGROUND))
    for axes in drawing.axes:
        _recolour_ticks(axes)


def _recolour_ticks(axes: Axes) -> None:
    """Recolour the ticks that are made only when the figure is written."""
    for axis in (axes.xaxis, axes.yaxis):
        now: Any = axis.get_tick_params()
        keys = ("color", "labelcolor", "grid_color")
        axis.set_tick_params(which="both", **{key: _dark(now[key]) for key in keys if key in now})


def _recolour(artist: Artist) -> None:
    if isinstance(artist, Text):
        if artist.get_gid() != FIXED:
            artist.set_color(_dark(artist.get_color()))
        for patch in (artist.get_bbox_patch(), getattr(artist, "arrow_patch", None)):
            if patch is not None:
                _recolour(patch)
    elif isinstance(artist, Line2D):
        artist.set_markerfacecolor(_dark(artist.get_markerfacecolor()))
        artist.set_markeredgecolor(_dark(artist.get_markeredgecolor()))
        artist.set_color(_dark(artist.get_color()))
    elif isinstance(artist, Patch):
        face, edge = artist.get_facecolor(), artist.get_edgecolor()
        artist.set_facecolor(_dark(face))
        artist.set_edgecolor(_dark(edge))
    elif isinstance(artist, Collection) and artist.get_array() is None:
        face, edge = artist.get_facecolor(), artist.get_edgecolor()
        artist.set_facecolor(_dark_array(face))
        artist.set_edgecolor(_dark_array(edge))


def _dark(colour: Any) -> Any:
    if isinstance(colour, str) and colour in ("none", "auto"):
        return colour
    rows = _dark_array(colour)
    return tuple(rows[0].tolist()) if len(rows) else colour


def _dark_array(colour: Any) -> Any:
    """Return colours [n, 4] for a dark ground; the opacity stays."""
    rgba = to_rgba_array(colour)
    for row in rgba:
        row[:3] = to_rgba_array(colours.on_dark(to_hex(row[:3])))[0, :3]
    return rgba

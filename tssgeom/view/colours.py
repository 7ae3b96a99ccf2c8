"""One visual language: the colours of tension, of pieces and of lines, alike in every picture."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Vector

BACKGROUND = (17, 19, 24)
WHITE = (255, 255, 255)
AXIS = (120, 126, 138)
SENSED = (205, 208, 214)
OUTLIER = (255, 64, 64)
FRONT = (255, 140, 160)
LUMEN = (176, 120, 112)
CONTACT = (255, 92, 200)
BAND = (78, 90, 116)
GRID = (52, 56, 66)

MEASURED = (205, 208, 214)

TENSION_IN, TENSION_OUT, ELONGATION, ANGLE = "#1d2330", "#0072b2", "#d55e00", "#a3508a"
"""Colours of quantities on white, of Okabe and Ito (Φ darkened); `on_dark` gives those on a dark ground."""
ANGLE_BAND = (122, 72, 102)
"""Ends of the band of Φ in a recording."""
FIRST, SECOND = (86, 180, 233), (230, 159, 0)
"""Colours of A and B where two things are compared in a recording."""

_ON_DARK = {
    "#1d2330": "#e6e9ee",
    "#0072b2": "#3b9ad9",
    "#a3508a": "#cc79a7",
    "#d55e00": "#f0803c",
    "#c9dcea": "#24405a",
    "#f6f3e6": "#2d2a1c",
    "#ffffff": "#111318",
}
"""Colours of lines and bands, and what replaces them on a dark ground; chosen: of one hue."""
_GREY = 0.17
"""Largest difference of the parts of a grey, which a dark ground inverts; chosen: bands are greys."""
_BLACK, _WHITE = 0.08, 0.93
"""What white and black become on a dark ground; chosen: the ground is that of the recordings."""

TENDONS = (TENSION_OUT, ELONGATION, "#009e73", ANGLE)
"""Colours of tendons 1, 2 and so on of a machine on white; they begin anew after four."""
PIECES = ((230, 159, 0), (86, 180, 233), (204, 121, 167), (240, 228, 66), (213, 94, 0), (0, 158, 115))
"""Colours of neighbouring pieces: a selection of Okabe and Ito, distinct to colour-blind people too."""

BEFORE, AFTER = (230, 159, 0), (86, 180, 233)
"""A model before effects were added to it, and after."""

_DARKEST = 0.15  # of the map: darker colours vanish on the ground of a recording
_SHIFTS = np.array([2.0**24, 2.0**16, 2.0**8])  # of red, green and blue in 0xRRGGBBAA
_DIMMEST, _BRIGHTEST = 0.25, 0.95  # of the map of misfits: unlike the ground, and unlike white


def tension_rgb(tension: Vector, top: float) -> NDArray[np.float64]:
    """Colours of tensions: viridis without its darkest 15 %, from 0 N to `top`.

    Parameters
    ----------
    tension
        Any number of tensions [N].
    top
        Tension of the brightest colour [N].

    Returns
    -------
    NDArray, shape (n, 3)
        Red, green and blue from 0 to 1.
    """
    return _interpolated(_table("viridis", _DARKEST, 1.0), tension, top)


def tension_rgba32(tension: Vector, top: float) -> NDArray[np.uint32]:
    """Give the same colours as opaque 0xRRGGBBAA numbers, one for each tension [N]."""
    return (np.rint(255 * tension_rgb(tension, top)) @ _SHIFTS + 255).astype(np.uint32)


def misfit_rgba32(value: Vector, top: float) -> NDArray[np.uint32]:
    """Give colours of the misfit share, from 0 to `top`, as opaque 0xRRGGBBAA; unlike any tension's."""
    table = _table("inferno", _DIMMEST, _BRIGHTEST)
    return (np.rint(255 * _interpolated(table, value, top)) @ _SHIFTS + 255).astype(np.uint32)


@cache
def _table(name: str, first: float, last: float) -> NDArray[np.float64]:
    """Return 256 colours of a part of a map of matplotlib, which takes long to load [256, 3]."""
    from matplotlib import colormaps

    return np.asarray(colormaps[name](np.linspace(first, last, 256)))[:, :3]


def _interpolated(table: NDArray[np.float64], value: Vector, top: float) -> NDArray[np.float64]:
    """Return the rows of a table of colours for values from 0 to `top`; beyond them its ends."""
    share = np.clip(np.asarray(value, dtype=np.float64) / top, 0.0, 1.0)
    return table[np.rint(share * (len(table) - 1)).astype(np.intp)]


def on_dark(colour: str) -> str:
    """Return a colour `#rrggbb` for a dark ground: lines lighter, greys inverted, others as they are."""
    if (listed := _ON_DARK.get(colour)) is not None:
        return listed
    parts = np.array(rgb_of(colour)) / 255.0
    if np.ptp(parts) > _GREY:
        return colour
    grey = round(255.0 * float(_WHITE + (_BLACK - _WHITE) * parts.mean()))
    return css((grey, grey, grey))


def rgb_of(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue of `#rrggbb`."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def piece_rgb(piece: int) -> tuple[int, int, int]:
    """Colour of the piece of this number, counted from 0."""
    return PIECES[piece % len(PIECES)]


def tendon_rgb(number: int) -> tuple[int, int, int]:
    """Colour of the tendon of this number, counted from 0, on the dark ground of a recording."""
    return rgb_of(on_dark(TENDONS[number % len(TENDONS)]))


def css(rgb: tuple[int, int, int]) -> str:
    """Write a colour as `#rrggbb`."""
    return "#{:02x}{:02x}{:02x}".format(*rgb)

"""One visual language: the colours of tension, of pieces and of lines, alike in every picture."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
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

TENSION_IN = (253, 231, 37)
TENSION_OUT = (53, 183, 121)
MEASURED = (205, 208, 214)
ELONGATION = (86, 180, 233)
ANGLE = (230, 159, 0)
ANGLE_BAND = (138, 95, 0)

PIECES = ((230, 159, 0), (86, 180, 233), (204, 121, 167), (240, 228, 66), (213, 94, 0), (0, 158, 115))
"""Colours of neighbouring pieces: a selection of Okabe and Ito, distinct to colour-blind people too."""

BEFORE, AFTER = (230, 159, 0), (86, 180, 233)
"""A model before effects were added to it, and after."""

_DARKEST = 0.15  # of the map: darker colours vanish on the ground of a recording
_SHIFTS = np.array([2.0**24, 2.0**16, 2.0**8])  # of red, green and blue in 0xRRGGBBAA
_TABLE = np.asarray(colormaps["viridis"](np.linspace(_DARKEST, 1.0, 256)))[:, :3]
_MISFIT_TABLE = np.asarray(colormaps["inferno"](np.linspace(0.25, 0.95, 256)))[:, :3]


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
    return _interpolated(_TABLE, tension, top)


def tension_rgba32(tension: Vector, top: float) -> NDArray[np.uint32]:
    """Give the same colours as opaque 0xRRGGBBAA numbers, one for each tension [N]."""
    return (np.rint(255 * tension_rgb(tension, top)) @ _SHIFTS + 255).astype(np.uint32)


def misfit_rgba32(value: Vector, top: float) -> NDArray[np.uint32]:
    """Give colours of the misfit share, from 0 to `top`, as opaque 0xRRGGBBAA; unlike any tension's."""
    return (np.rint(255 * _interpolated(_MISFIT_TABLE, value, top)) @ _SHIFTS + 255).astype(np.uint32)


def _interpolated(table: NDArray[np.float64], value: Vector, top: float) -> NDArray[np.float64]:
    """Return the rows of a table of colours for values from 0 to `top`; beyond them its ends."""
    share = np.clip(np.asarray(value, dtype=np.float64) / top, 0.0, 1.0)
    return table[np.rint(share * (len(table) - 1)).astype(np.intp)]


def piece_rgb(piece: int) -> tuple[int, int, int]:
    """Colour of the piece of this number, counted from 0."""
    return PIECES[piece % len(PIECES)]


def css(rgb: tuple[int, int, int]) -> str:
    """Write a colour as `#rrggbb`."""
    return "#{:02x}{:02x}{:02x}".format(*rgb)

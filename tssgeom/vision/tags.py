"""Square tags of the ArUco and AprilTag families, with exact corners; docs/model.md (135)."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from tssgeom.arrays import Vector
from tssgeom.errors import SettingsError
from tssgeom.vision.views import Sightings, nothing

_FROM, _TO = 0.12, 0.88  # part of a side that is sampled: blur rounds the corners
_ALONG = 20  # positions on a side
_POSITION = (np.arange(_ALONG) + 0.5) / _ALONG * (_TO - _FROM) + _FROM
_STEP = 0.25  # between samples across a side [px]
_REACH = (1.5, 4.0)  # least and greatest distance sampled on both sides of an edge [px]
_SHARE = 0.7  # of a cell of the tag, which has six at least
_PASSES = 3
_ROUGH = 0.35  # scatter of a side about its line above which it is none [px]
_LEAST_NOISE = 0.03  # left by blur, lighting and the pixel grid [px]


CORNERS = 4

DICTIONARIES = {
    **{f"{n}x{n}_{size}": f"DICT_{n}X{n}_{size}" for n in (4, 5, 6, 7) for size in (50, 100, 250, 1000)},
    "aruco_original": "DICT_ARUCO_ORIGINAL",
    "aruco_mip_36h12": "DICT_ARUCO_MIP_36h12",
    **{f"apriltag_{name}": f"DICT_APRILTAG_{name}" for name in ("16h5", "25h9", "36h10", "36h11")},
}
"""Families of tags by the names that users write."""


def dictionary(name: str) -> cv2.aruco.Dictionary:
    """Return a family of tags; raises SettingsError where there is no family of that name."""
    known = DICTIONARIES.get(name.lower())
    if known is None:
        raise SettingsError(f"no family of tags is called {name!r}: use one of {', '.join(DICTIONARIES)}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, known))


def tag_finder(name: str) -> Callable[[np.ndarray], Sightings]:
    """Return what finds the tags of a family in an image.

    Raises SettingsError where there is no family of that name.
    """
    family = dictionary(name)
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    detector = cv2.aruco.ArucoDetector(family, settings)
    return lambda image: _tags(detector, grey(image))


def _tags(detector: cv2.aruco.ArucoDetector, image: np.ndarray) -> Sightings:
    """Detect tags; an id that occurs twice is ambiguous and left out."""
    corners, ids, _ = detector.detectMarkers(image)
    if ids is None or not len(ids):
        return nothing(CORNERS)
    numbers, where, count = np.unique(np.ravel(ids), return_index=True, return_counts=True)
    guess = np.array([np.reshape(corners[i], (CORNERS, 2)) for i in where], dtype=np.float64)
    pixels, noise = sharpened(image, guess)
    good = (count == 1) & np.isfinite(noise)
    return Sightings(pixels[good], noise[good], numbers[good].astype(np.int64), _areas(pixels[good]))


def _areas(pixels: np.ndarray) -> np.ndarray:
    x, y = pixels[..., 0], pixels[..., 1]
    return 0.5 * np.abs(np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1))


def grey(image: np.ndarray) -> np.ndarray:
    """Return the brightness of an image of one or three colours, 8 bits."""
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


def sharpened(image: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, Vector]:
    """Find the corners of tags where the lines through their sides meet.

    Parameters
    ----------
    image
        Brightness [h, w].
    corners
        First guess of the corners of each tag, in order [n, 4, 2] [px].

    Returns
    -------
    ndarray
        Corners [n, 4, 2] [px].
    Vector
        Standard deviation of a coordinate of a corner [n] [px], infinite where a side is no line.
    """
    brightness = image.astype(np.float32)
    for _ in range(_PASSES - 1):
        corners, _, _ = _moved(brightness, corners)
    corners, scatter, clear = _moved(brightness, corners)
    spread = np.sqrt(np.mean(scatter**2, axis=1) / _ALONG * (1.0 + 0.25 / np.var(_POSITION)))
    good = np.asarray(clear & (scatter < _ROUGH) & np.isfinite(corners).all(axis=2))
    return corners, np.where(np.all(good, axis=1), np.maximum(spread, _LEAST_NOISE), np.inf)


def _moved(brightness: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Move corners [n, 4, 2] to where the lines through their sides meet; scatter [px], clearness [n, 4]."""
    following = np.roll(corners, -1, axis=1)
    side = following - corners
    length = np.maximum(np.linalg.norm(side, axis=2), 1e-9)
    normal = _outward(side / length[..., None], corners)
    middle = corners[:, :, None] + _POSITION[:, None] * side[:, :, None]
    offset, clear = _edges(brightness, middle, normal, length)
    level, slope, scatter = _lines(_POSITION, offset)
    start = corners + level[..., None] * normal
    end = following + (level + slope)[..., None] * normal
    return _meet(start, end), scatter, clear


def _outward(along: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return unit normals of the sides that point away from the middle of the tag [n, 4, 2]."""
    normal = np.stack((along[..., 1], -along[..., 0]), axis=-1)
    out = np.sum(normal * (corners - corners.mean(axis=1, keepdims=True)), axis=2)
    return normal * np.where(out < 0, -1.0, 1.0)[..., None]


def _edges(
    brightness: np.ndarray, middle: np.ndarray, normal: np.ndarray, length: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where it gets bright outward of each position on a side [n, 4, m] [px], and whether it does at all."""
    reach = float(np.clip(_SHARE * np.median(length) / 6.0, *_REACH)) if length.size else _REACH[0]
    steps = np.arange(-reach, reach + _STEP, _STEP)
    sampled = middle[..., None, :] + steps[:, None] * normal[:, :, None, None]
    value = map_coordinates(brightness, (sampled[..., 1], sampled[..., 0]), order=1, mode="nearest")
    rise = np.maximum(np.diff(value, axis=-1), 0.0)
    total = rise.sum(axis=-1)
    between = 0.5 * (steps[1:] + steps[:-1])
    offset = np.where(total > 0, (rise * between).sum(axis=-1) / np.maximum(total, 1e-9), 0.0)
    return offset, np.median(total, axis=2) > 0


def _lines(position: Vector, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Offset at the first corner, its rise to the next, and the scatter, of each side [n, 4] [px]."""
    centred = position - position.mean()
    slope = (offset @ centred) / (centred @ centred)
    level = offset.mean(axis=2) - slope * position.mean()
    off = offset - level[..., None] - slope[..., None] * position
    return level, slope, np.sqrt(np.sum(off**2, axis=2) / (len(position) - 2))


def _meet(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Corners where each side [n, 4, 2] meets the one before it."""
    before_start, before_end = np.roll(start, 1, axis=1), np.roll(end, 1, axis=1)
    one, other, offset_between = before_end - before_start, end - start, start - before_start
    cross = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
    reach = (offset_between[..., 0] * other[..., 1] - offset_between[..., 1] * other[..., 0]) / np.where(
        cross == 0, np.nan, cross
    )
    return before_start + reach[..., None] * one

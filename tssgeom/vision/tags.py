"""Square tags of the ArUco and AprilTag families, with corners to a fraction of a pixel."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from tssgeom.errors import SettingsError
from tssgeom.vision.edges import sharpened
from tssgeom.vision.sightings import Sightings, nothing

CORNERS = 4

DICTIONARIES = {
    **{f"{n}x{n}_{size}": f"DICT_{n}X{n}_{size}" for n in (4, 5, 6, 7) for size in (50, 100, 250, 1000)},
    "aruco_original": "DICT_ARUCO_ORIGINAL",
    "aruco_mip_36h12": "DICT_ARUCO_MIP_36h12",
    **{f"apriltag_{name}": f"DICT_APRILTAG_{name}" for name in ("16h5", "25h9", "36h10", "36h11")},
}
"""Families of tags by the names that users write."""


def dictionary(name: str) -> cv2.aruco.Dictionary:
    """Return a family of tags.

    Raises
    ------
    SettingsError
        Where there is no family of that name.
    """
    known = DICTIONARIES.get(name.lower())
    if known is None:
        raise SettingsError(f"no family of tags is called {name!r}: use one of {', '.join(DICTIONARIES)}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, known))


def tag_finder(name: str) -> Callable[[np.ndarray], Sightings]:
    """Return what finds the tags of a family in an image.

    Raises
    ------
    SettingsError
        Where there is no family of that name.
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

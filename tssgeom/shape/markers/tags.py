"""Square tags of the ArUco and AprilTag families, with corners to a fraction of a pixel."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from tssgeom.errors import SettingsError
from tssgeom.shape.markers.sightings import Sightings, nothing

CORNERS = 4
_NOISE = 0.1
"""Standard deviation of a corner before the views have told it [px]."""
_MOST_WINDOW, _SHARE_OF_CELL = 5, 0.4

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
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    settings.cornerRefinementWinSize = _MOST_WINDOW
    settings.relativeCornerRefinmentWinSize = _SHARE_OF_CELL
    settings.cornerRefinementMinAccuracy = 0.005
    settings.cornerRefinementMaxIterations = 100
    detector = cv2.aruco.ArucoDetector(family, settings)
    return lambda image: _tags(detector, image)


def _tags(detector: cv2.aruco.ArucoDetector, image: np.ndarray) -> Sightings:
    """Find tags; an id that is there twice tells nothing and is left out."""
    corners, ids, _ = detector.detectMarkers(grey(image))
    if ids is None or not len(ids):
        return nothing(CORNERS)
    numbers, where, count = np.unique(np.ravel(ids), return_index=True, return_counts=True)
    once = where[count == 1]
    pixels = np.array([np.reshape(corners[i], (CORNERS, 2)) for i in once], dtype=np.float64)
    pixels = pixels.reshape(-1, CORNERS, 2)
    return Sightings(pixels, np.full(len(once), _NOISE), numbers[count == 1].astype(np.int64), _areas(pixels))


def _areas(pixels: np.ndarray) -> np.ndarray:
    x, y = pixels[..., 0], pixels[..., 1]
    return 0.5 * np.abs(np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1))


def grey(image: np.ndarray) -> np.ndarray:
    """Return the brightness of an image of one or three colours, 8 bits."""
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)

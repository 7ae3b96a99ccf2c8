"""Images with the detections in them: markers, their numbers, the route, and how far each is off."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from tssgeom.vision.boards import BoardDetection
from tssgeom.vision.cameras import Camera, project
from tssgeom.vision.views import Located, Sightings

_WHITE, _UNUSED, _SHADE = (255, 255, 255), (80, 80, 255), (0, 0, 0)
_MAGNIFIED = 20.0
"""How many times longer than they are the errors appear."""
_BAND = 0.04  # of the height of an image, for the line of text
_SUB = 4  # bits of a pixel that OpenCV draws to


def annotated(
    image: np.ndarray,
    camera: Camera,
    sightings: Sightings,
    one: Located,
    view: int,
    labels: Sequence[int],
    heading: str,
) -> np.ndarray:
    """Draw the sightings of one camera in one frame.

    Circles are sightings, coloured by arc length, red where they were not used; their numbers stand off the
    line, which joins the triangulated points. Short white strokes are twenty times the reprojection errors.
    """
    canvas = _in_colour(image)
    size = max(canvas.shape[0] / 600.0, 0.6)
    shades = _shades(len(one.points))
    pixels = project(camera, one.points)
    _draw_route(canvas, pixels, shades, size)
    used = one.which[:, view]
    for k in set(range(len(sightings))) - set(used.tolist()):
        _draw_outline(canvas, sightings, k, _UNUSED, size)
    for n, k in enumerate(used.tolist()):
        if k >= 0:
            _draw_outline(canvas, sightings, k, shades[n], size)
            error = sightings.centre[k] - pixels[n]
            _draw_line(canvas, sightings.centre[k], sightings.centre[k] + _MAGNIFIED * error, _WHITE, size)
    outward = _outward(pixels)
    for n, k in enumerate(used.tolist()):  # above every outline
        if k >= 0:
            _write_beside(canvas, str(labels[n]), sightings.centre[k], _reach(sightings, k), outward[n], size)
    return _headed(canvas, heading)


def annotated_board(image: np.ndarray, sightings: BoardDetection | None, heading: str) -> np.ndarray:
    """Draw the detected corners of a board."""
    canvas = _in_colour(image)
    size = max(canvas.shape[0] / 600.0, 0.6)
    if sightings is not None:
        shades = _shades(int(sightings.corners.max()) + 1)
        for corner, pixel in zip(sightings.corners, sightings.pixels, strict=True):
            cv2.circle(canvas, _at(pixel), _fine(3.5 * size), shades[corner], 1, cv2.LINE_AA, _SUB)
        for corner in (0, 1):
            here = sightings.pixels[sightings.corners == corner]
            if len(here):
                _write(canvas, str(corner), here[0] + 6 * size, shades[corner], 0.45 * size)
    return _headed(canvas, heading)


def beside(images: Sequence[np.ndarray]) -> np.ndarray:
    """Set images of one frame side by side, at one height."""
    height = max(image.shape[0] for image in images)
    padded = [cv2.copyMakeBorder(i, 0, height - i.shape[0], 0, 4, cv2.BORDER_CONSTANT) for i in images]
    return np.hstack(padded)


def encoded(image: np.ndarray) -> bytes:
    """Return an image as JPEG."""
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()


def _in_colour(image: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy()


def _shades(count: int) -> list[tuple[int, int, int]]:
    """Colours from the proximal to the distal end, without the darkest."""
    steps = np.linspace(60, 255, max(count, 1)).astype(np.uint8)
    table = cv2.applyColorMap(steps[:, None], cv2.COLORMAP_VIRIDIS)[:, 0]
    return [(int(b), int(g), int(r)) for b, g, r in table]


def _draw_route(
    canvas: np.ndarray, pixels: np.ndarray, shades: Sequence[tuple[int, int, int]], size: float
) -> None:
    """Join neighbours that were both located; across a missing marker there is no line."""
    for n in range(len(pixels) - 1):
        if np.isfinite(pixels[n : n + 2]).all():
            _draw_line(canvas, pixels[n], pixels[n + 1], shades[n], size)


def _draw_line(
    canvas: np.ndarray, start: np.ndarray, end: np.ndarray, colour: tuple[int, int, int], size: float
) -> None:
    if np.isfinite([start, end]).all() and max(np.abs(start).max(), np.abs(end).max()) < 1e5:
        cv2.line(canvas, _at(start), _at(end), colour, max(round(size), 1), cv2.LINE_AA, _SUB)


def _draw_outline(
    canvas: np.ndarray, sightings: Sightings, k: int, colour: tuple[int, int, int], size: float
) -> None:
    thick = max(round(1.3 * size), 1)
    if sightings.pixels.shape[1] > 1:
        corners = np.rint(sightings.pixels[k] * 2**_SUB).astype(np.int32)
        cv2.polylines(canvas, [corners], True, colour, thick, cv2.LINE_AA, _SUB)
        return
    radius = float(np.sqrt(sightings.size[k] / np.pi)) + 3 * size
    cv2.circle(canvas, _at(sightings.centre[k]), _fine(radius), colour, thick, cv2.LINE_AA, _SUB)


def _reach(sightings: Sightings, k: int) -> float:
    """Return how far a sighting and its outline reach from their middle [px]."""
    corners = np.linalg.norm(sightings.pixels[k] - sightings.centre[k], axis=1)
    return max(float(np.sqrt(sightings.size[k] / np.pi)), float(corners.max())) + 5.0


def _outward(pixels: np.ndarray) -> np.ndarray:
    """Return unit vectors [n, 2] square to the line of the markers, away from their middle."""
    known = np.isfinite(pixels).all(axis=1)
    out = np.tile([0.0, -1.0], (len(pixels), 1))
    if known.sum() > 1:
        line = pixels[known]
        along = np.gradient(line, axis=0)
        square = np.column_stack((along[:, 1], -along[:, 0]))
        square *= np.where(np.sum(square * (line - line.mean(axis=0)), axis=1) < 0, -1.0, 1.0)[:, None]
        out[known] = square / np.maximum(np.linalg.norm(square, axis=1, keepdims=True), 1e-9)
    return out


def _write_beside(
    canvas: np.ndarray, text: str, middle: np.ndarray, reach: float, outward: np.ndarray, size: float
) -> None:
    """Write a number in white, its middle so far outward that it is clear of a sighting."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.45 * size, 1)
    half = 0.5 * np.array([width, height])
    at = middle + (reach + float(np.abs(outward) @ half)) * outward
    _write(canvas, text, at + half * (-1.0, 1.0), _WHITE, 0.45 * size)


def _headed(canvas: np.ndarray, heading: str) -> np.ndarray:
    band = max(int(_BAND * canvas.shape[0]), 18)
    canvas = cv2.copyMakeBorder(canvas, band, 0, 0, 0, cv2.BORDER_CONSTANT)
    _write(canvas, heading, np.array([6.0, 0.72 * band]), _WHITE, 0.5 * band / 18)
    return canvas


def _write(
    canvas: np.ndarray, text: str, position: np.ndarray, colour: tuple[int, int, int], scale: float
) -> None:
    if np.isfinite(position).all():
        at = int(position[0]), int(position[1])
        cv2.putText(canvas, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, _SHADE, 3, cv2.LINE_AA)
        cv2.putText(canvas, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, 1, cv2.LINE_AA)


def _at(pixel: np.ndarray) -> tuple[int, int]:
    return _fine(pixel[0]), _fine(pixel[1])


def _fine(value: float) -> int:
    return round(float(value) * 2**_SUB)

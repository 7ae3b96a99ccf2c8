"""Bright, dark or coloured blobs, with centres to a fraction of a pixel; docs/model.md (134)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from tssgeom.core.constants import MEDIANS
from tssgeom.errors import SettingsError
from tssgeom.vision.tags import grey
from tssgeom.vision.views import Sightings, nothing

_ROUND = (0.8, 1.25)  # area over that of the ellipse with the same moments
_SLIM = 0.12  # smallest ratio of the squared axes: a disc viewed at 70 degrees
_CLEAR = 8.0  # standard deviations of the image noise that a blob stands out at least
_LEVEL = 0.4  # of the brightest: where the edge of a blob lies
_RIM = 2  # pixels around a blob that count for its centre
_RIM_OF_PATCH = np.ones((2 * _RIM + 1, 2 * _RIM + 1), np.uint8)
_NEIGHBOURS = np.ones((3, 3), np.uint8)
_EIGHT_BIT = 0.29  # noise of rounding to whole grey levels
_LEAST_NOISE = 0.02  # left by lighting and neighbouring pixels in an image without noise [px]
_SATURATION = 60.0  # of a colour, below which a pixel has none


@dataclass(frozen=True, slots=True)
class BlobAppearance:
    """Appearance of the blobs: colour and range of areas."""

    kind: str = "bright"
    """"bright", "dark", or a colour as #RRGGBB."""
    least: float = 6.0
    """Smallest area [px²]."""
    most: float = 5000.0
    """Largest area [px²]."""


def blob_finder(wanted: BlobAppearance) -> Callable[[np.ndarray], Sightings]:
    """Return what finds blobs in an image.

    Raises SettingsError where the appearance is unknown, or the areas are not a range.
    """
    if not 0 < wanted.least < wanted.most:
        raise SettingsError(
            f"blobs of {wanted.least:g} to {wanted.most:g} px²: give a range of areas that begins above 0 px²"
        )
    strength = _strength_of(wanted.kind)
    return lambda image: _blobs(strength(image), wanted)


def _strength_of(kind: str) -> Callable[[np.ndarray], np.ndarray]:
    if kind == "bright":
        return lambda image: grey(image).astype(np.float32)
    if kind == "dark":
        return lambda image: 255.0 - grey(image).astype(np.float32)
    if not re.fullmatch(r"#[0-9a-fA-F]{6}", kind):
        raise SettingsError(
            f"there is no appearance {kind!r}: write bright, dark or a colour such as #ff3030"
        )
    red, green, blue = (int(kind[k : k + 2], 16) for k in (1, 3, 5))
    colour = np.array([blue, green, red], dtype=np.float32)
    vivid = colour - colour.mean()
    if np.ptp(colour) < _SATURATION:
        raise SettingsError(f"the colour {kind} is nearly grey: use bright or dark")
    return lambda image: _likeness(image, vivid / np.linalg.norm(vivid))


def _likeness(image: np.ndarray, way: np.ndarray) -> np.ndarray:
    """How strongly a pixel has a colour: the part of its colour, less its grey, along the wanted one.

    A pixel of another hue, whose colour lies mostly across the wanted one, has none of it.
    """
    if image.ndim == 2:
        raise SettingsError("a grey image has no colours: use bright or dark blobs")
    vivid = image.astype(np.float32)
    vivid -= vivid.mean(axis=2, keepdims=True)
    along = vivid @ way
    across = np.sqrt(np.maximum(np.einsum("ijk,ijk->ij", vivid, vivid) - along * along, 0.0))
    return np.maximum(along - across, 0.0)


def _blobs(strength: np.ndarray, wanted: BlobAppearance) -> Sightings:
    """Find round patches that stand out; those cut off by the edge of the image are left out."""
    floor, noise = _floor(strength)
    peak = float(strength.max()) - floor
    level = max(_LEVEL * peak, _CLEAR * noise)
    if peak <= level:
        return nothing(1)
    mask = strength > floor + level
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        mask.view(np.uint8), connectivity=8, ltype=cv2.CV_32S
    )
    area = stats[:, cv2.CC_STAT_AREA]
    fit = (area >= wanted.least) & (area <= wanted.most) & (np.arange(count) > 0)
    boxes = stats[:, [cv2.CC_STAT_LEFT, cv2.CC_STAT_TOP, cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]]
    chosen = np.flatnonzero(fit & _is_round(mask, labels, count)).tolist()
    centres = {k: at for k in chosen if (at := _centre(strength, labels, k, boxes[k], floor, noise))}
    if not centres:
        return nothing(1)
    whole = np.array(list(centres.values()))
    size, ids = area[list(centres)].astype(np.float64), np.full(len(whole), -1)
    return Sightings(whole[:, None, :2], np.maximum(whole[:, 2], _LEAST_NOISE), ids, size)


def _floor(strength: np.ndarray) -> tuple[float, float]:
    """Strength of the background and its noise, from differences of neighbours in a few rows."""
    rows = np.ascontiguousarray(strength[:: max(len(strength) // 60, 1)])
    noise = MEDIANS.sd_per_absolute / np.sqrt(2.0) * float(np.median(np.abs(np.diff(rows, axis=1))))
    return float(np.median(rows)), max(noise, _EIGHT_BIT)


def _is_round(mask: np.ndarray, labels: np.ndarray, count: int) -> np.ndarray:
    """Whether each of `count` patches fills the ellipse with its moments, as no part of a disc does."""
    at = np.flatnonzero(mask)
    of = labels.ravel()[at]
    y, x = (part.astype(np.float64) for part in np.divmod(at, labels.shape[1]))
    n, *sums = (np.bincount(of, part, count) for part in (None, x, y, x * x, x * y, y * y))
    mx, my, xx, xy, yy = (one / np.maximum(n, 1) for one in sums)
    xx, xy, yy = xx - mx * mx + 1 / 12, xy - mx * my, yy - my * my + 1 / 12
    half, half_difference = 0.5 * (xx + yy), np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
    filled = n / (4.0 * np.pi * np.sqrt(np.maximum(xx * yy - xy * xy, 1e-12)))
    slim = half - half_difference <= _SLIM * (half + half_difference)
    return (_ROUND[0] < filled) & (filled < _ROUND[1]) & ~slim


def _centre(
    strength: np.ndarray, labels: np.ndarray, label: int, box: np.ndarray, floor: float, noise: float
) -> tuple[float, float, float] | None:
    """Return centre and standard deviation of a patch by its strength above the ground around it [px].

    None where it is too near to the edge of the image, or where another patch reaches into its rim.
    """
    (left, top, wide, high), edge = box.tolist(), _RIM + 1
    height, width = labels.shape
    if min(left, top) < edge or left + wide > width - edge or top + high > height - edge:
        return None
    # one pixel more than the ground, in which others count too
    x0, y0 = max(left - edge - 1, 0), max(top - edge - 1, 0)
    around = labels[y0 : top + high + edge + 1, x0 : left + wide + edge + 1]
    own, other = (around == label).view(np.uint8), ((around != 0) & (around != label)).view(np.uint8)
    counts = cv2.dilate(own, _RIM_OF_PATCH)
    if (counts & other).any():
        return None
    value = strength[y0 : y0 + len(around), x0 : x0 + around.shape[1]].astype(np.float64)
    zone = (slice(top - edge - y0, top + high + edge - y0), slice(left - edge - x0, left + wide + edge - x0))
    beside = cv2.dilate(other, _NEIGHBOURS)
    outside = ((counts == 0) & (beside == 0)).view(np.uint8)[zone]
    ground = cv2.mean(value[zone], outside)[0] if outside.any() else floor
    part, flat = cv2.moments((value - ground) * counts), cv2.moments(counts)
    total, count = part["m00"], flat["m00"]
    mx, my = part["m10"] / total, part["m01"] / total
    off = (flat["m10"] / count - mx) ** 2 + (flat["m01"] / count - my) ** 2
    spread = flat["mu20"] + flat["mu02"] + count * off
    # the noise of every pixel that counts moves the centre; docs/model.md (134)
    return x0 + mx, y0 + my, noise * math.sqrt(0.5 * spread) / total

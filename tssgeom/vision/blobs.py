"""Bright, dark or coloured blobs, with centres to a fraction of a pixel; docs/model.md (134)."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from tssgeom.errors import SettingsError
from tssgeom.statistics import MEDIANS
from tssgeom.vision.sightings import Sightings, nothing
from tssgeom.vision.tags import grey

_ROUND = (0.8, 1.25)  # area over that of the ellipse with the same moments
_SLIM = 0.12  # smallest ratio of the squared axes: a disc viewed at 70 degrees
_CLEAR = 8.0  # standard deviations of the image noise that a blob stands out at least
_LEVEL = 0.4  # of the brightest: where the edge of a blob lies
_RIM = 2  # pixels around a blob that count for its centre
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

    Raises
    ------
    SettingsError
        Where the appearance is unknown, or the areas are not a range.
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
        raise SettingsError(f"blobs cannot look {kind!r}: write bright, dark or a colour such as #ff3030")
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
    mask = (strength > floor + level).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8, ltype=cv2.CV_32S)
    area = stats[:, cv2.CC_STAT_AREA]
    fit = (area >= wanted.least) & (area <= wanted.most) & (np.arange(count) > 0)
    boxes = stats[:, [cv2.CC_STAT_LEFT, cv2.CC_STAT_TOP, cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]]
    chosen = np.flatnonzero(fit)
    centres = _centres(strength, labels, chosen, boxes[chosen], floor, noise)
    good = centres[:, 0] > 0
    centres, size = centres[good], area[chosen][good].astype(np.float64)
    ids = np.full(len(centres), -1)
    return Sightings(centres[:, None, 1:3], np.maximum(centres[:, 3], _LEAST_NOISE), ids, size)


def _floor(strength: np.ndarray) -> tuple[float, float]:
    """Strength of the background and its noise, from differences of neighbours in a few rows."""
    rows = np.ascontiguousarray(strength[:: max(len(strength) // 60, 1)])
    noise = MEDIANS.sd_per_absolute / np.sqrt(2.0) * float(np.median(np.abs(np.diff(rows, axis=1))))
    return float(np.median(rows)), max(noise, _EIGHT_BIT)


@njit(cache=True, nogil=True)
def _centres(
    strength: np.ndarray,
    labels: np.ndarray,
    chosen: np.ndarray,
    boxes: np.ndarray,
    floor: float,
    noise: float,
) -> np.ndarray:
    """Centre of each patch by its strength above the ground around it: [n] good, x, y, standard deviation."""
    out = np.zeros((len(chosen), 4))
    height, width = strength.shape
    for i in range(len(chosen)):
        left, top, wide, high = boxes[i]
        if left < _RIM + 1 or top < _RIM + 1 or left + wide > width - _RIM - 1:
            continue
        if top + high > height - _RIM - 1 or not _is_round(labels, chosen[i], boxes[i]):
            continue
        x0, x1, y0, y1 = left - _RIM, left + wide + _RIM, top - _RIM, top + high + _RIM
        ground, clear = _ground(strength, labels, chosen[i], x0 - 1, x1 + 1, y0 - 1, y1 + 1, floor)
        if not clear:
            continue
        total, mx, my = 0.0, 0.0, 0.0
        for y in range(y0, y1):
            for x in range(x0, x1):
                if _counts(labels, chosen[i], x, y):
                    part = strength[y, x] - ground
                    total += part
                    mx += part * x
                    my += part * y
        mx, my = mx / total, my / total
        spread = 0.0
        for y in range(y0, y1):
            for x in range(x0, x1):
                if _counts(labels, chosen[i], x, y):
                    spread += (x - mx) ** 2 + (y - my) ** 2
        # the noise of every pixel that counts moves the centre; docs/model.md (134)
        out[i] = (1.0, mx, my, noise * np.sqrt(0.5 * spread) / total)
    return out


@njit(cache=True, nogil=True)
def _counts(labels: np.ndarray, label: int, x: int, y: int) -> bool:
    """Whether a pixel is of a patch, or within its rim."""
    for j in range(max(y - _RIM, 0), min(y + _RIM + 1, labels.shape[0])):
        for i in range(max(x - _RIM, 0), min(x + _RIM + 1, labels.shape[1])):
            if labels[j, i] == label:
                return True
    return False


@njit(cache=True, nogil=True)
def _ground(
    strength: np.ndarray, labels: np.ndarray, label: int, x0: int, x1: int, y0: int, y1: int, floor: float
) -> tuple[float, bool]:
    """Strength just outside the rim of a patch, and whether no other patch reaches into the rim."""
    total, count = 0.0, 0
    for y in range(y0, y1):
        for x in range(x0, x1):
            inside = _counts(labels, label, x, y)
            if labels[y, x] != 0 and labels[y, x] != label:
                if inside:
                    return floor, False
            elif not inside and not _beside_other(labels, label, x, y):
                total += strength[y, x]
                count += 1
    return (total / count if count else floor), True


@njit(cache=True, nogil=True)
def _beside_other(labels: np.ndarray, label: int, x: int, y: int) -> bool:
    """Whether a pixel is next to another patch."""
    for j in range(max(y - 1, 0), min(y + 2, labels.shape[0])):
        for i in range(max(x - 1, 0), min(x + 2, labels.shape[1])):
            if labels[j, i] != 0 and labels[j, i] != label:
                return True
    return False


@njit(cache=True, nogil=True)
def _is_round(labels: np.ndarray, label: int, box: np.ndarray) -> bool:
    """Whether a patch fills the ellipse with its moments, as a whole disc does and a part of one does not."""
    left, top, wide, high = box
    n, mx, my, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for y in range(top, top + high):
        for x in range(left, left + wide):
            if labels[y, x] == label:
                n += 1.0
                mx += x
                my += y
                xx += x * x
                xy += x * y
                yy += y * y
    mx, my = mx / n, my / n
    xx, xy, yy = xx / n - mx * mx + 1 / 12, xy / n - mx * my, yy / n - my * my + 1 / 12
    area = xx * yy - xy * xy
    half, half_difference = 0.5 * (xx + yy), np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
    filled = n / (4.0 * np.pi * np.sqrt(max(area, 1e-12)))
    return _ROUND[0] < filled < _ROUND[1] and half - half_difference > _SLIM * (half + half_difference)

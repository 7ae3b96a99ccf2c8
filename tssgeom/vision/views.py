"""Sightings: markers in one image, and those of all cameras at one time as directions with their weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.vision.cameras import Camera, sight
from tssgeom.vision.triangulation import weights


@dataclass(frozen=True, slots=True)
class Sightings:
    """Markers in one image."""

    pixels: np.ndarray
    """Pixels of each marker: its centre, or the corners of a tag, [n, k, 2] [px]."""
    noise: Vector
    """Standard deviation of one of their coordinates, as estimated from the image [n] [px]."""
    ids: np.ndarray
    """Number on each tag, -1 for a blob [n]."""
    size: Vector
    """Area in the image [n] [px²]."""

    @property
    def centre(self) -> Matrix:
        """Middle of each marker [n, 2] [px]."""
        return self.pixels.mean(axis=1)

    def __len__(self) -> int:
        return len(self.noise)


def nothing(corners: int) -> Sightings:
    """Return the sightings of a missing image."""
    return Sightings(np.zeros((0, corners, 2)), np.zeros(0), np.zeros(0, np.int64), np.zeros(0))


@dataclass(frozen=True, slots=True)
class ViewSet:
    """Sightings of all cameras at one time, with their directions."""

    sightings: tuple[Sightings, ...]
    """One for each camera."""
    slope: tuple[np.ndarray, ...]
    """Directions of sight, for each camera [n, k, 2]."""
    weight: tuple[np.ndarray, ...]
    """Their inverse covariances [n, k, 2, 2]."""


@dataclass(frozen=True, slots=True)
class Located:
    """The markers of one frame, in the order of the route."""

    points: Points
    """A row of NaN for a marker that was not located [n, 3] [m]."""
    covariance: np.ndarray
    """[n, 3, 3] [m²]."""
    square: Vector
    """Sum of squared, weighted reprojection errors of a marker; NaN where it is not located [n]."""
    freedom: Vector
    """Degrees of freedom of `square`, 0 where one camera locates it [n]."""
    which: np.ndarray
    """The sighting of each camera that the marker comes from, -1 for none [n, v]."""


def view_set_of(cameras: Sequence[Camera], sightings: Sequence[Sightings]) -> ViewSet:
    """Turn pixels into directions."""
    slopes, inverse_covariances = [], []
    for camera, one in zip(cameras, sightings, strict=True):
        corners = one.pixels.shape[1]
        slope, by_pixel = sight(camera, one.pixels.reshape(-1, 2))
        slopes.append(slope.reshape(-1, corners, 2))
        inverse_covariances.append(
            weights(by_pixel, np.repeat(one.noise, corners)).reshape(-1, corners, 2, 2)
        )
    return ViewSet(tuple(sightings), tuple(slopes), tuple(inverse_covariances))


def nowhere(count: int, views: int) -> Located:
    """Return what is known of a frame in which nothing was recognised."""
    unknown = np.full(count, np.nan)
    return Located(
        np.full((count, 3), np.nan),
        np.full((count, 3, 3), np.nan),
        unknown,
        np.zeros(count),
        np.full((count, views), -1),
    )


def gathered(view_set: ViewSet, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions [v, n, k, 2] and weights [v, n, k, 2, 2] of chosen sightings [n, v], NaN for none."""
    count, views = which.shape
    corners = view_set.slope[0].shape[1]
    slope, weight = np.full((views, count, corners, 2), np.nan), np.zeros((views, count, corners, 2, 2))
    for v in range(views):
        here = which[:, v] >= 0
        slope[v, here], weight[v, here] = (
            view_set.slope[v][which[here, v]],
            view_set.weight[v][which[here, v]],
        )
    return slope, weight

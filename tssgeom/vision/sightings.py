"""Detections of one camera in one image: pixels of markers, how sharp they are, and what ids they have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Matrix, Vector


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

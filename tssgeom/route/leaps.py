"""Points that leapt alone, by how far they are from where they were expected; docs/model.md (156)."""

from __future__ import annotations

import numpy as np

from tssgeom import core
from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE
from tssgeom.route.directions import listed

FAR = CHANCE.never**2  # squared, over noise², the median of all and neighbours: when all move, none leapt


def leapt_points(distance: Vector) -> np.ndarray:
    """Return the points whose squared distance [n] [noise²] is great while that of most is not."""
    return np.flatnonzero(distance > FAR * max(1.0, core.median(distance)))


def alone(leapt: np.ndarray, distance: Vector, missing: Vector) -> np.ndarray:
    """Return those whose neighbours are where they were expected; the tip may move by itself."""
    inside = leapt[(leapt > 0) & (leapt < len(distance) - 1)]
    beside = np.where(missing > 0.0, np.inf, distance)
    nearest = np.maximum(beside[inside - 1], beside[inside + 1])
    return inside[distance[inside] > FAR * nearest]


def leap_warning(leapt: np.ndarray, coordinates: int) -> str:
    """Say which points or gratings leapt alone."""
    name = "point" if coordinates == 3 else "grating"
    several = f"{name}s {listed(leapt)} leapt" if len(leapt) > 1 else f"{name} {leapt[0]} leapt"
    return f"{several} while the others did not: taken for where the last frames had it"

"""Limits of the filter of points in time, and points that leapt alone; docs/model.md (156), (159)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tssgeom import core
from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE
from tssgeom.route.directions import counted


@dataclass(frozen=True, slots=True)
class FilterLimits:
    """When a filter begins anew, and which points it leaves out."""

    least_step: float = 0.1
    """Time that passes at least between two frames, and one over that after which the filter begins anew
    [usual steps]. Chosen: frames may come in bursts."""
    most_over_spatial: float = 4.0
    """Variance in time over that in one frame, which shows all noise of single points [1]. Chosen."""
    patience: int = 5
    """Frames in a row after which a point that leapt alone, or comes back, is used [1]. Chosen."""
    constant_share: float = 0.2
    """Least share of a stated variance that counts as constant in time [1]. Chosen: what changes is known to
    some 10 % after a few frames."""


FILTER = FilterLimits()
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
    several = f"{name}s {counted(leapt)} leapt" if len(leapt) > 1 else f"{name} {leapt[0]} leapt"
    return f"{several} while the others did not: taken for where the last frames had it"

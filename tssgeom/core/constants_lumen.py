"""Tuned numbers of the wall of a lumen."""

from typing import NamedTuple


class WallTolerance(NamedTuple):
    """When numbers of a wall differ by rounding alone."""

    same_point: float = 1e-7
    """Relative to the distance and to the side of a triangle. chosen: above the rounding of a foot."""
    smallest_distance: float = 1e-6
    """[m] Added to the distance, so that a point on the wall has a tolerance. chosen: 1 µm."""


WALL = WallTolerance()

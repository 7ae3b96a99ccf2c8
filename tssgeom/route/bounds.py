"""A curve through points is no shorter and turns no less than their polygon; docs/model.md (153)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Points, Vector
from tssgeom.core.constants import CHANCE, ROUNDING
from tssgeom.route.route import step_lengths


@dataclass(frozen=True, slots=True)
class BoundLimits:
    """What noise may explain."""

    small_noise: float = 0.3
    """Noise over the mean chord above which turns of the polygon bound nothing [1]. Chosen: chords then point
    anywhere."""


LIMITS = BoundLimits()

_RAYLEIGH = math.sqrt(
    0.5 * math.pi
)  # mean size of a plane vector over the standard deviation of its components


@dataclass(frozen=True, slots=True)
class Polygon:
    """The polygon through sensed points, and how noise changes it."""

    chord: Vector
    """Distances from point to point [m]."""
    turn: Vector
    """Angles between successive chords [rad]."""
    length_error: float
    """Standard deviation of the sum of the chords over that of a coordinate [1]."""
    angle_error: float
    """Standard deviation of the sum of the turns over that of a coordinate [1/m]."""

    def broken(self, length: float, angle: float, noise: float) -> str | None:
        """Say which bound a fit breaks, or return None.

        Parameters
        ----------
        length, angle
            Length [m] and accumulated angle [rad] of the fit.
        noise
            Standard deviation of a coordinate [m].
        """
        chords = float(self.chord.sum())
        noisy = 6.0 * noise**2 * len(self.chord) / max(float(self.chord @ self.chord), 1e-300)
        least = chords * math.sqrt(max(1.0 - noisy, 0.0)) * (1.0 - ROUNDING.relative)
        least -= CHANCE.clear * noise * self.length_error
        if length < least:
            return (
                f"the route is {1e3 * length:.5g} mm long, its points lie at least {1e3 * least:.5g} mm "
                "apart along it: check noise_mm, and check for outlying points"
            )
        inverse = 1.0 / self.chord
        turn_noise = np.sqrt(inverse[:-1] ** 2 + inverse[1:] ** 2 + (inverse[:-1] + inverse[1:]) ** 2)
        least = float(self.turn.sum()) * (1.0 - ROUNDING.relative) - _RAYLEIGH * noise * float(
            turn_noise.sum()
        )
        least -= CHANCE.clear * noise * self.angle_error
        if noise < LIMITS.small_noise * chords / len(self.chord) and angle < least:
            return (
                f"the route turns by {math.degrees(angle):.4g}°, the polygon through its points by at least "
                f"{math.degrees(least):.4g}°: check noise_mm, and check for outlying points"
            )
        return None


def polygon(points: Points, weight: Vector) -> Polygon:
    """Return the polygon through the points [n, 3] [m] that have a weight [n]."""
    used = points[weight > 0.0]
    size = np.maximum(step_lengths(used), 1e-300)
    unit = np.diff(used, axis=0) / size[:, None]
    before, after = unit[:-1], unit[1:]
    cosine = np.einsum("ij,ij->i", before, after)[:, None]
    aside = after - cosine * before
    sine = np.maximum(np.sqrt(np.einsum("ij,ij->i", aside, aside)), 1e-12)[:, None]
    # how the turns change with the directions of the chords, and these with the points
    of_before = -aside / sine / size[:-1, None]
    of_after = (cosine * after - before) / sine / size[1:, None]
    of_points = np.zeros_like(used)
    of_points[:-2] -= of_before
    of_points[1:-1] += of_before - of_after
    of_points[2:] += of_after
    return Polygon(
        chord=size,
        turn=np.arctan2(sine, cosine)[:, 0],
        length_error=math.sqrt(2.0 + float(np.sum((after - before) ** 2))),
        angle_error=float(np.sqrt(np.sum(of_points**2))),
    )

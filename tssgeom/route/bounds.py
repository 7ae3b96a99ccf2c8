"""A curve through points is no shorter and turns no less than their polygon; docs/model.md (153), (307)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Points, Vector
from tssgeom.core.constants import CHANCE, ROUNDING
from tssgeom.route.observations import Shape
from tssgeom.route.route import step_lengths, stretched
from tssgeom.route.route_fit import RouteFit


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
    directions_angle: float
    """Sum of the angles between successive directions [rad], less what their noise adds; 0 without any."""

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
        if angle < self.directions_angle:
            return (
                f"the route turns by {math.degrees(angle):.4g}°, the directions of its sensors by at least "
                f"{math.degrees(self.directions_angle):.4g}°: check direction_noise_deg, and their order"
            )
        return None


def polygon_of(shape: Shape, weight: Vector) -> Polygon:
    """Return the polygon through the points of a shape that have a weight [n], and its directions; (307)."""
    through = polygon(shape.points, weight)
    if shape.directions is None:
        return through
    turns, change = _turns(shape.directions[(weight > 0.0) & np.isfinite(shape.directions[:, 0])])
    noise = _RAYLEIGH * math.sqrt(2.0) * len(turns) + CHANCE.clear * float(np.sqrt(np.sum(change**2)))
    return replace(through, directions_angle=float(turns.sum()) - noise * shape.direction_noise)


def polygon(points: Points, weight: Vector) -> Polygon:
    """Return the polygon through the points [n, 3] [m] that have a weight [n]."""
    used = points[weight > 0.0]
    size = np.maximum(step_lengths(used), 1e-300)
    unit = np.diff(used, axis=0) / size[:, None]
    turn, of_unit = _turns(unit)
    of_points = np.zeros_like(used)  # how the turns change with the chords, and these with the points
    of_points[:-1] -= of_unit / size[:, None]
    of_points[1:] += of_unit / size[:, None]
    return Polygon(
        chord=size,
        turn=turn,
        length_error=math.sqrt(2.0 + float(np.sum(np.diff(unit, axis=0) ** 2))),
        angle_error=float(np.sqrt(np.sum(of_points**2))),
        directions_angle=0.0,
    )


def _turns(unit: Points) -> tuple[Vector, Points]:
    """Return the angles [n − 1] between successive directions [n, 3], and how their sum changes with each."""
    before, after = unit[:-1], unit[1:]
    cosine = np.einsum("ij,ij->i", before, after)[:, None]
    aside = after - cosine * before
    sine = np.maximum(np.sqrt(np.einsum("ij,ij->i", aside, aside)), 1e-12)[:, None]
    change = np.zeros_like(unit)
    change[:-1] -= aside / sine
    change[1:] += (cosine * after - before) / sine
    return np.arctan2(sine, cosine)[:, 0], change


def within_bounds(fit: RouteFit, shape: Shape) -> RouteFit:
    """Return a fit, with a warning where it is shorter or turns less than the polygon through its points.

    Many points also show where known stations lie farther apart than they: Φ would be too great as well.
    """
    through = polygon_of(shape, fit.weight)
    broken = through.broken(fit.arcs.total_length, fit.arcs.total_angle, fit.noise)
    fit = fit if broken is None else fit.warned(broken)
    if shape.stations is None or fit.spline is None or shape.is_of_few:
        return fit
    apart = stretched(fit.spline.route)
    return fit if apart is None else fit.warned(apart)

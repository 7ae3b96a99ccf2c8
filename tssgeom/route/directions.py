"""Tangent directions that are sensed beside the points, as by coils with six degrees of freedom."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Points, Vector
from tssgeom.errors import ShapeError
from tssgeom.plausibility.limits import LIMITS


@dataclass(frozen=True, slots=True)
class DirectionNoisePrior:
    """What is known beforehand of a noise that is to be estimated."""

    typical: float = 0.02
    """Standard deviation of a component [rad]. Chosen: magnetic trackers have 0.005 to 0.05."""
    values: float = 4.0
    """Residuals that it is worth, as is the noise of the first fit in a filter in time. Chosen: two sensors
    outweigh it; too small a noise does more harm."""


NOISE_PRIOR = DirectionNoisePrior()


def estimated_noise(directions: Points, tangent: Points, parameters: float) -> float:
    """Return the standard deviation of a component of sensed directions, from a fit to them [rad]; (170).

    Parameters
    ----------
    directions, tangent
        Unit vectors as sensed, a row of NaN where none was, and tangents of the fit there [n, 3].
    parameters
        Parameters of the fit that the directions determined [1].
    """
    off = directions - tangent
    off = off[~np.isnan(off).any(axis=1)]
    values = max(2.0 * len(off) - parameters, 0.0)
    square = NOISE_PRIOR.values * NOISE_PRIOR.typical**2 + float(np.sum(off**2))
    return float(np.sqrt(square / (NOISE_PRIOR.values + values)))


def checked_directions(directions: Points, points: Points) -> tuple[Points, tuple[str, ...]]:
    """Return unit tangents [n, 3] at the points [n, 3], rows of NaN where none can be used, and warnings.

    Raises ShapeError where there is not one row for each point, where a row is no unit vector, or where they
    run backwards.
    """
    return _along_route(unit_directions(directions, points), points)


def unit_directions(directions: Points, points: Points) -> Points:
    """Return sensed directions as unit vectors, a row of NaN where none was sensed [n, 3].

    Raises ShapeError where there is not one row for each point, or where a row is no unit vector.
    """
    d = np.array(directions, dtype=np.float64)
    if d.shape != points.shape:
        raise ShapeError(f"directions have shape {d.shape} for {len(points)} points: give one row for each")
    size = np.linalg.norm(d, axis=1)
    wrong = np.flatnonzero(np.abs(size - 1.0) > LIMITS.slight)
    if wrong.size:
        raise ShapeError(
            f"direction {wrong[0]} has length {size[wrong[0]]:.3g}: "
            "give unit vectors, and NaN where none was sensed"
        )
    return d / size[:, None]


def _along_route(d: Points, points: Points) -> tuple[Points, tuple[str, ...]]:
    cosine = _cosine_to_chord(d, points)
    sensed = np.isfinite(cosine)
    if sensed.any() and cosine[sensed].mean() < 0.0:
        raise ShapeError("directions point from the distal to the proximal end: turn them round")
    against = np.flatnonzero(sensed & (cosine < 0.0))
    if not against.size:
        return d, ()
    d[against] = np.nan
    return d, (f"{len(against)} directions run against the route, left out {counted(against)}",)


def _cosine_to_chord(d: Points, points: Points) -> Vector:
    """Cosine of each direction to the chord between the observed neighbours, NaN where there is none."""
    cosine = np.full(len(d), np.nan)
    rows = np.flatnonzero(~np.isnan(points).any(axis=1))
    if len(rows) > 1:
        p = points[rows]
        chord = np.concatenate((p[1:], p[-1:])) - np.concatenate((p[:1], p[:-1]))
        cosine[rows] = np.einsum("ij,ij->i", d[rows], chord) / (np.linalg.norm(chord, axis=1) + 1e-300)
    return cosine


def counted(which: np.ndarray) -> str:
    """Name the first few of some points, by their count in the sensed sequence."""
    return f"(count from 0: {', '.join(str(i) for i in which[:5])}{', ...' if len(which) > 5 else ''})"


def tangent_variances(tangents: Points, known: float, slid: Vector) -> Vector:
    """Variance of each direction across the route [rad²], 0 where none was sensed; docs/model.md (91).

    Parameters
    ----------
    tangents
        Unit tangents, rows of NaN where none was sensed [n, 3].
    known
        Variance of a component [rad²].
    slid
        What an unknown station adds, κ²σ² [rad²].
    """
    return np.where(np.isnan(tangents[:, 0]), 0.0, known + slid)


def direction_warnings(sensed: Points | None, used: Points | None, index: Vector) -> tuple[str, ...]:
    """Name the sensed directions that a fit left out."""
    if sensed is None or used is None:
        return ()
    outliers = index[np.isnan(used[:, 0]) & ~np.isnan(sensed[:, 0])].astype(int)
    if not len(outliers):
        return ()
    return (f"{len(outliers)} directions stand off the route, ignored {counted(outliers)}",)

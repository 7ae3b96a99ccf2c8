"""Tangent directions that a sensor gives beside the points, as coils with six degrees of freedom do."""

from __future__ import annotations

import numpy as np

from tssgeom.arrays import Points, Vector
from tssgeom.errors import ShapeError

_OFF_UNIT = 0.05  # by which a direction may be longer or shorter than 1
_AGAINST = -0.5  # cosine to the chord of the neighbours below which a direction runs against the route


def checked_directions(directions: Points, points: Points) -> tuple[Points, tuple[str, ...]]:
    """Return unit tangents [n, 3] at the points [n, 3], rows of NaN where none can be used, and warnings.

    Raises
    ------
    ShapeError
        Where there is not one row for each point, where a row is no unit vector, or where they run
        backwards.
    """
    d = np.array(directions, dtype=np.float64)
    if d.shape != points.shape:
        raise ShapeError(f"directions have shape {d.shape} for {len(points)} points: give one row for each")
    size = np.linalg.norm(d, axis=1)
    wrong = np.flatnonzero(np.abs(size - 1.0) > _OFF_UNIT)
    if wrong.size:
        raise ShapeError(
            f"direction {wrong[0]} has length {size[wrong[0]]:.3g}: "
            "give unit vectors, and NaN where none was sensed"
        )
    return _along_route(d / size[:, None], points)


def _along_route(d: Points, points: Points) -> tuple[Points, tuple[str, ...]]:
    cosine = _cosine_to_chord(d, points)
    sensed = np.isfinite(cosine)
    if sensed.any() and cosine[sensed].mean() < 0.0:
        raise ShapeError("directions point from the distal to the proximal end: turn them round")
    against = np.flatnonzero(sensed & (cosine < _AGAINST))
    if not against.size:
        return d, ()
    d[against] = np.nan
    return d, (_left_out(against, "run against the route, left out"),)


def _cosine_to_chord(d: Points, points: Points) -> Vector:
    """Cosine of each direction to the chord between the observed neighbours, NaN where there is none."""
    cosine = np.full(len(d), np.nan)
    at = np.flatnonzero(~np.isnan(points).any(axis=1))
    if len(at) > 1:
        order = np.arange(len(at))
        chord = points[at[np.minimum(order + 1, len(at) - 1)]] - points[at[np.maximum(order - 1, 0)]]
        cosine[at] = np.einsum("ij,ij->i", d[at], chord) / (np.linalg.norm(chord, axis=1) + 1e-300)
    return cosine


def _left_out(which: np.ndarray, what: str) -> str:
    named = ", ".join(str(i) for i in which[:5]) + (", ..." if len(which) > 5 else "")
    return f"{len(which)} directions {what} (count from 0: {named})"


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
    left_out = index[np.isnan(used[:, 0]) & ~np.isnan(sensed[:, 0])].astype(int)
    return (_left_out(left_out, "stand off the route, ignored"),) if len(left_out) else ()

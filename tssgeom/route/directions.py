"""Tangent directions that a sensor tells beside the points, as coils with six degrees of freedom do."""

from __future__ import annotations

import math

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.errors import ShapeError
from tssgeom.route.stations import across

_OFF_UNIT = 0.05  # by which a direction may be longer or shorter than 1
_AGAINST = -0.5  # cosine to the chord of the neighbours below which a direction runs against the route
_BEYOND = 16.0  # squared standard deviations, with 2 ln n added, beyond which a direction is an outlier
_TURN_SHARE = 0.5  # of the turn from point to point: what a jump of curvature alone can turn
_MOST_STRAY = 0.1  # of all directions


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
    """Cosine of each direction to the chord between the seen neighbours, NaN where there is none."""
    cosine = np.full(len(d), np.nan)
    seen = np.flatnonzero(~np.isnan(points).any(axis=1))
    if len(seen) > 1:
        order = np.arange(len(seen))
        chord = points[seen[np.minimum(order + 1, len(seen) - 1)]] - points[seen[np.maximum(order - 1, 0)]]
        cosine[seen] = np.einsum("ij,ij->i", d[seen], chord) / (np.linalg.norm(chord, axis=1) + 1e-300)
    return cosine


def _left_out(which: np.ndarray, what: str) -> str:
    named = ", ".join(str(i) for i in which[:5]) + (", ..." if len(which) > 5 else "")
    return f"{len(which)} directions {what} (count from 0: {named})"


def variances(aim: Points, known: float, slid: Vector) -> Vector:
    """Variance of each direction across the route [rad²], 0 where none was sensed; docs/model.md (91).

    Parameters
    ----------
    aim
        Unit tangents, rows of NaN where none was sensed [n, 3].
    known
        Variance of a component [rad²].
    slid
        What an unknown station adds, κ²σ² [rad²].
    """
    return np.where(np.isnan(aim[:, 0]), 0.0, known + slid)


def stray_direction(aim: Points, blur: Vector, u: Vector, mean: Matrix, spread: Vector) -> int:
    """Return the direction that a fit explains least, if beyond chance and a jump of curvature, or -1.

    Parameters
    ----------
    aim, blur
        Directions [n, 3] and their variances, 0 where none was sensed [n].
    u, mean, spread
        Stations [n] and states [n, 3, 4] of the fit, and the variance of a component of its tangents [n].
    """
    used = np.flatnonzero(blur > 0.0)
    if not used.size:
        return -1
    speed = np.maximum(np.linalg.norm(mean[:, :, 1], axis=1), 1e-12)
    tangent = mean[:, :, 1] / speed[:, None]
    bend = np.linalg.norm(across(mean[:, :, 2], tangent), axis=1) / speed**2
    turn = _TURN_SHARE * float(np.max(bend * np.gradient(u)))
    ahead = np.einsum("ij,ij->i", aim[used], tangent[used])
    off = np.where(ahead > 0.0, np.maximum(1.0 - ahead**2, 0.0), 4.0)
    own = np.maximum(1.0 - spread[used] / blur[used], 1e-3)
    beyond = off / (blur[used] * own * (_BEYOND + 2.0 * math.log(len(used))))
    beyond = np.where(np.sqrt(off) / own > turn, beyond, 0.0)
    worst = int(np.argmax(beyond))
    return int(used[worst]) if beyond[worst] > 1.0 else -1


def may_drop(aim: Points | None, sensed: Points | None) -> bool:
    """Whether one more of the sensed directions may be left out of those in use."""
    if aim is None or sensed is None:
        return False
    told = int(np.count_nonzero(~np.isnan(sensed[:, 0])))
    gone = told - int(np.count_nonzero(~np.isnan(aim[:, 0])))
    return gone + 1 <= max(_MOST_STRAY * told, 1.0)


def direction_warnings(sensed: Points | None, aim: Points | None, index: Vector) -> tuple[str, ...]:
    """Name the sensed directions that a fit left out."""
    if sensed is None or aim is None:
        return ()
    gone = index[np.isnan(aim[:, 0]) & ~np.isnan(sensed[:, 0])].astype(int)
    return (_left_out(gone, "stand off the route, ignored"),) if len(gone) else ()

"""Where the names of both ends of a route stand on a picture: off the route, each nearest to its own end."""

from __future__ import annotations

import numpy as np

from tssgeom.arrays import Matrix, Vector

ENDS = "proximal", "distal"
CLEAR = 4.0
"""Least distance of a name from the route [pt, px]; as all numbers here chosen by eye."""
_DISTANCES, _DIRECTIONS = (0.5, 8.0, 18.0), 16
"""Distances of a name from its end beyond the least, the best first [pt, px], and number of directions."""

_NOTHING = np.zeros((0, 2))


def end_names(
    line: Matrix, low: Vector, high: Vector, half: Vector, besides: Matrix = _NOTHING
) -> list[Vector]:
    """Choose the middles of the names of both ends.

    Parameters
    ----------
    line
        [n, 2] The route on the picture, up positive [pt, px].
    low, high
        [2] Corners of the part of the picture in which the names may stand [pt, px].
    half
        [2] Half of the size of a name [pt, px].
    besides
        [m, 2] What else no name may cover, such as letters [pt, px].
    """
    inner = min(8, len(line) - 1)
    turns = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    unit = np.column_stack([np.cos(turns), np.sin(turns)])
    reach = np.min((half + CLEAR) / np.maximum(np.abs(unit), 1e-9), axis=1)
    chosen = list[Vector]()
    for end, before, opposite in ((line[0], line[inner], line[-1]), (line[-1], line[-1 - inner], line[0])):
        outward = (end - before) / max(float(np.linalg.norm(end - before)), 1e-300)
        middles = np.concatenate([end + unit * (reach + d)[:, None] for d in _DISTANCES])
        covered = (np.abs(middles[:, None] - line) < half + CLEAR).all(axis=2).sum(axis=1)
        collides = [(np.abs(middles - other) < 2.0 * half + 2.0).all(axis=1) for other in chosen]
        collides += [(np.abs(middles - other) < half + CLEAR).all(axis=1) for other in besides]
        outside = ((middles < low + half) | (middles > high - half)).any(axis=1)
        turned = np.tile(1.0 - unit @ outward, len(_DISTANCES))
        far = np.repeat(np.arange(len(_DISTANCES)), len(unit))
        ambiguous = _off_box(opposite - middles, half) < 2.0 * _off_box(end - middles, half)
        cost = covered + 1e3 * (np.sum(collides, axis=0) + outside) + 30.0 * ambiguous
        cost += 0.1 * turned + 0.3 * far
        chosen.append(middles[int(np.argmin(cost))])
    return chosen


def _off_box(points: Matrix, half: Vector) -> Vector:
    """Return the distances of points [n, 2] from a box about the origin."""
    return np.linalg.norm(np.maximum(np.abs(points) - half, 0.0), axis=1)


def leader(end: Vector, middle: Vector, half: Vector) -> Matrix | None:
    """Return the ends [2, 2] of a line from a name to its end, where the name stands apart from it."""
    edge = middle + np.clip(end - middle, -half, half)
    return np.stack([edge, end]) if np.linalg.norm(end - edge) > 2.0 * CLEAR else None

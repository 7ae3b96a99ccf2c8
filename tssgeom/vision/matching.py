"""Which blob of one view is which of another, where one answer is left; docs/model.md (136)."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Points, Vector
from tssgeom.vision.cameras import Camera, Eyes, eyes
from tssgeom.vision.localisation import Alone, on_plane
from tssgeom.vision.triangulation import intersections
from tssgeom.vision.views import ViewSet


@dataclass(frozen=True, slots=True)
class Matches:
    """Possible points: which blob of each view they come from, -1 where a view does not see them."""

    blobs: np.ndarray
    """[m, v]."""
    points: Points
    """[m, 3] [m]."""
    square: Vector
    """Sum of squared, weighted reprojection errors [m]."""

    def take(self, chosen: np.ndarray) -> Matches:
        """Return some of them."""
        return Matches(self.blobs[chosen], self.points[chosen], self.square[chosen])


def matches_of(cameras: tuple[Camera, ...], view_set: ViewSet, gate: Vector, alone: Alone) -> Matches:
    """Return what the blobs of all cameras may be in space; one camera sees them on a plane."""
    first, *others = cameras
    if others:
        slopes, weights = [one[:, 0] for one in view_set.slope], [one[:, 0] for one in view_set.weight]
        return match(eyes(cameras), slopes, weights, gate)
    sightings = view_set.sightings[0]
    points, _ = on_plane(first, sightings.centre, sightings.noise, alone.plane or 0.0)
    kept = np.flatnonzero(np.isfinite(points).all(axis=1))
    return Matches(kept[:, None], points[kept], np.zeros(len(kept)))


def match(poses: Eyes, slopes: list[np.ndarray], weights: list[np.ndarray], gate: Vector) -> Matches:
    """Find every combination of blobs, one a view, whose rays meet.

    Parameters
    ----------
    poses
        Those of the cameras.
    slopes
        Directions of the blobs of each view [n, 2].
    weights
        Their inverse covariances [n, 2, 2].
    gate
        Largest square by the number of views.

    Returns
    -------
    Matches
        Combinations of as many views as agree, those with more views first, then by their square; a
        combination that is part of a larger one is left out.
    """
    most = max((len(slope) for slope in slopes), default=0)
    views = len(slopes)
    slope, weight = np.full((views, most, 2), np.nan), np.zeros((views, most, 2, 2))
    for v in range(views):
        slope[v, : len(slopes[v])], weight[v, : len(slopes[v])] = slopes[v], weights[v]
    rows = np.concatenate(
        [_pairs(poses, slope, weight, gate[2], a, b) for a, b in itertools.combinations(range(views), 2)]
    )
    points, square = _met(poses, slope, weight, rows)
    meet = square <= gate[2]
    rows, points, square = rows[meet], points[meet], square[meet]
    for v in range(views) if views > 2 else ():  # the nearest blob of another view may join
        left = np.flatnonzero(rows[:, v] < 0)
        more = rows[left]
        more[:, v] = _nearest(poses.rotation[v], poses.shift[v], slope[v], points[left])
        position, q = _met(poses, slope, weight, more)
        agree = (more[:, v] >= 0) & (q <= gate[(more >= 0).sum(axis=1)])
        joined = left[agree]
        rows[joined], points[joined], square[joined] = more[agree], position[agree], q[agree]
    _, first = np.unique(rows, axis=0, return_index=True)
    all_of = Matches(rows, points, square).take(first)
    support = (all_of.blobs >= 0).sum(axis=1)
    ordered = all_of.take(np.lexsort((all_of.square, -support)))
    return ordered.take(_whole(ordered.blobs))


def _pairs(poses: Eyes, slope: np.ndarray, weight: np.ndarray, gate: float, a: int, b: int) -> np.ndarray:
    """Return pairs of blobs of two views, as near to epipolar lines as noise can bring them [k, v]."""
    turn = poses.rotation[b] @ poses.rotation[a].T
    move = poses.shift[b] - turn @ poses.shift[a]
    cross = np.array([[0.0, -move[2], move[1]], [move[2], 0.0, -move[0]], [-move[1], move[0], 0.0]])
    line = np.column_stack((slope[a], np.ones(len(slope[a])))) @ (cross @ turn).T
    off = line[:, :2] @ slope[b].T + line[:, 2:]
    least = np.minimum(weight[b, :, 0, 0], weight[b, :, 1, 1]) * off * off
    near = least <= 16.0 * gate * (line[:, :1] ** 2 + line[:, 1:2] ** 2)  # False for NaN, which is no blob
    i, j = np.nonzero(near)
    rows = np.full((len(i), len(slope)), -1)
    rows[:, a], rows[:, b] = i, j
    return rows


def _met(poses: Eyes, slope: np.ndarray, weight: np.ndarray, rows: np.ndarray) -> tuple[Points, Vector]:
    """Return where the rays of each combination of blobs meet, and the squares of what they miss."""
    view = np.arange(len(slope))[:, None]
    points, _, square = intersections(poses, slope[view, rows.T], weight[view, rows.T], rows.T >= 0)
    return points, square


def _nearest(rotation: np.ndarray, shift: np.ndarray, slope: np.ndarray, points: Points) -> np.ndarray:
    """Return the blob of a view that is nearest to the projection of each point, -1 where there is none."""
    p = points @ rotation.T + shift
    in_front = p[:, 2] > 0.0
    at = p[:, :2] / np.where(in_front, p[:, 2], 1.0)[:, None]
    far = np.nan_to_num(((slope - at[:, None]) ** 2).sum(axis=2), nan=np.inf)
    return np.where(in_front & np.isfinite(far).any(axis=1), far.argmin(axis=1), -1)


def _whole(blobs: np.ndarray) -> np.ndarray:
    """Mark each combination that is no part of one before it."""
    part = ((blobs[:, None] < 0) | (blobs[:, None] == blobs)).all(axis=2)
    return ~np.tril(part, -1).any(axis=1)


def clash(blobs: np.ndarray) -> np.ndarray:
    """Which combinations share a blob, so that at most one of them is true [m, m] bool."""
    same = (blobs[:, None] == blobs[None]) & (blobs[:, None] >= 0)
    return same.any(axis=2) & ~np.eye(len(blobs), dtype=np.bool_)


def sure(candidates: Matches) -> tuple[np.ndarray, np.ndarray]:
    """Split combinations into consistent ones and those that are left open.

    A combination is sure where none that shares a blob with it has as many views. Taking it rules those out,
    which may make others sure.

    Returns
    -------
    tuple of ndarray
        Indices of the sure ones, and of the open ones.
    """
    support = (candidates.blobs >= 0).sum(axis=1)
    conflicting = clash(candidates.blobs)
    alive, taken = np.ones(len(support), np.bool_), np.zeros(len(support), np.bool_)
    while True:
        strong = conflicting & alive[None] & (support[None] >= support[:, None])
        now = alive & ~taken & ~strong.any(axis=1)
        if not now.any():
            return np.flatnonzero(taken), np.flatnonzero(alive & ~taken)
        taken |= now
        alive &= ~(conflicting & now[None]).any(axis=1)

"""Which blob of one view is which of another, where one answer is left; docs/model.md (136)."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from tssgeom.arrays import Points, Vector
from tssgeom.vision.cameras import Camera, Eyes, eyes
from tssgeom.vision.localisation import Alone
from tssgeom.vision.single_view import on_plane
from tssgeom.vision.triangulation import intersection
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
    candidates = [
        _pairs(poses.rotation, poses.shift, slope, weight, gate, a, b)
        for a, b in itertools.combinations(range(views), 2)
    ]
    rows = np.concatenate([rows for rows, _, _ in candidates])
    points = np.concatenate([points for _, points, _ in candidates])
    square = np.concatenate([square for _, _, square in candidates])
    _, first = np.unique(rows, axis=0, return_index=True)
    all_of = Matches(rows, points, square).take(first)
    support = (all_of.blobs >= 0).sum(axis=1)
    ordered = all_of.take(np.lexsort((all_of.square, -support)))
    return ordered.take(_whole(ordered.blobs))


@njit(cache=True, nogil=True)
def _pairs(
    rotation: np.ndarray,
    shift: np.ndarray,
    slope: np.ndarray,
    weight: np.ndarray,
    gate: np.ndarray,
    a: int,
    b: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of blobs of two views whose rays meet, each with the blobs of other views that join them."""
    views, most = slope.shape[0], slope.shape[1]
    rows = np.full((most * most, views), -1)
    points, squares = np.empty((most * most, 3)), np.empty(most * most)
    visible, trial, count = np.zeros(views, np.bool_), np.empty((views, 2)), 0
    chosen_weight = np.zeros((views, 2, 2))
    turn = rotation[b] @ rotation[a].T
    move = shift[b] - turn @ shift[a]
    cross = np.array([[0.0, -move[2], move[1]], [move[2], 0.0, -move[0]], [-move[1], move[0], 0.0]])
    essential = cross @ turn
    for i in range(most):
        if not math.isfinite(slope[a, i, 0]):
            continue
        line = essential @ np.array([slope[a, i, 0], slope[a, i, 1], 1.0])
        for j in range(most):
            if not math.isfinite(slope[b, j, 0]) or _far_off(line, slope[b, j], weight[b, j], gate[2]):
                continue
            visible[:] = False
            visible[a] = visible[b] = True
            trial[a], trial[b] = slope[a, i], slope[b, j]
            chosen_weight[a], chosen_weight[b] = weight[a, i], weight[b, j]
            x, _, q = intersection(rotation, shift, trial, chosen_weight, visible)
            if not q <= gate[2]:
                continue
            rows[count, a], rows[count, b] = i, j
            agreeing = 2
            for v in range(views):
                if v in (a, b):
                    continue
                near = _nearest(rotation[v], shift[v], slope[v], x)
                if near < 0:
                    continue
                visible[v], trial[v], chosen_weight[v] = True, slope[v, near], weight[v, near]
                x1, _, q1 = intersection(rotation, shift, trial, chosen_weight, visible)
                if q1 <= gate[agreeing + 1]:
                    agreeing += 1
                    rows[count, v], x, q = near, x1, q1
                else:
                    visible[v] = False
            points[count], squares[count] = x, q
            count += 1
    return rows[:count], points[:count], squares[:count]


@njit(cache=True, nogil=True)
def _far_off(line: np.ndarray, slope: np.ndarray, weight: np.ndarray, gate: float) -> bool:
    """Whether a sight is farther off an epipolar line than noise in both views can bring it."""
    off = line[0] * slope[0] + line[1] * slope[1] + line[2]
    least = min(weight[0, 0], weight[1, 1]) * off * off
    return least > 16.0 * gate * (line[0] ** 2 + line[1] ** 2)


@njit(cache=True, nogil=True)
def _nearest(rotation: np.ndarray, shift: np.ndarray, slope: np.ndarray, x: np.ndarray) -> int:
    """Return the blob of a view that is nearest to the projection of a point, -1 where there is none."""
    p = rotation @ x + shift
    best, least = -1, math.inf
    if p[2] > 0.0:
        for k in range(len(slope)):
            far = (slope[k, 0] - p[0] / p[2]) ** 2 + (slope[k, 1] - p[1] / p[2]) ** 2
            if far < least:
                best, least = k, far
    return best


@njit(cache=True, nogil=True)
def _whole(blobs: np.ndarray) -> np.ndarray:
    """Mark each combination that is no part of one before it."""
    keep = np.ones(len(blobs), np.bool_)
    for i in range(len(blobs)):
        for j in range(i):
            if keep[j] and keep[i]:
                part = True
                for v in range(blobs.shape[1]):
                    part = part and (blobs[i, v] < 0 or blobs[i, v] == blobs[j, v])
                keep[i] = not part
    return keep


def clash(blobs: np.ndarray) -> np.ndarray:
    """Which combinations share a blob, so that at most one of them is true [m, m] bool."""
    same = (blobs[:, None] == blobs[None]) & (blobs[:, None] >= 0)
    return same.any(axis=2) & ~np.eye(len(blobs), dtype=np.bool_)


def sure(candidates: Matches) -> tuple[np.ndarray, np.ndarray]:
    """Split combinations into those that nothing speaks against and those that are left open.

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

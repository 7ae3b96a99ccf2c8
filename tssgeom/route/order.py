"""The order of markers that a tracker gives in one of its own: the shortest path; docs/model.md (332)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Matrix, Points
from tssgeom.errors import ShapeError


@dataclass(frozen=True, slots=True)
class OrderLimits:
    """When another order is proposed."""

    much_shorter: float = 1.4
    """Length of the path as given over the shortest one from which on it may be the wrong one [1]. Measured:
    5 to 40 points of routes of 0 to 13 rad have at most 1.36, where a helix comes near itself."""
    slightly_shorter: float = 1.04
    """The same where a fit has a warning or shows little of Φ [1]. Measured: 95 % of neighbours that were
    exchanged have at least 1.05, 90 % of routes at most 1.02."""
    most_sorted: int = 1000
    """Points that are put in order. Chosen: by the memory of their distances."""


LIMITS = OrderLimits()


def along_the_shortest_path(points: Points, directions: Points | None, first: Points | None) -> np.ndarray:
    """Return the indices of sensed points [n, 3] in the order of the shortest path, without missing ones.

    Parameters
    ----------
    points, directions
        Sensed points, a row of NaN for a missing one, and unit tangents at them.
    first
        Where the first point of the route was a moment ago [3] [m]; without it the path runs as the
        directions do, and without these it begins at the end that is earlier in the sequence.

    Raises
    ------
    ShapeError
        Where there are too many points.
    """
    used = np.flatnonzero(~np.isnan(points).any(axis=1))
    if len(used) > LIMITS.most_sorted:
        raise ShapeError(
            f"{len(used)} points are too many to be put in order: sort them, and leave [shape] order"
        )
    path = used[shortest_path(points[used])] if len(used) > 1 else used
    ends = points[path[[0, -1]]] if len(path) else points[:0]
    if first is not None and len(path):
        away = np.linalg.norm(ends - first, axis=1)
        return path if away[0] <= away[1] else path[::-1].copy()
    if directions is not None and len(path):
        along = np.nansum(directions[path[:-1]] * np.diff(points[path], axis=0))
        return path if along >= 0.0 else path[::-1].copy()
    return path


def shortest_path(points: Points) -> np.ndarray:
    """Return the indices of points [n, 3] along the shortest path through all [n].

    It is the path of greedy edges, improved by turning parts of it round and by moving single points until
    neither helps (2-opt and or-opt). It begins at the end that is earlier in the sequence.
    """
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    path = _improved(_greedy(distance), distance)
    return path if path[0] < path[-1] else path[::-1].copy()


def _greedy(distance: Matrix) -> np.ndarray:
    """Join the nearest ends of paths until there is one."""
    n = len(distance)
    first, second = np.triu_indices(n, 1)
    paths, of = {i: [i] for i in range(n)}, list(range(n))
    for k in np.argsort(distance[first, second], kind="stable"):
        a, b = of[first[k]], of[second[k]]
        i, j = int(first[k]), int(second[k])
        if a == b or i not in (paths[a][0], paths[a][-1]) or j not in (paths[b][0], paths[b][-1]):
            continue
        left = paths[a] if paths[a][-1] == i else paths[a][::-1]
        right = paths.pop(b) if paths[b][0] == j else paths.pop(b)[::-1]
        paths[a] = left + right
        for one in right:
            of[one] = a
        if len(paths) == 1:
            break
    return np.array(next(iter(paths.values())))


def _improved(path: np.ndarray, distance: Matrix) -> np.ndarray:
    for _ in range(10 * len(path)):
        gain, better = max(_turned(path, distance), _moved(path, distance), key=lambda one: one[0])
        if gain <= 1e-12 * distance.max():
            break
        path = better
    return path


def _turned(path: np.ndarray, distance: Matrix) -> tuple[float, np.ndarray]:
    """Turn round the part of a path that shortens it most; an end has no edge beyond it."""
    d = distance[np.ix_(path, path)]
    n = len(path)
    before = np.concatenate(([0.0], np.diagonal(d, 1)))  # of the edge before each point
    after = np.append(np.diagonal(d, 1), 0.0)
    left, right = np.zeros((n, n)), np.zeros((n, n))
    left[1:, :] = d[:-1, :]  # from the point before i to j
    right[:, :-1] = d[:, 1:]  # from i to the point after j
    gain = np.triu(before[:, None] + after[None, :] - left - right, 1)
    i, j = divmod(int(np.argmax(gain)), n)
    better = path.copy()
    better[i : j + 1] = path[i : j + 1][::-1]
    return float(gain[i, j]), better


def _moved(path: np.ndarray, distance: Matrix) -> tuple[float, np.ndarray]:
    """Move the point that shortens a path most to where it does."""
    n, best = len(path), (0.0, path)
    length = float(distance[path[:-1], path[1:]].sum())
    for i in range(n):
        rest = np.delete(path, i)
        without = float(distance[rest[:-1], rest[1:]].sum())
        to = distance[path[i], rest]
        added = np.concatenate(([to[0]], to[:-1] + to[1:] - distance[rest[:-1], rest[1:]], [to[-1]]))
        k = int(np.argmin(added))
        gain = length - without - float(added[k])
        if gain > best[0]:
            best = gain, np.insert(rest, k, path[i])
    return best

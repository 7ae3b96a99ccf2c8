"""The order of markers that a tracker gives in one of its own: the shortest path; docs/model.md (332)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector, rows_at
from tssgeom.core.constants_arcs import CHAIN_FIT
from tssgeom.core.constants_route import POINTS
from tssgeom.errors import FitError, ShapeError
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.route.observations import BACK, Shape
from tssgeom.route.route import STATIONS, step_lengths
from tssgeom.route.route_fit import LITTLE, RouteFit


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
_COMPARED = 41  # points of both ways; numerical
_PATH = "the path through the points is"


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


def order_warning(points: Points, index: Vector | None = None, *, is_uncertain: bool = False) -> str | None:
    """Say that points [n, 3] [m] lie on a much shorter path in another order, or return None.

    Parameters
    ----------
    points, index
        Points, and the count of each in the sensed sequence.
    is_uncertain
        Whether their fit has a warning, or shows little of Φ: a slightly shorter path is then worth a word.

    Raises
    ------
    FitError
        Where the other path is so much shorter that no fit means anything.
    """
    if not 4 <= len(points) <= POINTS.few:
        return None
    path = shortest_path(points)
    given, shortest = float(step_lengths(points).sum()), float(step_lengths(points[path]).sum())
    if given < (LIMITS.slightly_shorter if is_uncertain else LIMITS.much_shorter) * shortest:
        return None
    order = _described(path, np.arange(len(points)) if index is None else index.astype(int))
    text = f"{_PATH} {1e3 * given:.4g} mm long, {order} {1e3 * shortest:.4g} mm: check their order, "
    if given < STATIONS.refusal * shortest:
        return f'{text}or set [shape] order = "shortest"'
    raise FitError(f'{text}set [shape] order = "shortest", or give their arc lengths if it is right')


def with_order_warning(fit: RouteFit, shape: Shape, before: RouteFit | None = None) -> RouteFit:
    """Return a fit with `order_warning`; one that goes on from `before` where that has it, or turns back.

    A new fit may have the warning of `there_and_back` instead.

    Raises FitError where the points are far out of order.
    """
    if shape.stations is not None:
        return fit
    turns_back = _turns_back(shape.points) or any(BACK in text for text in fit.warnings)
    had_it = before is None or any(text.startswith(_PATH) for text in before.warnings)
    if not (had_it or turns_back):
        return fit
    is_uncertain = turns_back or len(fit.warnings) > 0 or fit.arcs.total_angle_se > LITTLE
    text = there_and_back(shape.points) if before is None else None
    text = text or order_warning(shape.points, shape.index, is_uncertain=is_uncertain)
    return fit if text is None else fit.warned(text)


def _turns_back(points: Points) -> bool:
    """Whether few points [n, 3] turn so sharply from chord to chord as exchanged ones do."""
    if len(points) > POINTS.few:
        return False
    chord = np.diff(points, axis=0)
    along = np.einsum("ij,ij->i", chord[1:], chord[:-1])
    square = np.einsum("ij,ij->i", chord, chord)
    sharpest = math.cos(CHAIN_FIT.most_turn)
    return bool((along < sharpest * np.sqrt(square[1:] * square[:-1])).any())


def there_and_back(points: Points) -> str | None:
    """Say that points [n, 3] [m] run along one route there and back, or return None."""
    at = np.concatenate(([0.0], np.cumsum(step_lengths(points))))
    share = np.linspace(0.0, 0.5, _COMPARED)
    there, back = (rows_at(way * at[-1], at, points) for way in (share, 1.0 - share))
    if float(np.median(np.linalg.norm(there - back, axis=1))) > PLAUSIBLE.slight * 0.5 * at[-1]:
        return None
    return "the points run there and back: give either way as a shape to analyse --same if it is one route"


def _described(path: np.ndarray, index: np.ndarray) -> str:
    """Name what a path exchanges, or else its first points: "with points 3 and 4 exchanged"."""
    moved = np.flatnonzero(path != np.arange(len(path)))
    if len(moved) == 2:  # of more it is not clear which goes where
        return f"with points {' and '.join(map(str, index[moved]))} exchanged"
    listed = index[path]
    return f"in the order {' '.join(map(str, listed if len(path) <= 12 else (*listed[:3], '…')))}"


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

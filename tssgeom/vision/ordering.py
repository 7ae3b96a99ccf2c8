"""The order of nameless markers along a sheath: the one chain that links neighbours; docs/model.md (138)."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from tssgeom.arrays import Points
from tssgeom.errors import ShapeError

FEWEST = 4
_LONGEST = 4.6  # median links: a longer one has many markers missing, or joins what does not belong
_FEWEST_TOGETHER = 3
_ALTERNATIVE = 1.15  # another chain less than this longer is as likely
_ROUNDS = 50


def chained(points: Points) -> np.ndarray:
    """Order points along one chain, either end first.

    Parameters
    ----------
    points
        Positions of the markers in any order [n, 3] [m].

    Returns
    -------
    ndarray
        Indices of the points from one end to the other.

    Raises
    ------
    ShapeError
        Where there are too few points, or where more than one chain is likely.
    """
    if len(points) < FEWEST:
        raise ShapeError(f"{len(points)} markers: a route needs at least {FEWEST}")
    distance = cdist(points, points)
    order = _shortened(_linked(distance), distance)
    _refuse_unclear(order, distance)
    return order


def belonging(points: Points, reach: float) -> np.ndarray:
    """Mark the points that have at least two others around; a lone point far off is none of the markers.

    Parameters
    ----------
    points
        Positions [n, 3] [m].
    reach
        Distance within which the next marker lies [m].
    """
    if len(points) < FEWEST:
        return np.ones(len(points), np.bool_)
    near = csr_array(cdist(points, points) <= reach)
    _, group = connected_components(near, directed=False)
    return np.bincount(group)[group] >= _FEWEST_TOGETHER


def _linked(distance: np.ndarray) -> np.ndarray:
    """Link the nearest first, no point more than twice and without a ring."""
    n = len(distance)
    i, j = np.triu_indices(n, 1)
    links: list[list[int]] = [[] for _ in range(n)]
    group = list(range(n))
    for k in np.argsort(distance[i, j], kind="stable"):
        a, b = int(i[k]), int(j[k])
        if len(links[a]) < 2 and len(links[b]) < 2 and group[a] != group[b]:
            links[a].append(b)
            links[b].append(a)
            old, new = group[b], group[a]
            group = [new if one == old else one for one in group]
    order, before = [next(k for k in range(n) if len(links[k]) == 1)], -1
    while len(order) < n:
        here = order[-1]
        order.append(next(one for one in links[here] if one != before))
        before = here
    return np.array(order)


def _shortened(order: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Turn stretches of the chain round as long as that makes it shorter."""
    for _ in range(_ROUNDS):
        gain, i, j = _best_turn(order, distance)
        if gain <= 1e-12:
            break
        order = np.concatenate((order[:i], order[i : j + 1][::-1], order[j + 1 :]))
    return order


def _best_turn(order: np.ndarray, distance: np.ndarray) -> tuple[float, int, int]:
    """Return the stretch i..j whose turning round shortens the chain most, and by how much."""
    n = len(order)
    i, j = np.triu_indices(n, 1)
    keep = ~((i == 0) & (j == n - 1))
    i, j = i[keep], j[keep]
    d = np.pad(distance[np.ix_(order, order)], ((1, 1), (1, 1)))  # a link beyond an end costs nothing
    a, b = i + 1, j + 1
    gain = d[a - 1, a] + d[b, b + 1] - d[a - 1, b] - d[a, b + 1]
    best = int(np.argmax(gain))
    return float(gain[best]), int(i[best]), int(j[best])


def _refuse_unclear(order: np.ndarray, distance: np.ndarray) -> None:
    links = distance[order[:-1], order[1:]]
    usual, longest = float(np.median(links)), float(links.max())
    if longest > _LONGEST * usual:
        raise ShapeError(
            f"the markers make no one chain: {1e3 * longest:.1f} mm between two of them, usual are "
            f"{1e3 * usual:.1f} mm; mend the view of the missing ones, or use tags with numbers"
        )
    gain, _, _ = _best_turn(order, distance)
    if -gain < (_ALTERNATIVE - 1.0) * usual:
        raise ShapeError(
            f"the order of the markers is unclear: another chain is only {-1e3 * gain:.2f} mm longer, with "
            f"{1e3 * usual:.1f} mm from marker to marker; set them closer together, or use tags with numbers"
        )

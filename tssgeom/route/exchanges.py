"""Points that are exchanged, detected by where they were expected; docs/model.md (325)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tssgeom import core
from tssgeom.arrays import Points, Vector
from tssgeom.core.constants import CHANCE
from tssgeom.route.route import step_lengths


@dataclass(frozen=True, slots=True)
class ExchangeLimits:
    """When points are exchanged."""

    share: float = 0.1
    """Squared distances of points that are put back, and the median of the others, over those as they came;
    and by how much the path is shorter in an order that is new, over what its points move [1]. Chosen."""


EXCHANGE = ExchangeLimits()


def order_of(points: Points, expected: Points, distance: Vector, far: np.ndarray) -> np.ndarray | None:
    """Return the row of each point [n] where some are exchanged, or None.

    Parameters
    ----------
    points, expected
        Points as they came, and where each was expected [n, 3] [m].
    distance
        Square of how far each is from there [n] [noise²].
    far
        Those that are six standard deviations from there, or farther.
    """
    between = points[far, None] - expected[None, far]
    square = np.einsum("ijc,ijc->ij", between, between)
    nearest = square.argmin(axis=1)
    cycles = _cycles(nearest)
    rest = np.delete(distance, far[[i for cycle in cycles for i in cycle]])
    if not (cycles and len(rest)):
        return None
    others, order = core.median(rest), np.arange(len(points))
    for cycle in cycles:
        came = distance[far[cycle]]
        back = came * square[cycle, nearest[cycle]] / square[cycle, cycle]
        is_near = back.max() < CHANCE.never**2 < (came - back).mean()
        if (is_near or back.sum() < EXCHANGE.share * came.sum()) and others < EXCHANGE.share * came.mean():
            order[far[nearest[cycle]]] = far[cycle]
    return None if (order[far] == far).all() else order


def _cycles(nearest: np.ndarray) -> list[list[int]]:
    """Return what goes round where each goes to another; two that go to the same one do not."""
    cycles, passed = list[list[int]](), set[int]()
    for first in range(len(nearest)):
        path = list[int]()
        here = first
        while here not in passed:
            passed.add(here)
            path.append(here)
            here = int(nearest[here])
        if here in path and len(cycle := path[path.index(here) :]) > 1:
            cycles.append(cycle)
    return cycles


def is_shorter(points: Points, other: Points) -> bool:
    """Whether the path through points [n, 3] is clearly shorter than that through them in another order."""
    used, then = (each[~np.isnan(each).any(axis=1)] for each in (points, other))
    moved = np.linalg.norm(np.nan_to_num(other - points), axis=1).sum()
    return float(step_lengths(then).sum() - step_lengths(used).sum()) > EXCHANGE.share * float(moved)


def named(order: np.ndarray) -> list[str]:
    """Name the points that are exchanged: "points 3 and 4"."""
    texts, listed = list[str](), np.flatnonzero(order >= 0)
    for cycle in _cycles(np.argsort(np.argsort(order[listed]))):
        *some, last = sorted(listed[cycle].tolist())
        texts.append(f"points {', '.join(map(str, some))} and {last}")
    return texts

"""Commands of machines within the force, the travel and the speed of their drives; docs/model.md (219)."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import combinations

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_tendon import SOLVER
from tssgeom.mechanism import DriveLimits

Pull = Callable[[Vector], float]
"""Returns the greatest proximal tension of drives that have some freedoms [N]."""


def within_limits(
    limits: DriveLimits, wanted: Vector, was: Vector, rows: Matrix, base: Vector, elapsed: float, pull: Pull
) -> tuple[Vector, str]:
    """Return the freedoms nearest to wanted ones that keep to the limits, and the names of what cuts them.

    Parameters
    ----------
    limits
        Of each drive.
    wanted, was
        [k] Freedoms as wanted, and where they were; k = 1 or 2.
    rows, base
        [n, k], [n] Positions of the drives are base + rows @ freedoms [m].
    elapsed
        Time since they were there [s].
    pull
        The tension that a drive may not exceed.

    Notes
    -----
    Force is cut along the way from where the drives were, travel and speed to the nearest point. What the
    drives have in common stays. Where limits contradict each other, speed counts most.
    """
    most = math.inf if limits.tension_N is None else limits.tension_N * (1.0 + ROUNDING.relative)
    cut, freedom = list[str](), wanted
    if most < math.inf and pull(wanted) > most:
        freedom = _bearable(wanted, was, most, pull)
        cut.append("tension_N")
    low, high = (np.full(len(rows), bound) for bound in limits.displacement_m or (-math.inf, math.inf))
    if not _inside(base + rows @ freedom, low, high):
        cut.append("displacement_m")
        freedom = _nearest(freedom, rows, base, low, high, freedom)
    if limits.speed_m_per_s is not None:
        now, reach = base + rows @ was, limits.speed_m_per_s * elapsed
        if not _inside(base + rows @ freedom, now - reach, now + reach):
            cut.append("speed_m_per_s")
            fast = _nearest(freedom, rows, base, now - reach, now + reach, was)
            both = (np.maximum(low, now - reach), np.minimum(high, now + reach))
            freedom = _nearest(freedom, rows, base, *both, fast)
    if (
        most is not None
        and cut
        and "tension_N" not in cut
        and pull(freedom) > most * (1.0 + ROUNDING.relative)
    ):
        cut.insert(0, "tension_N")
    return freedom, ", ".join(cut)


def _inside(positions: Vector, low: Vector | float, high: Vector | float) -> bool:
    return bool(((positions >= low - ROUNDING.relative) & (positions <= high + ROUNDING.relative)).all())


def _bearable(wanted: Vector, was: Vector, most: float, pull: Pull) -> Vector:
    """Return the freedoms on the way to wanted ones with which no drive pulls more than [N].

    Drives that pull more already go where they pull less.
    """
    if (before := pull(was)) > most:
        return wanted if pull(wanted) < before else was
    good, bad = was, wanted
    while np.abs(bad - good).max() > SOLVER.accepted:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if pull(middle) <= most else (good, middle)
    return good


def _nearest(
    wanted: Vector, rows: Matrix, base: Vector, low: Vector, high: Vector, without: Vector
) -> Vector:
    """Return the freedoms nearest to wanted ones outside of bounds [n], or `without` where there are none.

    They are on one bound or, of two freedoms, where two bounds meet.
    """
    ends = [(row, end - at) for row, at, *both in zip(rows, base, low, high, strict=True) for end in both]
    bounds = [(row, float(at)) for row, at in ends if math.isfinite(at)]
    points = [wanted + (at - row @ wanted) / (row @ row) * row for row, at in bounds]
    if len(wanted) > 1:
        for (one, at), (other, there) in combinations(bounds, 2):
            both = np.array([one, other])
            if abs(np.linalg.det(both)) > ROUNDING.relative * np.linalg.norm(one) * np.linalg.norm(other):
                points.append(np.linalg.solve(both, np.array([at, there])))
    inside = [each for each in points if _inside(base + rows @ each, low, high)]
    return min(inside, key=lambda each: float(np.linalg.norm(each - wanted)), default=without)

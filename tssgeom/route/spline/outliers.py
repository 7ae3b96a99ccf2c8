"""Points and directions that a fitted smooth curve does not explain."""

from __future__ import annotations

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_route import OUTLIERS
from tssgeom.route.outliers import outlier_limit
from tssgeom.route.route import across


def leaves_out_a_stretch(weight: Vector) -> bool:
    """Whether so many points side by side have no weight that they are a part of the route."""
    used = np.flatnonzero(weight)
    if len(used) < 2:
        return True
    at_end, within = max(used[0], len(weight) - 1 - used[-1]), int(np.diff(used).max()) - 1
    most_within = max(2 * OUTLIERS.longest_run, OUTLIERS.share * len(weight))
    return bool(at_end > OUTLIERS.longest_run or within > most_within)


def outlying_tangent(tangents: Points, variance: Vector, u: Vector, mean: Matrix, spread: Vector) -> int:
    """Return the sensed direction that a fit explains least, if beyond chance and a jump of curvature, or -1.

    Parameters
    ----------
    tangents, variance
        Directions [n, 3] and their variances, 0 where none was sensed [n].
    u, mean, spread
        Stations [n] and states [n, 3, 4] of the fit, and the variance of a component of its tangents [n].
    """
    used = np.flatnonzero(variance > 0.0)
    if not used.size:
        return -1
    speed = np.maximum(np.linalg.norm(mean[:, :, 1], axis=1), 1e-12)
    fitted = mean[:, :, 1] / speed[:, None]
    bend = np.linalg.norm(across(mean[:, :, 2], fitted), axis=1) / speed**2
    turn = OUTLIERS.turn_share * float(np.max(bend * np.gradient(u)))
    cosine = np.einsum("ij,ij->i", tangents[used], fitted[used])
    off = np.where(cosine > 0.0, np.maximum(1.0 - cosine**2, 0.0), 4.0)
    own = np.maximum(1.0 - spread[used] / variance[used], ROUNDING.exact)
    over_limit = off / (variance[used] * own * outlier_limit(len(used), 1.0))  # docs/model.md (29)
    over_limit = np.where(np.sqrt(off) / own > turn, over_limit, 0.0)
    worst = int(np.argmax(over_limit))
    return int(used[worst]) if over_limit[worst] > 1.0 else -1


def may_drop_tangent(used: Points | None, sensed: Points | None) -> bool:
    """Whether one more of the sensed directions may be left out of those that are used."""
    if used is None or sensed is None:
        return False
    count = int(np.count_nonzero(~np.isnan(sensed[:, 0])))
    dropped = count - int(np.count_nonzero(~np.isnan(used[:, 0])))
    return dropped + 1 <= max(OUTLIERS.share * count, 1.0)

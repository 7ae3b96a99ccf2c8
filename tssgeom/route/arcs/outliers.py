"""Points that a fitted chain does not explain: they lose their weight, and get it back where they belong."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tssgeom.arrays import Vector
from tssgeom.route.arcs.fit import Chain, Data, settle
from tssgeom.route.arcs.moves import fit_chain
from tssgeom.route.spline.bending import FINE

_STRAY = 16.0  # squared distance in noise variances, with 2 ln n added, beyond which a point is an outlier
_MOST_STRAY = 0.1  # of all points: where more are off, the chain is wrong
_MEDIAN = {2: 1.386, 3: 2.366}  # of the sum of so many squared standard normal numbers
_ROUNDS = 4


def weighed(data: Data, chain: Chain, variance: float = 0.0) -> Vector | None:
    """Weight of each point by its distance across the chain, or None where no weight changes.

    Parameters
    ----------
    data, chain
        Points and the chain that was fitted to those with weight.
    variance
        Noise variance where `data` knows none: so much is believed before the distances are looked at [m²].
    """
    square = chain.square
    least = max(data.variance or variance, (FINE * data.gap) ** 2)
    limit = (_STRAY + 2.0 * math.log(len(square))) * least
    if not _any_off(square, data.weight, limit):
        return None
    if not data.variance:
        limit *= max(float(np.median(square)) / (_MEDIAN[2 if data.free else 3] * least), 1.0)
    weight = np.where(square > limit, 0.0, 1.0)
    few = np.count_nonzero(weight == 0.0) <= _MOST_STRAY * len(weight)
    return weight if few and not np.array_equal(weight, data.weight) else None


@njit(cache=True, nogil=True)
def _any_off(square: np.ndarray, weight: np.ndarray, limit: float) -> bool:
    """Whether any point is beyond the limit or has no weight."""
    off = False
    for i in range(len(square)):
        off |= not square[i] <= limit or weight[i] == 0.0
    return off


def without_strays(data: Data, chain: Chain) -> tuple[Data, Chain]:
    """Weigh the points by the chain and fit it again, until no weight changes."""
    for _ in range(_ROUNDS):
        weight = weighed(data, chain)
        if weight is None:
            break
        data = data._replace(weight=weight)
        chain = fit_chain(data, settle(data, chain))
    return data, chain

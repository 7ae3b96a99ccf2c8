"""What bend may hide in the straight pieces of a chain; docs/model.md (124)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tssgeom.route.arcs.dense import factor, inverse, left_over
from tssgeom.route.arcs.fit import (
    LEAST_INFORMATION,
    Chain,
    Data,
    equations_of,
    first_joint_column,
    noise_variance,
    values,
)


@njit(cache=True, nogil=True)
def hidden_bends(data: Data, chain: Chain) -> np.ndarray:
    """Mean square of the curvature that each straight piece may have had [k] [1/m²]; 0 for a curved one.

    A piece is straight where the points do not ask for a bend. It may be bent all the same, with the odds
    that the criterion gives, and then as the points have it.
    """
    k, hidden = len(chain.bend), np.zeros(len(chain.bend))
    if np.all(chain.curved):
        return hidden
    matrix, gradient = equations_of(data, chain, chain.joints, chain.bend, np.ones(k, np.bool_))
    first = first_joint_column(data.free) + k - 1
    fitted = np.ones(len(matrix), np.bool_)
    for j in range(k):
        fitted[first + 2 * j] = fitted[first + 2 * j + 1] = chain.curved[j]
    lower, unit = factor(chain.matrix, LEAST_INFORMATION)
    variance, price = noise_variance(data, chain), 2.0 * math.log(values(data))
    for j in range(k):
        if chain.curved[j]:
            continue
        own = slice(first + 2 * j, first + 2 * j + 2)
        cross = matrix[fitted][:, own]
        left, rest = left_over(lower, unit, gradient[fitted], cross, matrix[own, own], gradient[own])
        spread = inverse(*factor(left, LEAST_INFORMATION))
        bend = spread @ rest
        odds = math.exp(min(0.5 * (bend @ rest / variance - price), 700.0))
        share = odds / (1.0 + odds) if k > 1 else 1.0
        hidden[j] = share * (bend @ bend + variance * np.trace(spread))
    return hidden

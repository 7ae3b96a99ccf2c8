"""Statistics that several parts use, each written once; kernels share what is compiled here."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit


class NormalMedians(NamedTuple):
    """Medians of standard normal numbers; a sample median over them is a standard deviation or a variance."""

    sd_per_absolute: float = 1.4826
    """Standard deviation over the median absolute value [1]; derived: 1/Φ⁻¹(3/4)."""
    length_2: float = 1.177
    """Of the length of a vector of two components [1]; derived: √(2 ln 2)."""
    square_2: float = 1.386
    """Of the sum of two squares [1]; derived: 2 ln 2."""
    square_3: float = 2.366
    """Of the sum of three squares [1]; derived: χ² of three degrees of freedom."""


MEDIANS = NormalMedians()


@njit(cache=True, nogil=True)
def median(values: np.ndarray) -> float:
    """Return the median of some numbers [n]; numpy's own would be compiled once for each kernel."""
    return np.median(values)


def robust_sd(off: np.ndarray) -> float:
    """Return the standard deviation of deviations [n] by their median absolute value, whatever a few do."""
    return MEDIANS.sd_per_absolute * float(np.median(np.abs(off)))


@njit(cache=True, nogil=True)
def isotonic_regression(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the nearest non-decreasing sequence in weighted least squares (pool adjacent violators)."""
    n = len(x)
    level, mass, count = np.empty(n), np.empty(n), np.empty(n, dtype=np.int64)
    top = 0
    for i in range(n):
        level[top], mass[top], count[top] = x[i], weight[i], 1
        while top > 0 and level[top - 1] > level[top]:
            total = mass[top - 1] + mass[top]
            level[top - 1] = (mass[top - 1] * level[top - 1] + mass[top] * level[top]) / total
            mass[top - 1] = total
            count[top - 1] += count[top]
            top -= 1
        top += 1
    out, i = np.empty(n), 0
    for block in range(top):
        for _ in range(count[block]):
            out[i] = level[block]
            i += 1
    return out


@njit(cache=True, nogil=True)
def information_price(parameters: float, values: float) -> float:
    """Return what BIC, the Bayesian information criterion, adds to -2 ln likelihood for its parameters."""
    return parameters * math.log(values)

"""The median as kernels use it, in one place: numpy's would be compiled once for each that calls it."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def median(values: np.ndarray) -> float:
    """Return the median of some numbers [n]."""
    return np.median(values)

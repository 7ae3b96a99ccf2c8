"""Statistics in plain Python, as oracle of the core."""

from __future__ import annotations

import numpy as np


def median(values: np.ndarray) -> float:
    """Return the median of some numbers [n]; numpy's own would be compiled once for each kernel."""
    return np.median(values)


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

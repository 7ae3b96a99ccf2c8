"""How much of a true law the band of a learned one holds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

_FREE_SLOPE = ("strain_over_tension", "sensor_curve")
_FREE_ZERO = (*_FREE_SLOPE, "stretch_at_end", "sensor_drift", "load_over_position")


def band_share(law: Mapping[str, Any], true: Mapping[str, Any], kind: str) -> float:
    """Return the share of points of a law, as reports have it, where its band holds the true one."""
    x, value, low, high = (np.array(law[key], dtype=float) for key in ("x", "value", "lo", "hi"))
    inside = (x >= true["x"][0]) & (x <= true["x"][-1])
    if not inside.any():
        return 0.0
    x, value, low, high = (each[inside] for each in (x, value, low, high))
    width = high - low
    weight = 1.0 / np.maximum(width, 1e-2 * max(float(np.median(width)), 1e-12))
    goal = _freed(np.interp(x, true["x"], true["value"]), x, value, kind, weight)
    return float(np.mean((low <= goal) & (goal <= high)))


def _freed(goal: np.ndarray, x: np.ndarray, value: np.ndarray, kind: str, weight: np.ndarray) -> np.ndarray:
    """Return the true law [n] with what is free of it taken from a learned one [n], by weights [n]."""

    def scaled(true: np.ndarray, learned: np.ndarray) -> np.ndarray:
        own, other = weight * true, weight * learned
        return true * float(own @ other) / float(own @ own)

    if kind.startswith("friction_over"):
        return scaled(goal, value)
    if kind == "strain_over_time":
        return scaled(1.0 + goal, value)
    if kind in _FREE_SLOPE and len(x) > 2:
        slope, zero = np.polyfit(x, value - goal, 1, w=weight)
        return goal + slope * x + zero
    return goal + float(np.average(value - goal, weights=weight**2)) if kind in _FREE_ZERO else goal

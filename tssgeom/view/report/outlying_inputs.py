"""Which inputs of a batch differ most from the others, and in what."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tssgeom.statistics import robust_sd

FEWEST = 5
"""Among fewer inputs none is called odd."""
_BEYOND = 3.5  # robust z: the usual bound for an outlier (Iglewicz and Hoaglin 1993)
_LEAST_NOISE = 1e-9  # m

Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Oddity:
    """One input that stands out, and in what most."""

    name: str
    z: float
    """Distance from the median of all inputs in robust standard deviations."""
    words: str


@dataclass(frozen=True, slots=True)
class _Feature:
    of: Callable[[Row], float]
    floor: Callable[[Sequence[Row]], float]
    """The least standard deviation that counts: differences well below it mean nothing."""
    what: str
    words: Callable[[float], str]
    """The value with its unit."""
    among: Callable[[Row], bool] = lambda row: True
    """The inputs that it can be told of."""


def oddest(rows: Sequence[Row], most: int = 5) -> list[Oddity]:
    """Return the inputs that stand out most, the oddest first; rows are those of the summary.

    Compared are the change of Φ over an input, its noise, and the shares of frames that were rejected or gave
    a warning. Only more than the others is odd.
    """
    if len(rows) < FEWEST:
        return []
    scores = [_scores(rows, feature) for feature in _FEATURES]
    seen = [_oddity(rows, k, scores) for k in range(len(rows))]
    odd = sorted((each for each in seen if each.z > _BEYOND), key=lambda each: -each.z)
    return odd[:most]


def _oddity(rows: Sequence[Row], k: int, scores: Sequence[np.ndarray]) -> Oddity:
    best = max(range(len(_FEATURES)), key=lambda j: float(scores[j][k]))
    feature = _FEATURES[best]
    usual = float(np.median([feature.of(row) for row in rows if feature.among(row)]))
    words = f"{feature.what} {feature.words(feature.of(rows[k]))}, the others about {feature.words(usual)}"
    return Oddity(str(rows[k]["name"]), float(scores[best][k]), words)


def _scores(rows: Sequence[Row], feature: _Feature) -> np.ndarray:
    """Robust z of every input; 0 where the feature cannot be told, or of too few."""
    told = np.array([feature.among(row) for row in rows])
    values = np.array([feature.of(row) for row in rows])
    if told.sum() < FEWEST:
        return np.zeros(len(rows))
    off = values - np.median(values[told])
    spread = max(robust_sd(off[told]), feature.floor(rows))
    return np.where(told, off / spread, 0.0)


def _angle_error(rows: Sequence[Row]) -> float:
    return max(float(np.median([row["total_angle_se_rad"] for row in rows])), 1e-6)


_FEATURES = (
    _Feature(
        lambda row: row["total_angle_max_rad"] - row["total_angle_min_rad"],
        _angle_error,
        "change of Φ",
        lambda value: f"{math.degrees(value):.1f}°",
        lambda row: bool(row["timed"]),
    ),
    _Feature(
        lambda row: math.log(max(row["noise_rms_m"], _LEAST_NOISE)),
        lambda rows: 0.1,
        "noise",
        lambda value: f"{1e3 * math.exp(value):.2g} mm",
    ),
    _Feature(
        lambda row: row["rejected"] / row["frames"],
        lambda rows: 0.01,
        "rejected",
        lambda value: f"{100 * value:.3g} % of the frames",
    ),
    _Feature(
        lambda row: row["warned"] / max(row["frames"] - row["rejected"], 1),
        lambda rows: 0.02,
        "warnings in",
        lambda value: f"{100 * value:.3g} % of the frames",
    ),
)

"""Outlying inputs of a batch: those that differ most from the others, and in which feature."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tssgeom.statistics import robust_sd

Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class OutlyingLimits:
    """When an input of a batch differs from the others."""

    fewest: int = 5
    """Inputs in a batch of which some may be outlying. chosen: a median of fewer says little."""
    z: float = 3.5
    """Robust z beyond which an input is outlying. cited: Iglewicz and Hoaglin 1993."""
    least_angle_sd: float = 1e-6
    """Least standard deviation of the change of Φ [rad]. chosen: rounding of the columns."""
    least_log_noise_sd: float = 0.1
    """Least standard deviation of the logarithm of the noise [1]. chosen: 10 % of the noise."""
    least_rejected_sd: float = 0.01
    """Least standard deviation of the share of rejected frames [1]. chosen."""
    least_warned_sd: float = 0.02
    """Least standard deviation of the share of frames with warnings [1]. chosen."""


LIMITS = OutlyingLimits()
_LEAST_NOISE = 1e-9  # m, so that its logarithm is finite


@dataclass(frozen=True, slots=True)
class OutlyingInput:
    """An input that differs from the others, and in which feature most."""

    name: str
    z: float
    """Distance from the median of all inputs in robust standard deviations."""
    words: str


@dataclass(frozen=True, slots=True)
class _Feature:
    of: Callable[[Row], float]
    least_sd: Callable[[Sequence[Row]], float]
    """Least standard deviation that counts: differences well below it mean nothing."""
    title: str
    text: Callable[[float], str]
    """The value with its unit."""
    applies_to: Callable[[Row], bool] = lambda row: True
    """Inputs that have this feature."""


def outlying_inputs(rows: Sequence[Row], most: int = 5) -> list[OutlyingInput]:
    """Return the inputs that differ most from the others, the largest z first; rows are those of the summary.

    Compared are the change of Φ over an input, its noise, and the shares of frames that were rejected or gave
    a warning. Only values above those of the others count.
    """
    if len(rows) < LIMITS.fewest:
        return []
    scores = [_scores(rows, feature) for feature in _FEATURES]
    inputs = [_largest(rows, k, scores) for k in range(len(rows))]
    return sorted((each for each in inputs if each.z > LIMITS.z), key=lambda each: -each.z)[:most]


def _largest(rows: Sequence[Row], k: int, scores: Sequence[np.ndarray]) -> OutlyingInput:
    """Return the feature in which an input differs most."""
    best = max(range(len(_FEATURES)), key=lambda j: float(scores[j][k]))
    feature = _FEATURES[best]
    usual = float(np.median([feature.of(row) for row in rows if feature.applies_to(row)]))
    words = f"{feature.title} {feature.text(feature.of(rows[k]))}, the others about {feature.text(usual)}"
    return OutlyingInput(str(rows[k]["name"]), float(scores[best][k]), words)


def _scores(rows: Sequence[Row], feature: _Feature) -> np.ndarray:
    """Robust z of every input; 0 for those without the feature, or where too few have it."""
    applies = np.array([feature.applies_to(row) for row in rows])
    values = np.array([feature.of(row) for row in rows])
    if applies.sum() < LIMITS.fewest:
        return np.zeros(len(rows))
    deviation = values - np.median(values[applies])
    sd = max(robust_sd(deviation[applies]), feature.least_sd(rows))
    return np.where(applies, deviation / sd, 0.0)


def _angle_error(rows: Sequence[Row]) -> float:
    return max(float(np.median([row["total_angle_se_rad"] for row in rows])), LIMITS.least_angle_sd)


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
        lambda rows: LIMITS.least_log_noise_sd,
        "noise",
        lambda value: f"{1e3 * math.exp(value):.2g} mm",
    ),
    _Feature(
        lambda row: row["rejected"] / row["frames"],
        lambda rows: LIMITS.least_rejected_sd,
        "rejected",
        lambda value: f"{100 * value:.3g} % of the frames",
    ),
    _Feature(
        lambda row: row["warned"] / max(row["frames"] - row["rejected"], 1),
        lambda rows: LIMITS.least_warned_sd,
        "warnings in",
        lambda value: f"{100 * value:.3g} % of the frames",
    ),
)

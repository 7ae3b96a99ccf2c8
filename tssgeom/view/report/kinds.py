"""Kinds of inputs of a batch: groups that are clearly apart in length, angle or noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.statistics import EVIDENCE_SCALE, robust_sd

Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class KindLimits:
    """When inputs of a batch are of two kinds."""

    apart: float = 3.0
    """Least interval between two kinds, over the greater robust standard deviation of both [1]. fitted: at
    most 2.5 % of 400 batches of one normal, uniform, exponential or log-normal quantity are split, of 10 to
    1000 inputs."""
    most_tried: int = 8
    """Widest intervals that are tried. chosen: the time stays linear in the inputs."""


KIND_LIMITS = KindLimits()
LEAST_NOISE = 1e-9
"""Noise below which an input has none [m]. chosen: no sensor resolves it."""


@dataclass(frozen=True, slots=True)
class Kind:
    """Inputs that are alike."""

    members: NDArray[np.intp]
    """[n] Their rows, in their order."""
    words: str
    """Number, first name, and medians of L, Φ and noise."""


def kinds(rows: Sequence[Row]) -> list[Kind]:
    """Return the kinds of the rows of a summary, the largest first; one where none are clearly apart."""
    if not rows:
        return []
    angle = np.array([row["total_angle_rad"] for row in rows])
    unit = max(abs(float(np.median(angle))), 1e-12)
    values = np.column_stack([
        np.log([max(row["length_m"], LEAST_NOISE) for row in rows]),
        angle / unit,
        [log_noise(row) for row in rows],
    ])  # fmt: skip
    parts = sorted(_parts(values, np.arange(len(rows))), key=lambda part: (-len(part), part[0]))
    return [Kind(part, _words([rows[k] for k in part])) for part in parts]


def noise_text(log_noise: float) -> str:
    """Write a noise, given as its logarithm, with its unit."""
    noise = 1e3 * math.exp(log_noise)
    return f"{noise:.2g} mm" if noise < 99.5 else f"{noise:.0f} mm"


def log_noise(row: Row) -> float:
    """Return the logarithm of the root mean square noise of an input."""
    return math.log(max(row["noise_rms_m"], LEAST_NOISE))


def _parts(values: NDArray[np.float64], members: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Split at the widest interval in any column, and both parts again."""
    widest = [_widest_interval(column) for column in values[members].T]
    ratio, limit = max(widest)
    if ratio <= KIND_LIMITS.apart:
        return [members]
    below = values[members, [one for one, _ in widest].index(ratio)] < limit
    return _parts(values, members[below]) + _parts(values, members[~below])


def _widest_interval(column: NDArray[np.float64]) -> tuple[float, float]:
    """Return the widest interval between two values, over the spread beside it, and its middle."""
    ordered = np.sort(column)
    ends = np.arange(EVIDENCE_SCALE.fewest, len(ordered) - EVIDENCE_SCALE.fewest + 1)
    if not len(ends):
        return 0.0, 0.0
    between = np.diff(ordered)[ends - 1]
    tried = ends[np.argsort(-between, kind="stable")[: KIND_LIMITS.most_tried]]
    ratios = [between[k - EVIDENCE_SCALE.fewest] / max(_sd(ordered[:k]), _sd(ordered[k:])) for k in tried]
    best = int(np.argmax(ratios))
    return float(ratios[best]), float(ordered[tried[best] - 1 : tried[best] + 1].mean())


def _sd(values: NDArray[np.float64]) -> float:
    return max(robust_sd(values - np.median(values)), PLAUSIBLE.negligible)


def _words(rows: Sequence[Row]) -> str:
    def median(of: Callable[[Row], float]) -> float:
        return float(np.median([of(row) for row in rows]))

    count = "1 input" if len(rows) == 1 else f"{len(rows)} inputs"
    return (
        f"{count} such as {rows[0]['name']}: L {1e3 * median(lambda row: row['length_m']):.4g} mm, "
        f"Φ {math.degrees(median(lambda row: row['total_angle_rad'])):.3g}°, "
        f"noise {noise_text(median(log_noise))}"
    )

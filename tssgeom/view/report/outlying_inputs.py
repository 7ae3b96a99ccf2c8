"""Outlying inputs of a batch: those that differ from the others of their kind, and in which feature."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np

from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_route import OUTLIERS
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.route.agreement import AGREEMENT
from tssgeom.statistics import EVIDENCE_SCALE, robust_sd
from tssgeom.view.report.kinds import kinds, log_noise, noise_text

Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class OutlyingLimits:
    """When an input of a batch differs from the others."""

    z: float = 3.5
    """Robust z beyond which an input is outlying. cited: Iglewicz and Hoaglin 1993."""
    least_share: float = 1e-3
    """Least standard deviation of a length or a tension, of its median [1]. chosen: no sensor has less."""
    least_log_noise_sd: float = 0.1
    """Least standard deviation of the logarithm of the noise [1]. chosen: 10 % of the noise."""


LIMITS = OutlyingLimits()


@dataclass(frozen=True, slots=True)
class OutlyingInput:
    """An input that differs from the others of its kind, and in which features, the largest z first."""

    name: str
    z: float
    """Largest distance from the median of its kind, in robust standard deviations."""
    words: str
    own: float = math.nan
    """The same distance in standard errors of the input itself [1]; NaN where its feature has none."""


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
    se: Callable[[Row], float] | None = None
    """Standard error of the value by the input's own noise; None where there is none."""
    both_sides: bool = False
    """Whether values below those of the others count too."""
    counted: bool = False
    """Whether it is a share of frames and no measurement."""


@dataclass(frozen=True, slots=True)
class _Score:
    z: np.ndarray
    """Robust z of every input; 0 for those without the feature, or where too few have it."""
    own: np.ndarray
    """Difference from the median in standard errors of each input; infinite where the feature has none."""
    median: float


def outlying_inputs(rows: Sequence[Row]) -> list[OutlyingInput]:
    """Return the inputs that differ from the others of their kind; rows are those of the summary.

    Compared are L, Φ, T_out, the change of Φ over an input, its noise, and the shares of frames that were
    rejected or gave a warning. A difference counts that is large beside the spread of the others and beside
    the error that the input's own noise gives it. Those that differ in what was measured come first, the
    largest z before the others.
    """
    rows = _without_lacks(rows)
    outlying = [each for kind in kinds(rows) for each in _of_kind([rows[k] for k in kind.members])]
    return [each for _, each in sorted(outlying, key=lambda one: (one[0], -one[1].z))]


def _without_lacks(rows: Sequence[Row]) -> list[Row]:
    """Return the rows without warned frames where all warnings say what each frame of many inputs lacks.

    Such a text has no number and is that of a format or of the rig, not of what was measured.
    """
    texts = [[_text_of_all_frames(text) for text in row.get("warnings", ())] for row in rows]
    inputs = Counter(text for each in texts for text in {*each})
    lacks = {text for text, count in inputs.items() if text and count >= EVIDENCE_SCALE.fewest}
    return [
        {**row, "warned": 0} if each and lacks.issuperset(each) else row
        for row, each in zip(rows, texts, strict=True)
    ]


def _text_of_all_frames(warning: str) -> str:
    """Return a warning without its count of frames; empty where it has a number or is of some frames."""
    text, _, count = warning.rpartition(" (")
    match = re.fullmatch(r"(\d+) of (\d+) frames\)", count)
    text = text if match and match[1] == match[2] else warning
    return "" if re.search(r"\d", text) else text


def _of_kind(rows: Sequence[Row]) -> Iterator[tuple[bool, OutlyingInput]]:
    """Yield the outlying inputs of one kind, with whether only shares of their frames are outlying."""
    if len(rows) < EVIDENCE_SCALE.fewest:
        return
    scores = [_scores(rows, feature) for feature in _FEATURES]
    for k, row in enumerate(rows):
        if (each := _outlying(row, k, scores)) is not None:
            yield each


def _outlying(row: Row, k: int, scores: Sequence[_Score]) -> tuple[bool, OutlyingInput] | None:
    differing = [
        (float(score.z[k]), float(score.own[k]), feature, score.median)
        for feature, score in zip(_FEATURES, scores, strict=True)
        if score.z[k] > LIMITS.z and score.own[k] > LIMITS.z
    ]
    if not differing:
        return None
    differing.sort(key=lambda one: (one[2].counted, -one[0]))
    words = "; ".join(_words(row, feature, median) for _, _, feature, median in differing)
    z, own, feature, _ = differing[0]
    own = own if math.isfinite(own) else math.nan
    return feature.counted, OutlyingInput(str(row["name"]), z, words, own)


def _words(row: Row, feature: _Feature, median: float) -> str:
    """Write a value beside that of the others; of the one frame of a shape, the warnings themselves."""
    if feature.title == _WARNINGS and row["frames"] == 1 and row.get("warnings"):
        return f"warning: {'; '.join(row['warnings'])}"
    return f"{feature.title} {feature.text(feature.of(row))}, the others about {feature.text(median)}"


def _scores(rows: Sequence[Row], feature: _Feature) -> _Score:
    applies = np.array([feature.applies_to(row) for row in rows])
    if applies.sum() < EVIDENCE_SCALE.fewest:
        return _Score(np.zeros(len(rows)), np.zeros(len(rows)), math.nan)
    values = np.array([feature.of(row) for row in rows])
    median = float(np.median(values[applies]))
    deviation = np.abs(values - median) if feature.both_sides else values - median
    sd = max(robust_sd((values - median)[applies]), feature.least_sd(rows))
    own = np.full(len(rows), np.inf)
    if feature.se is not None:
        own = deviation / np.array([max(feature.se(row), 1e-300) for row in rows])
    z = np.where(applies, deviation / sd, 0.0)
    outlying = (z > LIMITS.z) & (own > LIMITS.z)
    if outlying.sum() > AGREEMENT.most_ignored * applies.sum():
        z *= sd / _spread((values - median)[applies])
    return _Score(z, own, median)


def _spread(deviation: np.ndarray) -> float:
    """Return the standard deviation of the normal law with the same largest deviation before its tail.

    Of two groups the smaller one is then not outlying if it is larger than the share of outliers.
    """
    within = float(np.quantile(np.abs(deviation), 1.0 - OUTLIERS.share))
    return within / NormalDist().inv_cdf(1.0 - OUTLIERS.share / 2.0)


def _angle_error(rows: Sequence[Row]) -> float:
    return max(float(np.median([row["total_angle_se_rad"] for row in rows])), ROUNDING.relative)


def _share_of(key: str) -> Callable[[Sequence[Row]], float]:
    return lambda rows: LIMITS.least_share * max(float(np.median([row[key] for row in rows])), 1e-12)


_WARNINGS = "warnings in"
_FEATURES = (
    _Feature(
        lambda row: row["total_angle_max_rad"] - row["total_angle_min_rad"],
        _angle_error,
        "change of Φ",
        lambda value: f"{math.degrees(value):.1f}°",
        lambda row: bool(row["timed"]),
        lambda row: row["total_angle_se_rad"],
    ),
    _Feature(
        lambda row: row["total_angle_rad"],
        _angle_error,
        "Φ",
        lambda value: f"{math.degrees(value):.1f}°",
        se=lambda row: row["total_angle_se_rad"],
        both_sides=True,
    ),
    _Feature(
        lambda row: row["length_m"],
        _share_of("length_m"),
        "L",
        lambda value: f"{1e3 * value:.1f} mm",
        se=lambda row: row["noise_m"],  # of the points at its ends
        both_sides=True,
    ),
    _Feature(
        lambda row: row["tension_out_N"],
        _share_of("tension_out_N"),
        "T_out",
        lambda value: f"{value:.2f} N",
        se=lambda row: row["tension_out_se_N"],
        both_sides=True,
    ),
    _Feature(log_noise, lambda rows: LIMITS.least_log_noise_sd, "noise", noise_text),
    _Feature(
        lambda row: row["rejected"] / row["frames"],
        lambda rows: PLAUSIBLE.negligible,
        "rejected",
        lambda value: f"{100 * value:.3g} % of the frames",
        counted=True,
    ),
    _Feature(
        lambda row: row["warned"] / max(row["frames"] - row["rejected"], 1),
        lambda rows: PLAUSIBLE.negligible,
        _WARNINGS,
        lambda value: f"{100 * value:.3g} % of the frames",
        counted=True,
    ),
)

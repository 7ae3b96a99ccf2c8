"""Summary of an input's frames, in constant memory."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tssgeom.stream import FrameResult, Rejected
from tssgeom.tendon.history import last_peak

RANGED = (
    "length_m",
    "total_angle_rad",
    "total_angle_se_rad",
    "tension_in_N",
    "tension_out_N",
    "tension_out_se_N",
    "elongation_m",
    "elongation_se_m",
)
"""Quantities whose range over a recording is reported."""
_OTHER = "other warnings"


@dataclass(frozen=True, slots=True)
class SummaryLimits:
    """Sizes that bound the memory of a running summary."""

    kept: int = 400
    """Frames, evenly spread over an input, whose whole result is kept; first rejected frames that are kept
    with their reasons; and different texts of warnings. Chosen: enough for every picture."""


LIMITS = SummaryLimits()


@dataclass(slots=True)
class RunningSummary:
    """Counts, ranges and selected results of consecutive frames; summaries of consecutive rows add up."""

    stride: int
    """Results of frames whose count is a multiple of it are kept."""
    at: float | None = None
    """Time of the frame that is to represent the input; None: at the highest peak of T_in [s]."""
    nearest: FrameResult | None = None
    """The good frame nearest to that time."""
    frames: int = 0
    refused: int = 0
    warned: int = 0
    """Frames with a warning."""
    rejected: list[Rejected] = field(default_factory=list)
    warnings: Counter[str] = field(default_factory=Counter)
    kept: list[FrameResult] = field(default_factory=list)
    last: FrameResult | None = None
    """The last good frame."""
    begin: float = math.nan
    """Time of the first good frame [s]."""
    low: dict[str, float] = field(default_factory=dict)
    high: dict[str, float] = field(default_factory=dict)
    noise_square: float = 0.0
    """Sum over the good frames [m²]."""

    @classmethod
    def of(cls, frame_count: int, at: float | None = None) -> RunningSummary:
        """Begin the summary of an input of so many frames, represented by that nearest to `at` [s]."""
        return cls(max(1, math.ceil(frame_count / LIMITS.kept)), at)

    @property
    def used(self) -> int:
        """Frames that could be used."""
        return self.frames - self.refused

    @property
    def noise(self) -> float:
        """Root mean square over the good frames of the noise of a coordinate [m]."""
        return math.sqrt(self.noise_square / max(self.used, 1))

    @property
    def results(self) -> list[FrameResult]:
        """Results that were kept, in order; the last one belongs to the last good frame."""
        if self.last is None or (self.kept and self.kept[-1].seq == self.last.seq):
            return list(self.kept)
        return [*self.kept, self.last]

    @property
    def representative(self) -> FrameResult:
        """The frame that represents the input in summary, pictures and report.

        It is that nearest to `at`; without that the last of the highest peaks of T_in, or the last good frame
        where T_in is constant.
        """
        if self.nearest is not None:
            return self.nearest
        results = self.results
        return results[last_peak(np.array([result.transmission.tension_in for result in results]))]

    def add(self, item: FrameResult | Rejected, row: Mapping[str, Any]) -> None:
        """Add one more frame with its row in the table of frames."""
        self.frames += 1
        if isinstance(item, Rejected):
            self.refused += 1
            if len(self.rejected) < LIMITS.kept:
                self.rejected.append(item)
            return
        if self.last is None:
            self.begin = item.frame.time
        self.nearest = self._nearer(item)
        self.noise_square += row["noise_m"] ** 2
        for name in RANGED:
            value = row[name]
            self.low[name] = min(self.low.get(name, value), value)
            self.high[name] = max(self.high.get(name, value), value)
        if item.warnings:
            self.warned += 1
            self._count(Counter(item.warnings))
        self.last = item
        if item.seq % self.stride == 0:
            self.kept.append(item.strip())

    def _nearer(self, item: FrameResult) -> FrameResult | None:
        """Return the frame nearest to `at`, of this one and those before it; the earlier of two."""
        if self.at is None:
            return None
        before = math.inf if self.nearest is None else abs(self.nearest.frame.time - self.at)
        return item.strip() if abs(item.frame.time - self.at) < before else self.nearest

    def close(self) -> RunningSummary:
        """Strip the last result of what only the next frame would have needed."""
        self.last = None if self.last is None else self.last.strip()
        return self

    def join(self, later: RunningSummary) -> None:
        """Add the summary of the frames that follow."""
        if self.last is None:
            self.begin = later.begin
        self.frames += later.frames
        self.refused += later.refused
        self.warned += later.warned
        self.rejected += later.rejected[: LIMITS.kept - len(self.rejected)]
        self._count(later.warnings)
        self.kept += later.kept
        self.last = later.last or self.last
        self.noise_square += later.noise_square
        for name, value in later.low.items():
            self.low[name] = min(self.low.get(name, value), value)
        for name, value in later.high.items():
            self.high[name] = max(self.high.get(name, value), value)

    def _count(self, warnings: Counter[str]) -> None:
        for text, count in warnings.items():
            full = text not in self.warnings and len(self.warnings) >= LIMITS.kept
            self.warnings[_OTHER if full else text] += count

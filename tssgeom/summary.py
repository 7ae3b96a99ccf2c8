"""What is known of an input after some of its frames, in memory that does not grow with their number."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tssgeom.route.tracking import TrackedFit
from tssgeom.stream import FrameResult, Rejected
from tssgeom.tendon.history import last_peak

MOST_KEPT = 400
"""Of so many frames, evenly spread over an input, the whole result is kept: for pictures and the summary."""
MOST_REJECTED = 200
"""The first so many rejected frames are kept with their reasons."""
RANGED = ("length_m", "total_angle_rad", "tension_in_N", "tension_out_N", "elongation_m")
"""Quantities that are told as a range over a recording."""

_MOST_WARNINGS = 1000  # different ones
_OTHER = "other warnings"


@dataclass(slots=True)
class Account:
    """Counts, ranges and samples of frames in a row; accounts of rows that follow each other add up."""

    stride: int
    """Results of frames whose count it divides are kept."""
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
    def of(cls, frame_count: int) -> Account:
        """Begin an account of an input of so many frames."""
        return cls(max(1, math.ceil(frame_count / MOST_KEPT)))

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
        """Results that are kept, in order; the last one is that of the last good frame."""
        if self.last is None or (self.kept and self.kept[-1].seq == self.last.seq):
            return list(self.kept)
        return [*self.kept, self.last]

    @property
    def told(self) -> FrameResult:
        """The frame that stands for the input: at the last of the highest peaks of T_in.

        Summary, pictures and report tell the same one. Where T_in does not vary it is the last good frame.
        """
        results = self.results
        return results[last_peak(np.array([result.transmission.tension_in for result in results]))]

    def add(self, item: FrameResult | Rejected, row: Mapping[str, Any]) -> None:
        """Take one more frame, and its row in the table of frames, into account."""
        self.frames += 1
        if isinstance(item, Rejected):
            self.refused += 1
            if len(self.rejected) < MOST_REJECTED:
                self.rejected.append(item)
            return
        if self.last is None:
            self.begin = item.frame.time
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
            self.kept.append(_light(item))

    def close(self) -> Account:
        """Let go of what only the next frame would have needed."""
        self.last = None if self.last is None else _light(self.last)
        return self

    def join(self, later: Account) -> None:
        """Add the account of the frames that follow."""
        if self.last is None:
            self.begin = later.begin
        self.frames += later.frames
        self.refused += later.refused
        self.warned += later.warned
        self.rejected += later.rejected[: MOST_REJECTED - len(self.rejected)]
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
            full = text not in self.warnings and len(self.warnings) >= _MOST_WARNINGS
            self.warnings[_OTHER if full else text] += count


def _light(result: FrameResult) -> FrameResult:
    """Leave out what only the fit of the next frame needs, which is most of a result."""
    return replace(result, tracked=TrackedFit(result.tracked.fit.strip(), result.tracked.index))

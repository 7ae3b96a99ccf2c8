"""What the report keeps of one input."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.stream import FrameResult, Rejected
from tssgeom.view.drawn import last_peak


@dataclass(frozen=True, slots=True)
class Series:
    """Numbers of a recording against time, one for each used frame."""

    time: Vector
    """[s]."""
    tension_in: Vector
    """[N]."""
    tension_out: Vector
    """[N]."""
    elongation: Vector
    """[m]."""


@dataclass(frozen=True, slots=True)
class ReportEntry:
    """What the report says of one input; of all frames it keeps one whole and some numbers of the rest."""

    name: str
    shown: FrameResult | None
    """The frame that is drawn, at the last peak of the tension; None where no frame could be used."""
    used: int
    """Number of frames that were used."""
    rejected: tuple[Rejected, ...] = ()
    series: Series | None = None
    """None for a static shape."""
    recording: str = ""
    """Address of the Rerun recording relative to the report; empty where there is none."""
    warnings: tuple[tuple[str, int], ...] = ()
    """Each warning and the number of frames that gave it, the most frequent first."""

    @classmethod
    def of(
        cls,
        name: str,
        results: Sequence[FrameResult],
        *,
        timed: bool,
        rejected: Sequence[Rejected] = (),
        recording: str = "",
    ) -> ReportEntry:
        """Take from the results of one input what the report needs."""
        series = _series(results) if timed and results else None
        counted = Counter(warning for result in results for warning in result.warnings)
        warnings = tuple(counted.most_common())
        return cls(name, _shown(results), len(results), tuple(rejected), series, recording, warnings)

    @classmethod
    def refused(cls, name: str, reason: str) -> ReportEntry:
        """Stand for an input that could not even be opened."""
        return cls(name, None, 0, (Rejected(0, 0.0, reason),))


def _shown(results: Sequence[FrameResult]) -> FrameResult | None:
    if not results:
        return None
    return results[last_peak(np.array([result.transmission.tension_in for result in results]))]


def _series(results: Sequence[FrameResult]) -> Series:
    seen = [result.transmission for result in results]
    return Series(
        time=np.array([result.frame.time for result in results]),
        tension_in=np.array([each.tension_in for each in seen]),
        tension_out=np.array([each.tension_out for each in seen]),
        elongation=np.array([each.elongation for each in seen]),
    )

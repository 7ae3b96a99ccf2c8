"""What the report keeps of one input."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.stream import FrameResult, Rejected
from tssgeom.tendon.history import last_peak


@dataclass(frozen=True, slots=True)
class Series:
    """Numbers of a recording against time, one for each frame that is drawn."""

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
    """The frame that stands for all, at the last of the highest peaks of T_in; None where none is good."""
    used: int
    """Number of frames that were used."""
    rejected: tuple[Rejected, ...] = ()
    series: Series | None = None
    """None for a static shape."""
    lost: int = 0
    """Number of frames that were rejected; `rejected` holds the first of them."""
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
        """Take from the results of all frames of one input what the report needs."""
        counted = Counter(warning for result in results for warning in result.warnings)
        entry = cls.of_some(name, results, timed=timed, rejected=rejected, recording=recording)
        return replace(entry, used=len(results), lost=len(rejected), warnings=_ranked(counted))

    @classmethod
    def of_some(
        cls,
        name: str,
        results: Sequence[FrameResult],
        *,
        timed: bool,
        rejected: Sequence[Rejected] = (),
        recording: str = "",
        used: int = 0,
        lost: int = 0,
        warnings: Mapping[str, int] | None = None,
    ) -> ReportEntry:
        """Take what the report needs from some of the results of an input, and the counts over all."""
        return cls(
            name,
            _shown(results),
            used,
            tuple(rejected),
            _series(results) if timed and results else None,
            lost,
            recording,
            _ranked(warnings or {}),
        )

    @classmethod
    def refused(cls, name: str, reason: str) -> ReportEntry:
        """Stand for an input that could not even be opened."""
        return cls(name, None, 0, (Rejected(0, 0.0, reason),), lost=1)


def _ranked(counts: Mapping[str, int]) -> tuple[tuple[str, int], ...]:
    return tuple(Counter(counts).most_common())


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

"""What the report keeps of one input."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.stream import FrameResult, Rejected
from tssgeom.tendon.history import last_peak
from tssgeom.tendon.transmission import Transmission


@dataclass(frozen=True, slots=True)
class Series:
    """Numbers of a recording against time, one for each frame that is drawn."""

    time: Vector
    """[s]."""
    tension_in: Vector
    """[N]."""
    tension_out: Vector
    """[N]."""
    tension_out_se: Vector
    """Standard error from that of the geometry [N]."""
    elongation: Vector
    """[m]."""
    elongation_se: Vector
    """[m]."""
    tension_out_measured: Vector | None = None
    """Where the run brings it, NaN where a frame does not [N]."""
    elongation_measured: Vector | None = None
    """[m]."""

    @classmethod
    def of(
        cls,
        time: Sequence[float],
        seen: Sequence[Transmission],
        tension_out: Sequence[float | None] = (),
        elongation: Sequence[float | None] = (),
    ) -> Series:
        """Take the numbers of the tendon at each time [s], and what was measured then [N, m]."""
        return cls(
            time=np.array(time),
            tension_in=np.array([each.tension_in for each in seen]),
            tension_out=np.array([each.tension_out for each in seen]),
            tension_out_se=np.array([each.tension_out_se for each in seen]),
            elongation=np.array([each.elongation for each in seen]),
            elongation_se=np.array([each.elongation_se for each in seen]),
            tension_out_measured=_measured(tension_out),
            elongation_measured=_measured(elongation),
        )


def _measured(values: Sequence[float | None]) -> Vector | None:
    found = np.array([np.nan if value is None else value for value in values])
    return found if np.isfinite(found).any() else None


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
            shown_of(results),
            used,
            tuple(rejected),
            series_of(results) if timed and results else None,
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


def shown_of(results: Sequence[FrameResult]) -> FrameResult | None:
    """Return the frame that stands for all, at the last of the highest peaks of T_in; None of none."""
    if not results:
        return None
    return results[last_peak(np.array([result.transmission.tension_in for result in results]))]


def series_of(results: Sequence[FrameResult]) -> Series:
    """Take the numbers of frames against time."""
    frames = [result.frame for result in results]
    return Series.of(
        [frame.time for frame in frames],
        [result.transmission for result in results],
        [frame.tension_out for frame in frames],
        [frame.elongation for frame in frames],
    )

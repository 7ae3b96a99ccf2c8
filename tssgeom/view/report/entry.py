"""The content of the report on one input."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.stream import FrameResult, Rejected
from tssgeom.tendon.capstan import Transmission
from tssgeom.tendon.history import last_peak
from tssgeom.view.samples import evenly

_MOMENTS = 500  # of a run in a figure, beside the turns of its drive


@dataclass(frozen=True, slots=True)
class Series:
    """Numbers of a recording against time, one for each frame of the plot."""

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
    """NaN where a frame has none; None where no frame has one [N]."""
    elongation_measured: Vector | None = None
    """[m]."""
    angle: Vector | None = None
    """Curve angle; None where the route stands [rad]."""
    angle_se: Vector | None = None
    """[rad]."""

    @property
    def driven(self) -> bool:
        """Whether T_in varies, so that there is something over it to draw."""
        return bool(np.ptp(self.tension_in) > 0.0)

    @classmethod
    def of(
        cls,
        time: Sequence[float],
        ends: Sequence[Transmission],
        tension_out: Sequence[float | None] = (),
        elongation: Sequence[float | None] = (),
        angles: Sequence[tuple[float, float]] = (),
    ) -> Series:
        """Take the tendon at each time [s], the measured values [N, m], and Φ with its error [rad]."""
        moves = len(set(angles)) > 1
        return cls(
            time=np.array(time),
            tension_in=np.array([each.tension_in for each in ends]),
            tension_out=np.array([each.tension_out for each in ends]),
            tension_out_se=np.array([each.tension_out_se for each in ends]),
            elongation=np.array([each.elongation for each in ends]),
            elongation_se=np.array([each.elongation_se for each in ends]),
            tension_out_measured=_measured(tension_out),
            elongation_measured=_measured(elongation),
            angle=np.array([angle for angle, _ in angles]) if moves else None,
            angle_se=np.array([error for _, error in angles]) if moves else None,
        )


def _measured(values: Sequence[float | None]) -> Vector | None:
    column = np.array([np.nan if value is None else value for value in values])
    return column if np.isfinite(column).any() else None


@dataclass(frozen=True, slots=True)
class ReportEntry:
    """The content of the report on one input: one frame whole, and some numbers of the others."""

    name: str
    representative: FrameResult | None
    """The frame at the last of the highest peaks of T_in; None where no frame is valid."""
    used: int
    """Number of frames that were used."""
    rejected: tuple[Rejected, ...] = ()
    series: Series | None = None
    """None for a static shape."""
    rejected_frames: int = 0
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
        used: int | None = None,
        rejected_frames: int | None = None,
        warnings: Mapping[str, int] | None = None,
    ) -> ReportEntry:
        """Take the content of the report from the results of an input.

        Where `results` and `rejected` are only some of the frames, the counts over all of them are given too.
        """
        if warnings is None:
            warnings = Counter(warning for result in results for warning in result.warnings)
        return cls(
            name,
            representative(results),
            len(results) if used is None else used,
            tuple(rejected),
            series_of(results) if timed and results else None,
            len(rejected) if rejected_frames is None else rejected_frames,
            recording,
            tuple(Counter(warnings).most_common()),
        )

    @classmethod
    def refused(cls, name: str, reason: str) -> ReportEntry:
        """Return the entry of an input that could not be opened."""
        return cls(name, None, 0, (Rejected(0, 0.0, reason),), rejected_frames=1)


def representative(results: Sequence[FrameResult]) -> FrameResult | None:
    """Return the frame at the last of the highest peaks of T_in; None of none."""
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
        [(result.arcs.total_angle, result.arcs.total_angle_se) for result in results],
    )


def moments(run: Series, most: int = _MOMENTS) -> np.ndarray:
    """Return the indices of the samples to draw: evenly chosen, and every turn of the drive."""
    turns = [edge for edge, _ in strokes(run.tension_in)]
    return np.union1d(evenly(len(run.time), most), np.array(turns[:most], dtype=np.intp))


def strokes(drive: Vector) -> list[tuple[int, int]]:
    """Cut a run where its drive turns: first and last sample of each pull and release."""
    direction = np.sign(np.diff(drive))
    moving = np.flatnonzero(direction)
    turns = moving[1:][direction[moving][1:] != direction[moving][:-1]]
    return list(itertools.pairwise([0, *turns.tolist(), len(drive) - 1])) if len(drive) > 1 else []

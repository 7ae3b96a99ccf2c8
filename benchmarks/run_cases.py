"""What a measured set gives to a fit: channels in SI, fitted rows, and held-out rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Vector

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Response:
    """One channel that is predicted from the channels that are given."""

    column: str
    drive: str
    """The channel that moves it, with hysteresis."""
    others: tuple[str, ...] = ()
    """Channels that are given beside the drive; a peer takes them linearly."""
    resists: bool = False
    """Whether it is a force that changes sign with the drive's direction (a stop), not a motion (a play)."""
    zeroed: bool = False
    """Whether drive and response count from the first row of each run, so that no offset is to be fitted."""


@dataclass(frozen=True, slots=True)
class Case:
    """One or several runs of one rig.

    Rows of a run follow each other in time. Those that are neither fitted nor held out belong to a run-up
    that only sets the state.
    """

    source: str
    """Name of the set."""
    name: str
    columns: Mapping[str, Vector]
    """[n] each, SI; the unit ends the name."""
    run: NDArray[np.int_]
    """[n] Number of the run of each row, from 0 and rising."""
    fitted: Mask
    """[n]"""
    held_out: Mask
    """[n]"""
    responses: tuple[Response, ...]
    known: Mapping[str, float] = field(default_factory=dict[str, float])
    """What is known of the rig, SI; the unit ends the name."""
    period: float | None = None
    """Of the drive [s], where fitted and held-out cycles repeat each other."""

    def runs(self) -> Iterator[slice]:
        """Yield the rows of each run."""
        ends = np.flatnonzero(np.diff(self.run)) + 1
        for start, end in zip((0, *ends), (*ends, len(self.run)), strict=True):
            yield slice(int(start), int(end))


def mean_cycle_error(case: Case, column: str) -> float:
    """Return the rms difference of held-out rows from the mean of the fitted cycles at the same phase.

    It is the error of a method that repeats the fitted cycle: no fit to the drive alone does much better.
    NaN where a held-out row has no fitted cycle before it.
    """
    if case.period is None:
        return np.nan
    errors = list[Vector]()
    for rows in case.runs():
        time, values = case.columns["time_s"][rows], case.columns[column][rows]
        fitted, held_out = case.fitted[rows], case.held_out[rows]
        if not (fitted.any() and held_out.any()):
            return np.nan
        low, high = time[fitted][[0, -1]]
        near = 0.5 * (time[1] - time[0])
        backs = np.arange(1, int((time[-1] - low) / case.period) + 2)
        at = time[held_out][:, None] - backs * case.period
        inside = (at >= low - near) & (at <= high + near)
        known = np.where(inside, np.interp(at, time, values), 0.0).sum(axis=1) / inside.sum(axis=1)
        errors.append(values[held_out] - known)
    return float(np.sqrt(np.mean(np.square(np.concatenate(errors)))))

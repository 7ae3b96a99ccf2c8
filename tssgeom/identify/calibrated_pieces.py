"""Calibration of a long log in pieces of time: how the numbers of a rig have changed.

Source: docs/machines.md, "A long log"; docs/model.md (179)-(183).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import SettingsError, TssgeomError
from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_estimates import MachineCalibration
from tssgeom.identify.machine_run import machine_run
from tssgeom.mechanism import answering
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.uncertain import Uncertain

_RUN_UP = 0.5
"""Of a piece: time before it that sets where the tendons stand [1]; chosen: some cycles of the drive, after
which no contact remembers what was before."""
_LEAST = 0.5
"""Of a piece: a shorter rest of the log belongs to the piece before it [1]; chosen."""
_MOST_PIECES = 2000
"""Chosen: two weeks in pieces of ten minutes; a fit of each takes a second."""


@dataclass(frozen=True, slots=True)
class CalibratedPiece:
    """A piece of a log, and the rig that is fitted to it."""

    start: float
    """Time of its first reading [s]."""
    end: float
    """Time of its last reading [s]."""
    fitted: MachineCalibration | None
    """None where it cannot be fitted."""
    failures: tuple[str, ...]
    """Why its numbers are not to be used, a sentence each; none where the fit passes its test."""


def calibrate_pieces(
    name: str,
    columns: Mapping[str, Vector],
    routes: Sequence[Arcs],
    rig: Rig,
    uncertain: Sequence[Uncertain] = (),
    *,
    every: float,
    progress: Callable[[str, float], object] = lambda step, share: None,
) -> Iterator[CalibratedPiece]:
    """Fit each piece of a log by itself, and yield it.

    Parameters
    ----------
    name, columns, routes, rig
        As of `tssgeom.identify.machine_run.machine_run`; the log begins at rest.
    uncertain
        What is not certain of the rig; friction and compliance never are.
    every
        Length of a piece [s].
    progress
        Called with each piece and the share of the log that is done [1].

    Raises
    ------
    SettingsError
        Where `every` is not above 0, or makes too many pieces.
    """
    time = columns["time_s"]
    edges = piece_edges(time, every)
    answers = answering(rig.drive, rig.end)
    for k, (start, end) in enumerate(pairwise(edges.tolist())):
        progress(f"from {start:g} s", k / (len(edges) - 1))
        last = time <= end if k == len(edges) - 2 else time < end
        rows = np.flatnonzero((time >= start - _RUN_UP * every) & last)
        inside = rows[time[rows] >= start]
        piece = {channel: values[rows] for channel, values in columns.items()}
        for channel in answers:
            if channel in piece:
                piece[channel] = np.where(time[rows] >= start, piece[channel], np.nan)
        span = (float(time[inside[0]]), float(time[inside[-1]])) if len(inside) else (start, end)
        try:
            run = machine_run(f"{name} from {start:g} s", piece, routes, rig)
            fitted = calibrate_machine([run], rig, uncertain)
        except TssgeomError as error:
            yield CalibratedPiece(*span, None, (str(error),))
            continue
        yield CalibratedPiece(*span, fitted, fitted.failures)


def piece_edges(time: Vector, every: float) -> Vector:
    """Return where the pieces of a log begin, and where the last one ends [s].

    Raises SettingsError where `every` is not above 0, or makes too many pieces.
    """
    first, last = float(time[0]), float(time[-1])
    count = (last - first) / every if every > 0.0 else np.inf
    if not count <= _MOST_PIECES:
        raise SettingsError(
            f"pieces of {every:g} s: a log of {last - first:g} s has at most {_MOST_PIECES} of them; give a "
            "greater --every"
        )
    whole = max(int(np.floor(count + 1.0 - _LEAST)), 1)
    return np.append(first + every * np.arange(whole), last)

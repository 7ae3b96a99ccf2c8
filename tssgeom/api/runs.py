"""Results of `analyse_all`, `simulate` and `compensate`: all rows of a recording or a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar, overload

from tssgeom.arrays import Vector
from tssgeom.io.formats.runs import MeasuredRun
from tssgeom.result import Result
from tssgeom.stream import FrameResult, Rejected
from tssgeom.tendon.command import Command
from tssgeom.tendon.simulation import Moment

Row = TypeVar("Row")


@dataclass(frozen=True, slots=True, repr=False)
class _Rows(Result, Sequence[Row], Generic[Row]):
    """Rows of a run, which count, iterate and slice as a tuple."""

    rows: tuple[Row, ...]
    """[n] One for each time of the run."""

    def __len__(self) -> int:
        return len(self.rows)

    @overload
    def __getitem__(self, index: int) -> Row: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Row, ...]: ...
    def __getitem__(self, index: int | slice) -> Row | tuple[Row, ...]:
        return self.rows[index]


@dataclass(frozen=True, slots=True, repr=False)
class RecordingResult(_Rows[FrameResult]):
    """The results of all frames of a recording: a sequence of `FrameResult`.

    As a table it has the columns of `frames/NAME.parquet` (docs/formats.md).
    """

    name: str = ""
    """Name of the recording."""
    rejected: tuple[Rejected, ...] = ()
    """Frames that could not be used, with the reason."""
    warnings: tuple[str, ...] = ()
    """What to know of the recording and its frames, a sentence each."""


@dataclass(frozen=True, slots=True, repr=False)
class Simulation(_Rows[Moment]):
    """The tendon at each time of a run: a sequence of `Moment`.

    As a table it has the columns of `simulate.parquet` (docs/formats.md).
    """

    run: MeasuredRun | None = None
    """The run with what was measured in it; None where only times and a drive were given."""
    angles: tuple[tuple[float, float], ...] = ()
    """[n] Curve angle and its standard error at each time, where the route moves [rad]."""
    warnings: tuple[str, ...] = ()
    """What is implausible in the run, a sentence each."""


@dataclass(frozen=True, slots=True, repr=False)
class Compensation(_Rows[Command]):
    """The command for each time of a run with a target: a sequence of `Command`.

    As a table it has the columns of `compensate.parquet` (docs/formats.md).
    """

    time: Vector
    """[n] Times of the run [s]."""
    target: Vector
    """[n] Target of the distal end: movement of the load [m], or tension [N] where `by_tension`."""
    by_tension: bool
    """Whether the target is the distal tension."""
    warnings: tuple[str, ...] = ()
    """What is implausible in the run, a sentence each."""

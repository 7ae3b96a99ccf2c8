"""What every reader returns: a recording in metres, whose frames are read anew at each pass."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import get_args, overload

from tssgeom.errors import ShapeError, TssgeomError
from tssgeom.io.formats.laboratory.units import UNITS
from tssgeom.io.formats.lengths import LengthUnit
from tssgeom.result import Result
from tssgeom.sensed_route import require_usable
from tssgeom.stream import Frame, Rejected

PER_METRE = {unit: float(f"{1.0 / UNITS[unit].factor:.15g}") for unit in get_args(LengthUnit)}
"""How many of each unit make one metre; dividing by it converts exactly rounded, where it is whole."""
GIVE_UNIT = "give --unit mm|m|cm|in|…"
"""Hint of errors where no unit is stated."""
UNTIMED = "no time: the frames are counted, one a second"
"""Warning of a recording without a clock; the tendon does not depend on the rate."""


@dataclass(frozen=True, slots=True, repr=False)
class Recording(Result):
    """One file of sensed shapes, in SI: a sequence of its frames, which are read when they are asked for.

    `recording[i]` reads the file from its beginning to that frame, unless the file holds one shape.
    """

    name: str
    """Stem of the file, with the part of it that was opened."""
    path: Path
    """The file, with the part of it that was opened."""
    unit: str
    """Unit of length in the file, such as "mm", "m" or "in"; the frames are in metres."""
    kind: str
    """Format: "jsonl", "npz", "slicer", "fcsv", "vtk", "ros2", "ndi" or "colonoscope"; of a table its
    ending, such as "csv", "parquet" or "xlsx"."""
    timed: bool
    """False for one static shape, True for frames with time."""
    frame_count: int
    """Number of frames, the rejected ones included."""
    frames: Iterable[Frame | Rejected]
    """Frames in order; a frame that cannot be read is a `Rejected` at its position."""
    warnings: tuple[str, ...] = ()
    """What to know of the file as a whole, a sentence each."""
    notes: tuple[str, ...] = ()
    """How a file of a laboratory was read, a phrase each; empty where its names are those of the formats."""

    def __iter__(self) -> Iterator[Frame | Rejected]:
        """Yield the frames in order, by a new pass over the file."""
        return iter(self.frames)

    def __len__(self) -> int:
        """Return the number of frames, the rejected ones included."""
        return self.frame_count

    @overload
    def __getitem__(self, index: int) -> Frame | Rejected: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Frame | Rejected, ...]: ...
    def __getitem__(self, index: int | slice) -> Frame | Rejected | tuple[Frame | Rejected, ...]:
        """Return a frame by its count from 0, or several; a negative count is from the end."""
        if isinstance(index, slice):
            wanted = range(self.frame_count)[index]
            last = max(wanted, default=-1)
            read = dict(islice(enumerate(self.frames), min(wanted, default=0), last + 1))
            return tuple(read[i] for i in wanted)
        at = range(self.frame_count)[index]
        if isinstance(self.frames, Sequence):
            return self.frames[at]
        return next(islice(self.frames, at, None))


class Frames(ABC):
    """Frames of one file, one at a time; each iteration is a new pass over the file."""

    __slots__ = ()

    def __iter__(self) -> Iterator[Frame | Rejected]:
        """Yield the frames in order."""
        return in_order(self.read())

    @abstractmethod
    def read(self) -> Iterable[Frame | Rejected]:
        """Yield the frames as the file holds them; `in_order` numbers them."""


def in_order(items: Iterable[Frame | Rejected]) -> Iterator[Frame | Rejected]:
    """Yield the items numbered from 0, a frame not later than the last usable one as a `Rejected`.

    The time of a frame that cannot be used does not count: it may be as wrong as the rest of it.
    """
    latest = -math.inf
    for seq, item in enumerate(items):
        if isinstance(item, Rejected):
            yield replace(item, seq=seq)
        elif latest < item.time < math.inf:
            latest = item.time if usable(item) else latest
            yield item
        else:
            yield Rejected(seq, item.time, late(item.time, latest), item.id)


def usable(frame: Frame) -> bool:
    """Whether a frame can be used, as far as that is known before the fit."""
    try:
        require_usable(frame)
    except TssgeomError:
        return False
    return True


def late(time: float, latest: float) -> str:
    """Return why a frame of this time cannot follow one of the `latest` time [s]."""
    if not math.isfinite(time):
        return f"the time of the frame is {time} s: give a finite time"
    return f"time {time:.15g} s comes after {latest:.15g} s: put the frames in order, each once"


def agreed_unit(path: Path, stated: str | None, given: str | None, hint: str) -> str:
    """Return the one unit of a file: the one that it states, or else the one of `--unit`.

    Parameters
    ----------
    path
        The file, for the message.
    stated
        The unit that the file states, if any.
    given
        The unit that the user states, if any.
    hint
        How this format states a unit, such as "name the columns x_mm,y_mm,z_mm".

    Raises
    ------
    ShapeError
        Where no unit is stated, where it is no `LengthUnit`, or where file and user disagree.
    """
    unit = stated or given
    if unit is None:
        raise ShapeError(f"{path}: the coordinates have no unit: {hint}, or {GIVE_UNIT}")
    for one in (stated, given):
        if one is not None and one not in PER_METRE:
            raise ShapeError(f"{path}: the unit is {one!r}: write mm or m")
    if stated and given and stated != given:
        raise ShapeError(f"{path}: the file is in {stated}, --unit says {given}: read it without --unit")
    return unit


def given_unit(path: Path, given: str | None, what: str) -> str:
    """Return the unit that the user states; `what`, such as "a ROS bag", is a format that cannot state one.

    Raises ShapeError where the user states none, or one that is no `LengthUnit`.
    """
    if given is None:
        raise ShapeError(f"{path}: {what} states no unit of length: {GIVE_UNIT}")
    return agreed_unit(path, None, given, "")

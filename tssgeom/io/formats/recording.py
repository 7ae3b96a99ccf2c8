"""What every reader hands on: a recording, whose frames are read anew each time they are asked for."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from tssgeom.errors import TssgeomError
from tssgeom.stream import Frame, Rejected, require_usable

UNTIMED = "no time: the frames are counted, one a second"
"""Warning of a recording without a clock; the tendon does not depend on the rate."""


@dataclass(frozen=True, slots=True)
class Recording:
    """One file of sensed shapes, in SI."""

    name: str
    """Stem of the file, with the part of it that was opened."""
    path: Path
    unit: str
    """Unit of length in the file, "m" or "mm" (of Slicer also "um"); the frames are in metres."""
    kind: str
    """Format: "csv", "jsonl", "npz", "parquet", "slicer", "fcsv", "vtk", "ros2", "ndi" or "colonoscope"."""
    timed: bool
    """False for one static shape, True for frames with time."""
    frame_count: int
    """Number of frames, the rejected ones included."""
    frames: Iterable[Frame | Rejected]
    """Frames in order; a frame that cannot be read is a `Rejected` in its place."""
    warnings: tuple[str, ...] = ()


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
    """Say why a frame of this time cannot follow one of the `latest` time [s]."""
    if not math.isfinite(time):
        return f"the time of the frame is {time} s: give a finite time"
    return f"time {time:g} s comes after {latest:g} s: put the frames in order, each once"

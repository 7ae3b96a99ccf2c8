"""Frames of a recording, each as the first pull of its tendon: `--geometry-only`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import count, islice

from tssgeom.engine import alone
from tssgeom.rig import Rig
from tssgeom.stream import Frame, FrameResult, Rejected


def first_pulls(
    frames: Iterable[Frame | Rejected], rig: Rig, *, tension_in: float
) -> Iterator[FrameResult | Rejected]:
    """Yield the result of each frame, chunk by chunk as `batch` shares them among its workers."""
    from tssgeom.io.results.tables import CHUNK

    frames = iter(frames)
    for first in count(0, CHUNK):
        chunk = list(islice(frames, CHUNK))
        if not chunk:
            return
        yield from alone(chunk, rig, tension_in=tension_in, first=first)

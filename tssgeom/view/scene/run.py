"""What one recording shows, chosen once for all its views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom.stream import FrameResult
from tssgeom.view.samples import Drawn, Ranges, drawn, front, ranges
from tssgeom.view.scene.camera import Camera, camera


@dataclass(frozen=True, slots=True)
class Run:
    """Everything that one recording shows."""

    name: str
    results: Sequence[FrameResult]
    frames: Sequence[Drawn]
    ranges: Ranges
    camera: Camera
    timed: bool

    @property
    def fronts(self) -> Sequence[float]:
        """Arc length up to which the tendon slid in each frame [m]."""
        return [front(result, frame) for result, frame in zip(self.results, self.frames, strict=True)]


def run_of(name: str, results: Sequence[FrameResult], timed: bool) -> Run:
    """Choose nodes, ranges and a camera that hold for every frame of a run."""
    frames = [drawn(result) for result in results]
    everywhere = np.concatenate([frame.position for frame in frames])
    forward = np.mean([frame.position[-1] - frame.position[0] for frame in frames], axis=0)
    limits = ranges(frames, [result.arcs for result in results])
    return Run(name, results, frames, limits, camera(everywhere, forward), timed)

"""Images of `tssgeom track` with the markers or boards that were detected in them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipelines.terminal import counted_progress
from tssgeom.atomic import replacing
from tssgeom.stream import Frame
from tssgeom.view.samples import evenly
from tssgeom.vision.boards import BoardDetection
from tssgeom.vision.cameras import Camera
from tssgeom.vision.footage import Footage
from tssgeom.vision.overlay import annotated, annotated_board, beside, encoded
from tssgeom.vision.track import Track
from tssgeom.vision.views import Sightings

_MOST_PAINTED = 500
"""Frames that are written, evenly spread [1]; chosen: a few tens of megabytes."""


@dataclass(frozen=True, slots=True)
class DetectedFootage:
    """The footage, and what was detected in it."""

    footage: Footage
    cameras: tuple[Camera, ...]
    detections: Sequence[Sequence[Sightings]]
    tracked: Track
    frames: Sequence[Frame]
    quiet: bool

    def images(self) -> Iterator[tuple[int, list[np.ndarray]]]:
        """Yield some frames evenly, each with its number and the images of all cameras with their markers."""
        selected = set(evenly(len(self.frames), _MOST_PAINTED).tolist())
        with counted_progress(1, quiet=self.quiet) as progress:
            progress.begin("drawing")
            for k, images in enumerate(self.footage):
                if k >= len(self.frames):
                    break
                if k in selected:
                    yield k, self._with_markers(k, images)
                progress.frame(len(self.frames))
            progress.end("drawing")

    def _with_markers(self, k: int, images: Sequence[np.ndarray | None]) -> list[np.ndarray]:
        frame, painted = self.tracked.frames[k], []
        for v, (image, camera) in enumerate(zip(images, self.cameras, strict=True)):
            canvas = np.zeros((camera.height, camera.width, 3), np.uint8) if image is None else image
            used = f"{int((frame.which[:, v] >= 0).sum())} of {len(frame.which)} used"
            heading = f"{camera.name}   frame {k}   t = {self.frames[k].time:.3f} s   {used}"
            markers = self.detections[k][v]
            painted.append(annotated(canvas, camera, markers, frame, v, self.tracked.ids, heading))
        return painted


def write_overlays(folder: Path, footage: DetectedFootage) -> list[str]:
    """Draw frames with the markers that were detected, all cameras side by side, and return the files.

    Raises SourceError where the disk refuses.
    """
    return [_write(folder / f"frame_{k:06d}.jpg", images) for k, images in footage.images()]


def write_picture(path: Path, footage: DetectedFootage, text: str) -> str:
    """Write a Rerun recording with the images, the markers detected in them, and the markers in space.

    Raises SourceError where the disk refuses.
    """
    from tssgeom.view.scene.track import Tracked, write_track_recording

    frames = footage.frames
    images: dict[str, list[tuple[float, bytes]]] = {camera.name: [] for camera in footage.cameras}
    for k, painted in footage.images():
        for image, shots in zip(painted, images.values(), strict=True):
            shots.append((frames[k].time, encoded(image)))
    tracked = Tracked(
        name=path.stem,
        time=np.array([frame.time for frame in frames]),
        points=np.array([frame.points for frame in frames]),
        ids=footage.tracked.ids,
        noise=np.array([np.nan if frame.noise is None else frame.noise for frame in frames]),
        summary=text,
        images=images,
    )
    with replacing(path) as draft:
        write_track_recording(draft, tracked)
    return path.as_posix()


def write_board_overlays(
    folder: Path,
    footage: Footage,
    names: Sequence[str],
    detections: Sequence[Sequence[BoardDetection | None]],
) -> list[str]:
    """Draw images with the corners of the board that were detected, all cameras side by side.

    Raises SourceError where the disk refuses.
    """
    selected = set(evenly(len(detections), _MOST_PAINTED).tolist())
    written = list[str]()
    for k, images in enumerate(footage):
        if k >= len(detections):
            break
        if k in selected:
            painted = [
                annotated_board(
                    image, board, f"{name}   image {k}   {0 if board is None else len(board.corners)} corners"
                )
                for image, board, name in zip(images, detections[k], names, strict=True)
                if image is not None
            ]
            if painted:
                written.append(_write(folder / f"board_{k:06d}.jpg", painted))
    return written


def _write(path: Path, images: Sequence[np.ndarray]) -> str:
    with replacing(path) as draft:
        draft.write_bytes(encoded(beside(images)))
    return path.as_posix()

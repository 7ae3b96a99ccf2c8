"""Images of `tssgeom track` with what was found in them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from pipelines.console import Tracker, tracking
from tssgeom.atomic import replacing
from tssgeom.stream import Frame
from tssgeom.view.samples import evenly
from tssgeom.vision.boards import BoardSeen
from tssgeom.vision.cameras import Camera
from tssgeom.vision.footage import Footage
from tssgeom.vision.overlay import beside, drawn, drawn_board, encoded
from tssgeom.vision.sightings import Sightings
from tssgeom.vision.track import Track

_MOST = 500
"""Of more frames than these, so many are drawn, evenly."""


def write_overlays(
    folder: Path,
    footage: Footage,
    cameras: tuple[Camera, ...],
    seen: Sequence[Sequence[Sightings]],
    found: Track,
    frames: Sequence[Frame],
    *,
    quiet: bool,
) -> list[str]:
    """Draw frames with the markers that were found, all cameras side by side, and return the files.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    written = list[str]()
    with tracking(1, quiet=quiet) as tracker:
        tracker.begin("drawing")
        for k, shown in _shown(footage, cameras, seen, found, frames, tracker):
            written.append(_write(folder / f"frame_{k:06d}.jpg", shown))
        tracker.end("drawing")
    return written


def write_picture(
    path: Path,
    footage: Footage,
    cameras: tuple[Camera, ...],
    seen: Sequence[Sequence[Sightings]],
    found: Track,
    frames: Sequence[Frame],
    summary: str,
    *,
    quiet: bool,
) -> str:
    """Write a Rerun recording with the images, what was found in them, and the markers in space.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    from tssgeom.view.scene.track import Tracked, write_track_recording

    images: dict[str, list[tuple[float, bytes]]] = {camera.name: [] for camera in cameras}
    with tracking(1, quiet=quiet) as tracker:
        tracker.begin("drawing")
        for k, shown in _shown(footage, cameras, seen, found, frames, tracker):
            for image, shots in zip(shown, images.values(), strict=True):
                shots.append((frames[k].time, encoded(image)))
        tracker.end("drawing")
    noise = [np.nan if frame.noise is None else frame.noise for frame in frames]
    tracked = Tracked(
        name=path.stem,
        time=np.array([frame.time for frame in frames]),
        points=np.array([frame.points for frame in frames]),
        ids=found.ids,
        noise=np.array(noise),
        summary=summary,
        images=images,
    )
    with replacing(path) as draft:
        write_track_recording(draft, tracked)
    return path.as_posix()


def _shown(
    footage: Footage,
    cameras: tuple[Camera, ...],
    seen: Sequence[Sequence[Sightings]],
    found: Track,
    frames: Sequence[Frame],
    tracker: Tracker,
) -> Iterator[tuple[int, list[np.ndarray]]]:
    """Yield some frames evenly, each with its number and the images of all cameras, markers drawn in."""
    wanted = set(evenly(len(frames), _MOST).tolist())
    for k, images in enumerate(footage):
        if k >= len(frames):
            return
        if k in wanted:
            one, shown = found.frames[k], []
            for v, (image, camera) in enumerate(zip(images, cameras, strict=True)):
                canvas = _blank(camera) if image is None else image
                heading = (
                    f"{camera.name}   frame {k}   t = {frames[k].time:.3f} s   {_count(one.which[:, v])}"
                )
                shown.append(drawn(canvas, camera, seen[k][v], one, v, found.ids, heading))
            yield k, shown
        tracker.frame(len(frames))


def write_board_overlays(
    folder: Path, footage: Footage, names: Sequence[str], seen: Sequence[Sequence[BoardSeen | None]]
) -> list[str]:
    """Draw images with the corners of the board that were found, all cameras side by side.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    wanted = set(evenly(len(seen), _MOST).tolist())
    written = list[str]()
    for k, images in enumerate(footage):
        if k >= len(seen):
            break
        if k in wanted:
            shown = [
                drawn_board(
                    image, board, f"{name}   image {k}   {0 if board is None else len(board.corners)} corners"
                )
                for image, board, name in zip(images, seen[k], names, strict=True)
                if image is not None
            ]
            if shown:
                written.append(_write(folder / f"board_{k:06d}.jpg", shown))
    return written


def _write(path: Path, images: Sequence[np.ndarray]) -> str:
    with replacing(path) as draft:
        draft.write_bytes(encoded(beside(images)))
    return path.as_posix()


def _count(which: np.ndarray) -> str:
    return f"{int((which >= 0).sum())} of {len(which)} used"


def _blank(camera: Camera) -> np.ndarray:
    return np.zeros((camera.height, camera.width, 3), np.uint8)

"""Images of `tssgeom track` with what was found in them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipelines.console import tracking
from tssgeom.io.atomic import replacing
from tssgeom.shape.markers.boards import BoardSeen
from tssgeom.shape.markers.cameras import Camera
from tssgeom.shape.markers.footage import Footage
from tssgeom.shape.markers.overlay import beside, drawn, drawn_board, encoded
from tssgeom.shape.markers.sightings import Sightings
from tssgeom.shape.markers.track import Track
from tssgeom.stream import Frame
from tssgeom.view.drawn import evenly

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
    wanted = set(evenly(len(frames), _MOST).tolist())
    written = list[str]()
    with tracking(1, quiet=quiet) as tracker:
        tracker.begin("drawing")
        for k, images in enumerate(footage):
            if k >= len(frames):
                break
            if k in wanted:
                one, shown = found.frames[k], []
                for v, (image, camera) in enumerate(zip(images, cameras, strict=True)):
                    canvas = _blank(camera) if image is None else image
                    heading = (
                        f"{camera.name}   frame {k}   t = {frames[k].time:.3f} s   {_count(one.which[:, v])}"
                    )
                    shown.append(drawn(canvas, camera, seen[k][v], one, v, found.ids, heading))
                written.append(_write(folder / f"frame_{k:06d}.jpg", shown))
            tracker.frame(len(frames))
        tracker.end("drawing")
    return written


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

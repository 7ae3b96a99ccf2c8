"""Videos, folders of images and cameras, frame by frame, several of them in step."""

from __future__ import annotations

import itertools
import re
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tssgeom.address_space import VIDEO, require_address_space
from tssgeom.errors import SettingsError, SourceError, require_file

IMAGES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm"}
_SAME_RATE = 2e-3  # relative difference of frame rates that is rounding


@dataclass(frozen=True, slots=True)
class Source:
    """One video, folder of images, image, or camera."""

    name: str
    """Stem of the file, name of the folder, or number of the camera."""
    images: tuple[Path, ...] = ()
    video: Path | None = None
    index: int | None = None
    """Number of a camera that is filming now."""
    count: int | None = None
    """Number of frames, where it is known."""
    rate: float | None = None
    """Frames each second, where the source states it [1/s]."""

    def frames(self) -> Generator[np.ndarray | None]:
        """Yield the images in order; None for an image file that cannot be read."""
        if self.images:
            for path in self.images:
                # a pipe or a device may have no end
                yield cv2.imread(str(path), cv2.IMREAD_COLOR) if path.is_file() else None
            return
        require_address_space(VIDEO, "a video")
        capture = cv2.VideoCapture(str(self.video) if self.index is None else self.index)
        try:
            while True:
                read, image = capture.read()
                if not read:
                    return
                yield image
        finally:
            capture.release()


@dataclass(frozen=True, slots=True)
class Footage:
    """Sources in step: frame k of each was taken at one time."""

    sources: tuple[Source, ...]
    rate: float | None
    """Frames each second; None where nothing states it [1/s]."""
    count: int | None
    """Frames that all sources have, where it is known."""
    warnings: tuple[str, ...] = ()

    @property
    def live(self) -> bool:
        """Whether cameras are filming now, so that no frame can be read twice."""
        return any(source.index is not None for source in self.sources)

    def __iter__(self) -> Iterator[tuple[np.ndarray | None, ...]]:
        """Yield the images of each frame, until the first source ends."""
        streams = [source.frames() for source in self.sources]
        try:
            yield from itertools.islice(zip(*streams, strict=False), self.count)
        finally:
            for stream in streams:
                stream.close()


def open_footage(given: Sequence[str | Path], rate: float | None = None) -> Footage:
    """Open sources that were filmed in step.

    Parameters
    ----------
    given
        Paths of videos, images or folders of images, or the number of a camera.
    rate
        Frames each second, for sources that state none [1/s].

    Raises
    ------
    SourceError
        Where a source cannot be read.
    SettingsError
        Where sources have different rates, or the stated rate is not positive.
    """
    sources = tuple(_source(str(one)) for one in given)
    if rate is not None and not 0 < rate < 1e6:
        raise SettingsError(f"the frame rate is {rate:g} /s: give a rate > 0 /s")
    rates = [(source.name, source.rate) for source in sources if source.rate]
    for name, other in rates[1:]:
        if rate is None and abs(other / rates[0][1] - 1.0) > _SAME_RATE:
            raise SettingsError(
                f"{name} has {other:g} frames/s, {rates[0][0]} {rates[0][1]:g}: film in step, or give --fps"
            )
    counts = [source.count for source in sources if source.count is not None]
    count = min(counts, default=None)
    warnings = ()
    if counts and max(counts) != min(counts):
        most = max(counts)
        warnings = (f"the sources have {min(counts)} to {most} frames: the first {min(counts)} are used",)
    return Footage(sources, rate or (rates[0][1] if rates else None), count, warnings)


def _source(given: str) -> Source:
    path = Path(given)
    if given.isdecimal() and not path.exists():
        return _camera(int(given))
    require_file(path)
    if not path.exists():
        raise SourceError(f"{given}: no such file, folder or camera: check the path")
    if path.is_dir():
        images = tuple(sorted((f for f in path.iterdir() if _is_image(f)), key=_natural))
        if not images:
            raise SourceError(
                f"{given}: no image in this folder: put {', '.join(sorted(IMAGES))} files there"
            )
        return Source(path.resolve().name, images, count=len(images))
    if _is_image(path):
        return Source(path.stem, (path,), count=1)
    return _video(path)


def _is_image(path: Path) -> bool:
    return path.suffix.lower() in IMAGES and not path.name.startswith(".")


def _natural(path: Path) -> list[tuple[bool, int | str]]:
    """Sort key under which frame 10 comes after frame 9."""
    parts = re.split(r"(\d+)", path.name)
    return [(part.isdecimal(), int(part) if part.isdecimal() else part) for part in parts]


def _camera(index: int) -> Source:
    capture = cv2.VideoCapture(index)
    try:
        if not capture.isOpened():
            raise SourceError(f"camera {index} cannot be opened: check that it is there and not in use")
        return Source(str(index), index=index, rate=capture.get(cv2.CAP_PROP_FPS) or None)
    finally:
        capture.release()


def _video(path: Path) -> Source:
    require_address_space(VIDEO, "a video")
    capture = cv2.VideoCapture(str(path))
    try:
        if not capture.isOpened() or not capture.grab():
            raise SourceError(f"{path}: cannot be read as a video: convert it to MP4 or AVI")
        count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        rate = float(capture.get(cv2.CAP_PROP_FPS))
        return Source(
            path.stem, video=path, count=count if count > 0 else None, rate=rate if rate > 0 else None
        )
    finally:
        capture.release()

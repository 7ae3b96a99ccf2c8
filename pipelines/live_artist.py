"""Pictures of a stream, for viewers and for files; in a process beside the stream."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tssgeom.stream import FrameResult
from tssgeom.view.scene.live import LivePicture, warm_up
from tssgeom.view.scene.writer import GrowingFile, hosted


class Artist:
    """Draws frames into a picture that viewers look at."""

    def __init__(self, picture: LivePicture) -> None:
        self._picture = picture
        self._results = list[FrameResult]()
        self._numbers = list[np.ndarray]()

    def take(self, kind: str, content: Any) -> None:
        """Take in a frame to be drawn, or the numbers of many."""
        (self._results if kind == "picture" else self._numbers).append(content)

    def flush(self) -> None:
        """Draw what has come."""
        if self._results:
            self._picture.draw(self._results)
            self._results.clear()
        if self._numbers:
            numbers = np.concatenate(self._numbers)
            self._picture.number(numbers[:, 0], numbers[:, 1:])
            self._numbers.clear()

    def finish(self) -> None:
        """Draw the rest."""
        self.flush()


class Recorder(Artist):
    """Draws into a file."""

    def __init__(self, path: Path) -> None:
        self._file = GrowingFile(path)
        super().__init__(LivePicture(self._file.recording, path.stem))

    def flush(self) -> None:
        """Draw what has come, and write it."""
        super().flush()
        self._file.write()

    def finish(self) -> None:
        """Draw and write the rest, and put the file in its place."""
        super().flush()
        self._file.finish()


def recorder(path: Path) -> Recorder:
    """Return who draws into a file, ready to draw."""
    found = Recorder(path)
    warm_up()
    return found


def viewed(port: int) -> tuple[Artist, dict[str, str]]:
    """Return who draws for viewers at a port, ready to draw, and the address for them."""
    recording, address = hosted("live", port)
    warm_up()
    return Artist(LivePicture(recording, "live")), {"address": address}

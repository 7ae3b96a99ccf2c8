"""A process beside the stream that draws, records or saves, so that neither disk nor viewer slows the stream.

    python -P -m pipelines.live.worker ROLE ARGUMENT..., with the socket of the stream as standard input

It reads messages until the stream closes the socket, and then finishes. Rerun is imported by roles that draw.
"""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from pipelines.live.kept_files import Rotation, next_recording
from pipelines.live.messages import unpacked
from pipelines.live.priorities import set_niceness
from tssgeom.errors import TssgeomError, out_of_memory
from tssgeom.io.formats.states import write_state
from tssgeom.rig import write_rig
from tssgeom.stream import FrameResult

if TYPE_CHECKING:
    from tssgeom.view.scene.live import LivePicture

_FLUSH_INTERVAL = {"record": 0.5, "view": 0.08, "save": 0.1, "rig": 0.1}
"""Time between two batches by role [s]; measured: a batch costs as much as four pictures."""
_REPORT_INTERVAL = 60.0  # s between two reports of a file that cannot be written; stated
_LAST_FLUSH = 1.0  # s, longest wait for viewers at the end; chosen: half of what the stream allows
_NICENESS = 10  # chosen: far behind the stream
_READ_INTERVAL = 0.02  # s between two readings; chosen: each takes time from the stream
_CHUNK = 1 << 20  # bytes in one reading


class Role(Protocol):
    """What a process does with its messages."""

    def take(self, kind: str, content: Any) -> None:
        """Take in one message."""
        ...

    def flush(self) -> None:
        """Do the work on the messages since the last flush."""
        ...

    def finish(self) -> None:
        """Do the work on the last messages."""
        ...


class Newest:
    """Keeps the newest of what it gets, a state or a rig, in a file, whole or not at all."""

    def __init__(self, write: Callable[..., None]) -> None:
        self._write = write
        self._content: tuple[Any, ...] | None = None

    def take(self, kind: str, content: tuple[Any, ...]) -> None:
        """Take in what is to be written."""
        self._content = content

    def flush(self) -> None:
        """Write it."""
        if self._content is not None:
            self._write(*self._content)
            self._content = None

    finish = flush


class Drawer:
    """Draws frames into a picture."""

    def __init__(self, picture: LivePicture) -> None:
        self._picture = picture
        self._results = list[FrameResult]()
        self._numbers = list[np.ndarray]()

    def take(self, kind: str, content: Any) -> None:
        """Take in a frame to draw, or the numbers of many."""
        (self._results if kind == "picture" else self._numbers).append(content)

    def flush(self) -> None:
        """Draw the frames and numbers since the last flush."""
        results, numbers = self._results, self._numbers
        self._results, self._numbers = [], []  # where they find no memory, they are lost and leave theirs
        if results:
            self._picture.draw(results)
        if numbers:
            every = np.concatenate(numbers)
            self._picture.number(every[:, 0], every[:, 1:])

    def finish(self) -> None:
        """Draw the rest, and let it reach the viewers."""
        self.flush()
        with suppress(RuntimeError):  # a viewer that does not read
            self._picture.recording.flush(timeout_sec=_LAST_FLUSH)


class Recorder(Drawer):
    """Draws into a file, and into further ones beside it where each grows too large or too old.

    Parameters
    ----------
    path
        The first file.
    rotation
        When the next one begins; None: never.
    base
        The file whose name the further ones have, with a number; the first one by default.
    """

    def __init__(self, path: Path, rotation: Rotation | None = None, base: Path | None = None) -> None:
        self._base, self._rotation = base or path, rotation or Rotation()
        self._lock, self._optimizing = ExitStack(), ThreadPoolExecutor(1)
        self._begin(path)
        super().__init__(self._picture)

    def _begin(self, path: Path) -> None:
        from tssgeom.view.scene.live import LivePicture
        from tssgeom.view.scene.writer import GrowingFile

        self._file, self._begun = GrowingFile(path), monotonic()
        self._picture = LivePicture(self._file.recording, path.stem)

    def flush(self) -> None:
        """Draw the frames and numbers since the last flush, and write them."""
        super().flush()
        self._file.write()
        if self._file.size and self._rotation.is_due(self._file.size, monotonic() - self._begun):
            self._rotate()

    def _rotate(self) -> None:
        """Let the next file begin, then finish this one: where the next cannot, this one goes on."""
        last, lock = self._file, self._lock
        with ExitStack() as stack:
            self._begin(stack.enter_context(next_recording(self._base)))
            self._lock = stack.pop_all()
        with lock:
            last.close()
        self._optimizing.submit(last.optimize)

    def finish(self) -> None:
        """Draw and write the rest, and give the file its name."""
        super().flush()
        with self._lock:
            self._file.finish()
        self._optimizing.shutdown()


def _role(name: str, argument: str, *more: str) -> tuple[Role, dict[str, Any]]:
    """Return a role that is ready for messages, and what the stream has to know of it."""
    if name in ("save", "rig"):
        return Newest(partial(write_state if name == "save" else write_rig, Path(argument))), {}
    from tssgeom.view.scene.live import LivePicture, warm_up  # here, since it takes long to load
    from tssgeom.view.scene.writer import hosted

    if name == "record":
        base, size, age = more
        recorder = Recorder(Path(argument), Rotation(float(size), float(age)), Path(base))
        warm_up()
        return recorder, {}
    recording, address = hosted("live", int(argument))
    warm_up()
    return Drawer(LivePicture(recording, "live")), {"address": address}


def _messages(sock: socket.socket, flush: Callable[[], None], pause: float) -> Iterator[tuple[str, Any]]:
    """Yield messages until the stream closes the socket, flushing every so often."""
    data, due = bytearray(), monotonic() + pause
    while True:
        sleep(_READ_INTERVAL)
        if select.select([sock], [], [], max(due - monotonic(), 0.0))[0]:
            chunk = sock.recv(_CHUNK)
            if not chunk:
                return
            data += chunk
        yield from unpacked(data)
        if monotonic() >= due:
            flush()
            due = monotonic() + pause


def main(role_name: str, *arguments: str) -> int:
    """Serve the stream until it ends; return the exit status."""
    # the stream ends it by closing the socket; a terminal may not stop it, even where it writes to it
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTTOU):
        signal.signal(number, signal.SIG_IGN)
    sock = socket.socket(fileno=0)

    def report(status: dict[str, Any]) -> None:
        with suppress(OSError):
            sock.sendall(json.dumps(status).encode() + b"\n")

    try:
        role, details = _role(role_name, *arguments)
    except TssgeomError as error:
        report({"failed": str(error)})
        return 1
    set_niceness(os.getpid(), os.nice(0) + _NICENESS)  # not before: the stream waits until it is ready
    report({"ready": True} | details)

    failed_at = list[float]()  # when failures were reported [s]

    def attempt(work: Callable[[], None]) -> None:
        try:
            work()
        except (TssgeomError, MemoryError) as error:
            if not failed_at or monotonic() > failed_at[-1] + _REPORT_INTERVAL:
                failed_at.append(monotonic())
                reason = out_of_memory(error) if isinstance(error, MemoryError) else error
                report({"failed": str(reason)})

    for kind, content in _messages(sock, lambda: attempt(role.flush), _FLUSH_INTERVAL[role_name]):
        role.take(kind, content)
    attempt(role.finish)
    return 1 if failed_at else 0


if __name__ == "__main__":
    os._exit(main(*sys.argv[1:]))  # all is written, and Rerun would take half a second to end

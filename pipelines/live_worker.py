"""A process beside the stream that draws, records or saves, so that neither disk nor viewer slows the stream.

    python -P -m pipelines.live_worker ROLE ARGUMENT, with the socket of the stream as standard input

It reads messages until the stream closes the socket, whether that ends well or not, and then finishes.
"""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep
from typing import Any, Protocol

from pipelines.live_messages import unpacked
from tssgeom.errors import TssgeomError
from tssgeom.io.formats.states import write_state
from tssgeom.tendon.state import TendonState

_FLUSH = {"record": 0.5, "view": 0.08, "save": 0.1}  # s between two batches: one costs as much as four
_NICER = 10
_REST = 0.02  # s between two readings
_CHUNK = 1 << 20


class Role(Protocol):
    """What a worker does with what it is sent."""

    def take(self, kind: str, content: Any) -> None:
        """Take in one message."""
        ...

    def flush(self) -> None:
        """Do what is to be done with the messages since the last time."""
        ...

    def finish(self) -> None:
        """Do it for the last time."""
        ...


class Saver:
    """Keeps the newest state of the tendon on disk."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._state: TendonState | None = None

    def take(self, kind: str, content: Any) -> None:
        """Take in a state."""
        self._state = content

    def flush(self) -> None:
        """Write the newest state, whole or not at all."""
        if self._state is not None:
            write_state(self._path, self._state)
            self._state = None

    finish = flush


def _role(name: str, argument: str) -> tuple[Role, dict[str, Any]]:
    """Return the worker of a role, and what it has to say when it is ready."""
    if name == "save":
        return Saver(Path(argument)), {}
    from pipelines import live_artist  # here, since it takes long to load

    if name == "record":
        return live_artist.recorder(Path(argument)), {}
    return live_artist.viewed(int(argument))


def _messages(sock: socket.socket, flush: Callable[[], None], pause: float) -> Iterator[tuple[str, Any]]:
    """Yield messages until the stream closes the socket, flushing every so often."""
    data, due = bytearray(), monotonic() + pause
    while True:
        sleep(_REST)  # many messages at once: each waking takes time from the stream
        if select.select([sock], [], [], max(due - monotonic(), 0.0))[0]:
            chunk = sock.recv(_CHUNK)
            if not chunk:
                return
            data += chunk
        yield from unpacked(data)
        if monotonic() >= due:
            flush()
            due = monotonic() + pause


def main(role_name: str, argument: str) -> int:
    """Serve the stream until it ends; return the exit status."""
    # the stream tells the end by closing the socket; a terminal may not stop what is told on it
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGTTOU):
        signal.signal(number, signal.SIG_IGN)
    with suppress(OSError):
        os.nice(_NICER)
    sock = socket.socket(fileno=0)

    def say(what: dict[str, Any]) -> None:
        with suppress(OSError):
            sock.sendall(json.dumps(what).encode() + b"\n")

    try:
        role, said = _role(role_name, argument)
    except TssgeomError as error:
        say({"failed": str(error)})
        return 1
    say({"ready": True} | said)

    failures = list[str]()

    def guarded(work: Callable[[], None]) -> None:
        try:
            work()
        except TssgeomError as error:
            failures.append(str(error))
            say({"failed": str(error)})

    for kind, content in _messages(sock, lambda: guarded(role.flush), _FLUSH[role_name]):
        role.take(kind, content)
    guarded(role.finish)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2]))

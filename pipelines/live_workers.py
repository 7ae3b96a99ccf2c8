"""The processes beside a stream, as the stream sees them: they are offered messages and never waited for."""

from __future__ import annotations

import json
import selectors
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from time import monotonic
from typing import Any

import numpy as np

from pipelines.background import keep_back
from pipelines.live_messages import packed
from tssgeom.errors import SourceError
from tssgeom.io.network.channel import Channel
from tssgeom.stream import FrameResult
from tssgeom.tendon.state import TendonState
from tssgeom.view.samples import numbers_of

_START_LIMIT = 60.0  # s in which a process has to be ready
_END_LIMIT = 30.0  # s in which it has to finish
_BACKLOG = 1 << 23  # bytes that wait for a process at most
_BEHIND = 1 << 18  # bytes that wait for a process which falls behind
_CHUNK = 1 << 16
_STATES = 5.0  # per second, saved at most
_NUMBERS = 0.05  # s of numbers in one message


class Worker:
    """One process beside the stream.

    Parameters
    ----------
    selector
        Calls back what is registered with it.
    role, argument
        What it does; see `pipelines.live_worker`.
    tell
        Called with a sentence for the user.
    """

    def __init__(
        self, selector: selectors.BaseSelector, role: str, argument: str, tell: Callable[[str], object]
    ) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            command = [sys.executable, "-P", "-m", "pipelines.live_worker", role, argument]
            # not in a session of its own: Linux shares cores between sessions, whatever their niceness
            self._process = subprocess.Popen(
                command, stdin=theirs.fileno(), stdout=subprocess.DEVNULL, process_group=0
            )
        self.role, self.address = role, ""
        self.ready, self.failure, self.ended = False, "", False
        self.lost = 0
        self._kept_back, self._may_wait = False, role != "save"
        self._tell, self._said = tell, b""
        self._channel = Channel(selector, ours, self._heard, self._gone, _BACKLOG)

    def offer(self, message: bytes) -> None:
        """Send a message if there is room for it; otherwise it is lost, and counted."""
        if self.ended:
            return
        self.lost += not self._channel.send(message)
        self.keep_back(self._channel.waiting < (_BEHIND if self._kept_back else 1))

    def keep_back(self, wanted: bool) -> None:
        """Let it run only where a core is idle, or as any other."""
        if self._may_wait and wanted != self._kept_back:
            self._kept_back = wanted
            keep_back(self._process.pid, wanted)

    @property
    def waiting(self) -> bool:
        """Whether it still has to take something."""
        return self._channel.open and self._channel.waiting > 0

    def hang_up(self) -> None:
        """Let it finish: no message follows."""
        self.keep_back(False)
        if self._channel.open:
            self._channel.sock.shutdown(socket.SHUT_WR)

    def join(self) -> bool:
        """Wait until it has finished; return whether all went well."""
        try:
            self._process.wait(_END_LIMIT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._tell(f"{self.role}: did not finish within {_END_LIMIT:g} s and was ended")
        self._hear_out()
        self._channel.close()
        return self._process.returncode == 0

    def _hear_out(self) -> None:
        """Take in what a process that has ended said last."""
        with suppress(OSError):  # also where nothing is left
            while self._channel.open and (data := self._channel.sock.recv(_CHUNK)):
                self._heard(data)

    def _heard(self, data: bytes) -> None:
        *lines, self._said = (self._said + data).split(b"\n")
        for line in lines:
            said: dict[str, Any] = json.loads(line)
            self.ready |= bool(said.get("ready"))
            self.address = said.get("address", self.address)
            if "failed" in said:
                self.failure = said["failed"]
                if self.ready:
                    self._tell(self.failure)

    def _gone(self) -> None:
        if not self.failure and not self.ended:
            self.failure = f"{self.role}: its process has ended; the stream goes on without it"
            if self.ready:
                self._tell(self.failure)
        self.ended = True


@dataclass(slots=True)
class Allowance:
    """So many pictures a second, and a number of them at once."""

    rate: float
    burst: float
    _left: float = field(default=0.0)
    _since: float = field(default_factory=monotonic)

    def __post_init__(self) -> None:
        self._left = self.burst

    def granted(self, now: float) -> bool:
        """Whether there may be one more."""
        self._left = min(self._left + self.rate * (now - self._since), self.burst)
        self._since = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


@dataclass(slots=True)
class Artists:
    """Workers that draw: numbers of every frame, and as many pictures as each is allowed."""

    workers: Sequence[tuple[Worker, Allowance]]
    """Those who are allowed more first: the others get some of the same pictures."""
    _numbers: list[tuple[float, ...]] = field(default_factory=list)
    _due: float = 0.0

    def take(self, result: FrameResult, now: float) -> None:
        """Take in an answered frame."""
        self._numbers.append((result.frame.time, *numbers_of(result)))
        chosen = list[Worker]()
        for worker, allowance in self.workers:
            if not allowance.granted(now):
                break
            chosen.append(worker)
        if chosen:
            _offer(chosen, "picture", result.strip())
        if now >= self._due:
            self.flush()
            self._due = now + _NUMBERS

    def flush(self) -> None:
        """Send the numbers that have come together."""
        if self._numbers:
            _offer([worker for worker, _ in self.workers], "numbers", np.array(self._numbers))
            self._numbers.clear()


@dataclass(slots=True)
class Keeper:
    """A worker that saves the tendon's state."""

    worker: Worker
    _due: float = 0.0
    _newest: TendonState | None = None

    def take(self, result: FrameResult, now: float) -> None:
        """Take in an answered frame."""
        self._newest = result.state
        if now >= self._due:
            self.flush()
            self._due = now + 1.0 / _STATES

    def flush(self) -> None:
        """Send the newest state."""
        if self._newest is not None:
            _offer([self.worker], "state", self._newest)
            self._newest = None


def _offer(workers: Sequence[Worker], kind: str, content: object) -> None:
    """Offer one message to all of them, packed once."""
    if any(not worker.ended for worker in workers):
        message = packed(kind, content)
        for worker in workers:
            worker.offer(message)


def await_ready(selector: selectors.BaseSelector, workers: Sequence[Worker]) -> None:
    """Wait until all workers are ready.

    Raises
    ------
    SourceError
        Where one of them cannot do its work.
    """
    end = monotonic() + _START_LIMIT
    while not all(worker.ready for worker in workers):
        for worker in workers:
            if worker.failure or monotonic() > end:
                raise SourceError(worker.failure or f"{worker.role}: not ready in {_START_LIMIT:g} s")
        for key, events in selector.select(0.2):
            key.data(events)


def finished(selector: selectors.BaseSelector, workers: Sequence[Worker]) -> bool:
    """Let all workers take what waits, and finish; return whether all went well."""
    end = monotonic() + _END_LIMIT
    while any(worker.waiting for worker in workers) and monotonic() < end:
        for key, events in selector.select(0.2):
            key.data(events)
    for worker in workers:
        worker.hang_up()
    sound = [worker.join() for worker in workers]
    return all(sound)

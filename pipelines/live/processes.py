"""The processes beside a stream: the stream sends them messages and never waits for them."""

from __future__ import annotations

import json
import math
import os
import selectors
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from time import monotonic
from typing import Any

import numpy as np

from pipelines.live.messages import packed
from pipelines.live.priorities import set_idle_priority, set_niceness
from tssgeom.adapt.follower import Follower
from tssgeom.errors import SourceError
from tssgeom.io.formats.states import Origin
from tssgeom.io.network.channel import Channel
from tssgeom.stream import Carried, FrameResult
from tssgeom.view.samples import numbers_of

_CHUNK = 1 << 16  # bytes in one reading


@dataclass(frozen=True, slots=True)
class ProcessLimits:
    """What a process beside the stream gets; no answer of the stream depends on it. All chosen."""

    start: float = 180.0
    """Time in which it has to be ready [s]: it takes 3 s, and a minute beside ten other processes."""
    start_reported: float = 2.0
    """Time after which a line states what the start waits for [s]."""
    end: float = 60.0
    """Time in which all of them have to finish [s]: a long recording is still put in order."""
    end_view: float = 2.0
    """The same for one that writes no file [s]."""
    poll: float = 0.2
    """Longest wait for its messages at start and end [s]."""
    most_waiting: int = 1 << 23
    """Bytes that wait for it at most; further messages are lost and counted."""
    late: int = 1 << 18
    """Waiting bytes from which it is late and leaves idle priority."""
    state_interval: float = 0.2
    """Time between two states to save [s]."""
    numbers_interval: float = 0.05
    """Time between two messages of numbers [s]."""


_LIMITS = ProcessLimits()


class SideProcess:
    """One process beside the stream.

    Parameters
    ----------
    selector
        Calls back what is registered with it.
    role, arguments
        Its work; see `pipelines.live.worker`.
    report
        Called with a sentence for the user.
    """

    def __init__(
        self,
        selector: selectors.BaseSelector,
        role: str,
        arguments: Sequence[str],
        report: Callable[[str], object],
    ) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            command = [sys.executable, "-P", "-m", "pipelines.live.worker", role, *arguments]
            # not in a session of its own: Linux shares cores between sessions, whatever their niceness
            self._process = subprocess.Popen(
                command, stdin=theirs.fileno(), stdout=subprocess.DEVNULL, process_group=0
            )
        self.role, self.address = role, ""
        self.ready, self.failure, self.ended = False, "", False
        self._finishes = self._killed = False
        self.lost = 0
        self._idle, self._may_idle = False, role not in ("save", "rig")
        self._report, self._unread = report, b""
        self._channel = Channel(selector, ours, self._read, self._closed, _LIMITS.most_waiting)

    def send(self, message: bytes) -> None:
        """Send a message if there is room for it; otherwise it is lost, and counted."""
        if self.ended:
            return
        if not self._channel.send(message):
            if not self.lost:
                self._report(f"{self.role}: it is slower than the stream and begins to lose messages")
            self.lost += 1
        self._set_idle(self._channel.waiting < (_LIMITS.late if self._idle else 1))

    def _set_idle(self, idle: bool) -> None:
        """Let it run only where a core is idle, or as any other."""
        if self._may_idle and idle != self._idle:
            self._idle = idle
            set_idle_priority(self.pid, idle)

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def waiting(self) -> bool:
        """Whether messages still wait for it."""
        return self._channel.open and self._channel.waiting > 0

    def end_messages(self) -> None:
        """Let it finish: no message follows."""
        self._finishes = True
        if self._channel.open:
            self._channel.sock.shutdown(socket.SHUT_WR)

    def resume(self) -> None:
        """Let it go on where it was stopped, or ran only where a core is idle: it has to finish."""
        self._set_idle(False)
        set_niceness(self.pid, os.nice(0))
        self._process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        """End it now: it has nothing to finish."""
        self._killed = True
        self._process.kill()

    def join(self, begun: float | None = None) -> bool:
        """Wait until it has finished, which it has `begun` then [s] or now; return whether all went well."""
        begun = monotonic() if begun is None else begun
        allowed = _LIMITS.end_view if self.role == "view" else _LIMITS.end
        while self._process.poll() is None and monotonic() < begun + allowed:
            self.resume()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_LIMITS.poll)
        if self._process.poll() is None:
            self.kill()
            self._process.wait()
            self._report(f"{self.role}: did not finish within {allowed:g} s and was ended")
        self._read_rest()
        self._channel.close()
        if self.lost:
            self._report(
                f"{self.role}: {self.lost} messages were lost, as it was slower than the stream: what it "
                "wrote lacks these frames; replay the frames, or give it a free core or a faster disk"
            )
        if self._process.returncode and not (self.failure or self._killed):
            self._report(f"{self.role}: its process has ended unfinished: the last of what it wrote may lack")
        return self._process.returncode == 0

    def _read_rest(self) -> None:
        """Read the last lines of a process that has ended."""
        with suppress(OSError):  # also where nothing is left
            while self._channel.open and (data := self._channel.sock.recv(_CHUNK)):
                self._read(data)

    def _read(self, data: bytes) -> None:
        *lines, self._unread = (self._unread + data).split(b"\n")
        for line in lines:
            status: dict[str, Any] = json.loads(line)
            self.ready |= bool(status.get("ready"))
            self.address = status.get("address", self.address)
            if "failed" in status:
                self.failure = status["failed"]
                if self.ready:
                    self._report(self.failure)

    def _closed(self) -> None:
        if not self.failure and not self.ended and not self._finishes:
            self.failure = f"{self.role}: its process has ended; the stream goes on without it"
            if self.ready:
                self._report(self.failure)
        self.ended = True


@dataclass(slots=True)
class TokenBucket:
    """Allows so many pictures a second, and a number of them at once."""

    rate: float
    """Tokens a second [1/s]."""
    burst: float
    """Tokens that a full bucket holds [1]."""
    _left: float = field(default=0.0)
    _since: float = field(default_factory=monotonic)

    def __post_init__(self) -> None:
        self._left = self.burst

    def take(self, now: float) -> bool:
        """Take a token at a time [s]; return whether there was one."""
        self._left = min(self._left + self.rate * (now - self._since), self.burst)
        self._since = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


@dataclass(slots=True)
class PictureFeed:
    """Sends processes that draw the numbers of every frame, and as many pictures as their buckets allow."""

    processes: Sequence[tuple[SideProcess, TokenBucket]]
    """The one with the highest rate first: the others get some of the same pictures."""
    _numbers: list[tuple[float, ...]] = field(default_factory=list)
    _due: float = 0.0

    def take(self, result: FrameResult, now: float) -> None:
        """Take in an answered frame."""
        self._numbers.append((result.frame.time, *numbers_of(result)))
        drawing = list[SideProcess]()
        for process, bucket in self.processes:
            if not bucket.take(now):
                break
            drawing.append(process)
        if drawing:
            send(drawing, "picture", result.strip())
        if now >= self._due:
            self.flush()
            self._due = now + _LIMITS.numbers_interval

    def finish(self) -> None:
        """Send the last numbers."""
        self.flush()

    def flush(self) -> None:
        """Send the numbers since the last message."""
        if self._numbers:
            send([process for process, _ in self.processes], "numbers", np.array(self._numbers))
            self._numbers.clear()


@dataclass(slots=True)
class StateFeed:
    """Sends the newest state of the tendon to the process that saves it."""

    process: SideProcess
    origin: Origin
    follower: Follower | None = None
    """Its filter is saved with the tendon."""
    _due: float = 0.0
    _newest: Carried | None = None

    def take(self, result: FrameResult, now: float) -> None:
        """Take in an answered frame."""
        self._newest = result.carried
        if now >= self._due and not self.process.waiting:  # an older state would delay the newest one
            self.flush()
            self._due = now + _LIMITS.state_interval

    def finish(self) -> None:
        """Send the last state."""
        self.flush()

    def flush(self) -> None:
        """Send the newest state."""
        if self._newest is not None:
            followed = None if self.follower is None else self.follower.saved()
            send([self.process], "state", (self._newest, followed, self.origin))
            self._newest = None


def send(processes: Sequence[SideProcess], kind: str, content: object) -> None:
    """Send one message to all of them, packed once."""
    if any(not process.ended for process in processes):
        message = packed(kind, content)
        for process in processes:
            process.send(message)


def await_ready(
    selector: selectors.BaseSelector, processes: Sequence[SideProcess], report: Callable[[str], object]
) -> None:
    """Wait until all processes are ready, and report what takes long.

    Raises SourceError where one of them cannot do its work.
    """
    end, reported = monotonic() + _LIMITS.start, monotonic() + _LIMITS.start_reported
    while late := [process for process in processes if not process.ready]:
        if monotonic() > reported:
            report(f"the stream waits for processes that start: {', '.join(one.role for one in late)}")
            reported = math.inf
        for process in processes:
            if process.failure or (monotonic() > end and process in late):
                raise SourceError(process.failure or f"{process.role}: not ready in {_LIMITS.start:g} s")
        _call_back(selector)


def finish_all(selector: selectors.BaseSelector, processes: Sequence[SideProcess]) -> bool:
    """Let each process take its messages and finish, or end it where it is not ready yet; return success."""
    begun = monotonic()
    for process in processes:
        process.resume() if process.ready else process.kill()
    left = [*processes]
    while left:
        over = monotonic() > begun + _LIMITS.end
        for process in [one for one in left if over or not one.waiting]:
            process.end_messages()
            left.remove(process)  # one that is done waits for no slower one
        _call_back(selector, 0.0 if not left else _LIMITS.poll)
    ended_well = [process.join(begun) for process in processes]  # each of them, even after one that failed
    return all(ended_well)


def _call_back(selector: selectors.BaseSelector, wait: float = _LIMITS.poll) -> None:
    for key, events in selector.select(wait):
        key.data(events)

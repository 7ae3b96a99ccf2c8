"""The stream that is attacked, and its good sender: a frame each 10 ms, each of which needs its answer."""

from __future__ import annotations

import gc
import json
import multiprocessing
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise
from typing import Any

from tests.live_process import SWAY_PERIOD, Live, arriving, line, points_mm, retimed

PERIOD = 0.01
"""Time between good frames [s]; the goal of the stream."""
_HANG = 2.0  # s without an answer that count as a hang; the goal of the stream
_GIVEN_UP = 20.0  # s until a reaction counts as missing; chosen
_BEGIN = 1000.0  # s on the clock of the good sender


def hang(more: float = 0.0) -> float:
    """Return the time that counts as a hang [s], `more` than elsewhere; longer where others use the cores."""
    return (_HANG + more) * max(os.getloadavg()[0] / (os.cpu_count() or 1), 1.0)


@contextmanager
def beside(work: Callable[[], object]) -> Iterator[None]:
    """Do work in another process, which must not take the interpreter from the good sender."""

    def begun() -> None:
        if hasattr(os, "SCHED_OTHER"):  # also where good sender and stream have a priority
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        work()

    worker = multiprocessing.get_context("fork").Process(target=begun, daemon=True)
    worker.start()
    try:
        yield
    finally:
        worker.kill()
        worker.join()


class Target:
    """A running stream, all lines that it has sent, and the good sender."""

    def __init__(self, stream: Live) -> None:
        self.stream = stream
        self.lines: list[dict[str, Any]] = []
        self.sent: dict[str, float] = {}
        self.answers: dict[str, float] = {}
        """When the answer to each good frame came [s]."""
        self._arrived = threading.Condition()
        self._ending = threading.Event()
        self._good = [line(points_mm(60, PERIOD * k), 0.0) for k in range(round(SWAY_PERIOD / PERIOD))]
        gc.disable()  # it would stop the good sender for 70 ms, with so many lines kept
        sink, self._source = stream.reader().sock, stream.source()
        self._threads = [
            threading.Thread(target=self._read, args=(sink,), daemon=True),
            threading.Thread(target=self._send, daemon=True),
        ]
        for thread in self._threads:
            thread.start()
        self.reaction(lambda one: "segments" in one)

    def reaction(self, wanted: Callable[[dict[str, Any]], bool], begin: int = 0) -> bool:
        """Wait for a line that is wanted, among those from a count on."""
        until = time.monotonic() + _GIVEN_UP
        with self._arrived:
            while (left := until - time.monotonic()) > 0.0:
                if any(map(wanted, self.lines[begin:])):
                    return True
                begin = len(self.lines)
                self._arrived.wait(min(left, 0.5))
        return False

    def end(self) -> None:
        """Stop the good sender, and wait for its last answers."""
        self._ending.set()
        self._threads[1].join(_GIVEN_UP)
        last = next(reversed(self.sent))
        self.reaction(lambda one: one.get("id") == last)
        gc.enable()

    def missing(self) -> int:
        """Return how many good frames have no answer and are not counted as dropped."""
        dropped = max((one["dropped"] for one in self.lines if "dropped" in one), default=0)
        return max(len(self.sent) - len(self.answers) - dropped, 0)

    def summary(self, begin: int = 0) -> str:
        """Return how many good frames from a count on have an answer, and how long it took."""
        sent = [name for name in list(self.sent)[begin:] if name in self.answers or self._is_old(name)]
        times = sorted(self.answers[name] - self.sent[name] for name in sent if name in self.answers)
        if not times:
            return f"{len(sent)} sent, none with an answer"
        high = 1e3 * times[int(0.99 * len(times))]
        return f"{len(sent)} sent, {len(times) / len(sent):.1%} with an answer, p99 {high:.1f} ms"

    def _is_old(self, name: str) -> bool:
        return time.monotonic() - self.sent[name] > 1.0

    def longest_silence(self) -> float:
        """Return the longest time without an answer to a good frame [s]."""
        times = sorted(self.answers.values())
        return max((b - a for a, b in pairwise(times)), default=_GIVEN_UP)

    def _read(self, sink: socket.socket) -> None:
        with suppress(OSError, json.JSONDecodeError):
            for now, lines in arriving(sink):
                for content in map(json.loads, lines):
                    if str(name := content.get("id", "")).startswith("good") and "segments" in content:
                        self.answers[name] = now
                    self.lines.append(content)
                with self._arrived:
                    self._arrived.notify_all()

    def _send(self) -> None:
        count, first = 0, time.monotonic()
        with suppress(OSError):
            while not self._ending.wait(max(first + PERIOD * count - time.monotonic(), 0.0)):
                text = retimed(self._good[count % len(self._good)], _BEGIN + PERIOD * count)
                name = f"good {count}"
                self.sent[name] = time.monotonic()
                self._source.sendall(text[:-2] + f',"id":"{name}"}}\n'.encode())
                count += 1


def said(sock: socket.socket) -> bytes:
    """Return all that a peer gets until it is cut off or nothing comes."""
    data = b""
    sock.settimeout(3.0)
    with suppress(OSError):
        while chunk := sock.recv(1 << 16):
            data += chunk
    return data

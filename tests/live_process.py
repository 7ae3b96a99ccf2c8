"""A stream in a process of its own, frames of a moving endoscope as lines of JSON, and malformed lines."""

from __future__ import annotations

import json
import queue
import re
import signal
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from time import monotonic
from typing import IO, Any

import numpy as np

from tests.known_routes import harmonic_course, of_arcs, truth
from tssgeom.route.synthetic import Course

_SWAY = 0.02  # of all curvatures, to both sides
SWAY_PERIOD = 2.0
"""Time in which the route of `points_mm` sways to both sides and back [s]."""
_PULLS = 3.0  # s, period of the tension
_ARCS_OF_ONE = 16  # of the random route, since fewer arcs take less time
_DIGITS = 4  # after the point, in mm

_WRONG = {
    "truncated JSON": b'{"t": 1.0, "unit": "mm", "points": [[1,2,3],[4,5',
    "NaN": b'{"t": 1.0, "unit": "mm", "points": [[NaN,2,3],[4,5,6],[7,8,9],[1,1,1]]}',
    "too large a number": b'{"t": 1.0, "unit": "mm", "points": [[1e999,2,3],[4,5,6],[7,8,9],[1,1,1]]}',
    "infinite time": b'{"t": 1e999, "unit": "mm", "points": [[1,2,3],[4,5,6],[7,8,9],[1,1,1]]}',
    "wrong unit": b'{"t": 1.0, "unit": "inch", "points": [[1,2,3],[4,5,6],[7,8,9],[1,1,1]]}',
    "no unit": b'{"t": 1.0, "points": [[1,2,3],[4,5,6],[7,8,9],[1,1,1]]}',
    "no time": b'{"unit": "mm", "points": [[1,2,3],[4,5,6],[7,8,9],[1,1,1]]}',
    "no points": b'{"t": 1.0, "unit": "mm", "points": []}',
    "ragged points": b'{"t": 1.0, "unit": "mm", "points": [[1,2,3],[4,5],[7,8,9],[1,1,1]]}',
    "text for a number": b'{"t": "now", "unit": "mm", "points": [[1,2,3],[4,5,6],[7,8,9],[1,1,1]]}',
    "negative tension": None,
    "deep nesting": b'{"t": 1.0, "unit": "mm", "x": ' + b"[" * 100_000 + b"]" * 100_000 + b"}",
    "binary noise": np.random.default_rng(0).bytes(400).replace(b"\n", b" "),
    "no object": b"[1, 2, 3]",
    "too many points": b'{"t": 1.0, "unit": "m", "points": [' + b"[0,0,0]," * 60_000 + b"[1,1,1]]}",
}


ROUTES = ("7 pieces", "harmonics")
"""Those of `points_mm`: one of pieces and a smooth one."""


def points_mm(n: int, time: float, seed: int = 0, noise: float = 5e-4, route: str = ROUTES[0]) -> np.ndarray:
    """Noisy points [n, 3] of a route that sways [mm]; `noise` of each coordinate [m]."""
    course = _course(route)
    sway = 1.0 + _SWAY * np.sin(2 * np.pi * time / SWAY_PERIOD)
    swayed = of_arcs(Course(course.length, sway * course.bend), piecewise=True)
    positions = swayed.position(np.linspace(0.0, course.total_length, n))
    return 1e3 * (positions + noise * np.random.default_rng(seed).standard_normal((n, 3)))


@cache
def _course(route: str) -> Course:
    """Pieces as they are, a smooth route as arcs so short that their steps are far below the noise."""
    if pieces := truth(route, np.random.default_rng(0)).course:
        return pieces
    fine, short = harmonic_course(np.random.default_rng(0)), _ARCS_OF_ONE
    return Course(short * fine.length[::short], fine.bend[short // 2 :: short])


def line(points: np.ndarray, time: float, **more: object) -> bytes:
    """Write one frame, with the tension of a slow pull and release unless `more` brings a drive."""
    pull = round(8.0 + 6.0 * float(np.sin(2 * np.pi * time / _PULLS)), 4)
    content = {"t": round(time, 6), "points": np.round(points, _DIGITS).tolist(), "unit": "mm"}
    content |= {"tension_in_N": pull} | more
    return json.dumps(content, separators=(",", ":")).encode() + b"\n"


def lines(n: int, count: int, rate: float, route: str = ROUTES[0]) -> list[bytes]:
    """Frames at a rate [Hz], the first at time 0."""
    return [line(points_mm(n, i / rate, i, route=route), i / rate) for i in range(count)]


def retimed(text: bytes, time: float) -> bytes:
    """Return a frame of `line` with another time [s]."""
    return b'{"t":%.6f,' % time + text.partition(b",")[2]


def malformed() -> Iterator[tuple[str, bytes]]:
    """Yield each kind of bad line with its name."""
    good = line(points_mm(30, 0.0), 1.0, tension_in_N=-3.0)
    for name, text in _WRONG.items():
        yield name, (good.rstrip() if text is None else text)


PATIENCE = 120.0
"""Longest wait for anything that has to come [s]."""
START = [sys.executable, "-c", "from pipelines.cli import main; main()", "live"]

_ADDRESS = re.compile(r"(source|sink|view) (\S+?)(?:,|$)")


class Live:
    """A running stream, and its lines on stderr."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = process
        self.errors: list[str] = []
        self._lines: queue.Queue[str | None] = queue.Queue()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()
        self.addresses: list[tuple[str, str]] = []

    def await_ready(self) -> None:
        """Wait until it is ready, and note its addresses."""
        self.addresses = _ADDRESS.findall(self.said("ready").removeprefix("ready: "))

    def said(self, text: str) -> str:
        """Wait for the next line on stderr that holds `text`, and return it."""
        end = monotonic() + PATIENCE
        while monotonic() < end:
            line = self._lines.get(timeout=PATIENCE)
            if line is None:
                break
            if text in line:
                return line
        raise AssertionError(f"{text!r} was not said: {self.errors[-5:]}")

    def port(self, what: str, scheme: str) -> int:
        """Port of a source or a sink."""
        matches = [text for kind, text in self.addresses if kind == what and text.startswith(scheme)]
        return int(matches[0].rpartition(":")[2])

    def source(self, scheme: str = "tcp") -> socket.socket:
        """Connect to a source."""
        kind = socket.SOCK_STREAM if scheme == "tcp" else socket.SOCK_DGRAM
        sock = socket.socket(socket.AF_INET, kind)
        sock.connect(("127.0.0.1", self.port("source", scheme)))
        if scheme == "tcp":
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return sock

    def reader(self) -> Reader:
        """Connect to the TCP sink."""
        return Reader(socket.create_connection(("127.0.0.1", self.port("sink", "tcp")), PATIENCE))

    @property
    def output(self) -> IO[bytes]:
        """Its standard output."""
        assert self.process.stdout is not None
        return self.process.stdout

    @property
    def input(self) -> IO[bytes]:
        """Its standard input."""
        assert self.process.stdin is not None
        return self.process.stdin

    @property
    def alive(self) -> bool:
        """Whether it still runs."""
        return self.process.poll() is None

    def memory(self) -> float:
        """Resident memory [MiB]."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        matches = re.search(r"VmRSS:\s+(\d+) kB", status)
        return int(matches[1]) / 1024 if matches else 0.0

    def children(self) -> list[int]:
        """Process ids of the processes beside the stream."""
        text = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text()
        return [int(number) for number in text.split()]

    def stop(self, number: int = signal.SIGTERM) -> int:
        """End it with a signal; return its exit status."""
        self.process.send_signal(number)
        return self.process.wait(PATIENCE)

    def close(self) -> None:
        """End it, if it still runs, and let go of its pipes."""
        if self.alive:
            self.process.kill()
        self.process.wait(PATIENCE)
        self._listener.join(PATIENCE)
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with suppress(BrokenPipeError):
                    pipe.close()

    def _listen(self) -> None:
        assert self.process.stderr is not None
        with self.process.stderr as errors:
            for line in errors:
                self.errors.append(line.decode().rstrip("\n"))
                self._lines.put(self.errors[-1])
        self._lines.put(None)


def arriving(sock: socket.socket) -> Iterator[tuple[float, list[bytes]]]:
    """Yield when each piece of a stream came [s], and the lines that it ends, until the peer closes it."""
    data = b""
    while chunk := sock.recv(1 << 20):
        now = monotonic()
        *lines, data = (data + chunk).split(b"\n")
        yield now, lines


class Reader:
    """A client that reads answers."""

    def __init__(self, sock: socket.socket) -> None:
        self.sock = sock
        self._lines, self._rest = deque[bytes](), b""

    def next(self) -> dict[str, Any]:
        """Wait for the next line, whatever its kind."""
        while not self._lines:
            chunk = self.sock.recv(1 << 18)
            if not chunk:
                raise EOFError
            *lines, self._rest = (self._rest + chunk).split(b"\n")
            self._lines.extend(lines)
        return json.loads(self._lines.popleft())

    def answer(self) -> dict[str, Any]:
        """Wait for the next line that answers a frame."""
        while (content := self.next()).get("stale") is True:
            pass
        return content

    def until(self, key: str, value: Any) -> list[dict[str, Any]]:
        """Read lines up to the one in which `key` is `value`; it is the last of them."""
        lines = [self.next()]
        while lines[-1].get(key) != value:
            lines.append(self.next())
        return lines


@contextmanager
def live(*arguments: str | Path, **options: Any) -> Iterator[Live]:
    """Start a stream, wait until it is ready, and end it whatever happens."""
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    command: Sequence[str] = [*START, *map(str, arguments)]
    process: Any = subprocess.Popen(command, **(pipes | options))
    stream = Live(process)
    try:
        stream.await_ready()
        yield stream
    finally:
        stream.close()

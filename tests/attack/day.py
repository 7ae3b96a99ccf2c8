"""A day of a stream as fast as it answers, `python -m tests.attack.day [--seconds S] [--rate R]`: what grows?

A frame follows the answer to the last one, until the day or the time is over. Meanwhile clients come, go and
stay, frames are rejected, the route moves and leaps, and state and recording are kept. Memory of the stream
and of the processes beside it, open files, threads, processes, kept files and the size of the state are
sampled; the slope of each over the frames of the second half says what a day adds. Few frames decide nothing:
what is bounded fills up first. One step to a new high-water mark of the allocator counts as a slope too: what
grows goes on to grow in a longer run.
"""

from __future__ import annotations

import argparse
import math
import os
import signal
import socket
import struct
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path

import numpy as np

from tests.attack.live_target import hang
from tests.live_process import SWAY_PERIOD, Live, line, live, malformed, points_mm, retimed
from tssgeom.engine import process
from tssgeom.rig import Rig
from tssgeom.stream import Frame, FrameResult

RATE = 100.0
"""Frames a second of the day unless another rate is given [Hz]; cameras have 30, magnetic trackers 40."""
DAY = 86400.0
"""Length of a day [s]."""
_MOST = {"memory": 64.0, "memory beside": 64.0, "open files": 16.0, "threads": 4.0}
_MOST |= {"processes beside": 4.0, "kept files": 16.0, "kept state": 1.0}
"""What a day may add [MiB, 1]; chosen: a week of it is borne."""
_POINTS, _CYCLE = 16, 6.0  # of a frame; s after which sway and pull are as at first
_EVERY, _FIRST = 100, 20  # frames from one event to the next, and while the stream is new
_NEW = 10_000  # frames; chosen: all senders whose clocks are kept have come then
_LEAST = 100_000  # frames of which a slope is taken; chosen: fewer are a matter of single steps
_GUESTS = 4  # clients that stay beside the sender
_WARM, _BLOCKS = 0.5, 8  # share of the frames that is not counted; blocks of the rest
_KEPT = 2  # recordings that the user keeps
_SENSORS = {"tension_in_N": 0.02, "displacement_in_m": 1e-5}  # noise of each reading


@dataclass(frozen=True, slots=True)
class Trend:
    """A straight line through what was sampled."""

    slope: float
    """Per million frames."""
    error: float
    """Standard error of it."""

    def verdict(self, most: float, rate: float = RATE) -> str:
        """Say whether a day adds more than `most`: flat, grows, or open where the samples do not decide."""
        days, beyond = 1e-6 * DAY * rate * self.slope, 2e-6 * DAY * rate * self.error
        return "grows" if days - beyond > most else "flat" if days + beyond <= most else "open"


def trend(frames: Sequence[float], values: Sequence[float], least: int = _LEAST) -> Trend:
    """Fit a line to the means of blocks, since neighbours err alike; its error is infinite for few frames."""
    whole = np.column_stack([np.asarray(frames, float) / 1e6, np.asarray(values, float)])
    late = whole[whole[:, 0] >= _WARM * whole[-1, 0]]
    if len(late) < _BLOCKS or frames[-1] < least:
        return Trend(math.nan, math.inf)
    x, y = np.array([block.mean(axis=0) for block in np.array_split(late, _BLOCKS)]).T
    x -= x.mean()
    slope = float(x @ y / (x @ x))
    left = y - y.mean() - slope * x
    return Trend(slope, math.sqrt(float(left @ left) / (_BLOCKS - 2) / float(x @ x)))


def texts(rate: float) -> list[bytes]:
    """Return frames of one cycle of sway and pull, with noisy readings of the model's drive and a target."""
    count = round(_CYCLE * rate)
    times = np.arange(2 * count) / rate
    pulls = 8.0 + 4.0 * np.sin(2 * np.pi * times / SWAY_PERIOD / 1.5)
    exact = (
        Frame(1e-3 * points_mm(_POINTS, moment, noise=0.0), moment, tension_in=pull)
        for moment, pull in zip(times.tolist(), pulls.tolist(), strict=True)
    )
    under = process(exact, Rig(), tension_in=8.0)
    results = [one.transmission for one in under if isinstance(one, FrameResult)][count:]
    drives = np.array([(one.tension_in, one.displacement_in) for one in results])
    drives += np.random.default_rng(0).standard_normal(drives.shape) * list(_SENSORS.values())
    return [
        line(points_mm(_POINTS, k / rate, k), 0.0, **dict(zip(_SENSORS, drive, strict=True)))
        for k, drive in enumerate(drives.tolist())
    ]


@dataclass(slots=True)
class Day:
    """A stream, its sender, and those who come and go."""

    stream: Live
    folder: Path
    rate: float = RATE
    frames: int = 0
    unanswered: int = 0
    silence: float = 0.0
    """The longest wait for an answer [s]."""
    events: int = 0
    samples: list[dict[str, float]] = field(default_factory=list)
    _texts: list[bytes] = field(default_factory=list)
    _guests: list[socket.socket] = field(default_factory=list)

    @property
    def hours(self) -> float:
        """How long the stream has lived by the clock of its sensor [h]."""
        return self.frames / self.rate / 3600.0

    def run(self, seconds: float) -> None:
        """Send until the day or the time is over, and sample each second or more often."""
        self._texts = texts(self.rate)
        source, sink = self.stream.source(), self.stream.reader().sock
        sink.settimeout(20.0)
        begun, pause = time.monotonic(), min(1.0, seconds / 100.0)
        until, due, happen = begun + seconds, begun + pause, cycle(self._happenings())
        while (now := time.monotonic()) < until and self.frames < DAY * self.rate and self.stream.alive:
            self._asked(source, sink, self._texts[self.frames % len(self._texts)])
            if self.frames % (_EVERY if self.frames > _NEW else _FIRST) == 0:
                self.events += 1
                what = next(happen)
                if what == "again":
                    source.close()
                    source = self.stream.source()
                elif what == "leap":
                    self._asked(source, sink, line(points_mm(3 * _POINTS, 0.7, self.frames), 0.0))
            if now > due:
                due += pause
                self.samples.append(self._sample())
        for sock in (*self._guests, source, sink):
            sock.close()

    def _asked(self, source: socket.socket, sink: socket.socket, text: bytes) -> None:
        """Send a frame and wait for its answer."""
        self.frames += 1
        name, begun = b'"id":"%d"' % self.frames, time.monotonic()
        source.sendall(retimed(text, self.frames / self.rate)[:-2] + b"," + name + b"}\n")
        data = b""
        with suppress(TimeoutError):
            while name not in data:
                data = data[-20:] + sink.recv(1 << 18)
        self.unanswered += name not in data
        self.silence = max(self.silence, time.monotonic() - begun)

    def _happenings(self) -> Iterator[str]:
        """Let what happens in a day happen, one after the other; yield what the sender has to do."""
        for _, wrong in malformed():
            with self.stream.source() as sock:
                sock.sendall(wrong + b"\n")
            yield ""
            self._guest("source").sendall(retimed(self._texts[0], 1.0))  # its own clock, fits and filters
            yield "again"
            self._guest("sink")
            yield "leap"
            with self.stream.source("udp") as sock:
                sock.send(retimed(self._texts[1], 1.0))
            yield ""
            with self.stream.source() as sock:
                sock.sendall(self._texts[2][:200])
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            yield "again"
        time.sleep(0.25)  # the stream says that no frames come
        yield ""

    def _guest(self, what: str) -> socket.socket:
        """Let a client come that stays while some others come; it reads nothing and may be cut off."""
        if len(self._guests) == _GUESTS:
            self._guests.pop(0).close()
        self._guests.append(socket.create_connection(("127.0.0.1", self.stream.port(what, "tcp"))))
        return self._guests[-1]

    def _sample(self) -> dict[str, float]:
        """Return what the stream has now, the user having removed old recordings."""
        recordings = sorted(self.folder.glob("run*.rrd"), key=lambda path: path.stat().st_mtime)
        for path in recordings[:-_KEPT]:
            path.unlink()
        own = Path(f"/proc/{self.stream.process.pid}")
        return {
            "frames": float(self.frames),
            "memory": _resident(own),
            "memory beside": sum(_resident(Path(f"/proc/{pid}")) for pid in self.stream.children()),
            "processes beside": float(len(self.stream.children())),
            "open files": float(len(os.listdir(own / "fd"))),
            "threads": float(len(os.listdir(own / "task"))),
            "kept files": float(len(os.listdir(self.folder))),
            "kept state": sum(one.stat().st_size for one in self.folder.glob("state.json")) / 2**20,
        }


def _resident(process: Path) -> float:
    """Return the resident memory of a process [MiB]."""
    pages = int((process / "statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def lived(seconds: float, folder: Path, *more: str, rate: float = RATE) -> tuple[Day, list[str]]:
    """Let a stream live; return its day, and what may not be."""
    rig = folder / "rig.toml"
    rig.write_text("".join(f"[sensors.{name}]\nnoise = {noise}\n" for name, noise in _SENSORS.items()))
    kept = folder / "kept"
    kept.mkdir()
    ends = [
        *("--source", "tcp://127.0.0.1:0", "--source", "udp://127.0.0.1:0", "--sink", "tcp://127.0.0.1:0")
    ]
    keeps = ["--state", kept / "state.json", "--record", kept / "run.rrd", "--record-rotate", "4MB"]
    keeps += ["--write-rig", kept / "rig.toml"] if "--adapt" in more else []
    with live(*ends, *keeps, "--rig", rig, *more) as stream:
        day = Day(stream, kept, rate)
        day.run(seconds)
        status = stream.stop(signal.SIGTERM)
    wrong = list[str]()
    if status or any("Traceback" in one for one in stream.errors):
        wrong.append(f"status {status} {stream.errors[-3:]}")
    if day.unanswered or day.silence > hang():
        wrong.append(f"{day.unanswered} without an answer, a wait of {day.silence:.1f} s")
    return day, wrong


def judged(day: Day, least: int = _LEAST) -> Iterator[tuple[str, str]]:
    """Yield what was sampled, with its verdict, and print both."""
    frames = [one["frames"] for one in day.samples]
    for what, most in _MOST.items():
        values = [one[what] for one in day.samples]
        made = trend(frames, values, least)
        said = made.verdict(most, day.rate)
        ends = f"{values[0]:.4g} at first, {values[-1]:.4g} at last"
        slope = f"{made.slope:+.3g} ± {made.error:.2g} in a million frames"
        print(f"{what}: {ends}, {slope}; a day may add {most:g}: {said}", flush=True)  # noqa: T201
        yield what, said


def main() -> int:
    """Let a day pass, and return 1 where anything grows or happened that may not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--rate", type=float, default=RATE, help="frames a second by their times [Hz]")
    parser.add_argument("--adapt", action="store_true", help="follow the rig")
    parser.add_argument("--view", action="store_true", help="host the picture too")
    given = parser.parse_args()
    more = ["--adapt"] * given.adapt + ["--view", "--view-port", "9977"] * given.view
    with tempfile.TemporaryDirectory() as home:
        begun = time.monotonic()
        day, faults = lived(given.seconds, Path(home), *more, rate=given.rate)
    print(  # noqa: T201
        f"{day.frames} frames in {time.monotonic() - begun:.0f} s, {day.hours:.2f} h at {day.rate:g} Hz, "
        f"{day.events} events; {day.unanswered} without an answer, longest wait {day.silence:.2f} s"
    )
    faults += [f"{what} grows" for what, verdict in judged(day) if verdict == "grows"]
    for fault in faults:
        print(fault)  # noqa: T201
    print(f"{len(faults)} faults")  # noqa: T201
    return int(bool(faults))


if __name__ == "__main__":
    raise SystemExit(main())

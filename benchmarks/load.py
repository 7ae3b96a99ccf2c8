"""Latency and greatest rate of `tssgeom live`, measured from another process; what its pictures cost.

    python -m benchmarks.load [--quick] [--minutes M] [--rate HZ] [--points N] [--frames N] [--markdown]

The route sways, the noise is half a millimetre and unknown; the tension pulls and releases. A frame's latency
runs from just before it was sent to when the first byte of its answer arrived, by the clock of a client in C;
`sent late` is how late the client itself was, in the 99th percentile. `--view` and `--record` are on where a
row states it. The load of the machine is printed, since other work on it affects every number.

The second table is what a frame of 200 points costs in a Rerun recording: the whole picture, as `live` and
`batch` send it, and the numbers that `live` sends of every frame. Time is that of the sender's thread; bytes
are those of the finished file. No time is asserted.
"""

from __future__ import annotations

import argparse
import math
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr

from benchmarks import ABSENT, machine, number, options_parser, table
from tests.live_process import ROUTES, Live, line, lines, live, points_mm
from tssgeom.core.build import compiler
from tssgeom.engine import process
from tssgeom.rig import Rig
from tssgeom.stream import Frame, FrameResult
from tssgeom.view.samples import numbers_of
from tssgeom.view.scene.labels import label_positions
from tssgeom.view.scene.live import LivePicture, warm_up
from tssgeom.view.scene.recording import write_recording
from tssgeom.view.scene.run import run_of

_DIFFERENT = 3000  # frames, sent over and over
_MINUTES, _QUICK = 10.0, 0.05
_FLOOD, _QUICK_FLOOD = 20_000, 2000  # frames, one after the other
_BRIEF = 20_000  # frames of all other runs than that of seven pieces with `--view --record`
_HERE = "tcp://127.0.0.1:0"
_TARGETS = "targets: p50 ≤ 0.5, p99 ≤ 1, p99.9 ≤ 3 ms at 1000 frames/s, N = 200"
_FOLLOWED_RATE = 200.0  # Hz
_FOLLOWED_TARGETS = "targets: p50 ≤ 1, p99 ≤ 2 ms"
_FOLLOWED_CYCLE = 6.0  # s, after which sway and pull of `points_mm` are as at first
_SENSORS = {"tension_in_N": 0.02, "displacement_in_m": 1e-5}  # noise of each reading of that rig


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    options = _options(arguments)
    begin = time.perf_counter()
    print(machine())
    print(f"\n== latency [ms], {options.points} points, {options.rate:g} frames/s ({_TARGETS})\n")
    print(_latency_table(options), flush=True)
    print(f"\n== a rig that is followed, {_FOLLOWED_RATE:g} frames/s ({_FOLLOWED_TARGETS})\n")
    print(_followed_table(options), flush=True)
    print("\n== pictures\n")
    print(_picture_table(options.frames or (200 if options.quick else 2000), markdown=options.markdown))
    print(f"\n{time.perf_counter() - begin:.0f} s; load {os.getloadavg()[0]:.1f} at the end")
    return 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__, "some seconds instead of ten minutes")
    parser.add_argument("--minutes", type=float, default=0.0, help=f"of the long run ({_MINUTES:g})")
    parser.add_argument("--rate", type=float, default=1000.0, help="frames a second")
    parser.add_argument("--points", type=int, default=200, help="points of a frame")
    parser.add_argument("--frames", type=int, default=0, help="frames of the pictures")
    return parser.parse_args(arguments)


def _latency_table(options: argparse.Namespace) -> str:
    different, flood = (300, _QUICK_FLOOD) if options.quick else (_DIFFERENT, _FLOOD)
    minutes = options.minutes or (_QUICK if options.quick else _MINUTES)
    count = int(60.0 * minutes * options.rate)
    rows = list[list[str]]()
    with tempfile.TemporaryDirectory() as folder:
        program = compiled_client(Path(folder))
        beside = ["--view", "--view-port", str(_free_port()), "--record", str(Path(folder) / "load.rrd")]
        for route in ROUTES:
            frames = lines(options.points, different, options.rate, route)
            for name, more in (("nothing beside", []), ("--view --record", beside)):
                most = count if more and route == "7 pieces" else min(count, _BRIEF)
                with live("--source", _HERE, "--sink", _HERE, *more) as stream:
                    rows += _rows_at(options.rate, stream, program, name, route, frames, most)
                    result = measured(program, _ports(stream), frames, 0.0, flood)
                    rows.append(_row(f"{name}, one after the other", route, result, result.outside, ""))
                    stream.stop()
    return table(_HEADER, rows, text_columns=2, markdown=options.markdown)


_HEADER = (
    *("run", "route", "frames", "answered/s", "dropped", "sent late"),
    *("p50", "p90", "p99", "p99.9", "max", "memory [MiB]"),
)


def _followed_table(options: argparse.Namespace) -> str:
    """Measure `live --adapt` with tension and position of the drive."""
    count = int(_FOLLOWED_RATE * (20.0 if options.quick else 300.0))
    rows = list[list[str]]()
    with tempfile.TemporaryDirectory() as folder:
        program = compiled_client(Path(folder))
        rig = Path(folder) / "rig.toml"
        rig.write_text("".join(f"[sensors.{name}]\nnoise = {noise}\n" for name, noise in _SENSORS.items()))
        for route in ROUTES:
            frames = _driven(options.points, route)
            with live("--source", _HERE, "--sink", _HERE, "--adapt", "--rig", rig) as stream:
                rows += _rows_at(_FOLLOWED_RATE, stream, program, "--adapt", route, frames, count)
                stream.stop()
    return table(_HEADER, rows, text_columns=2, markdown=options.markdown)


def _driven(points: int, route: str) -> list[bytes]:
    """Return frames of the second cycle of a sway and pull, with noisy readings of the model's drive."""
    count = round(_FOLLOWED_CYCLE * _FOLLOWED_RATE)
    times = np.arange(2 * count) / _FOLLOWED_RATE
    exact = (
        Frame(1e-3 * points_mm(points, time, noise=0.0, route=route), time, tension_in=pull)
        for time, pull in zip(times, 8.0 + 4.0 * np.sin(2 * np.pi * times / 3.0), strict=True)
    )
    under = process(exact, Rig(), tension_in=8.0)
    results = [one.transmission for one in under if isinstance(one, FrameResult)][count:]
    drives = np.array([(one.tension_in, one.displacement_in) for one in results])
    drives += np.random.default_rng(0).standard_normal(drives.shape) * list(_SENSORS.values())
    return [
        line(points_mm(points, time, i, route=route), time, **dict(zip(_SENSORS, drive, strict=True)))
        for i, (time, drive) in enumerate(zip(times[:count].tolist(), drives.tolist(), strict=True))
    ]


def _rows_at(
    rate: float, stream: Live, program: Path, name: str, route: str, frames: Sequence[bytes], count: int
) -> list[list[str]]:
    """Measure frames at a rate [Hz], from outside and by the stream itself."""
    memory = stream.memory()
    result = measured(program, _ports(stream), frames, rate, count)
    grown = f"{stream.memory() - memory:+.1f}"
    inside = _row(f"{name}, by the stream itself", route, result, result.inside, "")
    return [_row(name, route, result, result.outside, grown), inside]


def _ports(stream: Live) -> tuple[int, int]:
    return stream.port("source", "tcp"), stream.port("sink", "tcp")


def _row(name: str, route: str, result: Latencies, latencies: np.ndarray, grown: str) -> list[str]:
    times = np.percentile(latencies, (50, 90, 99, 99.9, 100))
    return [
        name,
        route,
        str(result.sent),
        f"{result.answered / result.seconds:.0f}",
        str(result.sent - result.answered),
        f"{np.percentile(result.late, 99):.2f}" if len(result.late) else "",
        *(f"{value:.2f}" for value in times),
        grown,
    ]


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


_SOURCE = Path(__file__).with_name("live_client.c")
_FLAGS = ("-std=c11", "-O2", "-Wall", "-Wextra", "-Werror")
_COLD = 200  # frames at the start that are not counted, or a tenth of few


@dataclass(frozen=True, slots=True)
class Latencies:
    """Result of a run of frames, latencies without those of the first frames."""

    sent: int
    answered: int
    outside: np.ndarray
    """As a peer measures them [ms]."""
    inside: np.ndarray
    """As the stream itself reports them [ms]."""
    late: np.ndarray
    """By how much the client missed the time at which a frame was due [ms]; none without a rate."""
    seconds: float


def compiled_client(folder: Path) -> Path:
    """Compile the client into a folder; NoCompilerError where there is no compiler."""
    program = folder / "live_client"
    subprocess.run([*compiler(), *_FLAGS, str(_SOURCE), "-o", str(program)], check=True)
    return program


def measured(
    program: Path, ports: tuple[int, int], lines: Sequence[bytes], rate: float, count: int
) -> Latencies:
    """Send `count` frames, the given ones over and over, and time each answer.

    Parameters
    ----------
    program
        The compiled client.
    ports
        Of a source and of a sink.
    rate
        Frames a second [Hz]; 0: each as soon as the answer to the one before is there.
    """
    sent, outside, inside = 1e-3 * _times(program, ports, lines, rate, count).T
    answered = np.flatnonzero(~np.isnan(outside))
    warm = answered[min(_COLD, len(answered) // 10) :]
    late = sent - 1e3 / rate * np.arange(count) if rate else np.empty(0)
    return Latencies(count, len(answered), outside[warm], inside[warm], late, 1e-3 * sent[-1])


def _times(
    program: Path, ports: tuple[int, int], lines: Sequence[bytes], rate: float, count: int
) -> np.ndarray:
    """Return when each frame was sent, its latency, and that in its answer, [count, 3] [µs]."""
    frames = program.with_suffix(".frames")
    frames.write_bytes(b"".join(line.partition(b",")[2][:-2] + b"\n" for line in lines))
    command = [str(each) for each in (program, *ports, frames, rate, count)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        with suppress(AttributeError, OSError):  # no such priority here, no privilege, or it has ended
            os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(1))
        output = process.communicate()[0]
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return np.frombuffer(output).reshape(count, 3)


_RATE = 1000.0  # Hz of the frames of pictures
_BATCH = 50  # frames that are sent at once, those of 50 ms


@dataclass(frozen=True, slots=True)
class Cost:
    """What one way of drawing costs."""

    way: str
    seconds: Sequence[float]
    """For each sending."""
    frames: int
    """In each sending."""
    size: float
    """Bytes of a frame in the file; NaN where there is no file of it."""

    def row(self) -> tuple[str, ...]:
        """Cells of the table."""
        each = 1e6 * np.array(self.seconds) / self.frames
        middle, high = np.percentile(each, [50, 99]) if len(each) > 1 else (each[0], math.nan)
        size = ABSENT if math.isnan(self.size) else f"{1e-3 * self.size:.2f}"
        share = f"{100 * 1e-6 * float(each.mean()) * _RATE:.0f}"
        return self.way, number(float(middle)), number(float(high)), share, size


def _picture_table(count: int, *, markdown: bool) -> str:
    """Draw frames in each way."""
    warm_up()
    frames = (
        Frame(1e-3 * points_mm(200, i / _RATE, i), i / _RATE, tension_in=8 + 6 * math.sin(i / 40))
        for i in range(count)
    )
    results = [one for one in process(frames, Rig(), tension_in=5.0) if isinstance(one, FrameResult)]
    header = ("way", "p50 [µs/frame]", "p99 [µs/frame]", "of a core at 1 kHz [%]", "file [kB/frame]")
    return table(header, [way(results).row() for way in _WAYS], text_columns=1, markdown=markdown)


@contextmanager
def _file() -> Iterator[tuple[rr.RecordingStream, Path]]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "frames.rrd"
        recording = rr.RecordingStream("benchmark")
        recording.save(path)
        yield recording, path


def _timed(
    way: str, results: Sequence[FrameResult], size: int, send: Callable[[rr.RecordingStream, int, int], None]
) -> Cost:
    """Send all frames, `size` at once, into a file."""
    seconds = list[float]()
    with _file() as (recording, path):
        with recording:
            for begin in range(0, len(results) - size + 1, size):
                start = time.perf_counter()
                send(recording, begin, begin + size)
                seconds.append(time.perf_counter() - start)
        return Cost(way, seconds, size, path.stat().st_size / (len(seconds) * size))


def _numbers(results: Sequence[FrameResult]) -> Cost:
    """Send what `live` sends of every frame, with a picture or without."""
    numbers = np.array([numbers_of(one) for one in results])
    times = np.arange(len(results)) / _RATE
    pictures = dict[int, LivePicture]()

    def send(recording: rr.RecordingStream, begin: int, end: int) -> None:
        picture = pictures.setdefault(id(recording), LivePicture(recording, "numbers"))
        picture.number(times[begin:end], numbers[begin:end])

    return _timed(f"live: numbers of every frame, {_BATCH} at once", results, _BATCH, send)


def _pictures(size: int) -> Callable[[Sequence[FrameResult]], Cost]:
    def way(results: Sequence[FrameResult]) -> Cost:
        pictures = dict[int, LivePicture]()

        def send(recording: rr.RecordingStream, begin: int, end: int) -> None:
            picture = pictures.setdefault(id(recording), LivePicture(recording, "picture"))
            picture.draw(results[begin:end])

        at_once = "one by one" if size == 1 else f"{size} at once"
        return _timed(f"live: whole picture, {at_once}", results, size, send)

    return way


def _bulk(results: Sequence[FrameResult]) -> Cost:
    """Write a whole recording as `batch` does."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.rrd"
        start = time.perf_counter()
        write_recording(path, "run", results, timed=True)
        spent = time.perf_counter() - start
        return Cost("batch: whole recording", [spent], len(results), path.stat().st_size / len(results))


def _labels(results: Sequence[FrameResult]) -> Cost:
    run = run_of("labels", results, True)
    seconds = list[float]()
    for frame, result in zip(run.frames, run.results, strict=True):
        start = time.perf_counter()
        label_positions(run.camera, frame, result.arcs)
        seconds.append(time.perf_counter() - start)
    return Cost("of it: positions of the labels", seconds, 1, math.nan)


_WAYS = (_numbers, _pictures(1), _pictures(_BATCH), _bulk, _labels)

if __name__ == "__main__":
    sys.exit(main())

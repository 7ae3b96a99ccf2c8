"""What it costs to draw: time and bytes of a frame in a Rerun recording, sent one by one and many at once.

    python -m benchmarks.view [--quick] [--frames N] [--markdown]

A frame is a route of 200 sensed points. The minimal frame (route, points, profile and six numbers) is logged
as Rerun's first pages teach it and then as columns; beside it stands what tssgeom draws: the whole picture of
a frame, as `live` and `batch` send it, and the numbers that `live` sends of every frame. Time is that of the
sender's thread; bytes are those of the finished file. No time is asserted.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr

from benchmarks import ABSENT, machine, number, options_parser, table
from benchmarks.live_process import points_mm
from tssgeom.engine import process
from tssgeom.rig import Rig
from tssgeom.stream import Frame, FrameResult
from tssgeom.view.samples import RouteSamples, numbers_of, route_samples
from tssgeom.view.scene.columns import Sender, segments_3d
from tssgeom.view.scene.labels import label_positions
from tssgeom.view.scene.live import LivePicture, warm_up
from tssgeom.view.scene.recording import write_recording
from tssgeom.view.scene.run import run_of

_RATE = 1000.0  # Hz of frames that come in
_BATCH = 50  # frames that are sent at once, those of 50 ms
_POINTS = 200
_SCALARS = 6


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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    parser = options_parser(__doc__, "fewer frames")
    parser.add_argument("--frames", type=int, default=0)
    options = parser.parse_args(arguments)
    count = options.frames or (200 if options.quick else 2000)
    results = _results(count)
    print(machine())
    pieces = np.mean([len(one.arcs.length) for one in results])
    print(f"{len(results)} frames of {_POINTS} points and {pieces:.1f} pieces, {_RATE:g} Hz\n", flush=True)
    warm_up()
    header = ("way", "p50 [µs/frame]", "p99 [µs/frame]", "of a core at 1 kHz [%]", "file [kB/frame]")
    rows = [way(results).row() for way in _WAYS]
    print(table(header, rows, text_columns=1, markdown=options.markdown))
    return 0


def _results(count: int) -> list[FrameResult]:
    frames = (
        Frame(1e-3 * points_mm(_POINTS, i / _RATE, i), i / _RATE, tension_in=8 + 6 * math.sin(i / 40))
        for i in range(count)
    )
    return [one for one in process(frames, Rig(), tension_in=5.0) if isinstance(one, FrameResult)]


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


def _logged(results: Sequence[FrameResult]) -> Cost:
    """Log each part of each frame by itself."""
    frames = [route_samples(one) for one in results]
    numbers = [(*numbers_of(one), 0.0, 0.0)[:_SCALARS] for one in results]

    def send(recording: rr.RecordingStream, begin: int, _: int) -> None:
        frame = frames[begin]
        recording.set_time("time", duration=begin / _RATE)
        recording.log("route", rr.LineStrips3D([frame.position]))
        recording.log("sensed", rr.Points3D(results[begin].frame.points))
        recording.log("profile", rr.LineStrips2D([np.column_stack([frame.s, frame.tension])]))
        for index, value in enumerate(numbers[begin]):
            recording.log(f"series/{index}", rr.Scalars(value))

    return _timed("minimal frame, logged part by part", results, 1, send)


def _in_columns(results: Sequence[FrameResult]) -> Cost:
    """Send the same as columns, a row a frame."""
    frames = [route_samples(one) for one in results]
    numbers = np.array([(*numbers_of(one), 0.0, 0.0)[:_SCALARS] for one in results])

    def send(recording: rr.RecordingStream, begin: int, end: int) -> None:
        sender = Sender(recording, np.arange(begin, end) / _RATE)
        sent = frames[begin:end]
        _send_strip(sender, sent, [one.frame.points for one in results[begin:end]])
        sender.send("series", rr.Scalars.columns(scalars=numbers[begin:end].ravel()), [_SCALARS] * len(sent))

    return _timed(f"the same as columns, {_BATCH} frames at once", results, _BATCH, send)


def _send_strip(sender: Sender, sent: Sequence[RouteSamples], points: Sequence[np.ndarray]) -> None:
    lengths = [len(frame.s) for frame in sent]
    strips = segments_3d([frame.position for frame in sent])
    sender.send("route", rr.LineStrips3D.columns(strips=strips), [length - 1 for length in lengths])
    positions = np.concatenate(points).astype(np.float32)
    sender.send("sensed", rr.Points3D.columns(positions=positions), [len(cloud) for cloud in points])
    profile = np.concatenate([np.column_stack([frame.s, frame.tension]) for frame in sent])
    sender.send("profile", rr.Points2D.columns(positions=profile.astype(np.float32)), lengths)


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


_WAYS = (_logged, _in_columns, _numbers, _pictures(1), _pictures(_BATCH), _bulk, _labels)

if __name__ == "__main__":
    sys.exit(main())

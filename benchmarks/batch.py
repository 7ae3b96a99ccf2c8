"""Frames a second of a whole batch, from files to tables, beside a loop over scipy, numpy and ruptures.

    python -m benchmarks.batch [--quick] [--frames N] [--large N] [--wall] [--markdown]

Recordings of 200 points go through what a worker of `tssgeom batch` does, without pictures, in one process
and in one for each core. The peer reads the same archives with numpy and runs splprep, curvature and a search
of ruptures on its frames, in as many processes. Starting (interpreter, imports, compiled code from its cache)
is left out on both sides and printed: every worker does a small recording before the clock starts. The clock
is the processor time of the busiest worker, so that waiting for a core does not count; `--wall` takes the
time on the wall, which needs a quiet machine. No time is asserted, for machines differ.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing.synchronize import Barrier
from pathlib import Path

import numpy as np

from benchmarks import machine, number, options_parser, table
from benchmarks.stages import NOISE, frames, kernel, pelt
from pipelines import tssgeom_version
from pipelines.batch.task import Task, work
from pipelines.inputs import RunSettings
from tssgeom.io.results.run_record import Settings
from tssgeom.io.storage import Folder
from tssgeom.rig import Rig, ShapeSensor
from tssgeom.stream import Frame

POINTS = 200
_FRAMES, _QUICK_FRAMES = 1500, 150  # of each recording
_RECORDINGS = 4
_LARGE, _QUICK_LARGE = 100_000, 2_000
_WARM = 24
_PEER_SHARE = 25  # the peer is given one of so many frames, for it is slow
_RIG = Rig(shape=ShapeSensor(noise_mm=1e3 * NOISE))
_DISTINCT = 64  # different frames, repeated in turn

_LEGEND = f"""\
Batch: from an archive of {POINTS} points a frame to tables of frames and segments, and the summary.
Peer: numpy reads, splprep (quintic, s = 3Nσ², stations known), curvature, then ruptures (Python or C); it
has no tendon and no error bars, and writes nothing. Last columns: frames a second over those of the peer."""


@dataclass(frozen=True, slots=True)
class Load:
    """Recordings on disk."""

    files: Sequence[Path]
    frames: int
    """Of each."""

    @property
    def total(self) -> int:
        """Frames in all."""
        return len(self.files) * self.frames


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    options = _options(arguments)
    each = options.frames or (_QUICK_FRAMES if options.quick else _FRAMES)
    print(machine())
    clock = "wall time" if options.wall else "processor time of the busiest worker"
    print(f"settings: {_RECORDINGS} recordings of {each} frames, {clock}, started before")
    print(f"\n{_LEGEND}\n", flush=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for smooth in (True, False):
            part = folder / ("smooth" if smooth else "pieces")
            part.mkdir()
            files = [record(part / f"run{k}.npz", each, smooth=smooth) for k in range(_RECORDINGS)]
            print("a smooth route that sways:\n" if smooth else "\nseven pieces that sway:\n")
            load = Load(files, each)
            print(_speed_table(part, load, wall=options.wall, markdown=options.markdown), flush=True)
        large = options.large or (_QUICK_LARGE if options.quick else _LARGE)
        print(f"\n{_large_table(folder, sorted({1000, large // 10, large}), markdown=options.markdown)}")
    return 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__, "fewer frames")
    parser.add_argument("--frames", type=int, default=0, help=f"of each recording ({_FRAMES})")
    parser.add_argument("--large", type=int, default=0, help=f"frames of the largest recording ({_LARGE})")
    parser.add_argument("--wall", action="store_true", help="time on the wall, not of the processor")
    return parser.parse_args(arguments)


def record(path: Path, count: int, *, smooth: bool = True) -> Path:
    """Write a recording of so many frames of a route that sways, while the tension goes up and down."""
    sensed = frames(POINTS, _DISTINCT, smooth=smooth)
    points = np.lib.format.open_memmap(path.with_suffix(".npy"), "w+", shape=(count, POINTS, 3))
    for k in range(count):
        points[k] = sensed[k % _DISTINCT].points
    tension = 10.0 + 5.0 * np.sin(np.arange(count) / 40.0)
    time_s, stations = np.arange(count) / 50.0, np.asarray(sensed[0].stations)
    np.savez(path, points=points, time_s=time_s, unit="m", tension_in_N=tension, s=stations)
    path.with_suffix(".npy").unlink()
    return path


Work = Callable[[Path, Path], None]


def batched(file: Path, out: Path) -> None:
    """Do what a worker of `tssgeom batch` does for one input: digest, tables, notes; no pictures."""
    settings = RunSettings(_RIG, None, 15.0, None, None)
    recorded = Settings(tension_in_N=15.0, unit=None, rig_file=None, rig=_RIG, pictures=False)
    name, source = file.stem, str(file)
    folder = Folder.of(str(out))
    size = file.stat().st_size
    task = Task(
        name, source, source, name, size, settings, recorded, tssgeom_version(), folder, figures=False
    )
    outcome = work(task)
    if outcome.done is None or outcome.unchanged:
        raise RuntimeError(f"{file}: {outcome.reason or 'done before'}: the benchmark needs a fresh folder")


def by_pelt(file: Path, out: Path) -> None:
    """Do the peer's part with the usual search of ruptures."""
    _by_peer(file, pelt)


def by_kernel(file: Path, out: Path) -> None:
    """Do the peer's part with the fastest search of ruptures."""
    _by_peer(file, kernel)


def _by_peer(file: Path, pipeline: Callable[[Frame], Sequence[int]]) -> None:
    with np.load(file) as archive:
        points, stations = archive["points"], archive["s"]
    for k in range(0, len(points), _PEER_SHARE):
        pipeline(Frame(points[k], float(k), stations))


def _speed_table(folder: Path, load: Load, *, wall: bool, markdown: bool) -> str:
    warm, rows, alone = record(folder / "warm.npz", _WARM), list[list[str]](), math.nan
    for count in sorted({1, len(os.sched_getaffinity(0))}):
        rate, start = _rate(count, batched, load.files, warm, folder / f"out{count}", wall=wall)
        mine = rate * load.frames
        alone = mine if count == 1 else alone
        rates = [_rate(count, peer, load.files, warm, folder, wall=wall)[0] for peer in (by_pelt, by_kernel)]
        theirs = [each * load.frames / _PEER_SHARE for each in rates]
        cells = [mine, mine / (count * alone), start, *theirs, *(mine / their for their in theirs)]
        rows.append([str(count), *map(number, cells)])
    header = (
        "processes",
        "frames/s",
        "efficiency",
        "start [s]",
        "PELT/s",
        "kernel/s",
        "to PELT",
        "to kernel",
    )
    return table(header, rows, text_columns=0, markdown=markdown)


def _rate(
    count: int, job: Work, files: Sequence[Path], warm: Path, out: Path, *, wall: bool
) -> tuple[float, float]:
    """Files a second of so many processes, and the seconds that they took to start."""
    context = multiprocessing.get_context("spawn")
    ready = context.Barrier(count + 1)
    begin = time.perf_counter()
    with ProcessPoolExecutor(count, context, initializer=_start, initargs=(job, warm, out, ready)) as pool:
        for _ in range(count):
            pool.submit(os.getpid)  # every one of them starts a process
        ready.wait()
        started = time.perf_counter()
        futures = [pool.submit(_timed, job, file, out / file.stem) for file in files]
        busy = dict[int, float]()
        for future in futures:
            worker, seconds = future.result()
            busy[worker] = busy.get(worker, 0.0) + seconds
        passed = time.perf_counter() - started if wall else max(busy.values())
        return len(files) / passed, started - begin


def _timed(job: Work, file: Path, out: Path) -> tuple[int, float]:
    """Do a job, and return the process and the processor time that it took [s]."""
    begin = time.process_time()
    job(file, out)
    return os.getpid(), time.process_time() - begin


def _start(job: Work, warm: Path, out: Path, ready: Barrier) -> None:
    job(warm, out / f"warm{os.getpid()}")
    ready.wait()


def _large_table(folder: Path, counts: Sequence[int], *, markdown: bool) -> str:
    """Time of a frame and greatest memory of a process over the length of one recording."""
    rows = []
    for count in counts:
        file = record(folder / "long.npz", count)
        code = f"from benchmarks.batch import one; one({str(file)!r}, {str(folder / f'long{count}')!r})"
        output = subprocess.run(
            [sys.executable, "-c", code], check=True, capture_output=True, text=True
        ).stdout
        before, seconds, peak = map(float, output.split())
        size = file.stat().st_size / 2**20
        cells = [1e6 * seconds / count, count / seconds, size, before, peak]
        rows.append([str(count), *map(number, cells)])
    header = ("frames", "µs a frame", "frames/s", "file [MiB]", "started [MiB]", "peak [MiB]")
    return table(header, rows, text_columns=0, markdown=markdown)


def one(file: str, out: str) -> None:
    """Print memory when started [MiB], processor seconds for one recording, and the greatest memory [MiB]."""
    folder = Path(out)
    batched(record(folder.with_suffix(".npz"), _WARM), folder / "warm")
    before, begin = _peak(), time.process_time()
    batched(Path(file), folder / "long")
    print(before, time.process_time() - begin, _peak())


def _peak() -> float:
    """Greatest resident memory of this process so far [MiB]; what started it counts not."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024


if __name__ == "__main__":
    sys.exit(main())

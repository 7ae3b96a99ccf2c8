"""Time of every stage of a frame beside scipy and ruptures, and of the tendon beside finite volumes.

    python -m benchmarks.speed [--quick] [--pairs N] [--wall] [--markdown]

Everything is run before the clock starts, and runs in one thread. Each repetition times the
peers and every stage once, one after the other, so that what else the machine does strikes all alike. The
clock is the processor time of the thread, so that waiting for a core does not count; `--wall` takes the time
on the wall. No time is asserted, for machines differ. `--quick` takes less than 20 s of one core.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from benchmarks.stages import NOISE, PIPELINES, SMOOTH_STAGES, STAGES, Stage, frames
from benchmarks.tables import machine, number, table
from benchmarks.tendon_steps import LEGEND, step_table

_COUNTS = (30, 200, 1000)
_SCALING, _QUICK_SCALING = (200, 500, 1000, 2000, 5000, 10000), (200, 800, 3000)
_PAIRS, _QUICK_PAIRS = 400, 20
_REPEATS, _QUICK_REPEATS = 9, 2
_STEPS, _QUICK_STEPS = 200, 20
_FRAMES, _QUICK_FRAMES = 16, 4  # different frames, taken in turn
_FINE = 1e-6  # a clock has to resolve this [s]

Clock = Callable[[], float]

_LEGEND = f"""\
p50, p99: of the time of one frame, the second of two in a row; everything else runs before the first.
Last columns: median over the pairs of the time of a whole peer pipeline over that of the stage, so more than
1 where the stage is faster. Peers: splprep of scipy (quintic, s = 3Nσ², stations known), curvature by numpy,
then ruptures: PELT with the l2 cost (Python) or KernelCPD with the linear kernel (C).
Points sway slowly from frame to frame, noise {NOISE * 1e3:g} mm and known: first on a smooth route, as
endoscopes have, then on 7 pieces in space."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    options = _options(arguments)
    pairs = options.pairs or (_QUICK_PAIRS if options.quick else _PAIRS)
    clock, named = _clock(wall=options.wall)
    sensed = _QUICK_FRAMES if options.quick else _FRAMES
    begin = time.perf_counter()
    print(machine())
    print(f"settings: one thread, {pairs} pairs, {named}, warmed up first")
    print(f"\n{_LEGEND}", flush=True)
    for n in _COUNTS:
        for smooth in (True, False):
            kind = "a smooth route" if smooth else "7 pieces"
            print(f"\n{_heading(f'N = {n}, {kind}', options)}\n")
            times = _paired_times(n, pairs, sensed, clock, smooth=smooth)
            print(_stage_table(times, markdown=options.markdown), flush=True)
    print(f"\n{_heading('one step of the tendon', options)}\n\n{LEGEND}\n")
    print(step_table(_QUICK_STEPS if options.quick else _STEPS, clock, markdown=options.markdown), flush=True)
    counts, repeats = (_QUICK_SCALING, _QUICK_REPEATS) if options.quick else (_SCALING, _REPEATS)
    print(f"\n{_heading(f'scaling: time as N to a power, N = {counts[0]} to {counts[-1]}', options)}\n")
    print(_scaling_table(counts, repeats, clock, markdown=options.markdown))
    print(f"\n{time.perf_counter() - begin:.0f} s")
    return 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary = (__doc__ or "").split("\n")[0]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.speed", description=summary)
    parser.add_argument("--quick", action="store_true", help="fewer pairs and sizes")
    parser.add_argument("--pairs", type=int, default=0, help=f"repetitions ({_PAIRS}; quick {_QUICK_PAIRS})")
    parser.add_argument("--wall", action="store_true", help="time on the wall, not of the processor")
    parser.add_argument("--markdown", action="store_true", help="tables to paste into documents")
    return parser.parse_args(arguments)


def _heading(text: str, options: argparse.Namespace) -> str:
    return f"## {text}" if options.markdown else f"== {text}"


def _clock(*, wall: bool) -> tuple[Clock, str]:
    """Return the clock and its name; the processor's, unless it is too coarse here."""
    if wall or time.get_clock_info("thread_time").resolution > _FINE:
        return time.perf_counter, "wall time"
    return time.thread_time, "processor time of the thread"


def _paired_times(n: int, pairs: int, count: int, clock: Clock, *, smooth: bool) -> Mapping[str, np.ndarray]:
    """Seconds of every stage and peer in every repetition, on `count` frames of `n` points in turn."""
    sensed = frames(n, count, smooth=smooth)
    stages: Sequence[Stage] = SMOOTH_STAGES if smooth else STAGES
    calls = {stage.name: stage.calls(sensed) for stage in (*stages, *PIPELINES)}
    for upcoming in calls.values():
        next(upcoming)()
    times = {name: np.empty(pairs) for name in calls}
    for i in range(pairs):
        for name, upcoming in calls.items():
            times[name][i] = _seconds(upcoming, clock)
    return times


def _seconds(upcoming: Iterator[Callable[[], object]], clock: Clock) -> float:
    """Time the second of two calls in a row, as in a stream of frames."""
    next(upcoming)()
    call = next(upcoming)
    begin = clock()
    call()
    return clock() - begin


def _stage_table(times: Mapping[str, np.ndarray], *, markdown: bool) -> str:
    peers = [peer.name for peer in PIPELINES]
    rows = []
    for name, taken in times.items():
        p50, p99 = np.percentile(taken, [50, 99]) * 1e6
        ratios = [number(float(np.median(times[peer] / taken))) for peer in peers]
        rows.append([name, number(float(p50)), number(float(p99)), *ratios])
    header = ["stage", "p50 [µs]", "p99 [µs]", "PELT / it", "kernel / it"]
    return table(header, rows, text_columns=1, markdown=markdown)


def _scaling_table(counts: Sequence[int], repeats: int, clock: Clock, *, markdown: bool) -> str:
    """Fit a power of N to the median time of each stage."""
    medians: dict[str, list[float]] = {stage.name: [] for stage in STAGES}
    for n in counts:
        sensed = frames(n, _FRAMES)
        for stage in STAGES:
            upcoming = stage.calls(sensed)
            next(upcoming)()
            taken = [_seconds(upcoming, clock) for _ in range(repeats)]
            medians[stage.name].append(float(np.median(taken)))
    rows = [
        [name, f"{np.polyfit(np.log(counts), np.log(taken), 1)[0]:.2f}", *(number(t * 1e6) for t in taken)]
        for name, taken in medians.items()
    ]
    header = ["stage", "power", *(f"{n} [µs]" for n in counts)]
    return table(header, rows, text_columns=1, markdown=markdown)


if __name__ == "__main__":
    sys.exit(main())

"""Time of every stage of a frame beside scipy and ruptures, and of the tendon beside finite volumes.

    python -m benchmarks.speed [--quick] [--pairs N] [--wall] [--markdown]

Everything is run before the clock starts, in one thread. Each repetition times the peers and every stage
once, one after the other, so that what else the machine does strikes all alike. The clock is the processor
time of the thread; `--wall` takes that on the wall. No time is asserted; `--quick` takes 20 s of one core.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import machine, number, options_parser, table
from benchmarks.stages import (
    NOISE,
    PIPELINES,
    SMOOTH_STAGES,
    STAGES,
    Stage,
    first_frame_table,
    frames,
    moving_course,
)
from tests.compiled import library_of
from tests.tendon import steps
from tssgeom.arrays import Vector
from tssgeom.rig import Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon import capstan as profile
from tssgeom.tendon.bars.bar_state import BarState
from tssgeom.tendon.capstan import transmit

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
    print(f"\n{_heading('first frame of routes that are hard to fit', options)}\n")
    print(first_frame_table(counts, clock, markdown=options.markdown))
    print(f"\n{time.perf_counter() - begin:.0f} s")
    return 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__, "fewer pairs and sizes")
    parser.add_argument("--pairs", type=int, default=0, help=f"repetitions ({_PAIRS}; quick {_QUICK_PAIRS})")
    parser.add_argument("--wall", action="store_true", help="time on the wall, not of the processor")
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


@dataclass(frozen=True, slots=True)
class Cells:
    """Tension in the cells, drive and load at both ends, and the faces between."""

    tension: Vector
    """[n+2] N."""
    turn: Vector
    """[n+1] Friction coefficient times the angle from the middle of one cell to that of the next [1]."""


@dataclass(frozen=True, slots=True)
class Rod:
    """What the cells are made of."""

    length: float
    """m."""
    compliance: float
    """Strain per tension [1/N]."""
    friction: float
    """Coulomb coefficient [1]."""
    pretension: float
    """N."""
    load_stiffness: float
    """N/m."""


def turns(rod: Rod, cells: int, length: Vector, angle: Vector) -> Vector:
    """Return μΔφ of each face [n+1] on a route of pieces of the given lengths [m] and angles [rad]."""
    middle = (np.arange(cells) + 0.5) / cells
    share = np.concatenate(([0.0], np.cumsum(length))) / length.sum()
    phi = np.interp(middle, share, np.concatenate(([0.0], np.cumsum(angle))))
    return rod.friction * np.diff(phi, prepend=0.0, append=angle.sum())


def at_rest(rod: Rod, turn: Vector) -> Cells:
    """Return the pretensioned tendon."""
    return Cells(np.full(len(turn) + 1, rod.pretension), turn)


def pulled(rod: Rod, state: Cells, turn: Vector, tension_in: float) -> Cells:
    """Return the equilibrium after one step of drive and route.

    Raises
    ------
    ArithmeticError
        Where there is none.
    """
    cells = len(turn) - 1
    stiffness = np.full(cells + 2, cells / (rod.compliance * rod.length))
    stiffness[0], stiffness[-1] = 0.0, rod.load_stiffness
    ffi, library = _compiled()
    tension, memory = state.tension.copy(), np.empty(8 * cells + 9)
    arrays = (tension, state.turn, turn, stiffness)
    given = [ffi.from_buffer("double[]", each) for each in (*arrays, memory)]
    if not library.pull(cells + 1, *given[:4], tension_in, given[4]):
        raise ArithmeticError(f"no equilibrium of {cells} cells at {tension_in:g} N")
    return Cells(tension, turn)


def elongation(rod: Rod, state: Cells) -> float:
    """Return the elongation above the pretensioned state [m]."""
    return rod.compliance * rod.length * float(np.mean(state.tension[1:-1]) - rod.pretension)


@cache
def _compiled() -> tuple[Any, Any]:
    here = Path(__file__).parent
    return library_of(here / "volumes.h", [here / "volumes.c"])


BARS = (15, 30, 60, 120, 240)
RIG = Rig(tendon=Tendon(pretension_N=2.0))
LEGEND = """\
From a pull to 15 N and a release to 9 N: mean of one step back to 15 N and one on to 6 N, on the route as it
is (fixed) or with all bends opened by 2 % in the same step (moving). error: of the elongation, rms over a
history on a fixed route, against the corner list, which is exact there and takes that step. volumes:
implicit, compiled, by Tresca's iteration, as many cells as it takes for that error. ratio: their time over
ours."""

_HISTORY = (15.0, 9.0, 12.0, 6.0, 14.0)  # [N]
_LOADED, _GOALS = (15.0, 9.0), (15.0, 6.0)
_OPENS = 1.02
_FINER = 1.15  # from one number of cells that is tried to the next


def step_table(
    repeats: int, clock: Callable[[], float], *, markdown: bool, bars: Sequence[int] = BARS
) -> str:
    """Return the table of times [µs] and ratios."""
    after = _route(1.0)
    exact = _timed([partial(profile.step, _corners(_LOADED), t, _MU) for t in _GOALS], repeats, clock)
    rows, moving = [], []
    for n in bars:
        error = _error(np.array([state.elongation for state in _bars_through(_HISTORY, n)]))
        cells = _cells_for(error)
        *_, chain = _bars_through(_LOADED, n)
        *_, volumes = _cells_through(_LOADED, cells)
        own = _timed([partial(steps.step, chain, after, RIG, tension_in=t) for t in _GOALS], repeats, clock)
        still = _timed([partial(_stepped, volumes, _route(_OPENS), t) for t in _GOALS], repeats, clock)
        other = _timed([partial(_stepped, volumes, after, t) for t in _GOALS], repeats, clock)
        moving.append(own)
        times = [number(1e6 * t) for t in (exact, own, still, other)]
        rows.append([str(n), f"{error:.1e}", str(cells), *times, number(still / exact), number(other / own)])
    header = ["bars", "error", "cells", "corners [µs]", "bars, moving", "volumes, fixed", "volumes, moving"]
    text = table([*header, "ratio, fixed", "ratio, moving"], rows, text_columns=0, markdown=markdown)
    power = np.polyfit(np.log(bars), np.log(moving), 1)[0]
    return f"{text}\nbars, moving: time as the number of bars to the power {power:.2f}"


_MU = RIG.friction.coefficient


def _route(opens: float) -> Arcs:
    course = moving_course(smooth=False)
    return Arcs.exact(course.length, opens * np.hypot(*course.bend.T) * course.length)


def _corners(drive: Sequence[float]) -> profile.Corners:
    state = profile.pretensioned(RIG)
    for tension_in in drive:
        state = profile.step(state, tension_in, _MU)
    return state


def _bars_through(drive: Sequence[float], bars: int) -> Iterator[BarState]:
    route = _route(_OPENS)
    state = steps.pretensioned_bars(RIG, route, bars)
    for tension_in in drive:
        state = steps.step(state, route, RIG, tension_in=tension_in)
        yield state


def cells_history(cells: int) -> Vector:
    """Return the elongation [m] of the reference after each step of the history."""
    return np.array([elongation(_rod(), state) for state in _cells_through(_HISTORY, cells)])


def _cells_through(drive: Sequence[float], cells: int) -> Iterator[Cells]:
    rod, route = _rod(), _route(_OPENS)
    turn = turns(rod, cells, route.length, route.angle)
    state = at_rest(rod, turn)
    for tension_in in drive:
        state = pulled(rod, state, turn, tension_in)
        yield state


def exact_history() -> Vector:
    """Return the exact elongation [m] after each step of the history."""
    states = [_corners(_HISTORY[: i + 1]) for i in range(len(_HISTORY))]
    return np.array([transmit(state, _route(_OPENS), RIG).elongation for state in states])


def _error(elongation: Vector) -> float:
    return float(np.sqrt(np.mean((elongation / exact_history() - 1) ** 2)))


def _cells_for(error: float) -> int:
    """Return the first number of cells tried that has no larger error."""
    cells = 10.0
    while _error(cells_history(round(cells))) > error:
        cells *= _FINER
    return round(cells)


@cache
def _rod() -> Rod:
    tendon = RIG.tendon
    length, load = _route(1.0).total_length, RIG.load.stiffness_N_per_m
    return Rod(length, tendon.compliance_per_N, _MU, tendon.pretension_N, load)


def _stepped(state: Cells, route: Arcs, tension_in: float) -> Cells:
    turn = turns(_rod(), len(state.turn) - 1, route.length, route.angle)
    return pulled(_rod(), state, turn, tension_in)


def _timed(calls: Sequence[Callable[[], object]], repeats: int, clock: Callable[[], float]) -> float:
    """Return the mean over the calls of each one's median time, the first run of each not counted [s]."""
    medians = []
    for call in calls:
        call()
        taken = []
        for _ in range(repeats):
            begin = clock()
            call()
            taken.append(clock() - begin)
        medians.append(float(np.median(taken)))
    return float(np.mean(medians))


if __name__ == "__main__":
    sys.exit(main())

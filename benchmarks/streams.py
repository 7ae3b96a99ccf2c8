"""Noisy streams of routes that stand and move: errors of Φ, T_out and δ, and how often 95 % intervals hold.

    python -m benchmarks.streams [--quick] [--routes N] [--points N] [--noise-mm X] [--markdown]

Each route is a chain of five arcs, sensed 150 times; the first 20 frames do not count. The truth of the
tendon is this project's own model on the exact route in each frame: what is compared is what noise of the
shape does to it. Beside this project stand each frame by itself (`[shape] time_filter = false`) and what
users do otherwise, points averaged exponentially with a weight of 0.1 for the newest frame. `--quick` takes
some twenty seconds and fails where a route that stands is not known as its frames allow.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks import machine, number, options_parser, share, table
from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.engine import process
from tssgeom.frame import Frame
from tssgeom.rig import Rig, ShapeSensor
from tssgeom.route.pieces import Arcs
from tssgeom.route.synthetic import chain, positions
from tssgeom.statistics import NORMAL_95
from tssgeom.stream import FrameResult
from tssgeom.tendon.state import pretensioned, step, transmit

_FRAMES, _FIRST, _INTERVAL = 150, 20, 0.02  # [1], [1], [s]
_NEWEST = 0.1
_QUICK_GAIN, _QUICK_COVERAGE = 5.0, 0.85

Motion = Callable[[int, Vector], Vector]
"""Factor on each angle in a frame, with a phase of each piece [rad]."""

MOTIONS: dict[str, Motion] = {
    "stands": lambda frame, phase: np.ones(len(phase)),
    "sways by 15 % in 250 frames": lambda frame, phase: 1 + 0.15 * np.sin(2 * np.pi * frame / 250 + phase),
    "sways by 30 % in 25 frames": lambda frame, phase: 1 + 0.3 * np.sin(2 * np.pi * frame / 25 + phase[0]),
    "leaps by 30 % every 50 frames": lambda frame, phase: np.full(len(phase), 1 + 0.3 * ((frame // 50) % 2)),
}
DRIVES: dict[str, Callable[[int], float]] = {
    "10 N": lambda _: 10.0,
    "5 to 15 N": lambda frame: 10.0 + 5.0 * math.sin(2 * math.pi * frame / 60),
}


@dataclass(frozen=True, slots=True)
class Recorded:
    """One noisy stream and its truth."""

    frames: tuple[Frame, ...]
    truth: Matrix
    """Φ [rad], T_out [N] and δ [m] in each frame."""


def recorded(seed: int, motion: Motion, drive: Callable[[int], float], points: int, noise: float) -> Recorded:
    """Draw a route, and sense it with noise [m] while it moves under a drive."""
    rng, rig = np.random.default_rng(seed), Rig()
    length, angle = rng.uniform(0.06, 0.14, 5), rng.uniform(0.4, 1.4, 5)
    plane, phase = np.cumsum(rng.uniform(-1.2, 1.2, 5)), rng.uniform(0.0, 2 * np.pi, 5)
    state, frames, truth = pretensioned(rig), list[Frame](), list[tuple[float, float, float]]()
    for count in range(_FRAMES):
        now, pull = angle * motion(count, phase), drive(count)
        exact = positions(chain(length, now / length, plane), np.linspace(0.0, length.sum(), points))
        sensed = exact + noise * rng.standard_normal(exact.shape)
        frames.append(Frame(sensed, time=_INTERVAL * count, tension_in=pull))
        state = step(state, Arcs.exact(length, now), rig, tension_in=pull)
        ends = transmit(state, rig)
        truth.append((float(now.sum()), ends.tension_out, ends.elongation))
    return Recorded(tuple(frames), np.array(truth))


def averaged(frames: Sequence[Frame]) -> Iterator[Frame]:
    """Average points exponentially."""
    mean: Points | None = None
    for frame in frames:
        mean = frame.points if mean is None else mean + _NEWEST * (frame.points - mean)
        yield Frame(mean, time=frame.time, tension_in=frame.tension_in)


_ALONE = Rig(shape=ShapeSensor(time_filter=False))
METHODS: dict[str, Callable[[Sequence[Frame]], tuple[Iterator[Frame], Rig]]] = {
    "tssgeom": lambda frames: (iter(frames), Rig()),
    "each frame alone": lambda frames: (iter(frames), _ALONE),
    "exponential mean": lambda frames: (averaged(frames), _ALONE),
}


@dataclass(frozen=True, slots=True)
class Score:
    """Errors of a method: [3] of Φ, T_out and δ."""

    rms: Vector
    coverage: Vector
    """Share of the 95 % intervals that hold the truth."""
    bias: Vector
    """Mean error over its standard error."""
    seconds: float
    """Of a frame."""


def score(streams: Sequence[Recorded], method: str) -> Score:
    """Compute all streams with one method."""
    errors, ratios, began = list[Matrix](), list[Matrix](), time.perf_counter()
    for stream in streams:
        frames, rig = METHODS[method](stream.frames)
        for count, result in enumerate(process(frames, rig, tension_in=10.0)):
            if count < _FIRST or not isinstance(result, FrameResult):
                continue
            ends, arcs = result.transmission, result.arcs
            estimate = np.array([arcs.total_angle, ends.tension_out, ends.elongation])
            error = np.array([arcs.total_angle_se, ends.tension_out_se, ends.elongation_se])
            errors.append(estimate - stream.truth[count])
            ratios.append(errors[-1] / np.maximum(error, 1e-9))
    passed = (time.perf_counter() - began) / (len(streams) * _FRAMES)
    error, ratio = np.array(errors), np.array(ratios)
    return Score(
        np.sqrt(np.mean(error**2, axis=0)),
        np.mean(np.abs(ratio) < NORMAL_95, axis=0),
        np.mean(ratio, axis=0),
        passed,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; 1 where a route that stands is not known as its frames allow."""
    options = _options(arguments)
    motions = dict(list(MOTIONS.items())[:2]) if options.quick else MOTIONS
    rows, failed = list[list[str]](), list[str]()
    for motion, moved in motions.items():
        for drive, pull in DRIVES.items():
            streams = [
                recorded(seed, moved, pull, options.points, 1e-3 * options.noise_mm)
                for seed in range(2 if options.quick else options.routes)
            ]
            scores = {method: score(streams, method) for method in METHODS}
            rows += [_row(f"{motion}, {drive}", method, one) for method, one in scores.items()]
            ours, alone = scores["tssgeom"], scores["each frame alone"]
            known = ours.rms[0] * _QUICK_GAIN < alone.rms[0] and ours.coverage[0] > _QUICK_COVERAGE
            if motion == "stands" and not known:
                failed.append(f"{motion}, {drive}: Φ is off by {ours.rms[0]:.4f} rad")
    print(machine())
    head = ["route, T_in", "method", "Φ [rad]", "%", "T_out [N]", "%", "δ [µm]", "%", "bias of T_out", "µs"]
    print(table(head, rows, text_columns=2, markdown=options.markdown))
    print("rms error; % of the 95 % intervals that hold the truth; mean error of T_out in standard errors")
    for text in failed:
        print(f"failed: {text}", file=sys.stderr)
    return 1 if failed else 0


def _row(cell: str, method: str, one: Score) -> list[str]:
    texts = [cell, method]
    for value, held in zip(one.rms * [1.0, 1.0, 1e6], one.coverage, strict=True):
        texts += [number(value), share(held)]
    return [*texts, f"{one.bias[1]:+.2f}", f"{1e6 * one.seconds:.0f}"]


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__, "two routes that stand or sway slowly")
    parser.add_argument("--routes", type=int, default=16, help="routes of each kind")
    parser.add_argument("--points", type=int, default=40, help="points of a route")
    parser.add_argument("--noise-mm", type=float, default=0.5, help="noise of a coordinate")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())

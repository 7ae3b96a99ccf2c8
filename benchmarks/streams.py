"""Noisy streams of routes that stand and move: errors of Φ, T_out and δ, and how often bounds hold.

    python -m benchmarks.streams [results | commands] [--quick] [--routes N] [--rigs N] [--markdown]

`results`: each route is a chain of five arcs, sensed 150 times; the first 20 frames do not count. The truth
of the tendon is this project's own model on the exact route in each frame: what is compared is what noise of
the shape does to it. Beside this project stand each frame by itself (`[shape] time_filter = false`) and what
users do otherwise, points averaged exponentially with a weight of 0.1 for the newest frame. It fails where a
route that stands is not known as its frames allow.

`commands`: lumped rigs whose true numbers are samples of those that are stated carry commands out. It fails
where the 95 % bounds of the commanded end hold less often than 93 % or more often than 97 %, beyond three
standard errors of that share. Without a part both are measured; `--quick` takes some forty seconds.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from benchmarks import machine, number, options_parser, share, table
from benchmarks.compensation import MU, PRETENSION, RHO, STATIONS, STIFFNESS, moved, sensed_points, swayed
from tests.lumped import Physics
from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.engine import process
from tssgeom.frame import Frame
from tssgeom.rig import Friction, Load, Rig, ShapeSensor, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.route.synthetic import chain, positions
from tssgeom.statistics import NORMAL_95
from tssgeom.stream import FrameResult
from tssgeom.tendon.command import Command
from tssgeom.tendon.command_error import bound
from tssgeom.tendon.commander import commander_of
from tssgeom.tendon.state import pretensioned, step, transmit
from tssgeom.uncertain import Uncertain, assumed

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


def results_table(options: argparse.Namespace) -> list[str]:
    """Print errors and how often intervals hold; return what fails."""
    motions = dict(list(MOTIONS.items())[:2]) if options.quick else MOTIONS
    rows, failed = list[list[str]](), list[str]()
    for (motion, sway), (drive, pull) in product(motions.items(), DRIVES.items()):
        streams = [
            recorded(seed, sway, pull, options.points, 1e-3 * options.noise_mm)
            for seed in range(2 if options.quick else options.routes)
        ]
        scores = {method: score(streams, method) for method in METHODS}
        rows += [_row(f"{motion}, {drive}", method, one) for method, one in scores.items()]
        ours, alone = scores["tssgeom"], scores["each frame alone"]
        known = ours.rms[0] * _QUICK_GAIN < alone.rms[0] and ours.coverage[0] > _QUICK_COVERAGE
        if motion == "stands" and not known:
            failed.append(f"{motion}, {drive}: Φ is off by {ours.rms[0]:.4f} rad")
    head = ["route, T_in", "method", "Φ [rad]", "%", "T_out [N]", "%", "δ [µm]", "%", "bias of T_out", "µs"]
    print(table(head, rows, text_columns=2, markdown=options.markdown))
    print("rms error; % of the 95 % intervals that hold the truth; mean error of T_out in standard errors")
    return failed


def _row(cell: str, method: str, one: Score) -> list[str]:
    texts = [cell, method]
    for value, held in zip(one.rms * [1.0, 1.0, 1e6], one.coverage, strict=True):
        texts += [number(value), share(held)]
    return [*texts, f"{one.bias[1]:+.2f}", f"{1e6 * one.seconds:.0f}"]


MU_SD, RHO_SD, GAIN_SD = 0.010, 1.6e-5, 0.02
"""Standard errors of friction [1], compliance [1/N] and of all angles' scale [1]; chosen: a calibration."""
NOISE = 5e-4
"""Of each coordinate of the sensed points [m]."""
_TARGETS = 1e-3 * np.array([2.0, 4.0, 5.5, 5.0, 3.0, 1.5, 2.5, 4.5, 4.2, 6.0])  # m, with turns
_RIGS, _QUICK_RIGS = 200, 40
_BEYOND = 3.0  # standard errors of a share that count as chance; chosen: four shares fail in one of 100 runs
LEAST, MOST = 0.93, 0.97
"""Of the 95 % bounds, the share that holds; stated in the goal of the commands."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Commands on one rig, and where they brought its end."""

    commands: tuple[Command, ...]
    position: Vector
    """[F] Movement of the load less target [m]."""
    by_force: bool
    """Whether the drive pulled with the commanded tension, not to the commanded position."""

    @property
    def holds(self) -> np.ndarray:
        """[F] Whether the end is within the 95 % bounds of its command."""
        errors = [
            each.errors.displacement_out_by_tension if self.by_force else each.displacement_out_se
            for each in self.commands
        ]
        return np.abs(self.position) <= np.array([bound(each) for each in errors])


def stated_rig() -> tuple[Rig, tuple[Uncertain, ...]]:
    """Return the rig as it is stated, with its errors."""
    rig = Rig(
        tendon=Tendon(compliance_per_N=RHO, pretension_N=PRETENSION),
        friction=Friction(coefficient=MU),
        load=Load(stiffness_N_per_m=STIFFNESS),
        shape=ShapeSensor(noise_mm=1e3 * NOISE, angle_gain_sd=GAIN_SD),
    )
    numbers = {"friction.coefficient": (MU, MU_SD), "tendon.compliance_per_N": (RHO, RHO_SD)}
    return rig, tuple(Uncertain(key, assumed(key, *each), stated=True) for key, each in numbers.items())


def outcome(seed: int, *, moving: bool, by_force: bool) -> Outcome:
    """Command one rig whose numbers are samples of the stated ones, and carry all commands out."""
    rng = np.random.default_rng((seed, moving, by_force))
    rig, uncertain = stated_rig()
    true_mu, true_rho = (each.prior.value(rng.standard_normal()) for each in uncertain)
    gain = 1.0 + GAIN_SD * rng.standard_normal()  # true over sensed
    angles = swayed(0.5 * np.arange(len(_TARGETS)), moving=moving)
    frames = [
        Frame(points, float(i), STATIONS, displacement_target=float(target))
        for i, (points, target) in enumerate(zip(sensed_points(angles, NOISE, rng), _TARGETS, strict=True))
    ]
    commander = commander_of(rig, uncertain)
    results = list(process(frames, rig, tension_in=0.0, commander=commander))
    commands = tuple(each.command for each in results if isinstance(each, FrameResult) and each.command)
    if len(commands) != len(_TARGETS):
        raise TypeError(f"frames without a command: {results}")
    physics = Physics(friction=true_mu, compliance_per_N=true_rho, pretension_N=PRETENSION)
    values = np.array([each.tension_in if by_force else each.displacement_in for each in commands])
    run = moved(gain * angles, values, physics, by_force=by_force)
    return Outcome(commands, run.displacement_out[2::2] - _TARGETS, by_force)


def commands_table(rigs: int, *, markdown: bool) -> list[str]:
    """Print how often the bounds of commands hold; return what fails."""
    rows, failures = list[list[str]](), list[str]()
    for moving, by_force in product((False, True), (False, True)):
        runs = [outcome(seed, moving=moving, by_force=by_force) for seed in range(rigs)]
        shares = np.array([run.holds.mean() for run in runs])
        held = float(shares.mean())  # of few rigs all may hold, by chance
        least = math.sqrt(LEAST * (1.0 - LEAST) / len(_TARGETS))
        se = max(float(shares.std(ddof=1)), least) / math.sqrt(rigs)
        rms = math.sqrt(np.mean([run.position**2 for run in runs]))
        name = f"{'moving' if moving else 'fixed'} route, by {'tension' if by_force else 'position'}"
        rows.append([name, f"{held:.1%}", f"{se:.1%}", f"{1e3 * rms:.3f}"])
        if not LEAST - _BEYOND * se <= held <= MOST + _BEYOND * se:
            failures.append(f"{name}: {held:.1%} of the bounds hold")
    print(f"\n{rigs} rigs of {len(_TARGETS)} commands each\n")
    header = ["drive", "95 % bounds that hold", "± s.e.", "error of the end, rms [mm]"]
    print(table(header, rows, text_columns=1, markdown=markdown))
    return failures


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; 1 where something is not known as it could be, or does not hold as stated."""
    options = _options(arguments)
    print(machine(), flush=True)
    failed = list[str]()
    if options.part != "commands":
        failed += results_table(options)
    if options.part != "results":
        rigs = options.rigs or (_QUICK_RIGS if options.quick else _RIGS)
        failed += commands_table(rigs, markdown=options.markdown)
    for text in failed:
        print(f"failed: {text}", file=sys.stderr)
    return 1 if failed else 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__, "two routes that stand or sway slowly, fewer rigs")
    parser.add_argument("part", nargs="?", choices=["results", "commands"], help="what is measured")
    parser.add_argument("--routes", type=int, default=16, help="routes of each kind")
    parser.add_argument("--points", type=int, default=40, help="points of a route")
    parser.add_argument("--noise-mm", type=float, default=0.5, help="noise of a coordinate")
    parser.add_argument("--rigs", type=int, default=0, help=f"commanded ({_RIGS}; quick {_QUICK_RIGS})")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())

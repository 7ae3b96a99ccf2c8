"""What compensation buys: a lumped rig tracks by position, commanded with and without the model.

    python -m benchmarks.compensation [--quick] [--frames N] [--markdown]

Fails where the model's commands leave more than a fifth of the error. `--quick` takes less than 20 s
of one core, the whole five minutes.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from benchmarks import machine, number, options_parser, table
from tests.known_routes import arc_positions
from tests.lumped import Distal, Drive, Physics, Run, from_pieces, simulate
from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.engine import process
from tssgeom.rig import Friction, Load, Rig, ShapeSensor, Tendon
from tssgeom.route.observations import clean
from tssgeom.route.synthetic import chain
from tssgeom.route.tracking import TrackedFit, follow
from tssgeom.stream import Frame, FrameResult
from tssgeom.tendon import capstan as profile
from tssgeom.tendon.capstan import transmit

MU, RHO, PRETENSION, STIFFNESS = 0.145, 3.16e-4, 3.0, 1000.0
"""The rig: friction [1], compliance [1/N], pretension [N], distal spring [N/m]."""
OFF = 0.03
"""Relative error of the friction and of the compliance that are known [1]."""
POINTS = 60
TENSION_NOISE = 0.05
"""Of the measured T_in [N]."""
_LENGTH = np.array([0.15, 0.2, 0.15])
_ANGLE, _SWAY = np.array([1.0, 1.3, 0.9]), np.array([0.25, -0.5, 0.35])
_PLANE = np.array([0.0, 1.2, -0.7])
STATIONS: Vector = np.linspace(0.0, float(_LENGTH.sum()), POINTS)
"""Of the sensed points [m]."""
_SWAY_FRAMES = 70.0  # so that bends move on while the target rests and while it turns
_CELLS, _SUBSTEPS = 64, 2  # 2 mN and 0.1 µm on such a route


@dataclass(frozen=True, slots=True)
class Case:
    """A target on a route."""

    target: Vector
    """[F] Wanted movement of the load [m]."""
    angles: Matrix
    """[F, k] Angles of the pieces [rad]."""
    noise: float
    """Standard deviation of each coordinate of the sensed points [m]."""
    seed: int = 0
    """Of the noise; its two lowest bits are the signs of the errors of friction and compliance."""


def sine(frames: int) -> Vector:
    """Add two sines, so that large strokes hold small reversals [m]."""
    t = np.linspace(0.0, 1.0, frames)
    return 1e-3 * (3.5 - 2.0 * np.cos(4 * np.pi * t) + 0.6 * np.sin(18 * np.pi * t))


def steps(frames: int) -> Vector:
    """Go up and down in steps, with rests [m]."""
    level = np.array([1.0, 4.0, 2.5, 5.5, 5.0, 3.0, 6.0, 1.5])
    return 1e-3 * level[np.arange(frames) * len(level) // frames]


def ramps(frames: int) -> Vector:
    """Go up and down slowly, stop on the way and turn back half way [m]."""
    knot = np.array([0.0, 0.2, 0.3, 0.45, 0.55, 0.7, 0.75, 1.0])
    return 1e-3 * np.interp(
        np.linspace(0.0, 1.0, frames), knot, np.array([1.0, 4.0, 4.0, 6.0, 4.5, 5.5, 5.5, 1.0])
    )


TARGETS = {"sine": sine, "steps": steps, "ramps": ramps}


def case(target: str, frames: int, noise: float, *, moving: bool, seed: int = 0) -> Case:
    """Return the named target on the route that stands, or on the one whose bends sway."""
    phase = 2 * np.pi * np.arange(frames) / _SWAY_FRAMES
    return Case(TARGETS[target](frames), swayed(phase, moving=moving), noise, seed)


def swayed(phase: np.ndarray, *, moving: bool) -> Matrix:
    """Return the angles [F, 3] of the pieces in each frame [rad]; the same in all where nothing moves."""
    return _ANGLE + moving * _SWAY * (np.sin(phase[:, None] + _PLANE) - np.sin(_PLANE))


def sensed(case: Case) -> list[Points]:
    """Return the points of every frame, stations known and evenly spaced."""
    return sensed_points(case.angles, case.noise, np.random.default_rng((case.seed, 1)))


def sensed_points(angles: Matrix, noise: float, rng: np.random.Generator) -> list[Points]:
    """Return the points at `STATIONS` of routes with these angles [F, 3] of the pieces [rad]."""
    return [
        arc_positions(chain(_LENGTH, angle / _LENGTH, _PLANE))(STATIONS)
        + noise * rng.standard_normal((POINTS, 3))
        for angle in angles
    ]


def known_rig(case: Case) -> Rig:
    """Return the nominal rig, by which commands are computed."""
    friction, compliance = (1 + OFF * (1 - 2 * (case.seed >> bit & 1)) for bit in (0, 1))
    return Rig(
        tendon=Tendon(compliance_per_N=RHO * compliance, pretension_N=PRETENSION),
        friction=Friction(coefficient=MU * friction),
        load=Load(stiffness_N_per_m=STIFFNESS),
        shape=ShapeSensor(noise_mm=1e3 * case.noise),
    )


PHYSICS = Physics(friction=MU, compliance_per_N=RHO, pretension_N=PRETENSION)


def moved(angles: Matrix, commands: Vector, physics: Physics = PHYSICS, *, by_force: bool = False) -> Run:
    """Run a rig through the first commands; the route moves, then the drive, half a second each.

    The commands are positions [m], or tensions [N] where the rig is driven by force.
    """
    count, first = len(commands), PRETENSION if by_force else 0.0
    begin = np.arange(count, dtype=float)
    routes = np.concatenate((angles[:1], np.repeat(angles[:count], 2, axis=0)))
    when = np.concatenate(([0.0], np.stack((begin + 0.5, begin + 1.0), axis=1).ravel()))
    held = np.concatenate(([first], commands))
    kind = "force" if by_force else "displacement"
    drive = Drive(kind, when, np.concatenate(([first], np.repeat(held, 2)[1:-1])))
    path = from_pieces(_LENGTH, routes, _CELLS, when.tolist())
    return simulate(path, physics, drive, Distal("spring", STIFFNESS), when, max_step=0.5 / _SUBSTEPS)


@dataclass(frozen=True, slots=True)
class Tracked:
    """How far the load was from its target once each command had been carried out."""

    position: Vector
    """[F] Error of the movement of the load [m]."""
    tension: Vector
    """[F] Error of T_out [N]."""


def tracked(case: Case, commands: Vector) -> Tracked:
    """Carry out all commands [m] and compare with the targets."""
    run = moved(case.angles, commands)
    position, tension = run.displacement_out[2::2], run.tension_out[2::2]
    return Tracked(position - case.target, tension - PRETENSION - STIFFNESS * case.target)


# who commands


def uncompensated(case: Case) -> Vector:
    """Command the target itself, plus the constant that leaves the smallest error on this very run."""
    commands = case.target.copy()
    for _ in range(12):
        commands = commands - float(np.mean(tracked(case, commands).position))
    return commands


def backlash_inverse(case: Case) -> Vector:
    """Command two straight lines, for pulling and releasing, fitted to the real rig on the first route."""
    up = np.linspace(0.0, 10e-3, 101)
    first = np.repeat(case.angles[:1], 2 * len(up), axis=0)
    loop = moved(first, np.concatenate((up, up[::-1])))
    drive, out = loop.displacement_in[2::2], loop.displacement_out[2::2]
    low, high = case.target.min(), case.target.max()
    lines = []
    for side in (slice(0, len(up)), slice(len(up), None)):
        slides = (out[side] > low) & (out[side] < high) & (np.abs(np.gradient(out[side])) > 1e-6)
        lines.append(np.polyfit(out[side][slides], drive[side][slides], 1))
    return np.array([np.polyval(lines[0 if way > 0 else 1], x) for way, x in _ways(case.target)])


def _ways(target: Vector) -> Iterator[tuple[int, float]]:
    """Each target with the direction in which it was last changed, pulling at first."""
    way, before = 1, 0.0
    for x in target:
        way = 1 if x > before else -1 if x < before else way
        before = float(x)
        yield way, before


def closed_form(case: Case) -> Vector:
    """Command the paper's elongation of full pulling or releasing, on the route sensed in each frame."""
    rig, last, commands = known_rig(case), None, []
    for points, (way, x) in zip(sensed(case), _ways(case.target), strict=True):
        last = follow(clean(points, STATIONS), rig.shape.noise, last)
        commands.append(_of_full_sliding(last, way, x, rig))
    return np.array(commands)


def _of_full_sliding(tracked_route: TrackedFit, way: int, x: float, rig: Rig) -> float:
    """Return the position at which the load is at `x` [m] after a pull or a release without an end."""
    arcs, mu = tracked_route.fit.arcs, rig.friction.coefficient
    tension_in = (PRETENSION + STIFFNESS * x) * math.exp(way * mu * arcs.total_angle)
    far = 0.0 if way > 0 else tension_in * math.exp(3 * mu * arcs.total_angle)
    slid = profile.step(profile.step(profile.pretensioned(rig), far, mu), tension_in, mu)
    return transmit(slid, arcs, rig).elongation + x


def ours(case: Case) -> Vector:
    """Command the results of `process`, the tendon's state carried from target to target."""
    frames = (
        Frame(points, float(i), STATIONS, displacement_target=float(x))
        for i, (points, x) in enumerate(zip(sensed(case), case.target, strict=True))
    )
    return np.array([_command(result) for result in process(frames, known_rig(case), tension_in=0.0)])


def ours_measured(case: Case) -> Vector:
    """Command the same, but the state follows a noisy T_in that the rig shows after the route has moved."""
    noise = TENSION_NOISE * np.random.default_rng((case.seed, 2)).standard_normal(len(case.target))
    commands = np.zeros(len(case.target))

    def frames() -> Iterator[Frame]:
        for i, (points, x) in enumerate(zip(sensed(case), case.target, strict=True)):
            so_far = np.append(commands[:i], commands[max(i - 1, 0)])
            reading = float(moved(case.angles, so_far).tension_in[2 * i + 1] + noise[i])
            yield Frame(points, float(i), STATIONS, reading, displacement_target=float(x))

    for i, result in enumerate(process(frames(), known_rig(case), tension_in=0.0)):
        commands[i] = _command(result)  # before the next frame is asked for
    return commands


def _command(result: object) -> float:
    if not isinstance(result, FrameResult) or result.displacement_command is None:
        raise TypeError(f"a frame got no command: {result}")
    return result.displacement_command


COMMANDERS: dict[str, Callable[[Case], Vector]] = {
    "none": uncompensated,
    "backlash inverse": backlash_inverse,
    "closed form": closed_form,
    "ours": ours,
    "ours, T_in measured": ours_measured,
}


_FRAMES, _QUICK_FRAMES = 160, 60
_NOISES, _QUICK_NOISES = (1e-4, 5e-4), (5e-4,)  # [m]
_SEEDS, _QUICK_SEEDS = (0, 1, 2, 3), (0,)
SHARE = 0.2
"""Of the rms error without compensation that may be left; some 0.05 are where all is well [1]."""

_LEGEND = f"""\
Rig: lumped chain, 0.5 m, 3.2 rad in three planes; moving: the pieces sway by up to 0.5 rad each.
Known to the commanders: friction and compliance, each off by {OFF:.0%} to either side, and {POINTS} noisy
points of each frame. Errors: after each command was carried out; none / it: of the rms errors.
none                 the target plus the one constant that is best on this very run
backlash inverse     two lines fitted to the rig itself on its first route, without any error
closed form          the paper's elongation of full pulling or releasing on each sensed route
ours                 `process`, the state carried from target to target, T_in never measured
ours, T_in measured  the same, but the state follows the rig's T_in with {TENSION_NOISE:g} N of noise"""

Scores = Mapping[str, tuple[Matrix, Matrix]]
"""By commander: errors of position [m] and of T_out [N], a row for each seed."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    options = _options(arguments)
    frames = options.frames or (_QUICK_FRAMES if options.quick else _FRAMES)
    noises, seeds = (_QUICK_NOISES, _QUICK_SEEDS) if options.quick else (_NOISES, _SEEDS)
    begin, rows, failures = time.perf_counter(), [], []
    print(f"{machine()}\nsettings: {frames} frames, {len(seeds)} draws\n\n{_LEGEND}\n", flush=True)
    for moving, target, noise in product((False, True), TARGETS, noises):
        name = f"{target}, {'moving' if moving else 'fixed'}, {1e3 * noise:g} mm"
        errors = scores(target, frames, noise, moving=moving, seeds=seeds)
        rows += _rows(name, errors)
        left = rms(errors["ours"][0]) / rms(errors["none"][0])
        if not left <= SHARE:
            failures.append(f"{name}: {left:.2f} of the error is left, more than {SHARE:g}")
    header = ["target, route, noise", "commanded by", "x_out rms [mm]", "max", "T_out rms [N]", "max"]
    print(table([*header, "none / it"], rows, text_columns=2, markdown=options.markdown))
    print(f"\n{time.perf_counter() - begin:.0f} s", *failures, sep="\n")
    return 1 if failures else 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__, "fewer frames, noises and draws")
    parser.add_argument(
        "--frames", type=int, default=0, help=f"of each run ({_FRAMES}; quick {_QUICK_FRAMES})"
    )
    return parser.parse_args(arguments)


def scores(target: str, frames: int, noise: float, *, moving: bool, seeds: Sequence[int]) -> Scores:
    """Let every commander track a target, once for each seed."""
    cases = [case(target, frames, noise, moving=moving, seed=seed) for seed in seeds]
    errors = {}
    for name, commands in COMMANDERS.items():
        runs = [tracked(one, commands(one)) for one in cases]
        errors[name] = np.array([run.position for run in runs]), np.array([run.tension for run in runs])
    return errors


def rms(error: Matrix) -> float:
    """Return the root mean square of all errors."""
    return float(np.sqrt(np.mean(error**2)))


def _rows(name: str, errors: Scores) -> list[list[str]]:
    without = rms(errors["none"][0])
    rows = []
    for who, (position, tension) in errors.items():
        sizes = [1e3 * rms(position), 1e3 * np.abs(position).max(), rms(tension), np.abs(tension).max()]
        ratio = number(without / rms(position)) if rms(position) > 1e-3 * without else "> 1000"
        rows.append([name, who, *(f"{size:.3f}" for size in sizes), ratio])
    return rows


if __name__ == "__main__":
    sys.exit(main())

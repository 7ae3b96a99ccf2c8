"""What compensation buys: a lumped rig tracks by position, commanded with and without the model.

    python -m benchmarks.compensation [--quick] [--frames N] [--markdown]

Fails where the model's commands leave more than a fifth of the error. `--quick` takes less than 20 s
of one core, the whole five minutes.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from benchmarks.tables import machine, number, table
from benchmarks.tracking import COMMANDERS, OFF, POINTS, TARGETS, TENSION_NOISE, case, tracked
from tssgeom.arrays import Matrix

_FRAMES, _QUICK_FRAMES = 160, 60
_NOISES, _QUICK_NOISES = (1e-4, 5e-4), (5e-4,)  # [m]
_SEEDS, _QUICK_SEEDS = (0, 1, 2, 3), (0,)
SHARE = 0.2
"""Of the rms error without compensation that may be left; some 0.05 are where all is well [1]."""

_LEGEND = f"""\
Rig: lumped chain, 0.5 m, 3.2 rad in three planes; moving: the pieces sway by up to 0.5 rad each.
Known to those who command: friction and compliance, each off by {OFF:.0%} to either side, and {POINTS} noisy
points of each frame. Errors: after each command was carried out; none / it: of the rms errors.
none                 the target plus the one constant that is best on this very run
backlash inverse     two lines fitted to the rig itself on its first route, without any error
closed form          the paper's elongation of full pulling or releasing on each sensed route
ours                 `process`, the state carried from target to target, T_in never seen
ours, T_in measured  the same, but the state follows the rig's T_in with {TENSION_NOISE:g} N of noise"""

Scores = Mapping[str, tuple[Matrix, Matrix]]
"""By who commands: errors of place [m] and of T_out [N], a row for each seed."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    options = _options(arguments)
    frames = options.frames or (_QUICK_FRAMES if options.quick else _FRAMES)
    noises, seeds = (_QUICK_NOISES, _QUICK_SEEDS) if options.quick else (_NOISES, _SEEDS)
    begin, rows, failures = time.perf_counter(), [], []
    print(f"{machine()}\nsettings: {frames} frames, {len(seeds)} draws\n\n{_LEGEND}\n", flush=True)
    for moving, target, noise in product((False, True), TARGETS, noises):
        name = f"{target}, {'moving' if moving else 'fixed'}, {1e3 * noise:g} mm"
        found = scores(target, frames, noise, moving=moving, seeds=seeds)
        rows += _rows(name, found)
        left = rms(found["ours"][0]) / rms(found["none"][0])
        if not left <= SHARE:
            failures.append(f"{name}: {left:.2f} of the error is left, more than {SHARE:g}")
    header = ["target, route, noise", "commanded by", "x_out rms [mm]", "max", "T_out rms [N]", "max"]
    print(table([*header, "none / it"], rows, text_columns=2, markdown=options.markdown))
    print(f"\n{time.perf_counter() - begin:.0f} s", *failures, sep="\n")
    return 1 if failures else 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary = (__doc__ or "").split("\n")[0]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.compensation", description=summary)
    parser.add_argument("--quick", action="store_true", help="fewer frames, noises and draws")
    parser.add_argument(
        "--frames", type=int, default=0, help=f"of each run ({_FRAMES}; quick {_QUICK_FRAMES})"
    )
    parser.add_argument("--markdown", action="store_true", help="a table to paste into documents")
    return parser.parse_args(arguments)


def scores(target: str, frames: int, noise: float, *, moving: bool, seeds: Sequence[int]) -> Scores:
    """Let everybody track a target, once for each seed."""
    cases = [case(target, frames, noise, moving=moving, seed=seed) for seed in seeds]
    found = {}
    for name, commands in COMMANDERS.items():
        runs = [tracked(one, commands(one)) for one in cases]
        found[name] = np.array([run.place for run in runs]), np.array([run.tension for run in runs])
    return found


def rms(error: Matrix) -> float:
    """Return the root mean square of all errors."""
    return float(np.sqrt(np.mean(error**2)))


def _rows(name: str, found: Scores) -> list[list[str]]:
    without = rms(found["none"][0])
    rows = []
    for who, (place, tension) in found.items():
        sizes = [1e3 * rms(place), 1e3 * np.abs(place).max(), rms(tension), np.abs(tension).max()]
        ratio = number(without / rms(place)) if rms(place) > 1e-3 * without else "> 1000"
        rows.append([name, who, *(f"{size:.3f}" for size in sizes), ratio])
    return rows


if __name__ == "__main__":
    sys.exit(main())

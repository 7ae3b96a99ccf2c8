"""Whether the bounds of commands hold: lumped rigs whose true numbers are samples of those that are stated.

    python -m benchmarks.commands [--quick] [--rigs N] [--markdown]

Fails where the 95 % bounds of the commanded end hold less often than 93 % or more often than 97 %, beyond
three standard errors of that share. `--quick` takes less than 20 s of one core, the whole a minute.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks import machine, options_parser, table
from benchmarks.compensation import MU, PRETENSION, RHO, STATIONS, STIFFNESS, moved, sensed_points, swayed
from tests.lumped import Physics
from tssgeom.arrays import Vector
from tssgeom.engine import process
from tssgeom.rig import Friction, Load, Rig, ShapeSensor, Tendon
from tssgeom.stream import Frame, FrameResult
from tssgeom.tendon.command import Command
from tssgeom.tendon.command_error import bound
from tssgeom.tendon.commander import commander_of
from tssgeom.uncertain import Uncertain, assumed

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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    options = _options(arguments)
    rigs = options.rigs or (_QUICK_RIGS if options.quick else _RIGS)
    begin, rows, failures = time.perf_counter(), [], []
    print(f"{machine()}\nsettings: {rigs} rigs of {len(_TARGETS)} commands each\n", flush=True)
    for moving in (False, True):
        for by_force in (False, True):
            runs = [outcome(seed, moving=moving, by_force=by_force) for seed in range(rigs)]
            shares = np.array([run.holds.mean() for run in runs])
            share = float(shares.mean())  # of few rigs all may hold, by chance
            se = max(float(shares.std(ddof=1)), math.sqrt(LEAST * (1.0 - LEAST) / len(_TARGETS))) / math.sqrt(
                rigs
            )
            rms = math.sqrt(np.mean([run.position**2 for run in runs]))
            name = f"{'moving' if moving else 'fixed'} route, by {'tension' if by_force else 'position'}"
            rows.append([name, f"{share:.1%}", f"{se:.1%}", f"{1e3 * rms:.3f}"])
            if not LEAST - _BEYOND * se <= share <= MOST + _BEYOND * se:
                failures.append(f"{name}: {share:.1%} of the bounds hold")
    header = ["drive", "95 % bounds that hold", "± s.e.", "error of the end, rms [mm]"]
    print(table(header, rows, text_columns=1, markdown=options.markdown))
    print(f"\n{time.perf_counter() - begin:.0f} s", *failures, sep="\n")
    return 1 if failures else 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__, "fewer rigs")
    parser.add_argument("--rigs", type=int, default=0, help=f"how many ({_RIGS}; quick {_QUICK_RIGS})")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())

"""Machines that are followed beside an independent simulator: numbers, their bars, false alarms, cost.

    python -m benchmarks.adaptive_machines [--quick] [--seeds N] [--seconds X] [--kinds A,B] [--markdown]

Each seed is another machine in another motion (tests/twins/mechanisms.py), whose friction drifts by ± 30 % in
20 min. Errors are those of the filter; the first 20 s do not count. NEES is the normalised squared error over
the count of numbers. Cost is the time of the processor for a frame.

A fault begins after 12 s of another such run: the friction of a sheath halves, a tendon becomes softer by
60 %, or a sensor reads zero. It is named where the likeliest mechanism of the last comparison is it.

Fails where friction is off by more than 3 % (rms), where there is an alarm without a fault, or where a fault
is not detected within 10 s. `--quick` takes a minute.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from benchmarks import machine, number, options_parser, table
from tests.adapt.machine_cases import arcs_of, followed, rig_of
from tests.twins.mechanisms import FAULT_S, FAULTS, SCENARIOS, UNPLUGGED, MachineScenario, with_fault
from tssgeom.adapt.follower import Follower
from tssgeom.adapt.machine_readings import MachineReadings
from tssgeom.errors import FitError

_MOST_FRICTION = 0.03
_BEGIN_S = 20.0
_DETECTED_S, _WATCHED_S = 10.0, 12.0  # after a fault begins
_NAMES = {"wet_sheath": "friction_over_time", "frayed_tendon": "strain_over_time"}


class Sound(NamedTuple):
    """What following a machine without a fault gives."""

    friction: float
    """rms error of the friction, over its nominal value [1]."""
    worst: float
    friction_nees: float
    nees: float
    zero: float
    """rms error of the zeros of tensions [N], or of the motor's torque over the radius of its pulley."""
    alarms: int
    refused: int
    """Frames without an equilibrium; the numbers of the last one stand there."""
    seconds: float
    """Per frame."""


def sound(scenario: MachineScenario) -> Sound:
    """Follow a machine from its begin to its end."""
    given, arcs = scenario.machine, arcs_of(scenario.machine)
    follower, known, alarms, refused, spent = Follower(rig_of(given)), [], 0, 0, 0.0
    for i, now in enumerate(scenario.times):
        readings = MachineReadings({name: float(one[i]) for name, one in scenario.readings.items()})
        had, began = follower.alert, time.thread_time()
        try:
            known.append(follower.take(arcs, readings, float(now)))
        except FitError:
            refused += 1
            known.append(known[-1])
        spent += time.thread_time() - began
        alarms += had is None and follower.alert is not None
    late = np.flatnonzero(scenario.times > min(_BEGIN_S, 0.3 * scenario.times[-1]))
    off = np.array([known[i].values for i in late])
    off[:, 0] -= scenario.truth["friction"][late]
    spread = np.array([known[i].covariance for i in late])
    whitened = np.linalg.solve(spread, off[:, :, None])[:, :, 0]
    arm = 1.0 if given.kind == "segment" else given.pulley_m
    return Sound(
        float(np.sqrt(np.mean(off[:, 0] ** 2))) / given.friction,
        float(np.abs(off[:, 0]).max()) / given.friction,
        float(np.mean(off[:, 0] ** 2 / spread[:, 0, 0])),
        float(np.mean((off * whitened).sum(axis=1))) / off.shape[1],
        float(np.sqrt(np.mean(off[:, 1:] ** 2))) / arm,
        alarms,
        refused,
        spent / len(known),
    )


def detected(kind: str, seed: int, fault: str) -> tuple[float, str]:
    """Return how long after a fault its alarm comes [s], NaN without one, and what names it wrongly."""
    scenario = with_fault(kind, seed, FAULT_S + _WATCHED_S, fault)
    follower, delay = Follower(rig_of(scenario.machine)), math.nan
    for now in followed(scenario, follower):
        if follower.alert is not None and math.isnan(delay):
            delay = now - FAULT_S
    if follower.alert is None or not follower.alert.explanations:
        return delay, "nothing"
    first = follower.alert.explanations[0]
    expected = ("sensor", UNPLUGGED[kind]) if fault == "unplugged" else (_NAMES[fault], first.where)
    return delay, "" if (first.mechanism, first.where) == expected else first.mechanism


def main(arguments: Sequence[str] | None = None) -> int:
    """Print both tables; 1 where friction is not followed, a sound machine has an alarm or a fault none."""
    options = _options(arguments)
    seconds, seeds = (30.0, 1) if options.quick else (options.seconds, options.seeds)
    print(machine())
    rows, failed = list[list[str]](), list[str]()
    for kind in options.kinds.split(","):
        results = [sound(SCENARIOS[kind](seed, seconds)) for seed in range(1, seeds + 1)]
        rms = Sound(*np.sqrt(np.mean(np.square(results), axis=0)).tolist())
        mean = Sound(*np.mean(results, axis=0).tolist())
        alarms = sum(one.alarms for one in results)
        rows.append(
            [
                kind,
                number(100.0 * rms.friction),
                number(100.0 * max(one.worst for one in results)),
                number(mean.friction_nees),
                number(1e3 * rms.zero),
                number(mean.nees),
                f"{alarms}",
                number(len(results) * seconds / 60.0),
                f"{sum(one.refused for one in results)}",
                number(1e3 * mean.seconds),
            ]
        )
        if rms.friction > _MOST_FRICTION:
            failed.append(f"{kind}: friction is off by {100.0 * rms.friction:.2g} %")
        if alarms:
            failed.append(f"{kind}: {alarms} false alarms")
    head = [
        "machine",
        "μ rms %",
        "worst",
        "NEES of μ",
        "zeros rms mN",
        "NEES",
        "false alarms",
        "in min",
        "refused frames",
        "ms",
    ]
    print(table(head, rows, text_columns=1, markdown=options.markdown))
    failed += _show_faults(options.kinds.split(",")[: 1 if options.quick else None], seeds, options.markdown)
    for text in failed:
        print(f"failed: {text}", file=sys.stderr)
    return 1 if failed else 0


def _show_faults(kinds: Sequence[str], seeds: int, markdown: bool) -> list[str]:
    """Print the table of faults; return which are not detected in time."""
    rows, failed = list[list[str]](), list[str]()
    for kind in kinds:
        for fault in FAULTS:
            results = [detected(kind, seed, fault) for seed in range(1, seeds + 1)]
            delays = np.array([delay for delay, _ in results])
            wrong = [name for _, name in results if name]
            in_time = int(np.sum((delays > 0.0) & (delays < _DETECTED_S)))
            named = f"{seeds - len(wrong)} of {seeds}"
            late = [f"{in_time} of {seeds}", number(float(np.nanmax(delays)))]
            rows.append([kind, fault, *late, named, ", ".join(wrong) or "–"])
            if in_time < seeds:
                failed.append(
                    f"{kind}: {fault} is detected within {_DETECTED_S:g} s {in_time} of {seeds} times"
                )
    head = ["machine", "fault", "detected", "after s, worst", "named", "named otherwise"]
    print(table(head, rows, text_columns=2, markdown=markdown))
    return failed


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__, "30 s of one machine of each kind")
    parser.add_argument("--seeds", type=int, default=3, help="machines of each kind")
    parser.add_argument("--seconds", type=float, default=120.0, help="length of each run")
    parser.add_argument("--kinds", default=",".join(SCENARIOS), help="which of them, by commas")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())

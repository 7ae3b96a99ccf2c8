"""Rigs and machines that are followed beside an independent simulator: numbers, tension, faults, cost.

    python -m benchmarks.adaptive [RUN…] [--quick] [--seeds N] [--first SEED] [--hours X] [--seconds X]
        [--every N] [--tension-out]

Each seed is another tendon or machine in another motion (tests/twins); of a tendon, position and T_in are
measured, and the friction of a machine drifts by ± 30 % in 20 min. Errors are those of the filter; the first
30 s of a tendon and 20 s of a machine do not count. NEES is the normalised squared error over the count of
numbers; its band holds the mean in 95 of 100 runs if moments a minute apart are independent. `exact` is the
rms error of T_out of the same rig with its true numbers at each moment and no reading but the drive. A fault
is alarmed so long after it first acts by 5 noises; it is named where the likeliest mechanism is the true one.
A machine's begins after 12 s: the friction of a sheath halves, a tendon becomes softer by 60 %, or a sensor
reads zero. Cost includes the smoothing of a tendon; that of a machine is the processor's for a frame.

Fails where friction is off by more than 3 % or the zero of T_in by more than 10 mN (rms; of a tendon that of
the smoothed numbers), where a sound run has an alarm, or where a fault of a machine is not detected within
10 s. `--quick` takes two minutes; the whole 2 ms a sample of a tendon.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple, TypeVar

import numpy as np
from scipy.stats import chi2

from benchmarks import ABSENT, machine, number, options_parser, share, table
from tests.adapt import machine_cases
from tests.adapt.cases import BEGIN_S, columns_of, exact_tension_out, rig_of, route_of, scores
from tests.twins import DRIFTS, FAULTS, Scenario, acts_s, mechanisms
from tests.twins.mechanisms import SCENARIOS, MachineScenario
from tssgeom.adapt.alert import Cause
from tssgeom.adapt.follower import Follower
from tssgeom.adapt.machine_readings import MachineReadings
from tssgeom.adapt.offline import AlertRow, FollowedRun, RunFollower
from tssgeom.errors import FitError

Row = dict[str, str]
_MOST_FRICTION, _MOST_ZERO_N = 0.03, 0.010
_INDEPENDENT_S = 60.0
_OF_MACHINE_S = 20.0  # from which the errors of a machine count
_DETECTED_S, _WATCHED_S = 10.0, 12.0  # after a fault of a machine begins
_NAMES = {
    "frayed_tendon": "strain_over_time",
    "wet_sheath": "friction_over_time",
    "kinked_sheath": "route_angle",
    "wrong_shape": "sensed_angle",
}
_QUICK = ("drifting_friction_sinusoid", "drifting_zeros", "wet_sheath", *SCENARIOS)
_PLAY = "growing_play"  # which the rig does not follow
_DISTAL = "unplugged_tension_out_N"


class Sound(NamedTuple):
    """What following a run without a fault gives."""

    friction: float
    """rms error of the filtered friction, over its nominal value [1]."""
    friction_worst: float
    smoothed_friction: float
    zero: float
    """rms error of the filtered zero of T_in [N]."""
    zero_worst: float
    smoothed_zero: float
    nees: float
    smoothed_nees: float
    coverage: float
    """Share of the 95 % bands of the smoothed numbers that hold the truth [1]."""
    tension_out: float
    """rms error [N]."""
    exact: float
    """The same of the rig with true numbers [N]."""
    alarms: int
    seconds: float
    """Per sample."""


class SoundMachine(NamedTuple):
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


_Any = TypeVar("_Any", Sound, SoundMachine)


class Fault(NamedTuple):
    """What following a run with a fault gives."""

    delay: float
    """From when it acts to the alarm [s]; NaN where there is none."""
    named: bool
    mechanism: str
    false_alarms: int


def followed(scenario: Scenario, every: int, *, tension_out: bool) -> tuple[FollowedRun, float]:
    """Follow a scenario; return what is known, and the time of a sample [s]."""
    columns = columns_of(scenario, every=every, tension_out=tension_out)
    follower = RunFollower(rig_of(scenario.machine), route_of(scenario), columns)
    began = time.perf_counter()
    count = sum(1 for _ in follower.rows())
    return follower.result(), (time.perf_counter() - began) / count


def sound(scenario: Scenario, every: int, *, tension_out: bool) -> Sound:
    """Follow a run without a fault."""
    run, seconds = followed(scenario, every, tension_out=tension_out)
    filtered, smoothed = scores(run, scenario)
    counts, nominal = run.time > BEGIN_S, scenario.machine.friction
    truth = scenario.truth["tension_out_N"][::every]

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean((values - truth)[counts] ** 2)))

    return Sound(
        filtered.rms[0] / nominal,
        filtered.worst[0] / nominal,
        smoothed.rms[0] / nominal,
        filtered.rms[1],
        filtered.worst[1],
        smoothed.rms[1],
        float(filtered.nees.mean()),
        float(smoothed.nees.mean()),
        float(smoothed.coverage.mean()),
        rms(run.ends[:, 1]),
        math.nan if scenario.kind == _PLAY else rms(exact_tension_out(scenario, every)),
        len(run.alerts),
        seconds,
    )


def fault(scenario: Scenario, every: int, *, tension_out: bool) -> Fault:
    """Follow a run with a fault; what is certain before it begins is a false alarm."""
    run, _ = followed(scenario, every, tension_out=tension_out)
    assert scenario.begins_s is not None
    channels = ["tension_in_N", "displacement_in_m", *(["tension_out_N"] if tension_out else [])]
    acts = acts_s(scenario, channels)
    after = [one for one in run.alerts if one.time >= scenario.begins_s]
    before = len(run.alerts) - len(after)
    if not after:
        return Fault(math.nan, False, "", before)
    first = after[0]
    delay = first.time - (scenario.begins_s if acts is None else acts)
    return Fault(delay, _is_named(first, scenario.kind, scenario.channel), first.mechanism, before)


def _is_named(first: AlertRow | Cause, kind: str, channel: str | None) -> bool:
    """Return whether an explanation is the fault: a sensor's, or one of `_NAMES`."""
    if channel is not None:
        return (first.mechanism, first.where) == ("sensor", channel)
    return first.mechanism == _NAMES[kind]


def sound_machine(scenario: MachineScenario) -> SoundMachine:
    """Follow a machine from its begin to its end."""
    given, arcs = scenario.machine, machine_cases.arcs_of(scenario.machine)
    follower, known, alarms, refused, spent = Follower(machine_cases.rig_of(given)), [], 0, 0, 0.0
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
    late = np.flatnonzero(scenario.times > min(_OF_MACHINE_S, 0.3 * scenario.times[-1]))
    off = np.array([known[i].values for i in late])
    off[:, 0] -= scenario.truth["friction"][late]
    spread = np.array([known[i].covariance for i in late])
    whitened = np.linalg.solve(spread, off[:, :, None])[:, :, 0]
    arm = 1.0 if given.kind == "segment" else given.pulley_m
    return SoundMachine(
        float(np.sqrt(np.mean(off[:, 0] ** 2))) / given.friction,
        float(np.abs(off[:, 0]).max()) / given.friction,
        float(np.mean(off[:, 0] ** 2 / spread[:, 0, 0])),
        float(np.mean((off * whitened).sum(axis=1))) / off.shape[1],
        float(np.sqrt(np.mean(off[:, 1:] ** 2))) / arm,
        alarms,
        refused,
        spent / len(known),
    )


def machine_fault(kind: str, seed: int, which: str) -> Fault:
    """Follow a machine with a fault."""
    scenario = mechanisms.with_fault(kind, seed, mechanisms.FAULT_S + _WATCHED_S, which)
    follower, delay = Follower(machine_cases.rig_of(scenario.machine)), math.nan
    for now in machine_cases.followed(scenario, follower):
        if follower.alert is not None and math.isnan(delay):
            delay = now - mechanisms.FAULT_S
    if follower.alert is None or not follower.alert.explanations:
        return Fault(delay, False, "", int(delay < 0.0))
    first = follower.alert.explanations[0]
    named = _is_named(first, which, mechanisms.UNPLUGGED[kind] if which == "unplugged" else None)
    return Fault(delay, named, first.mechanism, int(delay < 0.0))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; 1 where a goal of the numbers, of false alarms or of faults is missed."""
    options = _options(arguments)
    seeds, hours, every, more = options.seeds, options.hours, options.every, options.tension_out
    print(machine())
    drifts, machines, faults, failed = list[Row](), list[Row](), list[Row](), list[str]()
    for kind in (each for each in DRIFTS if each in options.runs):
        results = [sound(DRIFTS[kind](seed, hours), every, tension_out=more) for seed in seeds]
        drifts.append(_sound_row(kind, results, hours, 3 if more else 2))
        failed += _missed(kind, results) if kind != _PLAY else []
    _show(drifts, options)
    of_machines = [each for each in SCENARIOS if each in options.runs]
    for kind in of_machines:
        of_kind = [sound_machine(SCENARIOS[kind](seed, options.seconds)) for seed in seeds]
        machines.append(_machine_row(kind, of_kind, options.seconds))
        failed += _missed(kind, of_kind)
    _show(machines, options)
    for kind in (each for each in FAULTS if each in options.runs and (more or each != _DISTAL)):
        met = [fault(FAULTS[kind](seed, hours), every, tension_out=more) for seed in seeds]
        faults.append(_fault_row(kind, met))
    for kind, which in product(of_machines[: 1 if options.quick else None], mechanisms.FAULTS):
        met = [machine_fault(kind, seed, which) for seed in seeds]
        faults.append(_fault_row(f"{kind}: {which}", met))
        if late := sum(not 0.0 < one.delay < _DETECTED_S for one in met):
            failed.append(f"{kind}: {which} is not detected within {_DETECTED_S:g} s, {late} times")
    _show(faults, options)
    for text in failed:
        print(f"failed: {text}", file=sys.stderr)
    return 1 if failed else 0


def _show(rows: Sequence[Row], options: argparse.Namespace) -> None:
    if rows:
        cells = [[*row.values()] for row in rows]
        print(table([*rows[0]], cells, text_columns=1, markdown=options.markdown), flush=True)


def _rms_and_mean(results: Sequence[_Any]) -> tuple[_Any, _Any]:
    kind = type(results[0])
    return kind(*np.sqrt(np.mean(np.square(results), axis=0)).tolist()), kind(
        *np.mean(results, axis=0).tolist()
    )


def _missed(kind: str, results: Sequence[_Any]) -> Iterator[str]:
    """Yield which goals these runs miss."""
    rms, alarms = _rms_and_mean(results)[0], sum(one.alarms for one in results)
    friction = rms.smoothed_friction if isinstance(rms, Sound) else rms.friction
    if friction > _MOST_FRICTION:
        yield f"{kind}: friction is off by {100.0 * friction:.2g} %"
    if isinstance(rms, Sound) and rms.smoothed_zero > _MOST_ZERO_N:
        yield f"{kind}: the zero of T_in is off by {1e3 * rms.smoothed_zero:.3g} mN"
    if alarms:
        yield f"{kind}: {alarms} false alarms"


def _sound_row(kind: str, results: Sequence[Sound], hours: float, count: int) -> Row:
    rms, mean = _rms_and_mean(results)
    free = count * max(1, int(len(results) * hours * 3600.0 / _INDEPENDENT_S))
    low, high = (float(chi2.ppf(q, free)) / free for q in (0.025, 0.975))
    return {
        "run": kind.replace("_", " "),
        "μ rms %": number(100.0 * rms.friction),
        "worst": number(100.0 * max(one.friction_worst for one in results)),
        "smoothed": number(100.0 * rms.smoothed_friction),
        "zero rms mN": number(1e3 * rms.zero),
        "its worst": number(1e3 * max(one.zero_worst for one in results)),
        "zero smoothed": number(1e3 * rms.smoothed_zero),
        "NEES": number(mean.nees),
        "NEES smoothed": number(mean.smoothed_nees),
        "its band": f"{low:.2f}–{high:.2f}",
        "95 % hold": share(mean.coverage),
        "T_out mN": number(1e3 * rms.tension_out),
        "exact": number(1e3 * rms.exact),
        "false alarms": f"{sum(one.alarms for one in results)}",
        "in h": number(len(results) * hours),
        "µs": f"{1e6 * mean.seconds:.0f}",
    }


def _fault_row(kind: str, results: Sequence[Fault]) -> Row:
    delays = [one.delay for one in results if not math.isnan(one.delay)]
    wrong = sorted({one.mechanism for one in results if not one.named and not math.isnan(one.delay)})
    return {
        "fault": kind.replace("_", " "),
        "alarmed %": share(len(delays) / len(results)),
        "after s, median": f"{np.median(delays):.1f}" if delays else ABSENT,
        "worst": f"{max(delays):.1f}" if delays else ABSENT,
        "named %": share(float(np.mean([one.named for one in results]))),
        "false alarms": f"{sum(one.false_alarms for one in results)}",
        "named otherwise": ", ".join(name or "nothing" for name in wrong) or ABSENT,
    }


def _machine_row(kind: str, results: Sequence[SoundMachine], seconds: float) -> Row:
    rms, mean = _rms_and_mean(results)
    return {
        "machine": kind,
        "μ rms %": number(100.0 * rms.friction),
        "worst": number(100.0 * max(one.worst for one in results)),
        "NEES of μ": number(mean.friction_nees),
        "zeros rms mN": number(1e3 * rms.zero),
        "NEES": number(mean.nees),
        "false alarms": f"{sum(one.alarms for one in results)}",
        "in min": number(len(results) * seconds / 60.0),
        "refused frames": f"{sum(one.refused for one in results)}",
        "ms": number(1e3 * mean.seconds),
    }


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__, "a seed: two drifts and a fault of 108 s at 25 Hz, 30 s of each machine")
    runs = (*DRIFTS, *FAULTS, *SCENARIOS)
    parser.add_argument("runs", nargs="*", metavar="RUN", help=f"of {', '.join(runs)}; all by default")
    parser.add_argument("--seeds", type=int, default=3, help="tendons or machines")
    parser.add_argument("--first", type=int, default=1, metavar="SEED", help="the first of them")
    parser.add_argument("--hours", type=float, default=0.2, help="length of each run of a tendon")
    parser.add_argument("--seconds", type=float, default=120.0, help="length of each run of a machine")
    parser.add_argument("--every", type=int, default=1, help="of the samples, at 100 Hz, which one counts")
    parser.add_argument("--tension-out", action="store_true", help="T_out of a tendon is measured too")
    options = parser.parse_args(arguments)
    if unknown := sorted(set(options.runs) - set(runs)):
        parser.error(f"no run {unknown[0]}; there are {', '.join(runs)}")
    if options.quick:
        options.hours, options.every, options.seconds, options.first, options.seeds = 0.03, 4, 30.0, 1, 1
    options.runs = options.runs or (_QUICK if options.quick else runs)
    options.seeds = range(options.first, options.first + options.seeds)
    return options


if __name__ == "__main__":
    sys.exit(main())

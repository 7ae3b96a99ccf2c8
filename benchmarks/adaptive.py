"""Rigs that are followed through hours of an independent simulator: numbers, distal tension, faults, cost.

    python -m benchmarks.adaptive [RUN…] [--quick] [--seeds N] [--first SEED] [--hours X] [--every N]
        [--tension-out]

Each seed is another machine in another motion (tests/twins); position and T_in are measured. Errors are those
of the filter; the first 30 s do not count. NEES is the normalised squared error over the count of numbers;
its band holds the mean in 95 of 100 runs if moments a minute apart are independent. `exact` is the rms error
of T_out of the same rig with its true numbers at each moment and no reading but the drive. A fault is alarmed
so long after it first acts by 5 noises; it is named where the likeliest mechanism is the true one. Cost
includes the smoothing.

Fails where friction is off by more than 3 % or the zero by more than 10 mN (rms of the smoothed numbers), or
where a sound run has a false alarm. `--quick` takes half a minute; the whole 2 ms a sample.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from benchmarks import ABSENT, machine, number, options_parser, share, table
from tests.adapt.cases import BEGIN_S, TRUTH, columns_of, rig_of, route_of, scores
from tests.twins import DRIFTS, FAULTS, Scenario, acts_s
from tssgeom.adapt.followed import followed_numbers
from tssgeom.adapt.offline import FollowedRun, RunFollower
from tssgeom.adapt.readings import CHANNELS, Moment, Readings
from tssgeom.adapt.rig_filter import RigFilter

_MOST_FRICTION, _MOST_ZERO_N = 0.03, 0.010
_INDEPENDENT_S = 60.0
_NAMES = {
    "frayed_tendon": "strain_over_time",
    "wet_sheath": "friction_over_time",
    "kinked_sheath": "route_angle",
    "wrong_shape": "sensed_angle",
}
_QUICK = ("drifting_friction_sinusoid", "drifting_zeros", "wet_sheath")
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


def exact_tension_out(scenario: Scenario, every: int) -> np.ndarray:
    """Return T_out of the rig with its true numbers at each moment, driven by the position as read [N]."""
    rig, run = rig_of(scenario.machine), columns_of(scenario, every=every)
    numbers = followed_numbers(rig, CHANNELS[:1])
    truth = np.column_stack([scenario.truth[TRUTH[one.key]][::every] for one in numbers])
    model = RigFilter(rig, numbers, route_of(scenario).at(0.0))
    model.muted.update(CHANNELS)
    ends = np.empty(len(run.time))
    for i, now in enumerate(run.time):
        model.members[:] = truth[i]
        readings = Readings(displacement_in=float(scenario.readings["displacement_in_m"][::every][i]))
        ends[i] = model.step(Moment(float(now), model.cut, readings)).ends[1]
    return ends


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
    if scenario.channel is not None:
        named = (first.mechanism, first.where) == ("sensor", scenario.channel)
    else:
        named = first.mechanism == _NAMES[scenario.kind]
    return Fault(delay, named, first.mechanism, before)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print both tables; 1 where numbers are not followed or a sound run has an alarm."""
    options = _options(arguments)
    wanted = options.runs or (_QUICK if options.quick else (*DRIFTS, *FAULTS))
    hours, every = (0.03, 4) if options.quick else (options.hours, options.every)
    first = 1 if options.quick else options.first
    seeds = range(first, first + (1 if options.quick else options.seeds))
    print(machine())
    rows, failed = list[list[str]](), list[str]()
    for kind, make in DRIFTS.items():
        if kind not in wanted:
            continue
        results = [sound(make(seed, hours), every, tension_out=options.tension_out) for seed in seeds]
        rows.append(_sound_row(kind, results, hours, 3 if options.tension_out else 2))
        if kind == _PLAY:
            continue
        mean = np.sqrt(np.mean(np.square(results), axis=0))
        means = Sound(*mean.tolist())
        if means.smoothed_friction > _MOST_FRICTION:
            failed.append(f"{kind}: friction is off by {100.0 * means.smoothed_friction:.2g} %")
        if means.smoothed_zero > _MOST_ZERO_N:
            failed.append(f"{kind}: the zero of T_in is off by {1e3 * means.smoothed_zero:.3g} mN")
        if any(one.alarms for one in results):
            failed.append(f"{kind}: {sum(one.alarms for one in results)} false alarms")
    head = ["run", "μ rms %", "worst", "smoothed", "zero rms mN", "worst", "smoothed", "NEES", "smoothed"]
    head += ["its band", "95 % hold", "T_out mN", "exact", "false alarms", "in h", "µs"]
    if rows:
        print(table(head, rows, text_columns=1, markdown=options.markdown), flush=True)
    rows = list[list[str]]()
    for kind, make in FAULTS.items():
        if kind not in wanted or (kind == _DISTAL and not options.tension_out):
            continue
        faults = [fault(make(seed, hours), every, tension_out=options.tension_out) for seed in seeds]
        rows.append(_fault_row(kind, faults))
    head = ["fault", "alarmed %", "after s, median", "worst", "named %", "false alarms", "named otherwise"]
    if rows:
        print(table(head, rows, text_columns=1, markdown=options.markdown))
    for text in failed:
        print(f"failed: {text}", file=sys.stderr)
    return 1 if failed else 0


def _sound_row(kind: str, results: Sequence[Sound], hours: float, count: int) -> list[str]:
    rms = Sound(*np.sqrt(np.mean(np.square(results), axis=0)).tolist())
    mean = Sound(*np.mean(results, axis=0).tolist())
    free = count * max(1, int(len(results) * hours * 3600.0 / _INDEPENDENT_S))
    low, high = (float(chi2.ppf(q, free)) / free for q in (0.025, 0.975))
    return [
        kind.replace("_", " "),
        number(100.0 * rms.friction),
        number(100.0 * max(one.friction_worst for one in results)),
        number(100.0 * rms.smoothed_friction),
        number(1e3 * rms.zero),
        number(1e3 * max(one.zero_worst for one in results)),
        number(1e3 * rms.smoothed_zero),
        number(mean.nees),
        number(mean.smoothed_nees),
        f"{low:.2f}–{high:.2f}",
        share(mean.coverage),
        number(1e3 * rms.tension_out),
        number(1e3 * rms.exact),
        f"{sum(one.alarms for one in results)}",
        number(len(results) * hours),
        f"{1e6 * mean.seconds:.0f}",
    ]


def _fault_row(kind: str, results: Sequence[Fault]) -> list[str]:
    delays = [one.delay for one in results if not math.isnan(one.delay)]
    wrong = sorted({one.mechanism for one in results if not one.named and not math.isnan(one.delay)})
    return [
        kind.replace("_", " "),
        share(len(delays) / len(results)),
        f"{np.median(delays):.1f}" if delays else ABSENT,
        f"{max(delays):.1f}" if delays else ABSENT,
        share(float(np.mean([one.named for one in results]))),
        f"{sum(one.false_alarms for one in results)}",
        ", ".join(name or "nothing" for name in wrong) or ABSENT,
    ]


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__, "a seed, two drifts and a fault of 108 s at 25 Hz")
    runs = (*DRIFTS, *FAULTS)
    parser.add_argument("runs", nargs="*", metavar="RUN", help=f"of {', '.join(runs)}; all by default")
    parser.add_argument("--seeds", type=int, default=3, help="machines")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first of them")
    parser.add_argument("--hours", type=float, default=0.2, help="length of each run")
    parser.add_argument("--every", type=int, default=1, help="of the samples, at 100 Hz, which one counts")
    parser.add_argument("--tension-out", action="store_true", help="T_out is measured too")
    options = parser.parse_args(arguments)
    if unknown := sorted(set(options.runs) - set(runs)):
        parser.error(f"no run {unknown[0]}; there are {', '.join(runs)}")
    return options


if __name__ == "__main__":
    sys.exit(main())

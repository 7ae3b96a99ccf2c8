"""Coverage of the 95 % intervals of `tssgeom calibrate`, on runs of the lumped chain of `tests/lumped`.

`python -m benchmarks.calibration [--trials N] [--quick]` prints, for each kind of run, how often the interval
of each number held the truth, and its median error.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping

import numpy as np

from tests.lumped import Distal, Drive, Physics, Sensor, from_pieces, measure, simulate
from tssgeom.identify.calibrated_run import Measured
from tssgeom.identify.calibration import Calibration, calibrate
from tssgeom.rig import Rig, ShapeSensor
from tssgeom.route.pieces import Arcs

ROUTES = (
    ([0.5], [math.pi]),
    ([0.266, 0.234], [math.pi, 2 * math.pi]),
    ([0.1, 0.3, 0.1, 0.2], [0.0, 2.0, 0.0, 1.5]),
)
GAIN_SD = 0.01
"""Common error of all sensed angles [1]."""
OUT_OFFSET = 0.2
WHITE = {"tension_in_N": Sensor(noise=0.03), "tension_out_N": Sensor(noise=0.03, offset=OUT_OFFSET)}
DRIFT = {
    "tension_in_N": Sensor(noise=0.03),
    "tension_out_N": Sensor(noise=0.03, offset=OUT_OFFSET, drift=0.03, drift_time_s=15.0),
    "elongation_m": Sensor(noise=5e-6, drift=5e-6, drift_time_s=12.0),
}
KINDS: Mapping[str, Mapping[str, Sensor]] = {
    "white": {**WHITE, "elongation_m": Sensor(noise=5e-6)},
    "digits": {
        "tension_in_N": Sensor(noise=0.01, resolution=0.05),
        "tension_out_N": Sensor(noise=0.01, resolution=0.05, offset=OUT_OFFSET),
        "elongation_m": Sensor(noise=1e-6, resolution=5e-6),
    },
    "drift": DRIFT,
    "drift, 4 times": DRIFT,
    "no T_out": {"tension_in_N": Sensor(noise=0.03), "elongation_m": Sensor(noise=5e-6)},
    "no δ": WHITE,
    "by position": {
        "tension_out_N": Sensor(noise=0.03, offset=OUT_OFFSET),
        "elongation_m": Sensor(noise=5e-6),
        "displacement_in_m": Sensor(noise=2e-6),
    },
}


def trial(kind: str, seed: int) -> tuple[Calibration, dict[str, float]]:
    """Calibrate one run of random friction, compliance, slack and route, and return it with the truth."""
    rng = np.random.default_rng((seed, sorted(KINDS).index(kind)))
    lengths, angles = ROUTES[seed % len(ROUTES)]
    slack = 0.0 if kind == "by position" else rng.uniform(0.0, 2e-3)
    truth = {
        "friction": rng.uniform(0.08, 0.25),
        "compliance": rng.uniform(2e-4, 5e-4),
        "tension_out_offset": OUT_OFFSET,
        "elongation_offset": slack,
    }
    physics = Physics(
        friction=truth["friction"],
        compliance_per_N=truth["compliance"],
        take_up_in_m=slack,
        take_up_in_scale_N=rng.uniform(0.6, 1.5),
    )
    cycles = 4 if kind.endswith("times") else 1
    peak = rng.uniform(12.0, 18.0)
    tensions = np.concatenate(([0.05], np.tile([peak, 0.3], cycles)))
    drive = Drive("force", 10.0 * np.arange(len(tensions)), tensions)
    times = np.linspace(0.0, 20.0 * cycles, 400 * cycles)
    run = simulate(
        from_pieces(lengths, angles, 120), physics, drive, Distal("spring", 1000.0), times, max_step=0.1
    )
    columns = measure(run, KINDS[kind], seed)
    sensed = Arcs.exact(np.array(lengths), np.array(angles) * (1 + GAIN_SD * rng.standard_normal()))
    rig = Rig(shape=ShapeSensor(angle_gain_sd=GAIN_SD))
    measured = Measured(
        columns["time_s"],
        columns.get("tension_in_N"),
        columns.get("displacement_in_m"),
        columns.get("tension_out_N"),
        columns.get("elongation_m"),
    )
    return calibrate(measured, sensed, rig), truth


def print_table(trials: int, kinds: list[str]) -> None:
    """Print coverage [%], median error and median half interval of each number by kind of run."""
    print(f"{'run':12} {'number':20} {'held':>6} {'of':>4} {'median error':>13} {'half interval':>14}")
    for kind in kinds:
        held: dict[str, list[tuple[bool, float, float]]] = {}
        for seed in range(trials):
            result, truth = trial(kind, seed)
            for name, value in truth.items():
                if kind.startswith("drift") and name.endswith("offset"):
                    continue  # a zero that drifts has no one value
                estimate = result.estimates[name]
                if estimate.observable:
                    size = value if name in ("friction", "compliance") else 1.0
                    row = (
                        estimate.low <= value <= estimate.high,
                        abs(estimate.value - value) / size,
                        0.5 * (estimate.high - estimate.low) / size,
                    )
                    held.setdefault(name, []).append(row)
        for name, rows in held.items():
            share, error, half = (
                100 * np.mean([r[0] for r in rows]),
                *np.median([r[1:] for r in rows], axis=0),
            )
            line = f"{kind:12} {name:20} {share:5.0f}% {len(rows):4} {error:13.2g} {half:14.2g}"
            print(line, flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=120)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--kind", choices=sorted(KINDS), action="append")
    chosen = parser.parse_args()
    print_table(4 if chosen.quick else chosen.trials, chosen.kind or list(KINDS))

"""Coverage of the 95 % intervals of `tssgeom calibrate`, on runs of the lumped chains of `tests/lumped`.

    python -m benchmarks.calibration [--quick] [--trials N] [--kind KIND]

Held: the share of 95 % intervals, of numbers that are reported as identified, that hold the truth. First runs
of one tendon, with the median error; then machines, whose truth is sampled from what the rig assumes.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks import machine, options_parser
from tests import lumped
from tests.lumped import Sensor
from tssgeom.errors import TssgeomError
from tssgeom.identify.calibration import Calibration, calibrate
from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_estimates import MachineCalibration
from tssgeom.identify.machine_run import machine_run
from tssgeom.mechanism import Drive, End, GivenRoute
from tssgeom.rig import Rig, ShapeSensor, with_values
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import route_of_rig
from tssgeom.tendon.simulation import Measured
from tssgeom.uncertain import UNKNOWNS, Uncertain, assumed

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
    "x_in and T_in": {
        "tension_in_N": Sensor(noise=0.15),
        "tension_out_N": Sensor(noise=0.03, offset=OUT_OFFSET),
        "displacement_in_m": Sensor(noise=1e-5),
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
    physics = lumped.Physics(
        friction=truth["friction"],
        compliance_per_N=truth["compliance"],
        take_up_in_m=slack,
        take_up_in_scale_N=rng.uniform(0.6, 1.5),
    )
    cycles = 4 if kind.endswith("times") else 1
    peak = rng.uniform(12.0, 18.0)
    tensions = np.concatenate(([0.05], np.tile([peak, 0.3], cycles)))
    drive = lumped.Drive("force", 10.0 * np.arange(len(tensions)), tensions)
    times = np.linspace(0.0, 20.0 * cycles, 400 * cycles)
    run = lumped.simulate(
        lumped.from_pieces(lengths, angles, 120),
        physics,
        drive,
        lumped.Distal("spring", 1000.0),
        times,
        max_step=0.1,
    )
    columns = lumped.measure(run, KINDS[kind], seed)
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


FRICTION, ANGLE = "friction.coefficient", "route.angle_rad"
COMPLIANCE, PRETENSION, STIFFNESS = (
    *("tendon.compliance_per_N", "tendon.pretension_N"),
    "end.stiffness_Nm_per_rad",
)
CELLS, STEP = 120, 0.05
FARTHEST = 1.3  # standard deviations of what is assumed: rigs beyond do not move or stretch by half


@dataclass(frozen=True)
class Kind:
    """One kind of rig and run."""

    rig: Rig
    uncertain: Mapping[str, tuple[float, float] | None]
    """Key, and value with standard deviation; None where unknown."""
    simulated: Callable[[Rig, int, np.random.Generator], dict[str, np.ndarray]]
    """Columns of run k of a rig, with the noise of sensors."""
    unparted: tuple[str, ...] = ()
    """Keys that its runs cannot part from others."""


def _times() -> np.ndarray:
    return np.linspace(0.0, 24.0, 481)


def _motion(rng: np.random.Generator, size: float) -> np.ndarray:
    """Return four cycles whose size grows and shrinks."""
    times = _times()
    slow = 0.75 + 0.25 * np.sin(2 * np.pi * times / 24.0 + rng.uniform(0.0, 6.0))
    return size * slow * np.sin(2 * np.pi * times / 6.0)


def _tendons(rig: Rig, count: int) -> list[tuple[lumped.Path, lumped.Physics]]:
    route = route_of_rig(rig)
    path = lumped.from_pieces(route.length, route.angle, cells=CELLS)
    physics = lumped.Physics(
        friction=rig.friction.coefficient,
        compliance_per_N=rig.tendon.compliance_per_N,
        pretension_N=rig.tendon.pretension_N,
    )
    return [(path, physics)] * count


def _pair(rig: Rig, k: int, rng: np.random.Generator, torque: bool) -> dict[str, np.ndarray]:
    times, angle = _times(), _motion(rng, 0.9)
    load = 0.03 * (k % 3) * np.clip(times / 2.0, 0.0, 1.0)
    joint = lumped.Joint(rig.end.radius_m, rig.end.stiffness_Nm_per_rad, load=(times, load))
    motor = lumped.Motor("angle", times, angle, rig.drive.radius_m, play_rad=rig.drive.play_rad)
    run = lumped.simulate_machine(_tendons(rig, 2), motor, joint, times, STEP)
    sensors = {"joint_angle_rad": lumped.Sensor(noise=2e-3, offset=rng.normal(0.0, 0.02))}
    if torque:
        sensors["motor_torque_Nm"] = lumped.Sensor(noise=2e-3, offset=rng.normal(0.0, 0.005))
    columns = lumped.measure_machine(run, sensors, int(rng.integers(1 << 30)))
    return columns | {"motor_angle_rad": angle, "joint_torque_Nm": load}


def _with_torque(rig: Rig, k: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    return _pair(rig, k, rng, torque=True)


def _angles_alone(rig: Rig, k: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    return _pair(rig, k, rng, torque=False)


def _segment(rig: Rig, k: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    times, end = _times(), rig.end
    around = np.radians(end.tendon_angles_deg)
    turn = rng.uniform(0.0, 6.0)
    pulls = [_motion(rng, 1.2e-3) * np.cos(each - turn) for each in around]
    drives = [lumped.Drive("displacement", times, pull) for pull in pulls]
    bent = lumped.Segment(end.radius_m, tuple(around), end.stiffness_Nm_per_rad, end.length_m, end.marker_m)
    run = lumped.simulate_machine(_tendons(rig, len(around)), drives, bent, times, STEP)
    sensors = {f"bending_{axis}_rad": lumped.Sensor(noise=3e-3) for axis in "xy"}
    sensors |= {"tension_in_1_N": lumped.Sensor(noise=0.05, offset=rng.normal(0.0, 0.1))}
    columns = lumped.measure_machine(run, sensors, int(rng.integers(1 << 30)))
    return columns | {f"displacement_in_{i + 1}_m": pull for i, pull in enumerate(pulls)}


def _loop(rig: Rig, k: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    times = _times()
    tension = 8.0 - 6.5 * np.cos(2 * np.pi * times / 6.0) * (0.8 + 0.2 * np.sin(times / 5.0))
    ((path, physics),) = _tendons(rig, 1)
    drive = lumped.Drive("force", times, tension)
    load = lumped.Distal("spring", rig.load.stiffness_N_per_m)
    run = lumped.simulate(path, physics, drive, load, times, STEP)
    sensors = {
        "tension_in_N": lumped.Sensor(noise=0.03),
        "tension_out_N": lumped.Sensor(noise=0.03, offset=rng.normal(0.0, 0.1)),
    }
    return lumped.measure(run, sensors, int(rng.integers(1 << 30)))


_PAIR = Drive(kind="pair", radius_m=0.01)
_JOINT = End(kind="joint", radius_m=0.01, stiffness_Nm_per_rad=0.2)
_SEGMENT = End(
    kind="segment",
    radius_m=0.0045,
    stiffness_Nm_per_rad=0.05,
    tendon_angles_deg=(0.0, 120.0, 240.0),
    length_m=0.06,
    marker_m=0.008,
)
_ROUTE = GivenRoute(length_m=0.5, angle_rad=3.0)
MACHINES = {
    "pair, torque": Kind(
        Rig(drive=_PAIR, end=_JOINT, route=_ROUTE),
        {
            FRICTION: (0.15, 0.015),
            ANGLE: (3.0, 1.5),
            COMPLIANCE: (3e-4, 1.5e-4),
            PRETENSION: (6.0, 3.0),
            STIFFNESS: (0.2, 0.1),
            "drive.play_rad": (0.02, 0.01),
        },
        _with_torque,
    ),
    "pair, μ and Φ": Kind(
        Rig(drive=_PAIR, end=_JOINT, route=_ROUTE),
        {FRICTION: None, ANGLE: None, COMPLIANCE: (3e-4, 1.5e-4), PRETENSION: (6.0, 3.0)},
        _with_torque,
        (FRICTION, ANGLE),
    ),
    "angles alone": Kind(
        Rig(drive=_PAIR, end=_JOINT, route=_ROUTE),
        {FRICTION: (0.15, 0.1), COMPLIANCE: (3e-4, 1.5e-4), PRETENSION: (6.0, 3.0)},
        _angles_alone,
    ),
    "segment": Kind(
        Rig(drive=Drive(kind="tendons"), end=_SEGMENT, route=_ROUTE),
        {FRICTION: (0.15, 0.1), COMPLIANCE: (3e-4, 1.5e-4), STIFFNESS: (0.05, 0.03), PRETENSION: (8.0, 2.0)},
        _segment,
    ),
    "force loop": Kind(
        Rig(route=_ROUTE), {FRICTION: (0.15, 0.015), ANGLE: None, COMPLIANCE: (3e-4, 1e-4)}, _loop
    ),
}


def uncertain_of(kind: Kind) -> list[Uncertain]:
    """Return what is not certain of a kind."""
    return [
        Uncertain(key, UNKNOWNS[key] if given is None else assumed(key, *given), given is not None)
        for key, given in kind.uncertain.items()
    ]


def machine_trial(kind: Kind, seed: int, runs: int = 1) -> tuple[MachineCalibration, dict[str, float], float]:
    """Simulate and calibrate one rig; returns what is identified, the truth, and the seconds of the fit."""
    rng, uncertain = np.random.default_rng(seed), uncertain_of(kind)
    truth = {
        each.key: each.prior.value(float(np.clip(rng.standard_normal(), -FARTHEST, FARTHEST)))
        for each in uncertain
    }
    true_rig = with_values(kind.rig, truth)
    nominal = with_values(kind.rig, {each.key: each.prior.centre for each in uncertain})
    made = [
        machine_run(f"run {k + 1}", kind.simulated(true_rig, k, rng), [route_of_rig(nominal)], nominal)
        for k in range(runs)
    ]
    begin = time.perf_counter()
    fitted = calibrate_machine(made, nominal, uncertain)
    return fitted, truth, time.perf_counter() - begin


def print_machines(trials: int, kinds: list[str]) -> None:
    """Print coverage, how often a number is identified, its median half interval, and times."""
    print(f"{'rig and run':14} {'number':26} {'held':>6} {'identified':>11} {'half interval':>14}")
    for name in kinds:
        kind, rows, seconds, failed = MACHINES[name], dict[str, list[tuple[bool, bool, float]]](), [], 0
        for seed in range(trials):
            try:
                fitted, truth, taken = machine_trial(kind, seed)
            except (TssgeomError, lumped.NoBalanceError):
                failed += 1
                continue
            seconds.append(taken)
            for each in fitted.estimates:
                if each.key in truth:
                    held = each.low <= truth[each.key] <= each.high
                    half = 0.5 * (each.high - each.low) / abs(each.value)
                    rows.setdefault(each.key, []).append((each.identified, held, half))
        for key, each in rows.items():
            known = [(held, half) for identified, held, half in each if identified]
            share = f"{100 * np.mean([held for held, _ in known]):5.0f}%" if known else "     –"
            half = f"{100 * np.median([half for _, half in known]):13.2g}%" if known else "             –"
            note = "  cannot be parted" if key in kind.unparted else ""
            print(f"{name:14} {key:26} {share} {len(known):5} of {len(each):3} {half}{note}", flush=True)
        print(f"{name:14} a fit takes {np.median(seconds):.2g} s; {failed} of {trials} did not run")
    fitted, _, taken = machine_trial(MACHINES["pair, torque"], 0, runs=5)
    print(f"a campaign of 5 runs, {len(fitted.estimates)} numbers: {taken:.2g} s (wanted: 5 s)")


if __name__ == "__main__":
    parser = options_parser(__doc__, "fewer trials")
    parser.add_argument("--trials", type=int, default=0, help="runs of each kind (120; of a machine 60)")
    parser.add_argument("--kind", choices=sorted({*KINDS, *MACHINES}), action="append")
    chosen = parser.parse_args()
    kinds = chosen.kind or [*KINDS, *MACHINES]
    print(machine())
    print_table(chosen.trials or (4 if chosen.quick else 120), [each for each in kinds if each in KINDS])
    print_machines(chosen.trials or (3 if chosen.quick else 60), [each for each in kinds if each in MACHINES])

"""Pairs, joints and segments that run for minutes while the friction of their sheaths drifts.

    scenario = pair(seed=3, seconds=300.0)
    scenario.readings["joint_angle_rad"], scenario.truth["friction"]

As for one tendon, physics come from the lumped simulator, a seed chooses the machine and its motion, and a
longer run begins as a shorter one does.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tests.lumped import (
    Change,
    Drive,
    Joint,
    MachineRun,
    Motor,
    Physics,
    Segment,
    Sensor,
    from_pieces,
    machine_channels,
    measure_machine,
    simulate_machine,
)

RATE_HZ = 50.0
CELLS = 60
STROKE_S, DWELL_S = (0.7, 4.0), (0.3, 2.0)
DWELL_CHANCE = 0.3
DRIFT = 0.3  # of the friction, in a period of 20 min
PERIOD_S = 1200.0


class Given(NamedTuple):
    """What the machine is when a run begins: what a rig file may state of it."""

    kind: str
    """`pair`, `joint` or `segment`."""
    lengths_m: np.ndarray
    angles_rad: np.ndarray
    """Turn of each piece of the route."""
    friction: float
    compliance_per_N: float
    pretension_N: float
    pulley_m: float
    """Radius of the motor's pulley."""
    arm_m: float
    """Lever arm at the joint, or distance from the backbone."""
    stiffness_Nm_per_rad: float
    play_rad: float
    """Of the motor."""
    noise: dict[str, float]
    """Standard deviation of the readings of each channel that is measured, in its unit."""


class MachineScenario(NamedTuple):
    """A run of n samples at 50 Hz, and the truth about it."""

    machine: Given
    seed: int
    times: np.ndarray
    readings: dict[str, np.ndarray]
    truth: dict[str, np.ndarray]
    """`friction` and every channel without noise and zero; `zero_<channel>`."""


SEGMENT_DEG = (0.0, 120.0, 240.0)
LENGTH_M, MARKER_M = 0.06, 0.005
_NOISE = {
    "motor_angle_rad": 1e-3,
    "motor_torque_Nm": 2e-3,
    "joint_angle_rad": 1e-3,
    "joint_torque_Nm": 1e-3,
    "bending_x_rad": 5e-3,
    "bending_y_rad": 5e-3,
    "tip_x_m": 2e-4,
    "tip_y_m": 2e-4,
    "tip_z_m": 2e-4,
    "displacement_in": 1e-5,
    "tension_in": 0.03,
    "tension_out": 0.03,
}


def noise_of(channel: str) -> float:
    """Return the noise of a channel, of a numbered one that of its kind."""
    return next(value for name, value in _NOISE.items() if channel.startswith(name))


def given(kind: str, seed: int, channels: tuple[str, ...]) -> Given:
    """Return the machine of a seed."""
    rng = np.random.default_rng((seed, 11))
    pieces = int(rng.integers(2, 5))
    lengths, angles = rng.uniform(0.5, 1.5, pieces), rng.uniform(0.3, 1.5, pieces)
    friction = float(rng.uniform(0.1, 0.2))
    return Given(
        kind=kind,
        lengths_m=lengths * rng.uniform(0.5, 0.8) / lengths.sum(),
        angles_rad=angles * rng.uniform(2.0, 4.5) / angles.sum(),
        friction=friction,
        compliance_per_N=float(rng.uniform(2.7e-4, 3.3e-4)),
        pretension_N=float(rng.uniform(5.0, 8.0)) * (2.0 if kind == "segment" else 1.0),
        pulley_m=float(rng.uniform(0.008, 0.012)),
        arm_m=float(rng.uniform(0.006, 0.009)) if kind != "segment" else 0.005,
        stiffness_Nm_per_rad=float(rng.uniform(0.03, 0.08)),
        play_rad=float(rng.uniform(0.0, 0.03)) if kind == "pair" else 0.0,
        noise={name: noise_of(name) for name in channels},
    )


def strokes(
    seed: int, seconds: float, low: float, high: float, stream: int = 12
) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] and positions from 0: strokes of least jerk between two bounds, and dwells."""
    rng = np.random.default_rng((seed, stream))
    starts, spans, positions, at, up = list[float](), list[float](), [0.0], 0.0, True
    while at < seconds:
        share = rng.uniform(0.5, 1.0) if up else rng.uniform(0.0, 0.5)
        positions.append(low + (high - low) * share)
        starts.append(at)
        spans.append(float(np.exp(rng.uniform(*np.log(STROKE_S)))))
        at += spans[-1] + (rng.uniform(*DWELL_S) if rng.uniform() < DWELL_CHANCE else 0.0)
        up = not up
    times = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    now = np.searchsorted(starts, times, side="right") - 1
    part = np.clip((times - np.array(starts)[now]) / np.array(spans)[now], 0.0, 1.0)
    begin, end = np.array(positions)[now], np.array(positions)[now + 1]
    return times, begin + (end - begin) * part**3 * (10.0 - 15.0 * part + 6.0 * part**2)


def drift(seed: int, seconds: float, size: float = DRIFT) -> Change:
    """Return a sinusoid of the friction, up or down first by the seed."""
    at = np.arange(int(seconds) + 2, dtype=float)
    sign = 1.0 if np.random.default_rng((seed, 13)).integers(2) else -1.0
    return Change("friction", at, 1.0 + sign * size * np.sin(2.0 * np.pi * at / PERIOD_S))


def _scenario(
    machine: Given, seed: int, run: MachineRun, changes: tuple[Change, ...], zeros: dict[str, float]
) -> MachineScenario:
    sensors = {
        name: Sensor(noise=noise, offset=zeros.get(name, 0.0)) for name, noise in machine.noise.items()
    }
    columns = measure_machine(run, sensors, seed)
    factor = np.prod([each.at(run.times) for each in changes if each.kind == "friction"], axis=0)
    truth = {"friction": machine.friction * factor * np.ones(len(run.times))} | machine_channels(run)
    times = columns.pop("time_s")
    if machine.kind == "joint":  # the simulator's torque is from rest, where one tendon pulls alone
        for values in (columns, truth):
            values["motor_torque_Nm"] = values["motor_torque_Nm"] + machine.pulley_m * machine.pretension_N
    return MachineScenario(machine, seed, times, columns, truth)


def _tendons(machine: Given, count: int) -> list:
    physics = Physics(
        friction=machine.friction,
        compliance_per_N=machine.compliance_per_N,
        pretension_N=machine.pretension_N,
    )
    return [(from_pieces(machine.lengths_m, machine.angles_rad, CELLS), physics)] * count


def on_motor(
    kind: str,
    seed: int,
    seconds: float,
    channels: tuple[str, ...],
    *,
    changes: tuple[Change, ...] | None = None,
    zeros: dict[str, float] | None = None,
) -> MachineScenario:
    """Return a joint on a motor, pulled by a `pair` or by one tendon (`joint`)."""
    machine = given(kind, seed, ("motor_angle_rad", *channels))
    low, high = (-0.5, 0.5) if kind == "pair" else (0.0, 1.0)
    times, angle = strokes(seed, seconds, low, high)
    motor = Motor("angle", times, angle, machine.pulley_m, play_rad=machine.play_rad)
    joint = Joint(machine.arm_m, machine.stiffness_Nm_per_rad)
    made = (drift(seed, seconds),) if changes is None else changes
    tendons = _tendons(machine, 2 if kind == "pair" else 1)
    run = simulate_machine(tendons, motor, joint, times, 1.0 / RATE_HZ, made, ends_only=True)
    return _scenario(machine, seed, run, made, zeros or {})


def pair(seed: int, seconds: float, **options) -> MachineScenario:
    """Two tendons on one pulley turn a joint: motor angle, its torque, and the joint's angle are measured."""
    return on_motor("pair", seed, seconds, ("motor_torque_Nm", "joint_angle_rad"), **options)


def joint(seed: int, seconds: float, **options) -> MachineScenario:
    """One tendon turns a joint against a spring; the same is measured."""
    return on_motor("joint", seed, seconds, ("motor_torque_Nm", "joint_angle_rad"), **options)


def segment(
    seed: int,
    seconds: float,
    *,
    changes: tuple[Change, ...] | None = None,
    zeros: dict[str, float] | None = None,
) -> MachineScenario:
    """Three tendons bend a backbone: positions and tensions at the drives and the tip are measured."""
    names = ("displacement_in", "tension_in")
    channels = [f"{name}_{k}_{unit}" for name, unit in zip(names, "mN", strict=True) for k in (1, 2, 3)]
    machine = given("segment", seed, (*channels, "tip_x_m", "tip_y_m", "tip_z_m"))
    times, bend_x = strokes(seed, seconds, -0.6, 0.6, 14)
    _, bend_y = strokes(seed, seconds, -0.6, 0.6, 15)
    angles = np.radians(SEGMENT_DEG)
    drives = [
        Drive("displacement", times, machine.arm_m * (np.cos(a) * bend_x + np.sin(a) * bend_y))
        for a in angles
    ]
    bending = Segment(machine.arm_m, tuple(angles), machine.stiffness_Nm_per_rad, LENGTH_M, MARKER_M)
    made = (drift(seed, seconds),) if changes is None else changes
    run = simulate_machine(_tendons(machine, 3), drives, bending, times, 1.0 / RATE_HZ, made, ends_only=True)
    return _scenario(machine, seed, run, made, zeros or {})


SCENARIOS: dict[str, Callable[..., MachineScenario]] = {"pair": pair, "joint": joint, "segment": segment}
"""Machines whose friction drifts, each by (seed, seconds)."""

FAULT_S, RISE_S = 12.0, 0.1  # when a fault begins, and how long it takes
_STEPS = {"wet_sheath": ("friction", 0.5), "frayed_tendon": ("compliance", 1.6)}
FAULTS = (*_STEPS, "unplugged")
"""Faults of a machine, for `with_fault`."""
UNPLUGGED = {"pair": "motor_torque_Nm", "joint": "joint_angle_rad", "segment": "tension_in_2_N"}
"""The sensor of each kind that reads zero once it is unplugged."""


def with_fault(kind: str, seed: int, seconds: float, fault: str) -> MachineScenario:
    """Return a machine whose friction drifts, and which has a fault after `FAULT_S`."""
    make = SCENARIOS[kind]
    if fault in _STEPS:
        of, factor = _STEPS[fault]
        step = Change(of, np.array([FAULT_S, FAULT_S + RISE_S]), np.array([1.0, factor]))
        return make(seed, seconds, changes=(drift(seed, seconds), step))
    scenario = make(seed, seconds)
    name, late = UNPLUGGED[kind], scenario.times >= FAULT_S
    return scenario._replace(
        readings={**scenario.readings, name: np.where(late, 0.0, scenario.readings[name])}
    )

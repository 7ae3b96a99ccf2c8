"""What instruments make of a run: the columns of a measured file, with all that instruments add."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from tests.lumped.machine import MachineRun
from tests.lumped.mechanism import Course
from tests.lumped.simulate import Run

CHANNELS = (
    "tension_in_N",
    "tension_out_N",
    "elongation_m",
    "displacement_in_m",
    "displacement_out_m",
    "temperature_C",
)


@dataclass(frozen=True, slots=True)
class Sensor:
    """One channel, in the order in which its faults act; every default is a perfect instrument."""

    lag_s: float = 0.0
    """Time constant of a first-order lag [s]."""
    delay_s: float = 0.0
    """How late the clock of its recorder is [s]; before its start the channel stands still."""
    crosstalk: Mapping[str, float] = field(default_factory=dict)
    """What one unit of another channel adds [this channel's unit per unit of that]."""
    gain: float = 1.0
    offset: float = 0.0
    drift: float = 0.0
    """Amplitude of a slow wave that starts at 0 [unit of the channel]."""
    drift_time_s: float = 300.0
    """Period of that wave [s]."""
    nonlinearity: float = 0.0
    """Greatest deviation from a straight line over the full scale [1]; bow or S, by the seed."""
    noise: float = 0.0
    """Standard deviation of white noise [unit of the channel]."""
    resolution: float = 0.0
    """Step of the digits [unit of the channel]."""
    full_scale: float = np.inf
    """Readings end at plus and minus this [unit of the channel]."""
    zero: Course | None = None
    """What is added to the offset over time [s, unit of the channel]."""
    unplugged_s: float = np.inf
    """From this time on the reading no longer depends on the channel [s]."""
    unplugged: Literal["zero", "hold", "noise"] = "zero"
    """It is then 0, the last reading before, or the noise about 0."""


def measure(run: Run, sensors: Mapping[str, Sensor], seed: int) -> dict[str, np.ndarray]:
    """Return `time_s` and the channels that have a sensor, [F] each; the same seed gives the same digits.

    Each channel draws from a stream of its own, so that one more channel leaves the others as they were.
    """
    streams = {name: (seed, CHANNELS.index(name)) for name in sensors}
    return _measured(run.times, true_channels(run), sensors, streams)


def measure_machine(run: MachineRun, sensors: Mapping[str, Sensor], seed: int) -> dict[str, np.ndarray]:
    """Return `time_s` and the channels of a machine that have a sensor, as `measure` does for one tendon."""
    streams = {name: (seed, zlib.crc32(name.encode())) for name in sensors}
    return _measured(run.times, machine_channels(run), sensors, streams)


def _measured(times: np.ndarray, truth, sensors, streams) -> dict[str, np.ndarray]:
    late = {name: np.interp(times - sensor.delay_s, times, truth[name]) for name, sensor in sensors.items()}
    lagged = {name: _lag(times, late[name], sensor.lag_s) for name, sensor in sensors.items()}
    columns = {"time_s": times.copy()}
    for name, sensor in sensors.items():
        rng = np.random.default_rng(streams[name])
        value = lagged[name] + sum(share * truth[other] for other, share in sensor.crosstalk.items())
        columns[name] = _read(times, value, sensor, rng)
    return columns


def machine_channels(run: MachineRun) -> dict[str, np.ndarray]:
    """Return what perfect instruments on a machine would show, [F] each; tendons count from 1.

    `joint_torque_Nm` is what the tendons exert on the joint, `load_torque_Nm` what of it reaches the load.
    """
    truth = {
        "motor_angle_rad": run.motor_angle,
        "motor_torque_Nm": run.motor_torque,
        "joint_angle_rad": run.joint_angle,
        "joint_torque_Nm": run.joint_torque,
        "load_torque_Nm": run.load_torque,
    }
    if run.bending is not None:
        truth |= dict(zip(("bending_x_rad", "bending_y_rad"), run.bending.T, strict=True))
        truth |= dict(zip(("tip_x_m", "tip_y_m", "tip_z_m"), run.tip.T, strict=True))
    for k, tendon in enumerate(run.tendons, 1):
        truth[f"displacement_in_{k}_m"] = tendon.displacement_in
        truth[f"displacement_out_{k}_m"] = tendon.displacement_out
        truth[f"tension_in_{k}_N"] = tendon.tension_in
        truth[f"tension_out_{k}_N"] = tendon.tension_out
    truth["temperature_C"] = run.tendons[0].temperature
    return {name: value for name, value in truth.items() if value is not None}


def true_channels(run: Run) -> dict[str, np.ndarray]:
    """Return what perfect instruments would show, [F] each."""
    return {
        "tension_in_N": run.tension_in,
        "tension_out_N": run.tension_out,
        "elongation_m": run.elongation,
        "displacement_in_m": run.displacement_in,
        "displacement_out_m": run.displacement_out,
        "temperature_C": run.temperature,
    }


def _read(times: np.ndarray, value: np.ndarray, sensor: Sensor, rng: np.random.Generator) -> np.ndarray:
    phase, shape = rng.uniform(0.0, 2.0 * np.pi, 2)
    wave = 2.0 * np.pi * (times - times[0]) / sensor.drift_time_s + phase
    observed = sensor.gain * value + sensor.offset + sensor.drift * (np.sin(wave) - np.sin(phase))
    if sensor.zero is not None:
        observed = observed + np.interp(times, *sensor.zero)
    if sensor.nonlinearity:
        observed = observed + sensor.nonlinearity * sensor.full_scale * bend(
            observed / sensor.full_scale, shape
        )
    noise, gone = sensor.noise * rng.standard_normal(len(times)), times >= sensor.unplugged_s
    observed = np.where(gone, 0.0, observed) + noise
    if sensor.resolution:
        observed = sensor.resolution * np.round(observed / sensor.resolution)
    read = np.clip(observed, -sensor.full_scale, sensor.full_scale)
    if gone.any() and sensor.unplugged != "noise":
        last = read[~gone][-1] if sensor.unplugged == "hold" and not gone.all() else 0.0
        read[gone] = last
    return read


def bend(share: np.ndarray, shape: float) -> np.ndarray:
    """Return a mix of a bow and an S over −1 … 1, 0 at both ends and in the middle, at most 1."""
    u = np.clip(np.abs(share), 0.0, 1.0)
    bow, double = 4.0 * u * (1.0 - u), 6.0 * np.sqrt(3.0) * u * (1.0 - u) * (1.0 - 2.0 * u)
    grid = np.linspace(0.0, 1.0, 201)
    whole = np.cos(shape) * 4.0 * grid * (1.0 - grid)
    whole += np.sin(shape) * 6.0 * np.sqrt(3.0) * grid * (1.0 - grid) * (1.0 - 2.0 * grid)
    return np.sign(share) * (np.cos(shape) * bow + np.sin(shape) * double) / np.abs(whole).max()


def _lag(times: np.ndarray, value: np.ndarray, constant: float) -> np.ndarray:
    """Pass a series, straight between its samples, through a first-order lag that starts at rest, exactly."""
    if constant <= 0.0:
        return value
    out = np.empty_like(value)
    out[0] = value[0]
    for i, span in enumerate(np.diff(times)):
        rise = (value[i + 1] - value[i]) / span
        behind = rise * constant
        out[i + 1] = value[i + 1] - behind + (out[i] - value[i] + behind) * np.exp(-span / constant)
    return out

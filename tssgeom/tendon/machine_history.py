"""What the past of a machine leaves to its next sample: tendons, plays, turns and sensors that lag.

Source: docs/model.md (59), (62), (177), (178).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple, get_args

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import SensorLaw
from tssgeom.effects.laws import curve_at
from tssgeom.rig import Rig, Sensor
from tssgeom.tendon.machine import MachineState

DriveName = Literal["motor_angle_rad", "displacement_in", "tension_in", "motor_torque_Nm"]
GIVEN_DRIVES: tuple[DriveName, ...] = get_args(DriveName)
"""What may drive a machine; the first that a run has does. The middle ones are channels of each tendon."""
_STILL = 1e-9  # rad that count as no motion of a motor; derived: beyond rounding, below any encoder's step


class Turning(NamedTuple):
    """A motor or a joint between two samples."""

    value: float
    """Its angle [rad]."""
    way: float
    """Which way it went last: 1, −1, or 0 before its first motion."""
    engaged: float
    """Its angle behind the play [rad]."""


class MachineHistory(NamedTuple):
    """All that the past of a machine leaves to its next sample."""

    state: MachineState
    held: Matrix
    """[n, 2] Tension of the first and the last bar of each tendon when the run began [N]."""
    drive: DriveName
    time: float
    """Of the last sample [s]."""
    begun_at: float
    """Time at which the run began [s]."""
    motor: Turning | None = None
    joint: Turning | None = None
    lags: Mapping[str, tuple[float, float]] = {}
    """What each channel that lags is, and what its sensor reads."""
    recent: Matrix | None = None
    """[r, 1 + drives] When a drive that lags was recorded [s] and how; all but the first row act later."""


def engaged_of(before: Turning | None) -> float | None:
    """Return where a motor or a joint stands behind its play [rad]; None before the first sample."""
    return None if before is None else before.engaged


def direction(values: Vector, before: Turning | None = None) -> Vector:
    """Return which way a motor went last at each sample [s]: 1, −1, or 0 before its first motion."""
    first, way = (values[0], 0.0) if before is None else (before.value, before.way)
    steps = np.diff(values, prepend=first)
    ways = np.concatenate(([way], np.where(np.abs(steps) > _STILL, np.sign(steps), 0.0)))
    last = np.maximum.accumulate(np.where(ways != 0.0, np.arange(len(ways)), 0))
    return ways[last][1:]


def turned(values: Vector, engaged: Vector, before: Turning | None) -> Turning:
    """Return a motor or a joint after some samples, and after its play [rad]."""
    first, way = (values[0], 0.0) if before is None else (before.value, before.way)
    steps = np.concatenate(([values[0] - first], values[1:] - values[:-1]))
    moved = np.flatnonzero(np.abs(steps) > _STILL)
    way = float(np.sign(steps[moved[-1]])) if len(moved) else way
    return Turning(float(values[-1]), way, float(engaged[-1]))


def drift(sensor: Sensor, elapsed: Vector) -> Vector:
    """Return by how much a channel reads more after times since its run began [s]; docs/model.md (309)."""
    if sensor.drift_per_s == 0.0 or sensor.drift_time_s == 0.0:
        return sensor.drift_per_s * elapsed
    return -sensor.drift_per_s * sensor.drift_time_s * np.expm1(-elapsed / sensor.drift_time_s)


def read_by_sensors(
    values: Mapping[str, Vector], time: Vector, rig: Rig, history: MachineHistory, before: MachineHistory
) -> tuple[dict[str, Vector], MachineHistory]:
    """Return what the sensors read of the channels, and what their lags leave."""
    read, lags = dict[str, Vector](), dict[str, tuple[float, float]]()
    bent = [each for each in rig.effects if isinstance(each, SensorLaw) and each.channel in values]
    if not bent and rig.sensors.keys().isdisjoint(values):
        return dict(values), history._replace(lags=lags)
    begins = not before.lags
    spans = np.maximum(np.diff(time, prepend=time[0] if begins else before.time), 0.0)
    for name, true in values.items():
        sensor, read[name] = rig.sensors.get(name), true
        if sensor is None:
            continue
        if sensor.lag_s > 0.0:
            first = before.lags.get(name, (true[0], true[0]))
            read[name] = core.lagged(np.ascontiguousarray(true), spans, sensor.lag_s, *first)
            lags[name] = float(true[-1]), float(read[name][-1])
        zero = sensor.zero + drift(sensor, time - before.begun_at)
        read[name] = sensor.gain * read[name] + zero
    for each in bent:  # docs/model.md (188)
        at = values[each.channel] if each.over == "reading" else time - before.begun_at
        by = values[each.channel] if each.over == "time_gain" else 1.0  # docs/model.md (344)
        read[each.channel] = read[each.channel] + by * curve_at(each.curve, at)
    return read, history._replace(lags=lags)

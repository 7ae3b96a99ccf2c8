"""What the sensors of a machine read once its tendons and its end are known; docs/model.md (171)-(178)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import SensorLaw
from tssgeom.errors import SettingsError
from tssgeom.mechanism import (
    OF_CURRENT,
    OF_END,
    OF_MOTOR,
    OF_TENDON,
    Coordinates,
    held_by,
    numbered,
    per_motor_angle,
    tip,
)
from tssgeom.rig import Rig
from tssgeom.tendon.bars.sensors import play
from tssgeom.tendon.machine import Machine, MachineTrace
from tssgeom.tendon.machine_history import (
    MachineHistory,
    Turning,
    direction,
    engaged_of,
    read_by_sensors,
    turned,
)

_Value = TypeVar("_Value", float, Vector)


def as_read(value: _Value, channel: str, rig: Rig) -> _Value:
    """Return what the sensor of a channel reads of a true value, without its lag; docs/model.md (178)."""
    sensor = rig.sensors.get(channel)
    return value if sensor is None else sensor.gain * value + sensor.zero


def without_zero(run: Mapping[str, Vector], channel: str, rig: Rig) -> Vector:
    """Return a channel without its zero and gain; nothing where the run does not have it."""
    if channel not in run:
        return np.zeros(len(run["time_s"]))
    if any(isinstance(each, SensorLaw) and each.channel == channel for each in rig.effects):
        raise SettingsError(f"effects.sensor_law: {channel} is given and not an answer: leave the law out")
    values, sensor = run[channel], rig.sensors.get(channel)
    return values if sensor is None else (values - sensor.zero) / sensor.gain


def read_channels(
    machine: Machine,
    run: Mapping[str, Vector],
    trace: MachineTrace,
    motor: Vector | None,
    history: MachineHistory,
    before: MachineHistory,
    *,
    end_given: bool,
) -> tuple[dict[str, Vector], MachineHistory]:
    """Return what each channel reads, zeros, gains and lags of its sensor included; docs/model.md (178).

    Where the coordinates are given, what acts on them is an outcome. The history has what is left of each.
    """
    rig, motion, ends = machine.rig, machine.coordinates, trace.ends
    angles, held = trace.coordinate[:, : motion.distal.shape[1]], None
    if end_given:
        angles = np.column_stack([without_zero(run, name, rig) for name in motion.names])
        held = _outcome(motion, angles, ends, before)[:, 0]
    turned_by = None if motor is None else (motor, _motor_torque(rig, motor, ends, before.motor))
    out = true_channels(rig, ends, turned_by, angles, held)
    if rig.end.kind == "joint":
        out["joint_angle_rad"] = play(angles[:, 0], rig.end.play_rad, engaged_of(before.joint))
        history = history._replace(joint=turned(angles[:, 0], out["joint_angle_rad"], before.joint))
    return read_by_sensors(out, run["time_s"], rig, history, before)


def true_channels(
    rig: Rig, ends: np.ndarray, motor: tuple[Vector, Vector] | None, angles: Matrix, held: Vector | None
) -> dict[str, Vector]:
    """Return the true value of each channel by its name, but for the play of the joint.

    Parameters
    ----------
    rig
        The machine.
    ends
        [s, n, 4] T_in, T_out [N], x_in, x_out [m] of each tendon.
    motor
        [s] Angle [rad] and torque [N·m] of the motor, where there is one.
    angles
        [s, m] Coordinates of the end.
    held
        [s] What acts on a joint whose angle is given [N·m].
    """
    n, out = ends.shape[1], dict[str, Vector]()
    for row, name in enumerate(OF_TENDON):
        for which, channel in enumerate(numbered(name, n)):
            out[channel] = ends[:, which, row]
    if n == 1:
        out["elongation_m"] = out["displacement_in_m"] - out["displacement_out_m"]
    if motor is not None:
        out |= zip(OF_MOTOR, motor, strict=True)
        if rig.drive.torque_constant_Nm_per_A > 0.0:
            out[OF_CURRENT] = motor[1] / rig.drive.torque_constant_Nm_per_A
    if rig.end.kind == "joint":
        angle, torque = OF_END["joint"]
        out |= {angle: angles[:, 0]} | ({} if held is None else {torque: held})
    if rig.end.kind == "segment":
        out |= zip(OF_END["segment"], (*angles.T, *tip(angles, rig.end).T), strict=True)
    return out


def _motor_torque(rig: Rig, motor: Vector, ends: np.ndarray, before: Turning | None) -> Vector:
    arms = per_motor_angle(rig.drive, ends.shape[1])
    pulled = ends[:, :, 0] @ arms
    if rig.end.kind == "carried":
        pulled = pulled - ends[:, :, 1] @ arms
    if rig.drive.friction_Nm > 0.0:
        pulled = pulled + rig.drive.friction_Nm * direction(motor, before)
    return pulled


def _outcome(motion: Coordinates, angles: Matrix, ends: np.ndarray, before: MachineHistory) -> Matrix:
    """Return what acts on coordinates that are given [s, m]: what is left of (173)."""
    balance = motion.distal.T @ before.held[:, 1]
    torque = ends[:, :, 1] @ motion.distal - balance - angles * motion.stiffness
    torque = torque - held_by(motion.holds, angles)
    if motion.friction > 0.0:
        torque = torque - motion.friction * direction(angles[:, 0], before.joint)[:, None]
    return torque

"""What the sensors of a machine read once its tendons and its end are known; docs/model.md (171)-(178)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.mechanism import Coordinates, held_by, numbered, per_motor_angle, tip
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
    values, sensor = run[channel], rig.sensors.get(channel)
    return values if sensor is None else (values - sensor.zero) / sensor.gain


def channels_of(
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
    n, rig, motion, ends = machine.count, machine.rig, machine.coordinates, trace.ends
    out = dict[str, Vector]()
    for row, name in enumerate(("tension_in_N", "tension_out_N", "displacement_in_m", "displacement_out_m")):
        for which, channel in enumerate(numbered(name, n)):
            out[channel] = ends[:, which, row]
    if n == 1:
        out["elongation_m"] = out["displacement_in_m"] - out["displacement_out_m"]
    if motor is not None:
        out |= _of_motor(rig, motor, ends, before.motor)
    angles, torque = trace.coordinate[:, : motion.distal.shape[1]], None
    if end_given:
        angles = np.column_stack([without_zero(run, name, rig) for name in motion.names])
        torque = _outcome(motion, angles, ends, before)
    if rig.end.kind == "joint":
        joint = angles[:, 0]
        out["joint_angle_rad"] = play(joint, rig.end.play_rad, engaged_of(before.joint))
        history = history._replace(joint=turned(joint, out["joint_angle_rad"], before.joint))
        if torque is not None:
            out["joint_torque_Nm"] = torque[:, 0]
    if rig.end.kind == "segment":
        out["bending_x_rad"], out["bending_y_rad"] = angles.T
        out["tip_x_m"], out["tip_y_m"], out["tip_z_m"] = tip(angles, rig.end).T
    return read_by_sensors(out, run["time_s"], rig, history, before)


def _of_motor(rig: Rig, motor: Vector, ends: np.ndarray, before: Turning | None) -> dict[str, Vector]:
    arms = per_motor_angle(rig.drive, ends.shape[1])
    pulled = ends[:, :, 0] @ arms
    if rig.end.kind == "carried":
        pulled = pulled - ends[:, :, 1] @ arms
    torque = pulled
    if rig.drive.friction_Nm > 0.0:
        torque = pulled + rig.drive.friction_Nm * direction(motor, before)
    out = {"motor_angle_rad": motor, "motor_torque_Nm": torque}
    if rig.drive.torque_constant_Nm_per_A > 0.0:
        out["motor_current_A"] = torque / rig.drive.torque_constant_Nm_per_A
    return out


def _outcome(motion: Coordinates, angles: Matrix, ends: np.ndarray, before: MachineHistory) -> Matrix:
    """Return what acts on coordinates that are given [s, m]: what is left of (173)."""
    balance = motion.distal.T @ before.held[:, 1]
    torque = (
        ends[:, :, 1] @ motion.distal - balance - angles * motion.stiffness - held_by(motion.holds, angles)
    )
    if motion.friction > 0.0:
        torque = torque - motion.friction * direction(angles[:, 0], before.joint)[:, None]
    return torque

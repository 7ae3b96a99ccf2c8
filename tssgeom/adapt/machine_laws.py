"""What a step of many machines at once is given: drives, ends, and what acts on the coordinates.

Source: docs/model.md (171)-(178).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.adapt.machine_lines import MachineNumbers
from tssgeom.arrays import Matrix, Vector
from tssgeom.rig import Rig
from tssgeom.tendon.machine_history import DriveName


@dataclass(frozen=True, slots=True)
class Laws:
    """A step, with a row for each machine of n tendons and m coordinates."""

    drive: Matrix
    """[machines, n] Where each drive is besides the coordinates [m], or its tension [N]."""
    end: Matrix
    """[machines, n] Where each load is besides [m]."""
    load: Matrix
    """[machines, m] What acts against each coordinate."""
    proximal: np.ndarray
    """[machines, n, m]"""
    distal: np.ndarray
    """[machines, n, m]"""
    stiffness: Matrix
    """[machines, m]"""
    gravity: Matrix
    """[machines, 2·m]"""
    friction: Vector
    """[machines]"""
    at_rest: Matrix
    """[machines, m]"""
    angle: Vector | None = None
    """[machines] Angle of the joint where it is given [rad]."""


def laws_of(rig: Rig, of: MachineNumbers, name: DriveName, drive: Matrix, true: Mapping[str, Vector]) -> Laws:
    """Return what a step is given.

    Parameters
    ----------
    rig
        The machine.
    of
        Numbers of each.
    name, drive
        What drives; it is where each drive goes [machines, n] [m] or [N], or the torque of the motor
        [machines, 1] [N·m].
    true
        [machines] What was measured, without zero and gain.
    """
    rows, n = of.held_in.shape
    m = of.stiffness.shape[1]
    distal = of.distal.reshape(rows, n, m)
    by_torque = name == "motor_torque_Nm"
    laws = Laws(
        drive=np.zeros((rows, n)) if by_torque else drive,
        end=drive if rig.end.kind == "carried" else np.zeros((rows, n)),
        load=np.zeros((rows, m)),
        proximal=np.zeros((rows, n, m)),
        distal=distal,
        stiffness=of.stiffness,
        gravity=of.gravity,
        friction=of.friction[:, 0],
        at_rest=(distal * of.held_out[:, :, None]).sum(axis=1),
    )
    if rig.end.kind == "joint":
        by_angle = rig.end.given == "angle" and "joint_angle_rad" in true
        laws = _with_angle(laws, true["joint_angle_rad"]) if by_angle else _with_load(laws, true)
    return _with_motor(laws, of, drive[:, 0]) if by_torque else laws


def _with_angle(laws: Laws, angle: Vector) -> Laws:
    """Return the laws of a joint whose angle is given: nothing is free."""
    return replace(
        laws,
        angle=angle,
        end=angle[:, None] * laws.distal[:, :, 0],
        distal=np.zeros_like(laws.distal),
        stiffness=np.ones_like(laws.stiffness),
        gravity=np.zeros_like(laws.gravity),
        friction=np.zeros_like(laws.friction),
        at_rest=np.zeros_like(laws.at_rest),
    )


def _with_load(laws: Laws, true: Mapping[str, Vector]) -> Laws:
    torque = true.get("joint_torque_Nm")
    return laws if torque is None else replace(laws, load=torque[:, None])


def _with_motor(laws: Laws, of: MachineNumbers, torque: Vector) -> Laws:
    """Add the angle of a motor whose torque is given to the coordinates."""
    rows, n, m = laws.distal.shape
    column, none = np.zeros((rows, n, 1)), np.zeros((rows, 1))
    return replace(
        laws,
        load=np.hstack([laws.load, -torque[:, None]]),
        proximal=np.concatenate([np.zeros((rows, n, m)), of.arms[:, :, None]], axis=2),
        distal=np.concatenate([laws.distal, column], axis=2),
        stiffness=np.hstack([laws.stiffness, none]),
        gravity=np.hstack([laws.gravity, none, none]),
        at_rest=np.hstack([laws.at_rest, -(of.arms * of.held_in).sum(axis=1)[:, None]]),
    )


def without_zeros(
    values: Mapping[str, float], of: MachineNumbers, channels: Sequence[str]
) -> dict[str, Vector]:
    """Return what was measured for each machine without the zero and gain of its sensor [machines]."""
    at = {name: i for i, name in enumerate(channels)}
    return {
        name: (value - of.zero[:, at[name]]) / of.gain[:, at[name]]
        for name, value in values.items()
        if name in at
    }

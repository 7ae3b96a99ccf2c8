"""What the sensors of many machines read at once; docs/model.md (59), (62), (173), (178)."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from tssgeom.adapt.machine_lines import MachineNumbers
from tssgeom.adapt.readings import lagged
from tssgeom.arrays import Matrix, Vector
from tssgeom.mechanism import channels_of, held_by
from tssgeom.rig import Rig
from tssgeom.tendon.bars.sensors import behind_play
from tssgeom.tendon.machine_channels import true_channels


class MachineReadings(NamedTuple):
    """What was measured of a machine at one time, by channel."""

    values: Mapping[str, float]
    commanded: bool = False
    """Whether the drive is a command that counts as carried out: the true one, without noise."""


@dataclass(frozen=True, slots=True)
class Moved:
    """Where many machines are after a step, with a row for each; None where a quantity is not there."""

    ends: np.ndarray
    """[machines, n, 4] T_in, T_out [N], x_in, x_out [m] of each tendon."""
    coordinate: Matrix
    """[machines, m] Coordinates of the end."""
    motor: Vector | None
    """[machines] Angle of the motor [rad]."""
    given_angle: Vector | None
    """[machines] Angle of the joint where that is given [rad]."""
    motor_way: float
    """Which way the motor went last [1]."""
    joint_way: float
    """Which way the joint went last, where its angle is given [1]."""

    def with_rows(self, rows: Sequence[int], others: Moved) -> Moved:
        """Return the same with some machines replaced by others."""

        def replaced(one: np.ndarray | None, other: np.ndarray | None) -> Any:
            if one is None or other is None:
                return None
            mixed = one.copy()
            mixed[rows] = other
            return mixed

        arrays = ("ends", "coordinate", "motor", "given_angle")
        mixed = {name: replaced(getattr(self, name), getattr(others, name)) for name in arrays}
        return replace(self, **mixed)


def channels_read(rig: Rig) -> tuple[str, ...]:
    """Return the channels that a machine may compute, one tendon's elongation too."""
    names = channels_of(rig.drive, rig.end)
    return (*names, "elongation_m") if "displacement_in_m" in names else names


def true_values(rig: Rig, of: MachineNumbers, moved: Moved) -> dict[str, Vector]:
    """Return the true value of each channel [machines], but for the play of the joint."""
    ends, angles, motor, held = moved.ends, moved.coordinate[:, :2], None, None
    if moved.motor is not None:
        torque = (ends[:, :, 0] * of.arms).sum(axis=1) + of.motor_friction[:, 0] * moved.motor_way
        if rig.end.kind == "carried":
            torque = torque - (ends[:, :, 1] * of.arms).sum(axis=1)
        motor = moved.motor, torque
    if moved.given_angle is not None:
        angles = moved.given_angle[:, None]
        held = _held_torque(of, ends, moved.given_angle, moved.joint_way)
    return true_channels(rig, ends, motor, angles, held)


def _held_torque(of: MachineNumbers, ends: np.ndarray, angle: Vector, way: float) -> Vector:
    """Return what acts on a joint whose angle is given: what is left of (173)."""
    pull = ((ends[:, :, 1] - of.held_out) * of.distal).sum(axis=1)
    turned = of.stiffness[:, 0] * angle + held_by(of.holds, angle[None, :])[0]
    return pull - turned - of.friction[:, 0] * way


class SensorState:
    """What plays and lagging sensors of many machines keep, as columns that readings shift.

    Parameters
    ----------
    rig
        The machine.
    channels
        In their order.
    count
        Number of machines.
    """

    def __init__(self, rig: Rig, channels: Sequence[str], count: int) -> None:
        sensors = rig.sensors
        self._lags = {
            name: sensors[name].lag_s for name in channels if name in sensors and sensors[name].lag_s
        }
        self.block = np.full((count, 2 + 2 * len(self._lags)), np.nan)
        """[machines, 2 + 2·lags] Motor and joint behind their plays [rad]; what each lagging channel is, and
        what it reads."""

    def begin(
        self, motor: float | None, joint: float | None, lags: Mapping[str, tuple[float, float]]
    ) -> None:
        """Let all machines have these angles behind their plays [rad], and these lags."""
        kept = [each for name in self._lags for each in lags.get(name, (np.nan, np.nan))]
        self.block[:] = [np.nan if motor is None else motor, np.nan if joint is None else joint, *kept]

    def with_block(self, block: Matrix) -> SensorState:
        """Return the same with other columns."""
        other = copy.copy(self)
        other.block = block
        return other

    def engaged_motor(self, angle: Vector, play: Vector) -> Vector:
        """Return angles of the motor behind the play [rad], and keep them; docs/model.md (59)."""
        self.block[:, 0] = behind_play(angle, play, self.block[:, 0])
        return self.block[:, 0]

    def read(
        self, true: Mapping[str, Vector], of: MachineNumbers, channels: Sequence[str], span: float
    ) -> Matrix:
        """Return what the sensors read after a time [s] of true values; NaN where a channel is not there."""
        values = np.full((len(self.block), len(channels)), np.nan)
        for i, name in enumerate(channels):
            if (now := true.get(name)) is None:
                continue
            if name == "joint_angle_rad":
                now = self.block[:, 1] = behind_play(now, of.joint_play[:, 0], self.block[:, 1])
            values[:, i] = self._lagged(name, now, span) if name in self._lags else now
        return of.gain * values + of.zero

    def _lagged(self, name: str, now: Vector, span: float) -> Vector:
        """Return what a sensor with a lag reads [machines], and keep it; docs/model.md (62)."""
        at, lag = 2 + 2 * list(self._lags).index(name), self._lags[name]
        read = lagged(now, self.block[:, at], self.block[:, at + 1], lag, span)
        self.block[:, at], self.block[:, at + 1] = now, read
        return read

    def means(self) -> tuple[float, float, dict[str, tuple[float, float]]]:
        """Return motor and joint behind their plays, and what each lagging channel is and reads, as means."""
        motor, joint, *lags = self.block.mean(axis=0).tolist()
        pairs = zip(lags[::2], lags[1::2], strict=True)
        return motor, joint, dict(zip(self._lags, pairs, strict=True))

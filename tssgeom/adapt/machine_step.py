"""A step of many machines at once; docs/model.md (171)-(175), (201)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tssgeom import core
from tssgeom.adapt.machine_laws import laws_of, without_zeros
from tssgeom.adapt.machine_lines import MachineLines, MachineNumbers
from tssgeom.adapt.machine_readings import Moved, SensorState
from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import FitError
from tssgeom.rig import Rig
from tssgeom.tendon.machine_history import DriveName, Turning, direction
from tssgeom.tendon.machine_simulation import drive_channels


@dataclass(slots=True)
class Standing:
    """Where many machines stand."""

    memory: Matrix
    """[machines, …] What the tendons of each remember."""
    coordinate: Matrix
    """[machines, m] Coordinates of the end."""
    sensed: SensorState
    """What plays and lagging sensors keep."""

    def with_rows(self, count: int) -> Standing:
        """Return so many of them, further ones as the first."""
        rows = np.where(np.arange(count) < len(self.memory), np.arange(count), 0)
        block = self.sensed.with_block(self.sensed.block[rows])
        return Standing(self.memory[rows], self.coordinate[rows], block)

    def copied(self) -> Standing:
        """Return the same, to go on by themselves."""
        return self.with_rows(len(self.memory))


@dataclass(frozen=True, slots=True)
class MachineStep:
    """A machine whose members are to be stepped."""

    rig: Rig
    drive: DriveName
    channels: tuple[str, ...]
    keys: tuple[str, ...]
    """Of the numbers that are followed."""
    lines: MachineLines

    def of(
        self,
        start: Standing,
        numbers: Matrix,
        read: Matrix,
        values: Mapping[str, float],
        span: float,
        motor_way: int,
        joint: Turning,
    ) -> tuple[Standing, Moved, MachineNumbers]:
        """Return what a step makes of as many machines as there are numbers.

        Parameters
        ----------
        start
            Where they stand before it.
        numbers
            [machines, d] What is followed.
        read
            [machines, drives] What the sensors of the drives read.
        values
            What was measured, by channel.
        span
            How long it takes [s].
        motor_way, joint
            Which way the motor went last, and the joint before, where its angle is given.

        Returns
        -------
        tuple
            Where they stand, what their sensors are to read, and all numbers of them.

        Raises
        ------
        FitError
            Where one finds no equilibrium.
        """
        rows, lines, sensed = len(numbers), self.lines, start.sensed.copied()
        of = lines.numbers_of(numbers)
        motor, drive = self._driven(of, sensed, read)
        laws = laws_of(self.rig, of, self.drive, drive, without_zeros(values, of, self.channels))
        done, memory, coordinate, ends = core.step_machines(
            len(lines.machine.edge),
            lines.plant,
            lines.slope,
            numbers - lines.about,
            start.memory,
            laws.proximal.reshape(rows, -1),
            laws.distal.reshape(rows, -1),
            laws.stiffness,
            laws.gravity,
            laws.friction,
            laws.at_rest,
            start.coordinate,
            self.drive == "tension_in",
            laws.drive,
            laws.end,
            laws.load,
            span,
            0.0,
        )
        if done < rows:
            said = ", ".join(f"{key} {value:g}" for key, value in zip(self.keys, numbers[done], strict=True))
            raise FitError(f"there is no equilibrium of the machine with {said}: take smaller steps")
        motor = coordinate[:, -1] if self.drive == "motor_torque_Nm" else motor
        joint_way = 0.0 if laws.angle is None else float(direction(laws.angle[:1], joint)[0])
        ends = ends.reshape(rows, lines.machine.count, 4)
        moved = Moved(ends, coordinate, motor, laws.angle, float(motor_way), joint_way)
        return Standing(memory, coordinate, sensed), moved, of

    def _driven(self, of: MachineNumbers, sensed: SensorState, read: Matrix) -> tuple[Vector | None, Matrix]:
        """Return the angle of the motor, and where the drives go, from what their sensors read."""
        drives = drive_channels(self.drive, self.lines.machine.count)
        at = [self.channels.index(name) for name in drives]
        true = (read - of.zero[:, at]) / of.gain[:, at]
        if self.drive == "motor_angle_rad":
            engaged = sensed.engaged_motor(true[:, 0], of.play[:, 0])
            return true[:, 0], engaged[:, None] * of.arms
        return None, np.maximum(true, 0.0) if self.drive == "tension_in" else true

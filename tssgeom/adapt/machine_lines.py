"""A machine and its sensors as straight lines over the numbers that are followed; docs/model.md (201)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tssgeom.adapt.followed import FollowedNumber, slopes, with_values_of
from tssgeom.arrays import Matrix, Vector
from tssgeom.mechanism import per_motor_angle
from tssgeom.rig import Rig, Sensor
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import Machine, held_tensions, machine_of, routed


class MachineNumbers(NamedTuple):
    """Numbers of a machine of n tendons, m coordinates and c channels beside its plants.

    Each is a vector of one machine, or has a row for each of many.
    """

    distal: Matrix
    """[n·m] Movement of each load for 1 of each coordinate [m]."""
    stiffness: Matrix
    """[m]"""
    holds: Matrix
    """[40·m]"""
    friction: Matrix
    """[1] Of the only coordinate."""
    held_in: Matrix
    """[n] Tension of the first bar of each tendon when the run began [N]."""
    held_out: Matrix
    """[n] Of the last bar."""
    arms: Matrix
    """[n] How far each drive moves for each radian of the motor [m]."""
    play: Matrix
    """[1] Of the drive [rad]."""
    joint_play: Matrix
    """[1] [rad]"""
    motor_friction: Matrix
    """[1] [N·m]"""
    gain: Matrix
    """[c]"""
    zero: Matrix
    """[c] In the unit of each channel."""


def _numbers(machine: Machine, channels: Sequence[str]) -> MachineNumbers:
    rig, motion, held = machine.rig, machine.coordinates, held_tensions(machine)
    sensors = [rig.sensors.get(name, Sensor()) for name in channels]
    return MachineNumbers(
        motion.distal.ravel(),
        motion.stiffness,
        motion.holds.ravel(),
        np.array([motion.friction]),
        held[:, 0],
        held[:, -1],
        per_motor_angle(rig.drive, machine.count),
        np.array([rig.drive.play_rad]),
        np.array([rig.end.play_rad]),
        np.array([rig.drive.friction_Nm]),
        np.array([sensor.gain for sensor in sensors]),
        np.array([sensor.zero for sensor in sensors]),
    )


@dataclass(frozen=True, slots=True)
class MachineLines:
    """A machine as straight lines over the followed numbers about some values."""

    about: Vector
    """[d] The values."""
    machine: Machine
    """There."""
    plant: Matrix
    """[n, numbers] Plants of its tendons there."""
    slope: Matrix
    """[d, n·numbers] What 1 of each number adds to them."""
    numbers: MachineNumbers
    """There."""
    number_slope: Matrix
    """[d, …] What 1 of each adds to the `numbers`, one after the other."""

    def numbers_of(self, values: Matrix) -> MachineNumbers:
        """Return the numbers of members whose followed numbers are [members, d]."""
        whole = np.concatenate(self.numbers) + (values - self.about) @ self.number_slope
        ends = np.cumsum([len(each) for each in self.numbers])
        return MachineNumbers(*np.split(whole, ends[:-1], axis=1))


def machine_lines(
    rig: Rig, numbers: Sequence[FollowedNumber], about: Vector, arcs: Arcs, channels: Sequence[str]
) -> MachineLines:
    """Return a machine about values [d] of the numbers, on a route as sensed."""

    def at(values: Vector) -> Machine:
        changed = with_values_of(rig, numbers, values)
        return machine_of(changed, [routed(arcs, changed)])

    def flat(machine: Machine) -> Vector:
        return np.concatenate([*(each.block for each in machine.plants), *_numbers(machine, channels)])

    machine = at(about)
    plant, first = np.array([each.block for each in machine.plants]), _numbers(machine, channels)
    both = slopes(lambda values: flat(at(values)), flat(machine), numbers, about)
    slope, number_slope = map(np.ascontiguousarray, np.split(both, [plant.size], axis=1))
    return MachineLines(about, machine, plant, slope, first, number_slope)

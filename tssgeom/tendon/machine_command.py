"""The angle of a motor that turns a joint as wanted: the inverse of a machine, its history kept; (184)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.core.constants_tendon_rows import HELD
from tssgeom.errors import SettingsError
from tssgeom.mechanism import per_motor_angle
from tssgeom.tendon.bars.plant import Memory
from tssgeom.tendon.machine import (
    Machine,
    MachineState,
    MachineTrace,
    Start,
    begin,
    carry_on,
    held_tensions,
)
from tssgeom.tendon.machine_history import MachineHistory, direction


@dataclass(frozen=True, slots=True)
class CommandSettings:
    """How the angle of a motor is searched for."""

    close: float = 1e-7
    """Angle of the joint that may be missed [rad]; chosen: below what any encoder resolves."""
    first: float = 1e-3
    """First step of the search [rad]; chosen."""
    farthest: float = 100.0
    """Angle from which the target is out of reach [rad]; chosen: sixteen turns of a motor."""
    most_trials: int = 100
    """Trials of one sample; derived: doublings and halvings to rounding."""


COMMAND = CommandSettings()


class MachineCommands(NamedTuple):
    """What a motor has to do, and what then happens."""

    motor_angle: Vector
    """[s] [rad]."""
    joint_angle: Vector
    """[s] What the joint does [rad]."""
    ends: np.ndarray
    """[s, n, 4] T_in, T_out [N], x_in, x_out [m] of each tendon."""
    reached: np.ndarray
    """[s] Whether the joint gets where it is wanted."""


def command_machine(
    machine: Machine, time: Vector, target: Vector, load: Vector | None = None, start: Start | None = None
) -> MachineCommands:
    """Return the angle of the motor that turns a joint as wanted; docs/model.md (184).

    Parameters
    ----------
    machine
        One tendon or a pair on a motor, with a joint.
    time
        [s] Increasing [s].
    target
        [s] Angle of the joint [rad].
    load
        [s] Torque against the joint [N·m]; none where left out.
    start
        Where the tendons stand at the beginning; at rest where left out.

    Raises
    ------
    SettingsError
        Where the rig has no motor or no joint.
    """
    rig, arms = machine.rig, _arms(machine)
    spans = np.diff(time, prepend=2.0 * time[0] - time[1] if len(time) > 1 else time[0] - 1.0)
    resisting = np.zeros(len(time)) if load is None else load
    held = held_tensions(machine, start)
    balance = machine.coordinates.distal.T @ held[:, -1]
    state, angle, rows = begin(machine, held), 0.0, list[tuple[float, float, np.ndarray, bool]]()
    for k in range(len(time)):
        at = _Sample(machine, state, balance, arms, float(spans[k]), float(resisting[k]), float(target[k]))
        angle, trace, state, reached = at.solved(angle)
        rows.append((angle, float(trace.coordinate[0, 0]), trace.ends[0], reached))
    engaged = np.array([row[0] for row in rows])
    return MachineCommands(
        before_play(engaged, rig.drive.play_rad),
        np.array([row[1] for row in rows]),
        np.array([row[2] for row in rows]),
        np.array([row[3] for row in rows]),
    )


def next_angle(
    machine: Machine, history: MachineHistory, span: float, load: float, target: float
) -> tuple[float, float, bool]:
    """Return the angle of the motor that turns a joint as wanted, from where a machine stands; (184).

    Also the angle that the joint gets to, and whether that is the target. Angles are in rad, `load` is what
    acts against the joint [N·m], `span` how long the step lasts [s].

    Raises
    ------
    SettingsError
        Where the rig has no motor or no joint, or another quantity than a position drove before.
    """
    arms, width = _arms(machine), machine.rig.drive.play_rad
    if history.drive not in ("motor_angle_rad", "displacement_in"):
        raise SettingsError(
            f"{history.drive} drives: a target needs motor_angle_rad or displacement_in instead"
        )
    balance = machine.coordinates.distal.T @ history.held[:, 1]
    before = history.motor
    near = Memory(history.state.memory[0]).drive[HELD.drive] / arms[0] if before is None else before.engaged
    at = _Sample(machine, history.state, balance, arms, span, load, target)
    angle, trace, _, reached = at.solved(float(near))
    motor = angle - width * (angle < near)
    if before is not None and angle == near:
        motor = before.value
    return float(motor), float(trace.coordinate[0, 0]), reached


def _arms(machine: Machine) -> Vector:
    """Return how far each drive moves for each radian of the motor [n] [m]."""
    arms = per_motor_angle(machine.rig.drive, machine.count)
    if machine.rig.end.kind != "joint" or not arms.any():
        raise SettingsError(
            'a joint follows a target where a motor drives it: give end.kind = "joint", drive.radius_m > 0'
        )
    return arms


def before_play(engaged: Vector, width: float) -> Vector:
    """Return the motion whose play leaves `engaged` [s]: it crosses the play at each turn."""
    way = direction(np.concatenate(([0.0], engaged)))[1:]
    return engaged - width * (way < 0.0)


@dataclass(frozen=True, slots=True)
class _Sample:
    """One sample of a target, from where the machine stands."""

    machine: Machine
    state: MachineState
    balance: Vector
    arms: Vector
    span: float
    load: float
    target: float

    def at(self, angle: float) -> tuple[float, MachineTrace | None, MachineState]:
        """Return by how much the joint misses the target with this angle of the motor."""
        laws = self.machine.coordinates
        done, trace, state = carry_on(
            self.machine,
            self.state,
            laws,
            np.zeros_like(laws.distal),
            self.balance,
            by_force=False,
            spans=np.array([self.span]),
            given=(angle * self.arms)[None],
            moved=np.zeros((1, self.machine.count)),
            load=np.array([[self.load]]),
        )
        if done == 0:
            return math.nan, None, self.state
        return float(trace.coordinate[0, 0]) - self.target, trace, state

    def solved(self, near: float) -> tuple[float, MachineTrace, MachineState, bool]:
        """Return the angle nearest to `near` that gets there, what it does, and whether it does get there."""
        off, trace, state = self.at(near)
        if trace is None:
            raise SettingsError(f"the machine has no equilibrium with the motor at {near:g} rad")
        best = (near, trace, state)
        if abs(off) <= COMMAND.close:
            return *best, True
        way, low, step = (-1.0 if off > 0.0 else 1.0), near, COMMAND.first
        high = near
        for _ in range(COMMAND.most_trials):
            high = low + way * step
            there, trace, state = self.at(high)
            if trace is None or abs(high) > COMMAND.farthest:
                return *best, False
            best = (high, trace, state)
            if abs(there) <= COMMAND.close:
                return *best, True
            if there * off < 0.0:
                break
            low, step = high, 2.0 * step
        there = math.inf
        for _ in range(COMMAND.most_trials):
            middle = 0.5 * (low + high)
            there, trace, state = self.at(middle)
            if trace is None or middle in (low, high):
                break
            best = (middle, trace, state)
            if abs(there) <= COMMAND.close:
                return *best, True
            low, high = (middle, high) if there * off > 0.0 else (low, middle)
        return *best, abs(there) <= 1e3 * COMMAND.close

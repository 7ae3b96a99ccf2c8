"""The angle of a motor that turns a joint as wanted: the inverse of a machine, its history kept; (184)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_tendon import SOLVER
from tssgeom.core.constants_tendon_rows import HELD
from tssgeom.errors import SettingsError
from tssgeom.mechanism import NO_LIMITS, per_motor_angle
from tssgeom.tendon.bars.plant import Memory
from tssgeom.tendon.bars.sensors import behind_play
from tssgeom.tendon.command import DEAD_ZONE
from tssgeom.tendon.drive_limits import within
from tssgeom.tendon.machine import (
    Acts,
    Machine,
    MachineState,
    MachineTrace,
    begin,
    carry_on,
    held_tensions,
)
from tssgeom.tendon.machine_history import MachineHistory, Turning


@dataclass(frozen=True, slots=True)
class CommandSettings:
    """How the angle of a motor is searched for."""

    first: float = 1e-3
    """First step of the search [rad]; chosen."""
    farthest: float = 100.0
    """Angle from which the target is out of reach [rad]; chosen: sixteen turns of a motor."""


COMMAND = CommandSettings()


MayWait = Callable[[float, float], bool]
"""Says of a joint that misses its target by [rad], the motor held at [rad], whether it may stay there."""


class NextAngle(NamedTuple):
    """What a motor has to do for one target, and what then happens."""

    motor: float
    """Angle of the motor [rad]."""
    engaged: float
    """Its angle behind the play [rad]."""
    joint: float
    """Angle of the joint that its sensor gets to, behind the play of the end [rad]."""
    reached: bool
    """Whether an angle of the motor reaches the target; limits and policy may keep the motor from it."""
    trace: MachineTrace
    state: MachineState
    limited: str = ""
    """Limits of the drive that cut it, by their keys in `[drive] limits`."""
    waits: bool = False
    """Whether the motor is held inside the dead zone."""


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
    limited: tuple[str, ...]
    """[s] Limits of the drive that cut the command."""
    waits: np.ndarray
    """[s] Whether the motor is held inside the dead zone."""


def command_machine(
    machine: Machine,
    time: Vector,
    target: Vector,
    load: Vector | None = None,
    near_enough: float | None = None,
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
    near_enough
        Distance of the joint from its target up to which a motor inside the dead zone is held [rad]; the dead
        zone is crossed at once where left out.

    Raises
    ------
    SettingsError
        Where the rig has no motor or no joint.
    """
    resisting = np.zeros(len(time)) if load is None else load
    held = held_tensions(machine)
    spans = np.diff(time, prepend=2.0 * time[0] - time[1] if len(time) > 1 else time[0] - 1.0)
    state, begun = begin(machine, held), float(time[0] - spans[0])
    rest = Turning(0.0, 0.0, 0.0)
    at = MachineHistory(state, held[:, [0, -1]], "motor_angle_rad", begun, float(time[0]), rest)
    may_wait = None if near_enough is None else lambda miss, _: miss <= near_enough
    done = list[NextAngle]()
    for k in range(len(time)):
        span = float(spans[k])
        wanted = float(target[k])
        now = next_angle(machine, at, span, float(resisting[k]), wanted, span if k else 0.0, may_wait)
        motor = Turning(now.motor, 0.0, now.engaged)
        joint = Turning(float(now.state.coordinate[0]), 0.0, now.joint)
        at = at._replace(state=now.state, time=float(time[k]), motor=motor, joint=joint)
        done.append(now)
    return MachineCommands(
        np.array([one.motor for one in done]),
        np.array([one.joint for one in done]),
        np.array([one.trace.ends[0] for one in done]),
        np.array([one.reached for one in done]),
        tuple(one.limited for one in done),
        np.array([one.waits for one in done]),
    )


def next_angle(
    machine: Machine,
    history: MachineHistory,
    span: float,
    load: float,
    target: float,
    elapsed: float,
    may_wait: MayWait | None = None,
) -> NextAngle:
    """Return what turns a joint as wanted, from where a machine stands; docs/model.md (184), (219).

    Parameters
    ----------
    machine, history
        A joint on a motor, and where it stands.
    span
        How long the step lasts [s].
    load
        What acts against the joint [N·m].
    target
        Where the joint is wanted [rad].
    elapsed
        Time since the motor was where it is [s], for the limit of its speed.
    may_wait
        Says whether a motor inside the dead zone may be held there.

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
    near = float(near)
    was = near if before is None else before.value
    end = _EndPlay(machine.rig.end.play_rad, history)
    at = _Sample(machine, history.state, balance, arms, span, load, end.joint_for(target))
    angle, trace, state, reached = at.solved(near)
    if angle != near and may_wait is not None and at.is_dead(near, angle, was, width):
        joint, held, stays = at.with_motor_at(near)
        if may_wait(abs(end.read(joint) - target), was):
            return NextAngle(was, near, end.read(joint), reached, held, stays, waits=True)
    motor = was if angle == near else angle - width * (angle < near)
    joint, limited = float(trace.coordinate[0, 0]), ""
    if machine.rig.drive.limits != NO_LIMITS:
        motor, limited = at.within_limits(motor, was, near, elapsed)
    if limited:
        angle = behind_play(near, motor, width)
        joint, trace, state = at.with_motor_at(angle)
    return NextAngle(motor, angle, end.read(joint), reached, trace, state, limited)


class _EndPlay:
    """The play between a joint and its sensor, of a width [rad], as a history left it; docs/model.md (59)."""

    def __init__(self, width: float, history: MachineHistory) -> None:
        self._width, self._joint = width, float(history.state.coordinate[0])
        self._engaged = self._joint if history.joint is None else history.joint.engaged

    def read(self, joint: float) -> float:
        """Return what the sensor reads of a joint [rad]."""
        return behind_play(self._engaged, joint, self._width)

    def joint_for(self, target: float) -> float:
        """Return where the joint has to be for a reading [rad]."""
        if self._width > 0.0 and abs(target - self._engaged) <= SOLVER.accepted:
            return self._joint
        return target - self._width * (target < self._engaged)


def _arms(machine: Machine) -> Vector:
    """Return how far each drive moves for each radian of the motor [n] [m]."""
    arms = per_motor_angle(machine.rig.drive, machine.count)
    if machine.rig.end.kind != "joint" or not arms.any():
        raise SettingsError(
            'a joint follows a target where a motor drives it: give end.kind = "joint", drive.radius_m > 0'
        )
    return arms


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

    def is_dead(self, near: float, angle: float, was: float, width: float) -> bool:
        """Whether the joint does not follow the motor towards an angle at first, or has a play to cross."""
        way = math.copysign(1.0, angle - near)
        if way * (near - was) + max(-way, 0.0) * width > SOLVER.accepted:
            return True
        step = min(COMMAND.first, abs(angle - near))
        by = self.at(near + way * step)[0] - self.at(near)[0]
        free = step * abs(self.arms[0]) / self.machine.rig.end.radius_m
        return not abs(by) > DEAD_ZONE * free

    def within_limits(self, motor: float, was: float, near: float, elapsed: float) -> tuple[float, str]:
        """Return the angle of the motor that keeps to the limits, and the names of those that cut it."""
        drive, cut = self.machine.rig.drive, list[str]()
        limits, wanted = drive.limits, motor
        if limits.tension_N is not None:
            wanted = self._bearable(wanted, was, near, limits.tension_N)
            cut += ["tension_N"] * (wanted != motor)
        position = at = wanted * float(self.arms[0])
        if limits.displacement_m is not None:
            position = within(position, *limits.displacement_m, "displacement_m", cut)
        if limits.speed_m_per_s is not None:
            reach, now = limits.speed_m_per_s * elapsed, was * float(self.arms[0])
            position = within(position, now - reach, now + reach, "speed_m_per_s", cut)
        return wanted if position == at else position / float(self.arms[0]), ", ".join(cut)

    def _bearable(self, motor: float, was: float, near: float, most: float) -> float:
        """Return the angle of the motor next to a wanted one with which no drive pulls more than [N]."""
        width = self.machine.rig.drive.play_rad

        def pull(angle: float) -> float:
            trace = self.at(behind_play(near, angle, width))[1]
            return math.inf if trace is None else float(trace.ends[0, :, 0].max())

        if pull(motor) <= most * (1.0 + ROUNDING.relative):
            return motor
        good, bad = was, motor
        while abs(bad - good) > SOLVER.accepted:
            middle = 0.5 * (good + bad)
            good, bad = (middle, bad) if pull(middle) <= most else (good, middle)
        return good

    def with_motor_at(self, angle: float) -> tuple[float, MachineTrace, MachineState]:
        """Return the angle of the joint with this angle of the motor [rad], what happens, and where it ends.

        Raises
        ------
        SettingsError
            Where the machine has no equilibrium there.
        """
        _, trace, state = self.at(angle)
        if trace is None:
            raise SettingsError(f"the machine has no equilibrium with the motor at {angle:g} rad")
        return float(trace.coordinate[0, 0]), trace, state

    def at(self, angle: float) -> tuple[float, MachineTrace | None, MachineState]:
        """Return by how much the joint misses the target with this angle of the motor."""
        laws = self.machine.coordinates
        acts = Acts(
            *(self.machine, self.state, laws, np.zeros_like(laws.distal), self.balance),
            by_force=False,
            spans=np.array([self.span]),
            given=(angle * self.arms)[None],
            moved=np.zeros((1, self.machine.count)),
            load=np.array([[self.load]]),
        )
        done, trace, state = carry_on(acts)
        if done == 0:
            return math.nan, None, self.state
        return float(trace.coordinate[0, 0]) - self.target, trace, state

    def solved(self, near: float) -> tuple[float, MachineTrace, MachineState, bool]:
        """Return the angle nearest to `near` that gets there, what it does, and whether it does get there."""
        joint, trace, state = self.with_motor_at(near)
        off = joint - self.target
        best = (near, trace, state)
        if abs(off) <= SOLVER.accepted:
            return *best, True
        way, low, step = (-1.0 if off > 0.0 else 1.0), near, COMMAND.first
        high = near
        for _ in range(SOLVER.trials):
            high = low + way * step
            there, trace, state = self.at(high)
            if trace is None or abs(high) > COMMAND.farthest:
                return *best, False
            best = (high, trace, state)
            if abs(there) <= SOLVER.accepted:
                return *best, True
            if there * off < 0.0:
                break
            low, step = high, 2.0 * step
        there = math.inf
        for _ in range(SOLVER.trials):
            middle = 0.5 * (low + high)
            there, trace, state = self.at(middle)
            if trace is None or middle in (low, high):
                break
            best = (middle, trace, state)
            if abs(there) <= SOLVER.accepted:
                return *best, True
            low, high = (middle, high) if there * off > 0.0 else (low, middle)
        return *best, abs(there) <= 1e3 * SOLVER.accepted

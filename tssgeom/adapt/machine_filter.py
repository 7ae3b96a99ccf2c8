"""The filter that follows a machine: members are machines with tendons, plays and zeros of their own.

Source: docs/model.md (171)-(178), (200)-(205).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.adapt.ensemble import Ensemble
from tssgeom.adapt.followed import FollowedNumber, with_numbers
from tssgeom.adapt.machine_lines import MachineNumbers, machine_lines
from tssgeom.adapt.machine_readings import MachineReadings, Moved, SensorState, channels_read, true_values
from tssgeom.adapt.members import SETTINGS, Rows, Standing
from tssgeom.adapt.readings import Moment
from tssgeom.adapt.stepped import Stepped
from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import SensorLaw
from tssgeom.errors import SettingsError
from tssgeom.mechanism import HOLDS, tendon_count
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import Machine, begin, held_tensions, shift_rests
from tssgeom.tendon.machine_history import DriveName, MachineHistory, Turning, direction
from tssgeom.tendon.machine_simulation import drive_channels, on_clock
from tssgeom.tendon.machine_target import Following


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
    holds: Matrix
    """[machines, 40·m]"""
    friction: Vector
    """[machines]"""
    at_rest: Matrix
    """[machines, m]"""
    angle: Vector | None = None
    """[machines] Angle of the joint where it is given [rad]."""


class _OnClock(NamedTuple):
    """What was measured, with the drives on the clock of what answers; docs/model.md (178)."""

    values: Mapping[str, float]
    commanded: bool
    recent: Matrix | None
    """What was recorded of a drive that lags."""


class MachineFilter(Ensemble):
    """Follows numbers of a machine from frame to frame.

    Parameters
    ----------
    rig, numbers, arcs, seed
        As of `Ensemble`; the route is as sensed.
    drive
        What drives the tendons.
    """

    of_machines = True

    def __init__(
        self, rig: Rig, numbers: Sequence[FollowedNumber], arcs: Arcs, drive: DriveName, *, seed: int = 0
    ) -> None:
        for each in rig.effects:
            if isinstance(each, SensorLaw):
                raise SettingsError(f"effects.sensor_law: {each.channel} is not followed: leave it out")
        self.drive: DriveName = drive
        self.count = tendon_count(rig.drive, rig.end)
        super().__init__(rig, numbers, arcs, channels_read(rig), drive_channels(drive, self.count), seed)
        state, count = begin(self.machine, held_tensions(self.machine)), len(self.members)
        m = len(state.coordinate) + (drive == "motor_torque_Nm")
        self.sensors = SensorState(rig, self.channels, count)
        """With the block of no member: see `with_block`."""
        memory, none = np.tile(state.memory.ravel(), (count, 1)), np.zeros(count)
        self.stand(Standing(memory, np.zeros((count, m)), self.sensors.block, none, False, math.nan))
        self.joint = Turning(math.nan, 0.0, 0.0)
        """The joint where its angle is given; engaged is that of no member."""
        self.recent: Matrix | None = None
        """What was recorded of a drive that lags; docs/model.md (178)."""

    def go_on(self, history: MachineHistory) -> None:
        """Let all members stand where a machine stands."""
        motor, joint = (None if one is None else one.engaged for one in (history.motor, history.joint))
        for one in (self.kept, self.now):
            one.memory[:], one.coordinate[:] = history.state.memory.ravel(), history.state.coordinate
            self.sensors.with_block(one.block).begin(motor, joint, history.lags)
        self.recent, self.is_history_known = history.recent, True

    @property
    def machine(self) -> Machine:
        """The machine about which members are straight lines."""
        return self._lines.machine

    def motor(self, engaged: float) -> Turning | None:
        """Return the motor as it is now, whose members stand behind the play at [rad]; None without one."""
        if self.drive != "motor_angle_rad" or math.isnan(engaged):
            return None
        known = dict(zip(self.keys, self.values.tolist(), strict=True))  # by which the members stand there
        sensor = with_numbers(self.rig, known).sensors[self.drive]
        true = (self.trackers[self.drive].position - sensor.zero) / sensor.gain
        return Turning(true, float(self.trackers[self.drive].way), engaged)

    def outputs_after(self, values: Mapping[str, float], span: float, follows: Following) -> Matrix:
        """Return what follows a target after a move of the drives, of half the members [members, d].

        `values` are the readings, those of the drives as they go; nothing is changed; docs/model.md (205).
        """
        count = SETTINGS.members // 2
        read = np.tile([values[name] for name in self.drives], (count, 1))
        span = max(span, SETTINGS.first_span)
        at, rows = Moment(self.time, self.cut, MachineReadings(values)), np.arange(count)
        stepped = self._stepped(self.now, rows, read, at, span, 0.0)
        if follows.tendons:
            return stepped.ends[:, [4 * k + 1 for k in follows.tendons]]
        return stepped.standing.coordinate[:, : len(follows.outputs)]

    def _at_rest(self) -> Vector:
        by_force = self.drives[0].startswith("tension_in")
        return held_tensions(self.machine)[:, 0] if by_force else np.zeros(len(self.drives))

    def _used(self, at: Moment) -> tuple[Moment, list[float]]:
        values = self._with_torque(at.readings.values)
        if missing := [name for name in self.drives if name not in values]:
            raise SettingsError(f"no {missing[0]}, which drove before: give it in each frame, or begin anew")
        run = {name: np.array([values[name]]) for name in self.drives} | {"time_s": np.array([at.time])}
        driven, recent = on_clock(run, self.recent, self.drives, self.rig.drive.lag_s)
        values = {**values, **{name: float(value[0]) for name, value in driven.items()}}
        used = at._replace(readings=_OnClock(values, at.readings.commanded, recent))
        return used, [values[name] for name in self.drives]

    def _with_torque(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """Return what was measured, with the torque of a motor that drives where its current states it."""
        if self.drive != "motor_torque_Nm" or "motor_torque_Nm" in values or "motor_current_A" not in values:
            return values
        return {
            **values,
            "motor_torque_Nm": self.rig.drive.torque_constant_Nm_per_A * values["motor_current_A"],
        }

    def _stepped(
        self, start: Standing, rows: Rows, read: Matrix, at: Moment, span: float, passed: float
    ) -> Stepped:
        count, lines, sensed = len(rows), self._lines, self.sensors.with_block(start.block[rows])
        numbers = self.members[rows]
        of = lines.numbers_of(numbers)
        motor, drive = self._driven(of, sensed, read)
        laws = laws_of(self.rig, of, self.drive, drive, without_zeros(at.readings.values, of, self.channels))
        done, memory, coordinate, ends = core.step_machines(
            len(self.edge),
            lines.plant,
            lines.slope,
            numbers - lines.about,
            start.memory,
            rows,
            laws.proximal.reshape(count, -1),
            laws.distal.reshape(count, -1),
            laws.stiffness,
            laws.holds,
            laws.friction,
            laws.at_rest,
            start.coordinate[rows],
            self.drive == "tension_in",
            laws.drive,
            laws.end,
            laws.load,
            span,
            0.0,
        )
        self._require_all(done, rows, "machine")
        motor = coordinate[:, -1] if self.drive == "motor_torque_Nm" else motor
        joint = self.joint
        if laws.angle is not None:
            joint = Turning(float(laws.angle[0]), float(direction(laws.angle[:1], joint)[0]), 0.0)
        way = float(self._driving[0].way)
        moved = Moved(ends.reshape(count, self.count, 4), coordinate, motor, laws.angle, way, joint.way)
        channels = sensed.read(true_values(self.rig, of, moved), of, self.channels, passed)
        standing = Standing(memory, coordinate, sensed.block, start.position, False, at.time)
        return Stepped(standing, channels, ends, joint)

    def _driven(self, of: MachineNumbers, sensed: SensorState, read: Matrix) -> tuple[Vector | None, Matrix]:
        """Return the angle of the motor, and where the drives go, from what their sensors read."""
        at = [self.channels.index(name) for name in self.drives]
        true = (read - of.zero[:, at]) / of.gain[:, at]
        if self.drive == "motor_angle_rad":
            engaged = sensed.engaged_motor(true[:, 0], of.play[:, 0])
            return true[:, 0], engaged[:, None] * of.arms
        return None, np.maximum(true, 0.0) if self.drive == "tension_in" else true

    def _passed(self, after: Stepped, at: Moment) -> None:
        self.joint, self.recent = after.joint, at.readings.recent

    def _given(self, at: Moment) -> Vector:
        unused, values = {*self.muted, *self.drives}, at.readings.values
        if self.rig.end.given == "angle":
            unused.add("joint_angle_rad")
        elif "joint_torque_Nm" in values:
            unused.add("joint_torque_Nm")
        return np.array(
            [math.nan if name in unused else values.get(name, math.nan) for name in self.channels]
        )

    def _lie_on(self, arcs: Arcs) -> None:
        """Move the tendons of all machines to another route: each bar keeps its tension; (218)."""
        if arcs is self.cut:
            return
        before, self.cut = self.machine, arcs
        self.draw_lines(self.values)
        for one in (self.kept, self.now, *(() if self.path is None else (self.path.start,))):
            one.memory = one.memory.copy()
            for row in one.memory.reshape(len(one.memory), self.count, -1):
                shift_rests(row, before, self.machine)

    def _draw_lines(self) -> None:
        self._lines = machine_lines(self.rig, self.numbers, self.about, self.cut, self.channels)
        self.edge = self._lines.machine.edge


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
        holds=of.holds,
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
        holds=np.zeros_like(laws.holds),
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
        holds=np.hstack([laws.holds, np.zeros((rows, HOLDS))]),
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

"""The filter that follows a machine: members are machines with tendons, plays and zeros of their own.

Source: docs/model.md (171)-(178), (200)-(205).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Self

import numpy as np

from tssgeom.adapt.ensemble import PROBES, SETTINGS, Ensemble, Taken
from tssgeom.adapt.followed import FollowedNumber
from tssgeom.adapt.machine_lines import MachineNumbers, machine_lines
from tssgeom.adapt.machine_readings import MachineReadings, Moved, SensorState, channels_read, true_channels
from tssgeom.adapt.machine_step import MachineStep, Standing
from tssgeom.adapt.readings import FollowedRig, mean_and_sd, noise_variance
from tssgeom.adapt.trailed_drive import TRAIL, TrailedDrive
from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import SettingsError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import Machine, begin, held_tensions, shift_rests
from tssgeom.tendon.machine_history import DriveName, MachineHistory, Turning
from tssgeom.tendon.machine_simulation import drive_channels, on_clock


class MachineFilter(Ensemble):
    """Follows numbers of a machine from frame to frame.

    Parameters
    ----------
    rig
        The rig; its `sensors` state the noise of each channel.
    numbers
        What is followed.
    arcs
        The route of the first frame, as sensed.
    drive
        What drives the tendons.
    seed
        Of the numbers at the start and of the drift.
    """

    def __init__(
        self, rig: Rig, numbers: Sequence[FollowedNumber], arcs: Arcs, drive: DriveName, *, seed: int = 0
    ) -> None:
        super().__init__(rig, numbers, seed)
        self.drive: DriveName = drive
        self.cut, self.channels = arcs, channels_read(rig)
        about = np.array([one.value for one in numbers])
        self._lines = machine_lines(rig, numbers, about, arcs, self.channels)
        machine = self._lines.machine
        self.drives = drive_channels(drive, machine.count)
        state = begin(machine, held_tensions(machine))
        m = len(state.coordinate) + (drive == "motor_torque_Nm")
        count = len(self.members)
        self.kept, self.now = (
            Standing(
                np.tile(state.memory.ravel(), (count, 1)),
                np.zeros((count, m)),
                SensorState(rig, self.channels, count),
            )
            for _ in range(2)
        )
        """Where the members stand behind the drive for sure, and where they are by now."""
        self.kept_time = math.nan
        self.committed = np.zeros((count, len(self.drives)))
        """[members, drives] What the sensors of the drives read where the members are kept."""
        self.joint = Turning(math.nan, 0.0, 0.0)
        """The joint where its angle is given; engaged is that of no member."""
        self.recent: Matrix | None = None
        """What was recorded of a drive that lags; docs/model.md (178)."""
        variances = [noise_variance(rig.sensors.get(name)) for name in self.channels]
        self._noise_variance = np.maximum(variances, SETTINGS.least_noise**2)
        self.trackers = tuple(
            TrailedDrive(math.sqrt(noise_variance(rig.sensors.get(name)))) for name in self.drives
        )
        self._bound()

    def go_on(self, history: MachineHistory) -> None:
        """Let all members stand where a machine stands."""
        motor, joint = (None if one is None else one.engaged for one in (history.motor, history.joint))
        for one in (self.kept, self.now):
            one.memory[:], one.coordinate[:] = history.state.memory.ravel(), history.state.coordinate
            one.sensed.begin(motor, joint, history.lags)
        self.recent = history.recent

    def copied(self) -> Self:
        """Return a filter that goes on from here by itself."""
        other = super().copied()
        other.kept, other.now = self.kept.copied(), self.now.copied()
        other.trackers = tuple(one.copied() for one in self.trackers)
        return other

    @property
    def machine(self) -> Machine:
        """The machine about which members are straight lines."""
        return self._lines.machine

    def motor(self, engaged: float) -> Turning | None:
        """Return the motor as it is now, whose members stand behind the play at [rad]; None without one."""
        if self.drive != "motor_angle_rad" or math.isnan(engaged):
            return None
        sensor = self.rig_now().sensors[self.drive]
        true = (self.trackers[0].position - sensor.zero) / sensor.gain
        return Turning(true, float(self.trackers[0].way), engaged)

    @property
    def _by_torque(self) -> bool:
        return self.drive == "motor_torque_Nm"

    @property
    def count(self) -> int:
        """Number of tendons, n."""
        return self.machine.count

    def step(self, arcs: Arcs, readings: MachineReadings, time: float, warmth: float = 0.0) -> FollowedRig:
        """Move the drives of all members, and shift them by what was read.

        Parameters
        ----------
        arcs
            The route as sensed.
        readings
            What was measured.
        time
            Time [s], not before that of the last step.
        warmth
            Temperature above that of the first step [K].

        Raises
        ------
        SettingsError
            Where a drive is missing.
        FitError
            Where a member finds no equilibrium; all machines are then as before.
        """
        self._lie_on(arcs)
        self._drift(SETTINGS.first_span if math.isnan(self.time) else time - self.time)
        values, recent = self._on_clock(self._with_torque(readings.values), time)
        read = [values[name] for name in self.drives]
        exact = readings.commanded or not any(tracker.noise for tracker in self.trackers)
        if exact:
            self._set_drives(read)
        else:
            turned = [tracker.take(one) for tracker, one in zip(self.trackers, read, strict=True)]
            if any(one is not None for one in turned):
                self._follow(turned, values, time)
        count, probes = len(self.members), PROBES * len(self.drives)
        numbers = np.vstack((self.members, np.repeat(self.members[:1], probes, axis=0)))
        after, moved, of = self._stepped(
            self.kept.with_rows(count + probes), numbers, self._drive(exact=exact), values, self._span(time)
        )
        after.sensed.block[:, 2:] = self.now.with_rows(count + probes).sensed.block[:, 2:]
        span = 0.0 if math.isnan(self.time) else time - self.time
        predicted = after.sensed.read(true_channels(self.rig, of, moved), of, self.channels, span)

        def read_behind(drive: int) -> Vector:
            """Return what a member reads one of whose drives has turned as far as that may not show."""
            read = np.array([[one.position for one in self.trackers]])
            read[0, drive] -= self.trackers[drive].way * TRAIL.may_turn * self.trackers[drive].noise
            back, there, its = self._stepped(after.with_rows(1), numbers[:1], read, values, 0.0)
            return back.sensed.read(true_channels(self.rig, its, there), its, self.channels, 0.0)[0]

        taken = self._shifted(predicted, moved, after, self._given(values), read_behind)
        self.joint = _after(self.joint, moved)
        self.time, self.recent = time, recent
        if math.isnan(self.kept_time):
            self.kept_time = time - SETTINGS.first_span
            self.committed[:] = [tracker.committed for tracker in self.trackers]
        if exact:
            self.kept, self.kept_time = self.now.copied(), time
        elif any(tracker.needs_commit() for tracker in self.trackers):
            self._follow([None] * len(read), values, time)
        return self._result(taken)

    def _shifted(
        self,
        predicted: Matrix,
        moved: Moved,
        after: Standing,
        given: Vector,
        read_behind: Callable[[int], Vector],
    ) -> Taken:
        """Let what was read shift numbers, and where the members stand and are."""
        count, kept = len(self.members), self.kept
        ends = (
            moved.ends.reshape(len(predicted), -1),
            after.coordinate,
            after.sensed.block,
            kept.with_rows(len(predicted)).coordinate,
            kept.with_rows(len(predicted)).sensed.block[:, :2],
        )
        both = np.hstack((kept.memory, after.memory[:count]))
        taken = self._take_in(
            both,
            predicted,
            np.hstack(ends),
            given,
            self.trackers,
            read_behind,
            bars=len(self.machine.edge) + 1,
        )
        parts = np.cumsum([predicted.shape[1], *(each.shape[1] for each in ends)])
        _, _, coordinate, block, kept_coordinate, plays = np.split(taken.values, parts[:-1], axis=1)
        width = kept.memory.shape[1]
        self.now = Standing(both[:, width:].copy(), coordinate, after.sensed.with_block(block))
        kept.memory[:], kept.coordinate[:] = both[:, :width], kept_coordinate
        kept.sensed.block[:, :2] = plays
        return taken

    def _follow(self, turned: Sequence[float | None], values: Mapping[str, float], time: float) -> None:
        """Move what is kept behind the drives, to where one has `turned`; members differ in where."""
        count = len(self.members)
        sd = np.array([TRAIL.turn_error * one.noise for one in self.trackers])
        spread = self._deviations(count, sd, self._known())
        for i, (tracker, one) in enumerate(zip(self.trackers, turned, strict=True)):
            if one is not None:
                tracker.committed, self.committed[:, i] = one, one + spread[:, i]
            elif tracker.way * (tracker.safe() - tracker.committed) > 0.0:
                tracker.committed = self.committed[:, i] = tracker.safe()
        read = self.committed
        after, moved, of = self._stepped(self.kept, self.members, read, values, self._span(time))
        after.sensed.read(true_channels(self.rig, of, moved), of, self.channels, 0.0)
        self.kept, self.kept_time = after, time

    def _span(self, time: float) -> float:
        return SETTINGS.first_span if math.isnan(self.kept_time) else max(time - self.kept_time, 0.0)

    def _set_drives(self, read: Sequence[float]) -> None:
        for tracker, one in zip(self.trackers, read, strict=True):
            tracker.set(one)
        self.committed[:] = read

    def joint_after(self, values: Mapping[str, float], span: float) -> tuple[float, float]:
        """Return the angle of the joint after a move of the drive, and its standard error [rad].

        `values` are the readings, those of the drive as it goes to; nothing is changed; docs/model.md (205).
        """
        count = SETTINGS.members // 2
        read = np.tile([values[name] for name in self.drives], (count, 1))
        span = max(span, SETTINGS.first_span)
        moved = self._stepped(self.now.with_rows(count), self.members[:count], read, values, span)[1]
        joint = moved.coordinate[:, 0]
        return float(joint.mean()), float(joint.std(ddof=1))

    def _with_torque(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """Return what was measured, with the torque of a motor that drives where its current states it."""
        if not self._by_torque or "motor_torque_Nm" in values or "motor_current_A" not in values:
            return values
        return {
            **values,
            "motor_torque_Nm": self.rig.drive.torque_constant_Nm_per_A * values["motor_current_A"],
        }

    def _on_clock(
        self, values: Mapping[str, float], time: float
    ) -> tuple[Mapping[str, float], Matrix | None]:
        """Return what was measured with the drives on the clock of what answers; docs/model.md (178)."""
        if missing := [name for name in self.drives if name not in values]:
            raise SettingsError(f"no {missing[0]}, which drove before: give it in each frame, or begin anew")
        run = {name: np.array([values[name]]) for name in self.drives} | {"time_s": np.array([time])}
        driven, recent = on_clock(run, self.recent, self.drives, self.rig.drive.lag_s)
        return {**values, **{name: float(value[0]) for name, value in driven.items()}}, recent

    def _drive(self, *, exact: bool) -> Matrix:
        """Return what the sensors of the drives read for each member and probe [members + probes, drives]."""
        count, drives = len(self.members), len(self.drives)
        read = np.tile([tracker.position for tracker in self.trackers], (count + PROBES * drives, 1))
        if not exact:
            for i, tracker in enumerate(self.trackers):
                read[count + PROBES * i, i] += tracker.noise
                read[count + PROBES * i + 1, i] -= tracker.noise
        return read

    def _stepped(
        self, start: Standing, numbers: Matrix, read: Matrix, values: Mapping[str, float], span: float
    ) -> tuple[Standing, Moved, MachineNumbers]:
        """Return what a step makes of as many machines as there are numbers; see `step`."""
        step = MachineStep(self.rig, self.drive, self.channels, self.keys, self._lines)
        return step.of(start, numbers, read, values, span, self.trackers[0].way, self.joint)

    def _given(self, values: Mapping[str, float]) -> Vector:
        unused = {*self.muted, *self.drives}
        if self.rig.end.given == "angle":
            unused.add("joint_angle_rad")
        elif "joint_torque_Nm" in values:
            unused.add("joint_torque_Nm")
        return np.array(
            [math.nan if name in unused else values.get(name, math.nan) for name in self.channels]
        )

    def _result(self, taken: Taken) -> FollowedRig:
        mean, spread = mean_and_sd(taken.values)
        c = len(self.channels)
        error = np.hypot(spread[c:], taken.ends_by_drive)
        read = {
            name: (float(mean[i]), math.hypot(spread[i], taken.channels_by_drive[i]))
            for i, name in enumerate(self.channels)
            if math.isfinite(mean[i])
        }
        return FollowedRig(
            self.keys,
            *self._covariance(),
            mean[c : c + 4],
            error[:4],
            taken.innovation[:, 0],
            np.sqrt(taken.innovation[:, 1]),
            taken.beyond,
            read,
        )

    def _lie_on(self, arcs: Arcs) -> None:
        """Move the tendons of all machines to another route: each bar keeps its tension; (218)."""
        if arcs is self.cut:
            return
        before, self.cut = self.machine, arcs
        self._renew_lines()
        for one in (self.kept, self.now):
            for row in one.memory.reshape(len(one.memory), self.count, -1):
                shift_rests(row, before, self.machine)

    def _tensions(self) -> Matrix:
        tendons = self.kept.memory.reshape(len(self.members), self.count, -1)
        ends = tendons[:, :, [0, len(self.machine.edge)]]
        return ends.reshape(len(self.members), -1).T

    def about(self) -> Vector:
        """Return the numbers about which plants are straight lines [d]."""
        return self._lines.about

    def draw_lines(self, about: Vector) -> None:
        """Draw the straight lines about these numbers [d]; docs/model.md (201)."""
        self._lines = machine_lines(self.rig, self.numbers, about, self.cut, self.channels)

    def _renew_lines(self) -> None:
        self.draw_lines(self.values)


def _after(joint: Turning, moved: Moved) -> Turning:
    angle = moved.given_angle
    return joint if angle is None else Turning(float(angle[0]), moved.joint_way, 0.0)

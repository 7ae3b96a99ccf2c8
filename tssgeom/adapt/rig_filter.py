"""The filter that follows a rig: an ensemble of tendons, each with its own numbers and its own history.

Friction is not smooth, so no linear filter carries the tension along a tendon. Here each member is a tendon
that the same drive moves; a reading shifts numbers and tensions of all members together, by what they have
in common with what it reads. Source: docs/model.md (200) to (205); J. S. Whitaker and T. M. Hamill,
Ensemble data assimilation without perturbed observations, Monthly Weather Review 130 (2002).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tssgeom import core
from tssgeom.adapt.ensemble import PROBES, SETTINGS, Ensemble
from tssgeom.adapt.followed import FollowedNumber, straight_lines
from tssgeom.adapt.readings import (
    CHANNELS,
    FollowedRig,
    Readings,
    mean_and_sd,
    noise_variance,
    predicted_readings,
)
from tssgeom.adapt.trailed_drive import TRAIL, TrailedDrive
from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import FitError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import bends_of, edges
from tssgeom.tendon.bars.model import BARS, begin, model_of, setup_of
from tssgeom.tendon.bars.plant import Memory

DRIVES = ("displacement_in_m", "tension_in_N")
"""What may drive: a position, or else the tension."""


@dataclass(slots=True)
class Lying:
    """Where the tendons of the members lie."""

    memory: Matrix
    """[members, ...] What the tendon of each remembers."""
    position: Vector
    """[members] Where the drive of each is [m]."""
    by_force: bool
    """Whether the tension drove it there."""
    time: float
    """[s]"""

    def copied(self) -> Lying:
        """Return the same, to be changed by itself."""
        return Lying(self.memory.copy(), self.position.copy(), self.by_force, self.time)

    def with_rows(self, rows: NDArray[np.int64]) -> Lying:
        """Return those of some members."""
        memory, position = self.memory.take(rows, axis=0), self.position.take(rows)
        return Lying(memory, position, self.by_force, self.time)


_LEAST_SPAN = 1e-9  # of a step from where the members are [s]; derived: some rounding of times


class RigFilter(Ensemble):
    """Follows numbers of a rig of one tendon from frame to frame.

    Parameters
    ----------
    rig
        The rig; its `sensors` state the noise of each channel.
    numbers
        What is followed.
    arcs
        The route of the first frame, on which the tendon is cut.
    seed
        Of the numbers at the start and of the drift.
    memory
        Tension along the tendon before the first frame; by default the rig's pretension.
    """

    def __init__(
        self,
        rig: Rig,
        numbers: Sequence[FollowedNumber],
        arcs: Arcs,
        *,
        seed: int = 0,
        memory: Memory | None = None,
    ) -> None:
        super().__init__(rig, numbers, seed)
        self.cut, self.edge = arcs, edges(arcs, BARS)
        self._lines = straight_lines(rig, numbers, np.array([one.value for one in numbers]), arcs, self.edge)
        self._bends = bends_of(setup_of(rig))
        rest = memory or begin(model_of(setup_of(rig), arcs, "displacement_in_m", self.edge)).memory
        count = len(self.members)
        self.now = Lying(np.tile(rest.block, (count, 1)), np.zeros(count), False, math.nan)
        """Where the members are by now."""
        self.kept = self.now.copied()
        """Where they are behind the drive for sure."""
        self.committed = np.zeros(count)
        """[members] What the sensor of the drive reads there."""
        variances = (noise_variance(rig.sensors.get(name)) for name in CHANNELS)
        self._noise_variance = np.maximum(list(variances), SETTINGS.least_noise**2)
        self.drives = {
            name: TrailedDrive(math.sqrt(noise_variance(rig.sensors.get(name)))) for name in DRIVES
        }
        self._bound()

    def copied(self) -> Self:
        """Return a filter that goes on from here by itself."""
        other = super().copied()
        other.now, other.kept = self.now.copied(), self.kept.copied()
        other.drives = {name: one.copied() for name, one in self.drives.items()}
        return other

    def step(self, arcs: Arcs, readings: Readings, time: float, warmth: float = 0.0) -> FollowedRig:
        """Move the drive of all members, and shift them by what was read.

        Parameters
        ----------
        arcs
            The route.
        readings
            What was measured.
        time
            Time [s], not before that of the last step.
        warmth
            Temperature above that of the first step [K].

        Raises
        ------
        FitError
            Where a member finds no equilibrium; all tendons are then as before.
        """
        if "displacement_in_m" in self.muted:
            readings = readings._replace(displacement_in=None)
        self._drift(SETTINGS.first_span if math.isnan(self.time) else time - self.time)
        exact, frame = self._moved(readings, arcs, time, warmth), (arcs, time, warmth)
        drive, count = self._drive(readings.by_force), len(self.members)
        rows = np.append(np.arange(count), np.zeros(PROBES, dtype=np.int64))
        read = np.full(count + PROBES, drive.position)
        read[count:] += drive.noise, -drive.noise
        numbers = self.members[rows]
        true = self._true(read, numbers, readings)
        after, ends = self._stepped(self.kept.with_rows(rows), numbers, true, readings.by_force, *frame)
        sensors = self._lines.sensors_of(numbers)

        def read_behind(_: int) -> Vector:
            """Return what a member reads whose drive has turned as far as that may not show."""
            back = np.array([drive.position - drive.way * TRAIL.may_turn * drive.noise])
            start = Lying(after[:1], ends[:1, 2], readings.by_force, time)
            there = self._true(back, numbers[:1], readings)
            return predicted_readings(
                self._stepped(start, numbers[:1], there, readings.by_force, *frame)[1],
                self._lines.sensors_of(numbers[:1]),
            )[0]

        both = np.concatenate((self.kept.memory, after[:count]), axis=1)
        taken = self._take_in(
            both,
            predicted_readings(ends, sensors),
            ends,
            self._given(readings),
            [drive],
            read_behind,
            bars=len(self.edge) + 1,
        )
        width = after.shape[1]
        self.kept.memory = both[:, :width]
        self.now = Lying(both[:, width:], ends[:count, 2].copy(), readings.by_force, time)
        self.time = time
        if math.isnan(self.kept.time):
            self.kept.time = time - SETTINGS.first_span
            self.committed[:] = drive.committed
        if exact:
            self._catch_up()
        elif drive.needs_commit():
            self._follow(None, readings, *frame)
        mean, spread = mean_and_sd(taken.values[:, len(CHANNELS) :])
        return FollowedRig(
            self.keys,
            *self._covariance(),
            mean,
            np.hypot(spread, taken.ends_by_drive),
            taken.innovation[:, 0],
            np.sqrt(taken.innovation[:, 1]),
            taken.beyond,
        )

    def ends_after(
        self, arcs: Arcs, span: float, *, displacement_in: float | None, tension_in: float = 0.0
    ) -> tuple[Vector, Vector]:
        """Return both ends after a move of the drive, and their standard errors [4]; nothing is changed.

        A position [m], or else a true tension [N]; docs/model.md (205).
        """
        by_force, rows = displacement_in is None, np.arange(SETTINGS.members // 2)
        drive = np.full(len(rows), tension_in if by_force else displacement_in)
        start, span = self.now.with_rows(rows), max(span, SETTINGS.first_span)
        start.time = 0.0
        return mean_and_sd(self._stepped(start, self.members[rows], drive, by_force, arcs, span, 0.0)[1])

    def drive_value(self, by_force: bool) -> float:
        """Return where the drive is, as it follows from its readings [N] or [m]."""
        return self._drive(by_force).position

    def _given(self, readings: Readings) -> Vector:
        read = (
            None if readings.by_force else readings.tension_in,
            readings.tension_out,
            readings.elongation,
        )
        usable = zip(CHANNELS, read, strict=True)
        return np.array([math.nan if v is None or name in self.muted else v for name, v in usable])

    def _drive(self, by_force: bool) -> TrailedDrive:
        return self.drives[DRIVES[by_force]]

    def _moved(self, readings: Readings, arcs: Arcs, time: float, warmth: float) -> bool:
        """Let the drive take in its reading; return whether that is exact."""
        by_force = readings.by_force
        drive, given = self._drive(by_force), readings.tension_in if by_force else readings.displacement_in
        given = 0.0 if given is None else given
        if by_force != self.now.by_force and not math.isnan(self.time):
            self._catch_up()
            self.drives[DRIVES[by_force]] = drive = TrailedDrive(drive.noise)
        if readings.commanded or drive.noise == 0.0:
            drive.set(given)
            self.committed[:] = given
            return True
        turned = drive.take(given)
        if turned is not None:
            self._follow(turned, readings, arcs, time, warmth)
        return False

    def _catch_up(self) -> None:
        """Keep the members where they are by now."""
        self.kept = self.now.copied()

    def _follow(
        self, turned: float | None, readings: Readings, arcs: Arcs, time: float, warmth: float
    ) -> None:
        """Move what is kept behind the drive, to where that has `turned`; members differ in where."""
        drive = self._drive(readings.by_force)
        if turned is None:
            drive.committed = drive.safe()
            self.committed[:] = drive.committed
        else:
            spread = self._deviations(
                len(self.members), np.array([TRAIL.turn_error * drive.noise]), self._known()
            )
            drive.committed, self.committed = turned, turned + spread[:, 0]
        true = self._true(self.committed, self.members, readings)
        memory, ends = self._stepped(self.kept, self.members, true, readings.by_force, arcs, time, warmth)
        self.kept = Lying(memory, ends[:, 2].copy(), readings.by_force, time)

    def _true(self, read: Vector, numbers: Matrix, readings: Readings) -> Vector:
        """Return where the drive is, [N] or [m], from what its sensor reads for each."""
        if readings.commanded or not readings.by_force:
            return read
        sensors = self._lines.sensors_of(numbers)
        return np.maximum((read - sensors.zero_in) / sensors.gain_in, 0.0)

    def _stepped(
        self,
        start: Lying,
        numbers: Matrix,
        drive: Vector,
        by_force: bool,
        arcs: Arcs,
        time: float,
        warmth: float,
    ) -> tuple[Matrix, Matrix]:
        """Return memories and ends after a step, of as many members (then probes) as there are numbers."""
        span = SETTINGS.first_span if math.isnan(start.time) else max(time - start.time, _LEAST_SPAN)
        lines = self._lines
        done, after, ends = core.step_ensemble(
            self.edge,
            lines.plant,
            lines.slope,
            numbers - lines.about,
            start.memory,
            arcs.length,
            arcs.angle,
            self._gains(numbers),
            self._bends,
            arcs is not self.cut,
            by_force,
            start.by_force,
            start.position,
            drive,
            span,
            warmth,
        )
        if done < len(drive):
            said = ", ".join(f"{key} {value:g}" for key, value in zip(self.keys, numbers[done], strict=True))
            raise FitError(f"there is no equilibrium of the tendon with {said}: take smaller steps")
        return after, ends

    def _gains(self, numbers: Matrix) -> Vector:
        if "route.angle_gain" in self.keys:
            return np.ascontiguousarray(numbers[:, self.keys.index("route.angle_gain")])
        return np.full(len(numbers), self.rig.route.angle_gain)

    def _tensions(self) -> Matrix:
        """[2, members] Tension of each member at both ends [N]."""
        return self.kept.memory[:, [0, len(self.edge)]].T

    def about(self) -> Vector:
        """Return the numbers about which plants are straight lines [d]."""
        return self._lines.about

    def _renew_lines(self) -> None:
        self._bends = bends_of(setup_of(self.rig))
        self._lines = straight_lines(self.rig, self.numbers, self.values, self.cut, self.edge)

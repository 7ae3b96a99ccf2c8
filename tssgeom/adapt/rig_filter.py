"""The filter that follows a rig: an ensemble of tendons, each with its own numbers and its own history.

Friction is not smooth, so no linear filter carries the tension along a tendon. Here each member is a tendon
that the same drive moves; a reading shifts numbers and tensions of all members together, by what they have
in common with what it reads. Source: docs/model.md (200) to (205); J. S. Whitaker and T. M. Hamill,
Ensemble data assimilation without perturbed observations, Monthly Weather Review 130 (2002).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tssgeom import core
from tssgeom.adapt.drive import DriveTracker
from tssgeom.adapt.ensemble import PROBES, SETTINGS, Ensemble
from tssgeom.adapt.followed import FollowedNumber, SensorNumbers, straight_lines
from tssgeom.adapt.readings import (
    CHANNELS,
    FollowedRig,
    Readings,
    mean_and_sd,
    noise_variance,
    predicted_readings,
)
from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import FitError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import bends_of, edges
from tssgeom.tendon.bars.model import BARS, begin, model_of, setup_of
from tssgeom.tendon.bars.plant import Memory

_DISTAL = [1, 3]  # T_out and x_out among the ends


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
        count = len(self.members) + PROBES
        self.memory, self.position = np.tile(rest.block, (count, 1)), np.zeros(count)
        self._by_force, self._distal_error = False, np.zeros((1, len(_DISTAL)))
        variances = (noise_variance(rig.sensors.get(name)) for name in CHANNELS)
        self._noise_variance = np.maximum(list(variances), SETTINGS.least_noise**2)
        self._drives = {
            name: DriveTracker(math.sqrt(noise_variance(rig.sensors.get(name))))
            for name in ("tension_in_N", "displacement_in_m")
        }
        self._bound()

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
        span = SETTINGS.first_span if math.isnan(self.time) else time - self.time
        self._drift(span)
        count, tracker = len(self.members), self._tracker(readings.by_force)
        numbers = np.vstack((self.members, self.members[:1], self.members[:1]))
        self.memory[count:], self.position[count:] = self.memory[0], self.position[0]
        sensors = self._lines.sensors_of(numbers)
        drive = self._drive(readings, sensors)
        after, ends = self._stepped(arcs, numbers, drive, readings.by_force, span, warmth)
        predicted = predicted_readings(ends, sensors)
        taken = self._take_in(
            after,
            predicted,
            ends,
            self._given(readings),
            [tracker],
            bars=len(self.edge) + 1,
            pulls=_DISTAL[:1],
            distal=_DISTAL,
        )
        self.position = ends[:, 2].copy()
        self._by_force, self.time = readings.by_force, time
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
        by_force, numbers = displacement_in is None, self.members[: SETTINGS.members // 2]
        drive = np.full(len(numbers), tension_in if by_force else displacement_in)
        span = max(span, SETTINGS.first_span)
        return mean_and_sd(self._stepped(arcs, numbers, drive, by_force, span, 0.0)[1])

    def drive_value(self, by_force: bool) -> float:
        """Return where the drive is, as it follows from its readings [N] or [m]."""
        return self._tracker(by_force).value

    def _given(self, readings: Readings) -> Vector:
        read = (
            None if readings.by_force else readings.tension_in,
            readings.tension_out,
            readings.elongation,
        )
        usable = zip(CHANNELS, read, strict=True)
        return np.array([math.nan if v is None or name in self.muted else v for name, v in usable])

    def _tracker(self, by_force: bool) -> DriveTracker:
        return self._drives["tension_in_N" if by_force else "displacement_in_m"]

    def _drive(self, readings: Readings, sensors: SensorNumbers) -> Vector:
        """Return the drive of each member and probe, [N] or [m]."""
        by_force, tracker = readings.by_force, self._tracker(readings.by_force)
        given = readings.tension_in if by_force else readings.displacement_in
        if readings.commanded and given is not None:
            return np.full(len(self.memory), given)
        sd = tracker.take(0.0 if given is None else given)
        reading = np.full(len(self.memory), tracker.value)
        reading[-PROBES:] += sd, -sd
        return np.maximum((reading - sensors.zero_in) / sensors.gain_in, 0.0) if by_force else reading

    def _stepped(
        self, arcs: Arcs, numbers: Matrix, drive: Vector, by_force: bool, span: float, warmth: float
    ) -> tuple[Matrix, Matrix]:
        """Return memories and ends after a step, of as many members (then probes) as there are numbers."""
        lines, count = self._lines, len(numbers)
        done, after, ends = core.step_ensemble(
            self.edge,
            lines.plant,
            lines.slope,
            numbers - lines.about,
            self.memory[:count],
            arcs.length,
            arcs.angle,
            self._gains(numbers),
            self._bends,
            arcs is not self.cut,
            by_force,
            self._by_force,
            self.position[:count],
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
        return self.memory[: len(self.members), [0, len(self.edge)]].T

    def about(self) -> Vector:
        """Return the numbers about which plants are straight lines [d]."""
        return self._lines.about

    def _renew_lines(self) -> None:
        self._bends = bends_of(setup_of(self.rig))
        self._lines = straight_lines(self.rig, self.numbers, self.values, self.cut, self.edge)

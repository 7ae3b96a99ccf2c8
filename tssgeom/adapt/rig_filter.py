"""The filter that follows a rig: an ensemble of tendons, each with its own numbers and its own history.

Friction is not smooth, so no linear filter carries the tension along a tendon. Here each member is a tendon
that the same drive moves; a reading shifts numbers and tensions of all members together, by what they have
in common with what it reads. Source: docs/model.md (200) to (205); J. S. Whitaker and T. M. Hamill,
Ensemble data assimilation without perturbed observations, Monthly Weather Review 130 (2002).
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.adapt.drive import DriveTracker
from tssgeom.adapt.followed import FollowedNumber, SensorNumbers, limits_of, straight_lines, with_numbers
from tssgeom.adapt.readings import (
    CHANNELS,
    FollowedRig,
    Readings,
    mean_and_sd,
    noise_variance,
    predicted_readings,
)
from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import CHANCE
from tssgeom.errors import FitError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import bends_of, edges
from tssgeom.tendon.bars.model import BARS, begin, model_of, setup_of
from tssgeom.tendon.bars.plant import Memory

_ENDS = 4  # T_in, T_out, x_in, x_out
_DISTAL = [1, 3]
_PROBES = 2  # tendons that show what an error of the drive does: derived, one either way


class FilterSettings(NamedTuple):
    """Numbers of the filter."""

    members: int = 64
    """Tendons [1]. Chosen: the error of a correlation of two of them is an eighth."""
    commanded: int = 32
    """Of them, those that show what a command does [1]. Chosen: its standard errors are known to an eighth,
    and it takes half of the time."""
    drift_interval: float = 0.05
    """Time between two additions of drift [s]. Chosen: small beside any phase of a motion."""
    bent: float = 0.3
    """Share of its noise by which an error of the drive may bend a reading that is used [1]. Chosen: just
    behind a turn the tension is no straight line over the drive, and its mean would be biased."""
    stands: float = 0.1
    """Share of what an error of the drive did to T_out when it moved last, from which on the distal end moves
    [1]. Chosen: behind a turn the distal bar still moves by a thousandth."""
    straight: float = 2.0
    """Scales of a number after which its straight line is computed anew [1]. Chosen: friction is exact,
    (201)."""
    least_noise: float = 1e-6
    """Noise of a channel that states none [N, m]. Chosen: below every sensor."""
    first_span: float = 1e-2
    """Time that the first step takes [s]; chosen: only effects over time feel it."""


_SETTINGS = FilterSettings()


class RigFilter:
    """Follows numbers of a rig from frame to frame.

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
        self.rig, self.numbers, self.cut = rig, tuple(numbers), arcs
        self.edge = edges(arcs, BARS)
        self._random = np.random.default_rng(seed)
        start = np.array([one.value for one in numbers])
        self._lines = straight_lines(rig, numbers, start, arcs, self.edge)
        self._bends = bends_of(setup_of(rig))
        count = _SETTINGS.members
        self.members = start + self._deviations(count, np.array([one.sd for one in numbers]), [])
        rest = memory or begin(model_of(setup_of(rig), arcs, "displacement_in_m", self.edge)).memory
        self.memory = np.tile(rest.block, (count + _PROBES, 1))
        self.position = np.zeros(count + _PROBES)
        self.time = math.nan
        self.muted = set[str]()
        """Channels whose readings are not used."""
        self.outlier = CHANCE.never
        self._by_force, self._waiting, self._distal_error = False, 0.0, np.zeros(2)
        variances = (noise_variance(rig.sensors.get(name)) for name in CHANNELS)
        self._noise_variance = np.maximum(list(variances), _SETTINGS.least_noise**2)
        self._drives = {
            name: DriveTracker(math.sqrt(noise_variance(rig.sensors.get(name))))
            for name in ("tension_in_N", "displacement_in_m")
        }
        self._bound()

    @property
    def keys(self) -> tuple[str, ...]:
        """What is followed."""
        return tuple(one.key for one in self.numbers)

    @property
    def values(self) -> Vector:
        """[d] The numbers as they are now."""
        return self.members.sum(axis=0) / len(self.members)

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
        span = _SETTINGS.first_span if math.isnan(self.time) else time - self.time
        self._drift(span)
        count, tracker = len(self.members), self._tracker(readings.by_force)
        numbers = np.vstack((self.members, self.members[:1], self.members[:1]))
        self.memory[count:], self.position[count:] = self.memory[0], self.position[0]
        sensors = self._lines.sensors_of(numbers)
        drive = self._drive(readings, sensors)
        after, ends = self._stepped(arcs, numbers, drive, readings.by_force, span, warmth)
        predicted = predicted_readings(ends, sensors)
        by_drive = 0.5 * (predicted[count] - predicted[count + 1])
        ends_by_drive = np.abs(ends[count:] - ends[0]).max(axis=0)
        bent = 0.5 * np.abs(predicted[count] + predicted[count + 1] - 2.0 * predicted[0])
        given = self._given(readings)
        farthest = np.abs(predicted[count:] - predicted[0]).max(axis=0)
        mean, spread = mean_and_sd(predicted[:count])
        beyond = np.abs(given - mean) / np.sqrt(self._noise_variance + spread**2 + farthest**2)
        given[bent > _SETTINGS.bent * np.sqrt(self._noise_variance)] = math.nan
        slides = bool(ends_by_drive[1] > _SETTINGS.stands * self._distal_error[0])
        if not slides:  # what stands has the error of when it moved last
            ends_by_drive[_DISTAL] = self._distal_error
        variance = self._noise_variance + tracker.repeated(slides) * by_drive**2
        whole = np.ascontiguousarray(np.hstack((predicted, ends))[:count])
        _, innovation = core.assimilate(
            1,
            len(self.edge),
            self.members,
            after[:count],
            whole,
            np.concatenate((given, np.full(_ENDS, math.nan))),
            np.concatenate((variance, np.ones(_ENDS))),
            self.outlier,
        )
        self.memory, self.position = after, ends[:, 2].copy()
        self._by_force, self.time, self._distal_error = readings.by_force, time, ends_by_drive[_DISTAL]
        self._bound()
        self._update_lines()
        values = self.values
        deviation = self.members - values
        mean, spread = mean_and_sd(whole[:, len(CHANNELS) :])
        return FollowedRig(
            self.keys,
            values,
            deviation.T @ deviation / (count - 1),
            mean,
            np.hypot(spread, ends_by_drive),
            innovation[: len(CHANNELS), 0],
            np.sqrt(innovation[: len(CHANNELS), 1]),
            beyond,
        )

    def ends_after(
        self, arcs: Arcs, span: float, *, displacement_in: float | None, tension_in: float = 0.0
    ) -> tuple[Vector, Vector]:
        """Return both ends after a move of the drive, and their standard errors [4]; nothing is changed.

        A position [m], or else a true tension [N]; docs/model.md (205).
        """
        by_force, numbers = displacement_in is None, self.members[: _SETTINGS.commanded]
        drive = np.full(len(numbers), tension_in if by_force else displacement_in)
        span = max(span, _SETTINGS.first_span)
        return mean_and_sd(self._stepped(arcs, numbers, drive, by_force, span, 0.0)[1])

    def copied(self) -> RigFilter:
        """Return a filter that goes on from here by itself."""
        other = copy.copy(self)
        other._random = copy.deepcopy(self._random)
        other._drives = {name: copy.copy(drive) for name, drive in self._drives.items()}
        other.members, other.memory = self.members.copy(), self.memory.copy()
        other.position, other.muted = self.position.copy(), set(self.muted)
        return other

    def with_more(self, more: Sequence[FollowedNumber], rig: Rig) -> RigFilter:
        """Return a filter that goes on from here and follows further numbers of a rig too."""
        other = self.copied()
        other.rig, other.numbers = rig, (*self.numbers, *more)
        known = [*self.members.T, *self._tensions()]
        value, sd = np.array([(one.value, one.sd) for one in more]).reshape(-1, 2).T
        other.members = np.hstack((self.members, value + other._deviations(len(self.members), sd, known)))
        other._bends = bends_of(setup_of(other.rig))
        other._bound()
        other._lines = straight_lines(other.rig, other.numbers, other.values, self.cut, self.edge)
        return other

    def reopen(self, sds: Vector) -> None:
        """Let the numbers have at least these standard deviations [d] again: what is known of them is old."""
        now = self.members.std(axis=0, ddof=1)
        missing = np.sqrt(np.maximum(sds**2 - now**2, 0.0))
        known = [*self.members.T, *self._tensions()]
        self.members = self.members + self._deviations(len(self.members), missing, known)
        self._bound()

    def set_numbers(self, values: Mapping[str, float], sds: Mapping[str, float]) -> None:
        """Set some numbers to other values with these standard deviations, uncorrelated with all else."""
        chosen = [i for i, key in enumerate(self.keys) if key in values]
        keys = [self.keys[i] for i in chosen]
        known = [*np.delete(self.members, chosen, axis=1).T, *self._tensions()]
        spread = self._deviations(len(self.members), np.array([sds[key] for key in keys]), known)
        self.members[:, chosen] = np.array([values[key] for key in keys]) + spread
        self._bound()
        self._update_lines()

    def rig_now(self) -> Rig:
        """Return the rig with the followed numbers as they are now."""
        return with_numbers(self.rig, dict(zip(self.keys, self.values.tolist(), strict=True)))

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
        reading[-_PROBES:] += sd, -sd
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

    def _drift(self, span: float) -> None:
        """Add what the numbers change by in a time, uncorrelated with what members differ in; (204)."""
        self._waiting += span
        if self._waiting < _SETTINGS.drift_interval:
            return
        sd = np.array([one.hourly_change for one in self.numbers]) * math.sqrt(self._waiting / 3600.0)
        self._waiting = 0.0
        if sd.any():
            known = [*self.members.T, *self._tensions()]
            self.members = self.members + self._deviations(len(self.members), sd, known)
            self._bound()

    def _tensions(self) -> Matrix:
        """[2, members] Tension of each member at both ends [N]."""
        return self.memory[: len(self.members), [0, len(self.edge)]].T

    def _deviations(self, count: int, sd: Vector, known: Sequence[Vector]) -> Matrix:
        """Return [count, d] deviations of these sizes, uncorrelated in the sample with `known`."""
        basis = np.linalg.qr(np.column_stack([np.ones(count), *known]))[0]
        random = self._random.standard_normal((count, len(sd)))
        random -= basis @ (basis.T @ random)
        return np.linalg.qr(random)[0] * (math.sqrt(count - 1.0) * sd)

    def _bound(self) -> None:
        limits = limits_of(self.numbers)
        np.maximum(self.members, limits.lower, out=self.members)
        np.minimum(self.members, limits.upper, out=self.members)

    def _update_lines(self) -> None:
        """Draw the straight lines about other values where the numbers went far."""
        off = np.abs(self.values - self._lines.about)
        if (off > _SETTINGS.straight * limits_of(self.numbers).scale).any():
            self._lines = straight_lines(self.rig, self.numbers, self.values, self.cut, self.edge)

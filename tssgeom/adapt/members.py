"""Members of an ensemble: the numbers of each, how they drift, and where members stand.

Source: docs/model.md (200), (201), (204), (268).
"""

from __future__ import annotations

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from tssgeom import core
from tssgeom.adapt.drift_rate import DriftRate
from tssgeom.adapt.followed import FollowedNumber, limits_of, with_numbers
from tssgeom.adapt.readings import mean_and_covariance
from tssgeom.adapt.trailed_drive import TrailedDrive
from tssgeom.arrays import Matrix, Vector
from tssgeom.rig import Rig


class FilterSettings(NamedTuple):
    """Numbers of the filter."""

    members: int = 64
    """Tendons [1]. Chosen: the error of a correlation of two of them is an eighth."""
    drift_interval: float = 0.05
    """Time between two additions of drift [s]. Chosen: small beside any phase of a motion."""
    bent: float = 0.3
    """Share of its noise by which an error of the drive may bend a reading that is used [1]. Chosen: just
    behind a turn the tension is no straight line over the drive, and its mean would be biased."""
    straight: float = 2.0
    """Scales of a number after which its straight line is computed anew [1]. Chosen: friction is exact,
    (201)."""
    least_noise: float = 1e-6
    """Noise of a channel that states none [N, m]. Chosen: below every sensor."""
    first_span: float = 1e-2
    """Time that the first step takes [s]; chosen: only effects over time feel it."""


SETTINGS = FilterSettings()
Rows = NDArray[np.int64]
PLAYS = 2
"""First columns of a `block`, which plays keep, before those of lagging sensors."""


@dataclass(slots=True)
class Standing:
    """Where members stand."""

    memory: Matrix
    """[members, …] What the tendons of each remember."""
    coordinate: Matrix
    """[members, m] Coordinates of the end of a machine; none of one tendon."""
    block: Matrix
    """[members, …] What plays and lagging sensors keep."""
    position: Vector
    """[members] Where the drive of one tendon is [m]; 0 of a machine."""
    by_force: bool
    """Whether the tension drove one tendon there."""
    time: float
    """[s]"""

    def first(self, count: int) -> Standing:
        """Return those of the first members, in the same arrays."""
        return Standing(
            self.memory[:count],
            self.coordinate[:count],
            self.block[:count],
            self.position[:count],
            self.by_force,
            self.time,
        )

    def copied(self) -> Standing:
        """Return the same, to be changed by itself."""
        return replace(
            self,
            memory=self.memory.copy(),
            coordinate=self.coordinate.copy(),
            block=self.block.copy(),
            position=self.position.copy(),
        )


class Members(ABC):
    """Members of an ensemble, each with its own numbers.

    Parameters
    ----------
    rig
        The rig.
    numbers
        What is followed.
    seed
        Of the numbers at the start and of the drift.
    """

    def __init__(self, rig: Rig, numbers: Sequence[FollowedNumber], seed: int) -> None:
        self.rig, self.numbers = rig, tuple(numbers)
        self.random = np.random.default_rng(seed)
        sd = np.array([one.sd for one in numbers])
        self.members = np.array([one.value for one in numbers]) + self._deviations(
            sd, np.empty((SETTINGS.members, 0))
        )
        self._bound()
        self.time = math.nan
        self.drift = DriftRate(_stated(numbers))
        self._of_sensors = np.array([one.of_sensor for one in numbers], dtype=bool)
        self.waiting = 0.0
        self.draw_lines(np.array([one.value for one in numbers]))

    @property
    def keys(self) -> tuple[str, ...]:
        """What is followed."""
        return tuple(one.key for one in self.numbers)

    @property
    def values(self) -> Vector:
        """[d] Mean of the numbers of the members."""
        return self.members.sum(axis=0) / len(self.members)

    def estimate(self, values: Vector, covariance: Matrix) -> tuple[Vector, Matrix]:
        """Return the numbers [d] and their covariance [d, d], from mean and covariance of the members."""
        values, covariance = self.drift.estimate(values, covariance)
        return np.clip(values, self._limits.lower, self._limits.upper), covariance

    def rig_now(self) -> Rig:
        """Return the rig with the followed numbers as they are now."""
        values, _ = self.estimate(*mean_and_covariance(self.members))
        return with_numbers(self.rig, dict(zip(self.keys, values.tolist(), strict=True)))

    def copied(self) -> Self:
        """Return a filter that goes on from here by itself."""
        other = copy.copy(self)
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray | set | np.random.Generator | DriftRate):
                setattr(other, name, copy.deepcopy(value))
        return other

    def with_more(self, more: Sequence[FollowedNumber], rig: Rig) -> Self:
        """Return a filter that goes on from here and follows further numbers of a rig too."""
        other = self.copied()
        other.rig, other.numbers = rig, (*self.numbers, *more)
        value, sd = np.array([(one.value, one.sd) for one in more]).reshape(-1, 2).T
        spread = other._deviations(sd, self._known())
        other.members = np.hstack((self.members, value + spread))
        other.drift = self.drift.with_more(_stated(more))
        other._of_sensors = np.array([one.of_sensor for one in other.numbers], dtype=bool)
        other._bound()
        other.draw_lines(other.values)
        return other

    def reopen(self, sds: Vector) -> None:
        """Let the numbers have at least these standard deviations [d] again: what is known of them is old."""
        now = self.members.std(axis=0, ddof=1)
        missing = np.sqrt(np.maximum(sds**2 - now**2, 0.0))
        self.members = self.members + self._deviations(missing, self._known())
        self.drift.restart()
        self._bound()

    def set_numbers(self, values: Mapping[str, float], sds: Mapping[str, float]) -> None:
        """Set some numbers to other values with these standard deviations, uncorrelated with all else."""
        chosen = [i for i, key in enumerate(self.keys) if key in values]
        keys = [self.keys[i] for i in chosen]
        known = np.hstack((np.delete(self.members, chosen, axis=1), self._tensions()))
        spread = self._deviations(np.array([sds[key] for key in keys]), known)
        self.members[:, chosen] = np.array([values[key] for key in keys]) + spread
        self.drift.restart()
        self._bound()
        self._update_lines(self.values)

    def _known(self) -> Matrix:
        return np.concatenate((self.members, self._tensions()), axis=1)

    def draw_lines(self, about: Vector) -> None:
        """Draw the straight lines about these numbers [d]; docs/model.md (201)."""
        self.about, self._limits = about, limits_of(self.numbers)
        self._reach = SETTINGS.straight * self._limits.scale
        self._draw_lines()

    @abstractmethod
    def _draw_lines(self) -> None:
        """Draw them about the numbers `about`."""

    @abstractmethod
    def _tensions(self) -> Matrix:
        """Return the tension of each member at the ends of its tendons [members, ends] [N]."""

    def _update_lines(self, values: Vector) -> None:
        """Draw the straight lines about other values [d] where the numbers went far."""
        if (np.abs(values - self.about) > self._reach).any():
            self.draw_lines(values)

    def _drift(self, span: float, drives: Sequence[TrailedDrive]) -> None:
        """Add what the numbers change by, uncorrelated with what members differ in; (204), (269).

        What acts where the tendon slides shows itself there: while all drives stand, its drift waits.
        """
        self.waiting += span
        self.drift.wait(span)
        if self.waiting < SETTINGS.drift_interval:
            return
        self.waiting = 0.0
        moved = sum(one.has_moved() for one in drives) > 0  # each of them has to note that
        sd = self.drift.take(self._of_sensors | moved, self.members)
        if sd.any():
            self.members = self.members + self._deviations(sd, self._known())
            self._bound()

    def _deviations(self, sd: Vector, known: Matrix) -> Matrix:
        """Return [members, d] deviations of these sizes, uncorrelated in the sample with `known`."""
        return sd * core.deviations(self.random.standard_normal((len(known), len(sd))), known)

    def _bound(self) -> None:
        limits = limits_of(self.numbers)
        np.maximum(self.members, limits.lower, out=self.members)
        np.minimum(self.members, limits.upper, out=self.members)


def _stated(numbers: Sequence[FollowedNumber]) -> Vector:
    return np.array([one.hourly_change for one in numbers]) ** 2 / 3600.0

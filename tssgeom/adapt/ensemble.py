"""What filters of a rig share: members with numbers of their own, which readings shift all together.

Source: docs/model.md (200) to (205); J. S. Whitaker and T. M. Hamill, Ensemble data assimilation without
perturbed observations, Monthly Weather Review 130 (2002).
"""

from __future__ import annotations

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from tssgeom import core
from tssgeom.adapt.drift_rate import DriftRate
from tssgeom.adapt.followed import FollowedNumber, limits_of, with_numbers
from tssgeom.adapt.readings import FollowedRig, mean_and_sd, mean_and_variance
from tssgeom.adapt.trailed_drive import TrailedDrive
from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import CHANCE
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs


class FilterSettings(NamedTuple):
    """Numbers of the filter."""

    members: int = 64
    """Tendons [1]. Chosen: the error of a correlation of two of them is an eighth."""
    drift_interval: float = 0.05
    """Time between two additions of drift [s]. Chosen: small beside any phase of a motion."""
    bent: float = 0.3
    """Share of its noise by which an error of the drive may bend a reading that is used [1]. Chosen: just
    behind a turn the tension is no straight line over the drive, and its mean would be biased."""
    felt: float = 0.01
    """Share of its noise by which a drive has to move a reading that shows its turn [1]; chosen: less is
    rounding."""
    straight: float = 2.0
    """Scales of a number after which its straight line is computed anew [1]. Chosen: friction is exact,
    (201)."""
    least_noise: float = 1e-6
    """Noise of a channel that states none [N, m]. Chosen: below every sensor."""
    first_span: float = 1e-2
    """Time that the first step takes [s]; chosen: only effects over time feel it."""


SETTINGS = FilterSettings()
PROBES = 2
"""Members for each drive that show what an error of it does [1]; derived: one either way."""


class Taken(NamedTuple):
    """What readings have made of the members."""

    values: Matrix
    """[members, c + e] What each channel should read, and the ends."""
    channels_by_drive: Vector
    """[c] What errors of the drives do to the channels."""
    ends_by_drive: Vector
    """[e] The same of the ends."""
    innovation: Matrix
    """[c, 2] Readings less what was expected, and the variance of that."""
    beyond: Vector
    """[c] As in `FollowedRig`."""


class Ensemble(ABC):
    """Members of a filter, each with its own numbers.

    Parameters
    ----------
    rig
        The rig; its `sensors` state the noise of each channel.
    numbers
        What is followed.
    seed
        Of the numbers at the start and of the drift.
    """

    def __init__(self, rig: Rig, numbers: Sequence[FollowedNumber], seed: int) -> None:
        self.rig, self.numbers = rig, tuple(numbers)
        self.random = np.random.default_rng(seed)
        sd = np.array([one.sd for one in numbers])
        self.members = np.array([one.value for one in numbers]) + self._deviations(SETTINGS.members, sd, [])
        self.time = math.nan
        self.drift = DriftRate(_stated(numbers))
        self.cut: Arcs
        """The route on which the tendons were cut."""
        self.muted = set[str]()
        """Channels whose readings are not used."""
        self.outlier = CHANCE.never
        self.waiting = 0.0
        self._noise_variance: Vector = np.empty(0)

    @property
    def keys(self) -> tuple[str, ...]:
        """What is followed."""
        return tuple(one.key for one in self.numbers)

    @property
    def values(self) -> Vector:
        """[d] The numbers as they are now."""
        return self.members.sum(axis=0) / len(self.members)

    def rig_now(self) -> Rig:
        """Return the rig with the followed numbers as they are now."""
        return with_numbers(self.rig, dict(zip(self.keys, self.values.tolist(), strict=True)))

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
        spread = other._deviations(len(self.members), sd, self._known())
        other.members = np.hstack((self.members, value + spread))
        other.drift = self.drift.with_more(_stated(more))
        other._bound()
        other._renew_lines()
        return other

    def reopen(self, sds: Vector) -> None:
        """Let the numbers have at least these standard deviations [d] again: what is known of them is old."""
        now = self.members.std(axis=0, ddof=1)
        missing = np.sqrt(np.maximum(sds**2 - now**2, 0.0))
        self.members = self.members + self._deviations(len(self.members), missing, self._known())
        self.drift.restart()
        self._bound()

    def set_numbers(self, values: Mapping[str, float], sds: Mapping[str, float]) -> None:
        """Set some numbers to other values with these standard deviations, uncorrelated with all else."""
        chosen = [i for i, key in enumerate(self.keys) if key in values]
        keys = [self.keys[i] for i in chosen]
        known = [*np.delete(self.members, chosen, axis=1).T, *self._tensions()]
        spread = self._deviations(len(self.members), np.array([sds[key] for key in keys]), known)
        self.members[:, chosen] = np.array([values[key] for key in keys]) + spread
        self.drift.restart()
        self._bound()
        self._update_lines()

    @abstractmethod
    def step(self, arcs: Arcs, readings: Any, time: float, warmth: float = 0.0) -> FollowedRig:
        """Move the drives of all members, and shift them by what was read; as the filters have it."""

    @abstractmethod
    def _tensions(self) -> Matrix:
        """Return the tension of each member at the ends of its tendons [ends, members] [N]."""

    @abstractmethod
    def _renew_lines(self) -> None:
        """Draw the straight lines about the numbers as they are now; docs/model.md (201)."""

    @abstractmethod
    def about(self) -> Vector:
        """Return the numbers about which plants are straight lines [d]."""

    def _known(self) -> list[Vector]:
        return [*self.members.T, *self._tensions()]

    def _update_lines(self) -> None:
        """Draw the straight lines about other values where the numbers went far."""
        off = np.abs(self.values - self.about())
        if (off > SETTINGS.straight * limits_of(self.numbers).scale).any():
            self._renew_lines()

    def _take_in(
        self,
        after: Matrix,
        predicted: Matrix,
        ends: Matrix,
        given: Vector,
        drives: Sequence[TrailedDrive],
        read_behind: Callable[[int], Vector],
        *,
        bars: int,
    ) -> Taken:
        """Shift numbers and memories by what was read; docs/model.md (203), (251).

        Parameters
        ----------
        after
            [members, ...] What readings shift of what the members remember.
        predicted, ends
            What each channel should read [members + probes, c], and all else that a reading shifts.
        given
            [c] What was read; NaN is nothing.
        drives
            The drives.
        read_behind
            What each channel should read of a member whose drive of this number has turned [c].
        bars
            Of each tendon.
        """
        count, pairs = len(self.members), (len(drives), PROBES, -1)
        probes = predicted[count:].reshape(pairs) - predicted[0]
        ends_by_drive = 0.5 * np.abs(np.diff(ends[count:].reshape(pairs), axis=1))[:, 0]
        by_drive = 0.5 * (probes[:, 0] - probes[:, 1])
        bent = 0.5 * np.abs(probes.sum(axis=1)).max(axis=0)
        farthest = np.abs(probes).max(axis=1)
        mean, spread = mean_and_sd(predicted[:count])
        off = given - mean - np.array([one.off for one in drives]) @ by_drive
        variance = self._noise_variance + (by_drive**2).sum(axis=0)
        self._weigh(drives, off / np.sqrt(variance + spread**2), by_drive)
        for i, one in enumerate(drives):
            if one.turn_probability > 0.5:
                farthest[i] = np.maximum(farthest[i], np.abs(read_behind(i) - predicted[0]))
        most = self._noise_variance + spread**2 + (farthest**2).sum(axis=0)
        beyond = np.abs(given - mean) / np.sqrt(most)
        if any(one.may_have_turned for one in drives):
            off = np.full(len(off), math.nan)
        off[bent > SETTINGS.bent * np.sqrt(self._noise_variance)] = math.nan
        whole = np.ascontiguousarray(np.hstack((predicted, ends))[:count])
        _, innovation = core.assimilate(
            after.shape[1] // (9 * bars + 7),
            bars - 1,
            self.members,
            after,
            whole,
            np.concatenate((mean + off, np.full(ends.shape[1], math.nan))),
            np.concatenate((variance, np.ones(ends.shape[1]))),
            self.outlier,
        )
        self._bound()
        self._update_lines()
        share = np.array([one.share for one in drives])
        channels, moved = (
            np.sqrt(((share[:, None] * each) ** 2).sum(axis=0)) for each in (by_drive, ends_by_drive)
        )
        return Taken(whole, channels, moved, innovation[: len(given)], beyond)

    def _weigh(self, drives: Sequence[TrailedDrive], off: Vector, by_drive: Matrix) -> None:
        """Let each drive take in the reading that is most as if it had turned; docs/model.md (252)."""
        for one, does in zip(drives, by_drive, strict=True):
            signed = one.way * np.sign(does) * off
            felt = np.abs(does) > SETTINGS.felt * np.sqrt(self._noise_variance)
            signed = signed[felt & np.isfinite(signed)]
            one.weigh(float(signed.min()) if len(signed) else math.nan)

    def _covariance(self) -> tuple[Vector, Matrix]:
        """Return the numbers as they are now [d], and their covariance [d, d]."""
        values = self.values
        deviation = self.members - values
        return values, deviation.T @ deviation / (len(self.members) - 1)

    def _drift(self, span: float) -> None:
        """Add what the numbers change by, uncorrelated with what members differ in; (204), (253)."""
        self.waiting += span
        if self.waiting < SETTINGS.drift_interval:
            return
        if not math.isnan(self.time):
            self.drift.take(self.time, *mean_and_variance(self.members))
        sd = np.sqrt(self.drift.variance * self.waiting)
        self.waiting = 0.0
        if sd.any():
            self.members = self.members + self._deviations(len(self.members), sd, self._known())
            self._bound()

    def _deviations(self, count: int, sd: Vector, known: Sequence[Vector]) -> Matrix:
        """Return [count, d] deviations of these sizes, uncorrelated in the sample with `known`."""
        basis = np.linalg.qr(np.column_stack([np.ones(count), *known]))[0]
        random = self.random.standard_normal((count, len(sd)))
        random -= basis @ (basis.T @ random)
        return np.linalg.qr(random)[0] * (math.sqrt(count - 1.0) * sd)

    def _bound(self) -> None:
        limits = limits_of(self.numbers)
        np.maximum(self.members, limits.lower, out=self.members)
        np.minimum(self.members, limits.upper, out=self.members)


def _stated(numbers: Sequence[FollowedNumber]) -> Vector:
    return np.array([one.hourly_change for one in numbers]) ** 2 / 3600.0

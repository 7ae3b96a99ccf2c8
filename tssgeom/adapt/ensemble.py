"""The filter that follows a rig: members with histories of their own, shifted by readings.

Friction is not smooth, so no linear filter carries the tension along a tendon. Here the same drives move all
members; a reading shifts their numbers and tensions by what they have in common with what it reads. What a
member is, `rig_filter.py` has of one tendon and `machine_filter.py` of a machine. Source: docs/model.md (200)
to (205); J. S. Whitaker and T. M. Hamill, Ensemble data assimilation without perturbed observations, Monthly
Weather Review 130 (2002).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from tssgeom import core
from tssgeom.adapt.followed import FollowedNumber
from tssgeom.adapt.members import PLAYS, SETTINGS, Members, Standing
from tssgeom.adapt.readings import FollowedRig, Moment, mean_and_sd, noise_variance
from tssgeom.adapt.trailed_drive import TRAIL, TrailedDrive
from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import CHANCE
from tssgeom.errors import FitError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs

PROBES = 2
"""Members for each drive that show what an error of it does [1]; derived: one either way."""


class Stepped(NamedTuple):
    """What a step makes of members."""

    standing: Standing
    read: Matrix
    """[members, c] What each channel should read."""
    ends: Matrix
    """[members, 4 n] T_in, T_out [N], x_in, x_out [m] of each tendon."""
    joint: Any = None
    """Of a machine whose joint is given: where it is."""


class Taken(NamedTuple):
    """What readings have made of the members."""

    values: Matrix
    """[members, c + e] What each channel should read, and the ends and all else that is shifted."""
    channels_by_drive: Vector
    """[c] What errors of the drives do to the channels."""
    ends_by_drive: Vector
    """[e] The same of the ends."""
    innovation: Matrix
    """[c, 2] Readings less what was expected, and the variance of that."""
    beyond: Vector
    """[c] As in `FollowedRig`."""


class Ensemble(Members):
    """Follows numbers of a rig from frame to frame.

    Parameters
    ----------
    rig
        The rig; its `sensors` state the noise of each channel.
    numbers
        What is followed.
    arcs
        The route of the first frame, on which the tendons are cut.
    channels
        What is read, drives too where they are among them.
    drives
        Channels that may drive.
    seed
        Of the numbers at the start and of the drift.
    """

    of_machines: ClassVar[bool]
    """Whether members are machines: a command of theirs is probed with no noise, they draw random numbers at
    each move of what is kept, and their channels are stated."""

    def __init__(
        self,
        rig: Rig,
        numbers: Sequence[FollowedNumber],
        arcs: Arcs,
        channels: Sequence[str],
        drives: Sequence[str],
        seed: int,
    ) -> None:
        self.cut, self.channels, self.drives = arcs, tuple(channels), tuple(drives)
        """The route on which the tendons were cut, what is read, and what drives."""
        variances = {name: noise_variance(rig.sensors.get(name)) for name in (*channels, *drives)}
        self._noise_variance = np.maximum([variances[one] for one in channels], SETTINGS.least_noise**2)
        self.trackers = {name: TrailedDrive(math.sqrt(variances[name])) for name in drives}
        self.muted = set[str]()
        """Channels whose readings are not used."""
        self.outlier = CHANCE.never
        self.count: int
        """Number of tendons, n."""
        self.edge: Vector
        """Where their bars are cut."""
        super().__init__(rig, numbers, seed)

    def stand(self, at: Standing) -> None:
        """Let the members stand somewhere."""
        self.kept, self.now = at, at.copied()
        """Where they are behind the drives for sure, and where they are by now."""
        self.committed = np.zeros((len(self.members), len(self.drives)))
        """[members, drives] What the sensors of the drives read where the members are kept."""

    def copied(self) -> Self:
        """Return a filter that goes on from here by itself."""
        other = super().copied()
        other.kept, other.now = self.kept.copied(), self.now.copied()
        other.trackers = {name: one.copied() for name, one in self.trackers.items()}
        return other

    def step(self, at: Moment) -> FollowedRig:
        """Move the drives of all members, and shift them by what was read at a time not before the last.

        Raises
        ------
        SettingsError
            Where a drive is missing.
        FitError
            Where a member finds no equilibrium; all tendons are then as before.
        """
        self._lie_on(at.arcs)
        passed = math.nan if math.isnan(self.time) else at.time - self.time
        self._drift(SETTINGS.first_span if math.isnan(passed) else passed, self._driving)
        at, driven = self._used(at)
        drives = self._driving
        exact = at.readings.commanded or not any(one.noise for one in drives)
        if exact:
            for one, value in zip(drives, driven, strict=True):
                one.set(value)
            self.committed[:] = driven
        else:
            turned = [one.take(value) for one, value in zip(drives, driven, strict=True)]
            if any(one is not None for one in turned):
                self._follow(turned, at)
        count, probes = len(self.members), PROBES * len(drives)
        rows = np.append(np.arange(count), np.zeros(probes, dtype=np.int64))
        start, numbers = self.kept.with_rows(rows), self.members[rows]
        if start.block.shape[1] > PLAYS:
            start.block[:, PLAYS:] = self.now.block[rows, PLAYS:]
        read = np.full((count + probes, len(drives)), [one.position for one in drives])
        if not (exact and self.of_machines):
            for i, one in enumerate(drives):
                read[count + PROBES * i : count + PROBES * (i + 1), i] += one.noise, -one.noise
        after = self._stepped(start, numbers, read, at, self._span(at), 0.0 if math.isnan(passed) else passed)

        def read_behind(drive: int) -> Vector:
            """Return what a member reads one of whose drives has turned as far as that may not show."""
            one, back = drives[drive], read[:1].copy()
            back[0, drive] -= one.way * TRAIL.may_turn * one.noise
            first = after.standing.with_rows(rows[:1])
            return self._stepped(first, numbers[:1], back, at, 0.0, 0.0).read[0]

        taken = self._shifted(start, after, at, read_behind)
        self._passed(after, at)
        self.time = at.time
        if math.isnan(self.kept.time):
            self.kept.time = at.time - SETTINGS.first_span
            self.committed[:] = [one.committed for one in drives]
        if exact:
            self.kept = self.now.copied()
        elif any(one.needs_commit() for one in drives):
            self._follow([None] * len(drives), at)
        return self._result(taken)

    @property
    def _driving(self) -> list[TrailedDrive]:
        return [self.trackers[name] for name in self.drives]

    def _span(self, at: Moment) -> float:
        before = self.kept.time
        return SETTINGS.first_span if math.isnan(before) else max(at.time - before, 0.0)

    def _shifted(
        self, start: Standing, after: Stepped, at: Moment, read_behind: Callable[[int], Vector]
    ) -> Taken:
        """Let what was read shift numbers, and where the members stand and are."""
        count, there, kept = len(self.members), after.standing, self.kept
        both = np.concatenate((kept.memory, there.memory[:count]), axis=1)
        parts = (after.ends, there.coordinate, there.block, start.coordinate, start.block)
        others = np.concatenate(parts, axis=1)
        taken = self._take_in(both, after.read, others, self._given(at), read_behind)
        stop, columns = len(self.channels), list[Matrix]()
        for one in parts:
            columns.append(taken.values[:, stop : stop + one.shape[1]])
            stop += one.shape[1]
        _, coordinate, block, kept.coordinate, kept.block = columns
        width = kept.memory.shape[1]
        kept.memory, memory = both[:, :width], both[:, width:]
        self.now = Standing(memory, coordinate, block, there.position[:count], there.by_force, at.time)
        return taken

    def _follow(self, turned: Sequence[float | None], at: Moment) -> None:
        """Move what is kept behind the drives, to where one has `turned`; members differ in where."""
        spread = np.zeros_like(self.committed)
        if self.of_machines or turned.count(None) < len(turned):
            sd = np.array([TRAIL.turn_error * one.noise for one in self._driving])
            spread = self._deviations(len(self.members), sd, self._known())
        for i, (drive, one) in enumerate(zip(self._driving, turned, strict=True)):
            if one is not None:
                drive.committed, self.committed[:, i] = one, one + spread[:, i]
            elif drive.way * (drive.safe() - drive.committed) > 0.0:
                drive.committed = self.committed[:, i] = drive.safe()
        self.kept = self._stepped(self.kept, self.members, self.committed, at, self._span(at), 0.0).standing

    def _result(self, taken: Taken) -> FollowedRig:
        mean, spread = mean_and_sd(taken.values)
        c = len(self.channels)
        read = {
            name: (float(mean[i]), math.hypot(spread[i], taken.channels_by_drive[i]))
            for i, name in enumerate(self.channels if self.of_machines else ())
            if math.isfinite(mean[i])
        }
        return FollowedRig(
            self.keys,
            *self._covariance(),
            mean[c : c + 4],
            np.hypot(spread[c : c + 4], taken.ends_by_drive[:4]),
            taken.innovation[:, 0],
            np.sqrt(taken.innovation[:, 1]),
            taken.beyond,
            read,
        )

    @abstractmethod
    def _used(self, at: Moment) -> tuple[Moment, list[float]]:
        """Return what is used of a moment, and what its sensors read of the drives."""

    @abstractmethod
    def _stepped(
        self, start: Standing, numbers: Matrix, read: Matrix, at: Moment, span: float, passed: float
    ) -> Stepped:
        """Return what a step makes of as many members (then probes) as there are numbers.

        Parameters
        ----------
        start
            Where they stand before it.
        numbers
            [members, d] What is followed.
        read
            [members, drives] What the sensors of the drives read.
        at
            What was measured.
        span, passed
            How long it takes, and how long it is since lagging sensors read last [s].

        Raises
        ------
        FitError
            Where one finds no equilibrium.
        """

    @abstractmethod
    def _given(self, at: Moment) -> Vector:
        """Return what was read of each channel [c]; NaN is nothing that is used."""

    def _lie_on(self, arcs: Arcs) -> None:
        """Move the tendons to another route before a step."""

    def _passed(self, after: Stepped, at: Moment) -> None:
        """Keep what else is known after a moment."""

    def _tensions(self) -> Matrix:
        """Return the tension of each member at the ends of its tendons [ends, members] [N]."""
        tendons = self.kept.memory.reshape(len(self.members), self.count, -1)
        return tendons[:, :, [0, len(self.edge)]].reshape(len(self.members), -1).T

    def _require_all(self, done: int, numbers: Matrix, what: str) -> None:
        """Refuse a step in which not all members were done."""
        if done < len(numbers):
            said = ", ".join(f"{key} {value:g}" for key, value in zip(self.keys, numbers[done], strict=True))
            raise FitError(f"there is no equilibrium of the {what} with {said}: take smaller steps")

    def _take_in(
        self,
        after: Matrix,
        predicted: Matrix,
        ends: Matrix,
        given: Vector,
        read_behind: Callable[[int], Vector],
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
        read_behind
            What each channel should read of a member whose drive of this number has turned [c].
        """
        drives = self._driving
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
        whole = np.concatenate((predicted[:count], ends[:count]), axis=1)
        _, innovation = core.assimilate(
            2 * self.count,
            len(self.edge),
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

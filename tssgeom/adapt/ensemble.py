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
from collections.abc import Sequence
from functools import lru_cache
from typing import ClassVar, Self

import numpy as np

from tssgeom import core
from tssgeom.adapt.drive_path import DrivePath
from tssgeom.adapt.followed import FollowedNumber
from tssgeom.adapt.members import PLAYS, SETTINGS, Members, Rows, Standing
from tssgeom.adapt.readings import FollowedRig, Moment, noise_variance
from tssgeom.adapt.stepped import PROBES, Compared, Stepped, Taken, compare, compare_turned, with_probes
from tssgeom.adapt.trailed_drive import TRAIL, TrailedDrive, Turn
from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import CHANCE
from tssgeom.errors import FitError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs


@lru_cache(maxsize=8)
def _rows_with_probes(count: int, drives: int) -> Rows:
    """Return the rows of so many members, and then of those that show what errors of the drives do."""
    rows = np.append(np.arange(count), np.zeros(PROBES * drives, dtype=np.int64))
    rows.setflags(write=False)
    return rows


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
        self.is_history_known = False
        """Whether the members have the tendons' history before the first frame; else they came from rest, and
        how is not known: docs/model.md (274)."""
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
        self.path: DrivePath | None = None
        """Where the drives go, of several, while one may have turned."""

    def copied(self) -> Self:
        """Return a filter that goes on from here by itself."""
        other = super().copied()
        other.kept, other.now = self.kept.copied(), self.now.copied()
        other.path = None if self.path is None else self.path.copied()
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
        if math.isnan(self.time) and not (self.is_history_known or at.readings.commanded):
            self._arrive(driven, at)
        exact = at.readings.commanded or not any(one.noise for one in drives)
        if exact:
            for one, value in zip(drives, driven, strict=True):
                one.set(value)
            self.committed[:] = driven
        else:
            turned = [one.take(value) for one, value in zip(drives, driven, strict=True)]
            if self.path is not None:
                self.path.take(drives)
            if any(turned):
                self._follow(turned, at)
        count, start = len(self.members), self.kept
        rows = _rows_with_probes(count, len(drives))
        if start.block.shape[1] > PLAYS:
            start.block[:, PLAYS:] = self.now.block[:, PLAYS:]
        is_known = exact and self.of_machines
        errors = [0.0 if is_known else one.noise for one in drives]
        read = with_probes(count, [one.position for one in drives], errors)
        after = self._stepped(start, rows, read, at, self._span(at), 0.0 if math.isnan(passed) else passed)
        there = after.standing.first(count)

        def read_behind(drive: int) -> Vector:
            """Return what a member reads one of whose drives has turned as far as that may not show."""
            one, back = drives[drive], read[:1].copy()
            back[0, drive] -= one.way * TRAIL.may_turn * one.noise
            return self._stepped(there, rows[:1], back, at, 0.0, 0.0).read[0]

        compared = compare(after, self._given(at), drives, self._noise_variance, read_behind)
        if any(one.may_have_turned for one in drives):
            after, compared = self._turned(after, compared, rows, at)
            there = after.standing.first(count)
        taken = self._shifted(there, after, compared)
        self._passed(after, at)
        self.time = at.time
        if math.isnan(self.kept.time):
            self.kept.time = at.time - SETTINGS.first_span
            self.committed[:] = [one.committed for one in drives]
        if not any(one.is_behind for one in drives) or (self.path is not None and self.path.is_full):
            self.path = None
        elif self.path is None and len(drives) > 1:
            self.path = DrivePath(self.kept.copied(), self.committed.copy(), drives)
        if exact:
            self.kept = self.now.copied()
        elif any(one.needs_commit() for one in drives):
            self._follow([None] * len(drives), at)
        return self._result(taken)

    def _arrive(self, driven: Sequence[float], at: Moment) -> None:
        """Let each member come to the first frame from rest by turns of its own; docs/model.md (274)."""
        count, drives = len(self.members), len(driven)
        noise = np.array([one.noise for one in self._driving])
        further = np.array(driven) - self._at_rest()
        further[np.abs(further) <= CHANCE.never * noise] = 0.0
        if not further.any():
            return
        up, down = further * np.maximum(self.random.uniform(-1.0, 1.0, (2, count, 1)), 0.0) ** 3  # (274)
        there = driven + noise * self.random.standard_normal((count, drives))
        begun, rows = self.kept, _rows_with_probes(count, 0)
        try:
            for read in (driven + up, driven - down, there):
                begun = self._stepped(begun, rows, read, at, SETTINGS.first_span, 0.0).standing
        except FitError:  # a machine that does not go so far
            return
        self.kept, self.committed = begun, there

    @property
    def _driving(self) -> list[TrailedDrive]:
        return [self.trackers[name] for name in self.drives]

    def _span(self, at: Moment) -> float:
        before = self.kept.time
        return SETTINGS.first_span if math.isnan(before) else max(at.time - before, 0.0)

    def _turned(self, held: Stepped, compared: Compared, rows: Rows, at: Moment) -> tuple[Stepped, Compared]:
        """Let drives that may have turned go back to where they are by now; docs/model.md (306)."""
        behind = [one.behind() if one.may_have_turned else 0.0 for one in self._driving]
        drives = list(zip(self._driving, behind, strict=True))
        read = with_probes(
            len(self.members),
            [one.position - one.way * back for one, back in drives],
            [one.noise if back else 0.0 for one, back in drives],
        )
        after = self._stepped(held.standing.first(len(self.members)), rows, read, at, 0.0, 0.0)
        return after, compare_turned(compared, held, after, drives, self._noise_variance)

    def _shifted(self, there: Standing, after: Stepped, compared: Compared) -> Taken:
        """Let what was read shift numbers, and where the members stand and are."""
        count, kept, shifted = len(self.members), self.kept, after.ends[: len(self.members)]
        others = (there.coordinate, there.block, kept.coordinate, kept.block)
        if sum(one.shape[1] for one in others):
            shifted = np.concatenate((shifted, *others), axis=1)
        _, innovation, values, covariance, expected, moments = core.assimilate(
            self.count,
            len(self.edge),
            self.members,
            kept.memory,
            there.memory,
            after.read[:count],
            shifted,
            compared.reading,
            compared.variance,
            self.outlier,
            self._limits.lower,
            self._limits.upper,
        )
        stop, columns = after.ends.shape[1], list[Matrix]()
        for one in others:
            columns.append(shifted[:, stop : stop + one.shape[1]])
            stop += one.shape[1]
        there.coordinate, there.block, kept.coordinate, kept.block = columns
        self.now = there
        self._update_lines(values)
        return Taken(values, covariance, expected, moments, compared, innovation)

    def _follow(self, turned: Sequence[Turn | None], at: Moment) -> None:
        """Move what is kept behind the drives, to where one has `turned`; members differ in where."""
        if self.path is not None and any(turned[i] for i in self.path.turns):  # it turned again
            self.path = None
        spread = np.zeros_like(self.committed)
        if self.of_machines or any(turned):
            sd = np.array([0.0 if one is None else one.error for one in turned])
            spread = self._deviations(sd, self._known())
        for i, (drive, one) in enumerate(zip(self._driving, turned, strict=True)):
            if one is not None:
                drive.committed, self.committed[:, i] = one.value, one.value + spread[:, i]
                if self.path is not None:
                    self.path.turn(i, one.ago, self.committed[:, i].copy())
            elif drive.way * ((safe := drive.safe(alone=len(turned) == 1)) - drive.committed) > 0.0:
                drive.committed = self.committed[:, i] = safe
        path, self.path = self.path, None  # where there is no equilibrium along it
        start, stops = self.kept, [self.committed]
        if path is not None and any(turned):
            start, stops = path.start, path.again(self._driving)
            for drive, there in zip(self._driving, stops[-1].mean(axis=0).tolist(), strict=True):
                drive.committed = there
        elif path is not None:
            path.step()
        rows = _rows_with_probes(len(self.members), 0)
        for read in stops:
            start = self._stepped(start, rows, read, at, self._span(at), 0.0).standing
        self.kept, self.committed, self.path = start, stops[-1], path

    def _result(self, taken: Taken) -> FollowedRig:
        read = dict[str, tuple[float, float]]()
        if self.of_machines:
            mean, variance = taken.channels.T
            sd = np.sqrt(variance + taken.compared.by_drive**2)
            pairs = zip(self.channels, mean.tolist(), sd.tolist(), strict=True)
            read = {name: (one, error) for name, one, error in pairs if math.isfinite(one)}
        return FollowedRig(
            self.keys,
            *self.estimate(taken.values, taken.covariance),
            taken.ends[:4, 0],
            np.sqrt(taken.ends[:4, 1] + taken.compared.ends_by_drive[:4] ** 2),
            taken.innovation[:, 0],
            np.sqrt(taken.innovation[:, 1]),
            taken.compared.beyond,
            read,
        )

    @abstractmethod
    def _at_rest(self) -> Vector:
        """Return what the drives read at rest [drives], in their unit."""

    @abstractmethod
    def _used(self, at: Moment) -> tuple[Moment, list[float]]:
        """Return what is used of a moment, and what its sensors read of the drives."""

    @abstractmethod
    def _stepped(
        self, start: Standing, rows: Rows, read: Matrix, at: Moment, span: float, passed: float
    ) -> Stepped:
        """Return what a step makes of some members.

        Parameters
        ----------
        start
            Where all members stand before it.
        rows
            [rows] Which members they are, each as often as it is stepped.
        read
            [rows, drives] What the sensors of the drives read.
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
        """Return the tension of each member at the ends of its tendons [members, ends] [N]."""
        tendons, last = self.kept.memory.reshape(len(self.members), self.count, -1), len(self.edge)
        return np.concatenate((tendons[:, :, 0], tendons[:, :, last]), axis=1)

    def _require_all(self, done: int, rows: Rows, what: str) -> None:
        """Refuse a step in which not all members were done."""
        if done < len(rows):
            numbers = zip(self.keys, self.members[rows[done]], strict=True)
            said = ", ".join(f"{key} {value:g}" for key, value in numbers)
            raise FitError(f"there is no equilibrium of the {what} with {said}: take smaller steps")

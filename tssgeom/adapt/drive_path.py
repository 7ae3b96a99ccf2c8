"""Where several drives went since one of them may have turned; docs/model.md (305).

A turn is known some readings after it. The others go on meanwhile, and with friction the order counts: so the
state from before is kept, and once the turn is known the members go again, along where the drives were.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tssgeom.adapt.members import Standing
from tssgeom.adapt.trailed_drive import TRAIL, TrailedDrive
from tssgeom.arrays import Matrix, Vector


class DrivePath:
    """The path of some drives from where the members stood.

    Parameters
    ----------
    start, committed
        Where the members stood when a drive may have turned first, and what the drives read there
        [members, drives].
    drives
        They.
    """

    def __init__(self, start: Standing, committed: Matrix, drives: Sequence[TrailedDrive]) -> None:
        self.start, self.committed = start, committed
        self.values = [[one.value for one in drives]]
        """[readings][drives] Where they were at each reading since."""
        self.steps: list[int] = []
        """After which readings the members moved."""
        self.turns: dict[int, tuple[int, Vector]] = {}
        """After which reading a drive turned, and where each member has that [members]."""

    @property
    def is_full(self) -> bool:
        """Whether a turn at its start would no longer be recognised."""
        return len(self.values) >= TRAIL.longest

    def take(self, drives: Sequence[TrailedDrive]) -> None:
        """Note where the drives are at a further reading."""
        self.values.append([one.value for one in drives])

    def step(self) -> None:
        """Note that the members move after the last reading."""
        self.steps.append(len(self.values) - 1)

    def turn(self, drive: int, ago: int, committed: Vector) -> None:
        """Note that a drive turned some readings ago, and where each member has that [members]."""
        self.turns[drive] = max(len(self.values) - 1 - ago, 0), committed

    def again(self, drives: Sequence[TrailedDrive]) -> list[Matrix]:
        """Return where the members go one after the other from their start [members, drives].

        Drives that turned have turned in `drives` too.
        """
        there, gone = self.committed, list[Matrix]()
        for when in sorted({*self.steps, *(when for when, _ in self.turns.values())}):
            there = there.copy()
            for i, one in enumerate(drives):
                self._move(there[:, i], i, when, one)
            gone.append(there)
        return gone

    def copied(self) -> DrivePath:
        """Return a path that goes on from here by itself; arrays are shared, as none is changed."""
        other = copy.copy(self)
        other.start = replace(self.start)
        other.values, other.steps, other.turns = self.values.copy(), self.steps.copy(), self.turns.copy()
        return other

    def plain(self) -> dict[str, NDArray[np.float64]]:
        """Return all of it but its start, for `of`."""
        turns = [(drive, when, *at) for drive, (when, at) in self.turns.items()]
        return {
            "committed": self.committed,
            "values": np.array(self.values),
            "steps": np.array(self.steps, dtype=np.float64),
            "turns": np.array(turns).reshape(-1, 2 + len(self.committed)),
        }

    @classmethod
    def of(cls, start: Standing, kept: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the path that `plain` describes."""
        made = cls(start, kept["committed"], ())
        made.values = kept["values"].tolist()
        made.steps = kept["steps"].astype(int).tolist()
        made.turns = {int(one[0]): (int(one[1]), one[2:]) for one in kept["turns"]}
        return made

    def _move(self, there: Vector, i: int, when: int, drive: TrailedDrive) -> None:
        """Move one drive of all members [members] on to where it was after a reading."""
        turned, end = self.turns.get(i, (-1, there))
        if when == turned:
            there[:] = end
            return
        way, most = (drive.way, drive.safe(alone=False)) if when > turned else (-drive.way, float(end.mean()))
        if way:
            there[:] = way * np.maximum(way * there, min(way * self.values[when][i], way * most))

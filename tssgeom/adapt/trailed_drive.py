"""Where a drive is that is read with noise, and how far it is for sure; docs/model.md (239), (251), (252).

Friction keeps every turn, those of noise too. So the state that is kept trails the drive by more than its
noise, and each frame is a step from there to where the drive is by now, which noise may move to and fro.
Source of the steady gains: P. R. Kalata, The tracking index: a generalized parameter for α-β and α-β-γ target
trackers, IEEE Transactions on Aerospace and Electronic Systems 20 (1984).
"""

from __future__ import annotations

import copy
import math
from collections import deque
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from tssgeom.core.constants import CHANCE


class TrailSettings(NamedTuple):
    """Numbers of drives with noise."""

    jerks: tuple[float, ...] = (0.001, 0.01, 0.1, 1.0, 10.0)
    """By how many noises the speed changes from reading to reading, a filter each [1]. Chosen: from a drive
    that stands to one that no straight line follows."""
    memory: float = 0.9
    """Share of the evidence for each filter that counts at the next reading [1]. Measured: of 0.7, 0.8 and
    0.9 the least error, with error bars that are nearest to right."""
    longest: int = 64
    """Most readings that say where a leg ended [1]; chosen."""
    may_turn: float = 2.5
    """Noises behind its farthest value from which a drive may have turned, and readings are not used [1];
    chosen."""
    most_behind: float = 8.0
    """Noises by which it trails the drive at most [1]. Measured: with 8, 16 and 24 errors are alike; 24 takes
    a fifth fewer steps, but one in some thousand of a machine then has no equilibrium."""
    certain: float = 2.0
    """Noises by which a drive that goes on has not turned [1]. Chosen: two of its errors; one of several
    is kept behind by as much, (315)."""
    turns: float = 0.05
    """Probability that it turns at a reading by which it does not get on [1]. Chosen: some readings a leg."""
    spread: float = 10.0
    """Standard deviations of a reading over which it may lie behind a turn [1]. Chosen: a turn by one noise
    moves T_in by so much."""


TRAIL = TrailSettings()


class _Gains(NamedTuple):
    """Of filters of a drive whose speed changes at random, once they are steady."""

    value: list[float]
    """They are also variances of the value, over that of a reading [1]."""
    speed: list[float]
    expected: list[float]
    """Variance of a reading about what is expected, over its own [1]."""
    log_expected: list[float]
    """Logarithm of that."""


def _gains() -> _Gains:
    jerk = np.array(TRAIL.jerks)
    damping = (4.0 + jerk - np.sqrt(8.0 * jerk + jerk * jerk)) / 4.0
    value = 1.0 - damping**2
    speed = 2.0 * (2.0 - value) - 4.0 * np.sqrt(1.0 - value)
    return _Gains(
        value.tolist(), speed.tolist(), (1.0 / (1.0 - value)).tolist(), (-np.log1p(-value)).tolist()
    )


_GAINS = _gains()
_FEWEST = 3  # readings that show a bend
_ARRAYS = ("recent", "values", "speeds", "evidence")


class Turn(NamedTuple):
    """Where a drive has turned."""

    value: float
    """In the unit of the drive."""
    error: float
    """Its standard error."""
    ago: int
    """How many readings ago it was there."""


class TrailedDrive:
    """Follows one drive.

    Parameters
    ----------
    noise
        Standard deviation of a reading, in its unit.
    """

    def __init__(self, noise: float) -> None:
        self.noise = noise
        self.recent = deque[float](maxlen=2 * TRAIL.longest)
        self.values = self.speeds = self.evidence = [0.0] * len(TRAIL.jerks)
        """Of each filter where the drive is, its way from reading to reading, and the logarithm of its
        likelihood."""
        self.way = 0
        self.value = self.error = self.farthest = self.committed = math.nan
        """Where the drive is by now, its standard error, the farthest such value of this leg, and where the
        state that is kept has it."""
        self.reading = self.position = math.nan
        """The last reading, and where the tendon has it: by now, or before where it may have turned."""
        self.turn_probability, self.certain = 0.0, math.nan
        """Probability that it has turned, and where it last had not for sure."""
        self.moved_to = math.nan
        """Where `has_moved` was true last."""

    @property
    def may_have_turned(self) -> bool:
        """Whether it may have turned, and may not."""
        behind = self.way * (self.farthest - self.value) > TRAIL.may_turn * self.noise
        return behind or self.turn_probability > 0.5

    @property
    def is_behind(self) -> bool:
        """Whether it is behind the farthest where it was by more than its noise."""
        return self.may_have_turned or self.way * (self.farthest - self.value) > self.noise

    @property
    def off(self) -> float:
        """How far the last reading is from `position`, over the noise [1]."""
        return (self.reading - self.position) / self.noise if self.noise else 0.0

    @property
    def share(self) -> float:
        """Standard error of where it is, over the noise of a reading [1]."""
        return self.error / self.noise if self.noise > 0.0 else 1.0

    def take(self, reading: float) -> Turn | None:
        """Take in a reading; return where the drive has turned, if it has."""
        self._track(reading)
        self.reading = reading
        self.recent.append(reading)
        if math.isnan(self.farthest):
            self.farthest = self.committed = self.certain = self.value
        turned = self._turned()
        if turned is not None or not self.may_have_turned:
            self.position = self.value
        return turned

    def _turned(self) -> Turn | None:
        way, behind = self.way, self.farthest - self.value
        if way == 0:
            if abs(behind) > CHANCE.never * self.noise:
                self.way, self.farthest = (-1 if behind > 0.0 else 1), self.value
            return None
        self.farthest = way * max(way * self.farthest, way * self.value)
        if way * behind <= CHANCE.never * self.noise:
            return None
        readings = way * np.array(self.recent)
        end, error, ago = _turn_of(readings, self.noise)
        turned = Turn(way * max(end, way * self.committed), error, ago)
        behind_turn = readings[np.argmax(readings) + 1 :]
        self.recent.clear()
        self.recent.extend((way * behind_turn).tolist())
        self.way, self.farthest = -way, self.value
        self.turn_probability, self.certain = 0.0, self.value
        return turned

    def _track(self, reading: float) -> None:
        """Take in a reading by each filter, and the mean of them by their likelihood; docs/model.md (251)."""
        if math.isnan(self.value):
            self.values = [reading] * len(TRAIL.jerks)
            self.value, self.error = reading, self.noise
            return
        square = self.noise * self.noise
        values, speeds, evidence = list[float](), list[float](), list[float]()
        for x, v, was, of_value, of_speed, expected, log_expected in zip(
            self.values, self.speeds, self.evidence, *_GAINS, strict=True
        ):
            off = reading - x - v
            evidence.append(TRAIL.memory * was - 0.5 * (off * off / (square * expected) + log_expected))
            values.append(x + v + of_value * off)
            speeds.append(v + of_speed * off)
        self.values, self.speeds, self.evidence = values, speeds, evidence
        most = max(evidence)
        weights = [math.exp(one - most) for one in evidence]
        whole = sum(weights)
        self.value = now = sum(w * x for w, x in zip(weights, values, strict=True)) / whole
        of_each = zip(weights, values, _GAINS.value, strict=True)
        variance = sum(w * (square * share + (x - now) ** 2) for w, x, share in of_each) / whole
        self.error = math.sqrt(variance)

    def weigh(self, off: float) -> None:
        """Take in how far a reading is off for a drive that has not turned; docs/model.md (252).

        In standard deviations, and > 0 where it is as if the drive were farther on its way; NaN is none.
        """
        if self.way * (self.value - self.certain) > TRAIL.certain * self.noise or not self.way:
            self.turn_probability, self.certain = 0.0, self.value
            return
        if math.isnan(off):
            return
        off = min(max(off, -CHANCE.never), CHANCE.never)
        before = self.turn_probability + TRAIL.turns * (1.0 - self.turn_probability)
        before = min(before, 1.0 - TRAIL.turns**4)  # it may be revised
        sound = math.exp(-0.5 * off**2) / math.sqrt(2.0 * math.pi)
        turned = 0.5 * math.erfc(off / math.sqrt(2.0)) / TRAIL.spread
        self.turn_probability = before * turned / (before * turned + (1.0 - before) * sound)

    def set(self, value: float) -> None:
        """Set the drive to a position that is exact."""
        if value != self.position and not math.isnan(self.position):
            self.way = 1 if value > self.position else -1
        self.recent.clear()
        self.values = [value] * len(TRAIL.jerks)
        self.speeds = self.evidence = [0.0] * len(TRAIL.jerks)
        self.reading = self.value = self.position = self.farthest = self.committed = self.certain = value
        self.error = self.turn_probability = 0.0

    def behind(self) -> float:
        """Return how far it is by now behind `position` if it has turned; docs/model.md (306)."""
        off = self.way * (self.value - self.position) / self.error
        return self.error * (
            math.exp(-0.5 * off**2) / (math.sqrt(0.5 * math.pi) * math.erfc(off / math.sqrt(2.0))) - off
        )

    def has_moved(self) -> bool:
        """Whether it has moved since this was true last, by more than its noise."""
        if abs(self.value - self.moved_to) <= CHANCE.rare * self.noise:
            return False
        self.moved_to = self.value
        return True

    def plain(self) -> dict[str, Any]:
        """Return all of it, for `of`."""
        arrays = {name: np.array(getattr(self, name)) for name in _ARRAYS}
        return {**vars(self), **arrays}

    @classmethod
    def of(cls, kept: Mapping[str, Any]) -> TrailedDrive:
        """Return the drive that `plain` describes."""
        made = cls(0.0)
        for name, value in kept.items():
            setattr(made, name, value.tolist() if name in _ARRAYS else value)
        made.recent = deque(made.recent, 2 * TRAIL.longest)
        return made

    def copied(self) -> TrailedDrive:
        """Return a drive that goes on from here by itself."""
        other = copy.copy(self)
        other.recent = self.recent.copy()
        return other

    def safe(self, *, alone: bool) -> float:
        """Return how far the drive has gone for sure; docs/model.md (239), beside other drives (315)."""
        error = CHANCE.rare * self.noise if alone else TRAIL.certain * self.error
        certain = self.way * (self.position - self.committed) - error
        return self.committed + self.way * max(certain, 0.0)

    def needs_commit(self) -> bool:
        """Whether the state that is kept trails by more than it needs to."""
        return self.way * (self.position - self.committed) > TRAIL.most_behind * self.noise


def _turn_of(readings: np.ndarray, noise: float) -> Turn:
    """Return how far a drive went that then turned back, by readings that increase to there; (297)."""
    if noise == 0.0 or len(readings) < _FEWEST:
        return Turn(float(readings.max()), noise, len(readings) - 1 - int(readings.argmax()))
    start, near = _about_the_farthest(readings / noise)
    differences = np.diff(np.eye(len(near)), 2, axis=0)
    bent, jerks = differences @ near, np.array(TRAIL.jerks)[:, None, None]
    spread = differences @ differences.T + jerks**2 * np.eye(len(bent))
    inverse = np.linalg.inv(spread)
    whitened = inverse @ bent
    smooth = near - whitened @ differences
    last = smooth.argmax(axis=1)
    ends, moves = smooth.max(axis=1), differences[:, last].T
    variances = 1.0 - np.einsum("ki,kij,kj->k", moves, inverse, moves)
    evidence = -0.5 * (whitened @ bent + np.linalg.slogdet(spread)[1])
    share = np.exp(evidence - evidence.max())
    share /= share.sum()
    end = float(share @ ends)
    error = noise * math.sqrt(share @ (variances + (ends - end) ** 2))
    return Turn(noise * end, error, len(readings) - 1 - start - round(float(share @ last)))


def _about_the_farthest(readings: np.ndarray) -> tuple[int, np.ndarray]:
    """Return the readings, in noises, that lie about the farthest of their means of three, and two before.

    The number of the first of them stands before them.
    """
    top = 1 + int((readings[:-2] + readings[1:-1] + readings[2:]).argmax())
    far = np.flatnonzero(readings < readings[top] - CHANCE.never)
    stop = int(min(far[far > top], default=len(readings)))
    start = int(max(far[far < top], default=1)) - 1
    start = max(min(start, stop - _FEWEST), stop - TRAIL.longest, 0)
    return start, readings[start : max(stop, start + _FEWEST)]

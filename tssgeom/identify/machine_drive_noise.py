"""What the noise of channels that act on a machine does to its estimates: drives that may have been.

Source: docs/model.md (262), (264), (265).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE
from tssgeom.identify.drive import calmed
from tssgeom.identify.turning import Legs
from tssgeom.statistics import reading_noise, root_mean_square


@dataclass(frozen=True, slots=True)
class InputNoiseSettings:
    """How the noise of channels that act is taken off, and sampled."""

    lost: float = 1.2
    """What calming takes from a channel that acts, over its noise, up to which it is noise [1]; chosen: a
    swing as large as the noise makes it 1.2."""
    draws: int = 12
    """Draws of the noise of all runs together; chosen: a standard deviation is known to 21 %."""
    of_each: int = 4
    """Draws of each run at least; chosen for speed."""
    least: float = 1e-5
    """Of the range of a channel: less noise is none [1]; chosen: half of the rounding of a 14-bit encoder."""


INPUT_NOISE = InputNoiseSettings()
_FEWEST_STEPS = 4  # derived: Fisher's z of three has no error
_SEED = 20  # of the draws; any, but the same in all fits


@dataclass(frozen=True, slots=True)
class NoisyInputs:
    """What acts on a machine in a run, without its noise where that can be taken off."""

    time: Vector
    """[r] Of all readings [s]."""
    readings: Mapping[str, Vector]
    """[r] Of the noisy channels, calmed or as they were read."""
    noise: Mapping[str, float]
    """Standard deviation of the readings of each."""
    calm: frozenset[str]
    """Channels that are calmed."""
    kept: np.ndarray
    """Which readings are used."""
    at: np.ndarray
    """[s] Which of those are samples of the run."""
    pulls: Mapping[str, Legs]
    """Drives that are monotone from turn to turn, as far as their readings are used."""
    _made: dict[tuple[int, bytes | None], list[dict[str, Vector]]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    """Draws that were made, by their number and turns: every model of a search needs the same."""

    def draws(self, count: int, turns: np.ndarray | None) -> list[dict[str, Vector]]:
        """Return samples of the noisy channels as they might have been with other noise; docs/model.md (264).

        The run has a sample before each of its `turns` where it is driven by the tension of one tendon; noise
        that makes another turn is none that was read.
        """
        key = count, None if turns is None else turns.tobytes()
        if key not in self._made:
            self._made[key] = list(self._draws(count, turns))
        return self._made[key]

    def _draws(self, count: int, turns: np.ndarray | None) -> Iterator[dict[str, Vector]]:
        rng, time = np.random.default_rng(_SEED), self.time[self.kept]
        for _ in range(count if self.readings or self.pulls else 0):
            out = {channel: self._again(channel, rng)[self.kept][self.at] for channel in self.readings}
            if turns is not None:
                out = {channel: with_turns_between(values, turns) for channel, values in out.items()}
            pulled = {channel: made.again(time, rng) for channel, made in self.pulls.items()}
            if turns is None:
                yield out | {channel: made.values[self.at] for channel, made in pulled.items()}
            elif all(len(made.turns) == len(turns) for made in pulled.values()):
                yield out | {
                    channel: np.insert(made.values[self.at], turns, made.turn_values)
                    for channel, made in pulled.items()
                }

    def _again(self, channel: str, rng: np.random.Generator) -> Vector:
        noise = self.noise[channel]
        read = self.readings[channel] + noise * rng.standard_normal(len(self.time))
        return calmed(read, noise, self.time) if channel in self.calm else read


def noisy_inputs(columns: Mapping[str, Vector], rows: np.ndarray, channels: Sequence[str]) -> NoisyInputs:
    """Return the rows of channels that act, calmed; docs/model.md (66), (262).

    Friction keeps the farthest readings, a turn that is thinned that of many, and what answers to noise is
    taken for softness. A motion that is small beside its noise, and would be lost, stays as it was read.
    """
    time, out, noises, calm = columns["time_s"][rows], dict[str, Vector](), dict[str, float](), set[str]()
    for channel in channels:
        readings = columns[channel][rows]
        noise = reading_noise(readings)
        if is_noisy(readings, noise):
            quiet = calmed(readings, noise, time)
            lost = root_mean_square(readings - quiet) > INPUT_NOISE.lost * noise
            out[channel], noises[channel] = readings if lost else quiet, noise
            calm |= set() if lost else {channel}
    every = np.arange(len(rows))
    return NoisyInputs(time, out, noises, frozenset(calm), every, every, {})


def is_followed(readings: Vector, answers: Iterable[Vector]) -> bool:
    """Return whether an answer follows what might be noise of a drive; docs/model.md (288).

    A drive that is held at one level after another turns at most readings, and its steps are no noise.
    """
    if float(np.ptp(readings)) > 2.0 * CHANCE.never * reading_noise(readings):
        return False
    steps = np.diff(readings)
    for answer in answers:
        changes = np.diff(answer)
        both = np.array([steps, changes])[:, np.isfinite(changes)]
        if (count := both.shape[1]) > _FEWEST_STEPS and min(np.std(both[0]), np.std(both[1])) > 0.0:
            correlation = abs(float(np.corrcoef(both[0], both[1])[0, 1]))
            scale = math.sqrt(count - 3.0)  # Fisher's z has a standard deviation of 1 over it
            if math.atanh(min(correlation, 1.0 - 1e-12)) * scale > CHANCE.clear:
                return True
    return False


def is_noisy(readings: Vector, noise: float) -> bool:
    """Return whether the noise of readings is more than rounding."""
    return noise > INPUT_NOISE.least * float(np.ptp(readings))


def with_turns_between(values: Vector, turns: np.ndarray) -> Vector:
    """Return samples with one more before each turn, between its neighbours."""
    return np.insert(values, turns, 0.5 * (values[turns - 1] + values[turns]))

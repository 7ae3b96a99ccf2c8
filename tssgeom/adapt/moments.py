"""The last seconds of a stream as a run, for models with other numbers; docs/model.md (202), (207)."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from itertools import compress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tssgeom import core
from tssgeom.adapt.ensemble import Ensemble
from tssgeom.adapt.readings import CHANNELS, Moment, noise_variance, used
from tssgeom.adapt.rig_filter import RigFilter
from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import CHANCE
from tssgeom.core.constants_tendon_rows import HELD, PLANT
from tssgeom.errors import FitError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.model import model_of, setup_of
from tssgeom.tendon.bars.sensors import sensed


class DriveNoise(NamedTuple):
    """How noise of the drive is kept from turning the tendon."""

    overshoot: float = 1.5
    """Error of a drive that stands for long, which its last readings have moved too far, over the noise [1].
    Measured: 1.54 to 1.64 in holds of four simulated machines, 0.9 to 1.0 in their first ten readings."""
    memory: float = 0.1
    """Share of the newest reading in mean reading and mean step [1]. Chosen: ten readings of a motion."""
    slow: float = 0.3
    """Standard deviations that a drive moves from reading to reading below which the mean reading says
    more than the highest one [1]; chosen."""


_NOISE = DriveNoise()


class DriveTracker:
    """Follows the true drive behind noisy readings of the last seconds.

    Friction keeps every turn of the drive, those of its noise too: a few micrometres back take half a newton
    off T_in. Filters know a drive by `tssgeom.adapt.trailed_drive`; a march keeps no state behind the drive,
    so that this one goes only on.

    Parameters
    ----------
    noise
        Standard deviation of a reading [N] or [m].
    """

    def __init__(self, noise: float) -> None:
        self._noise = noise
        self._extreme: float | None = None
        self._way = 1
        self._mean = 0.0
        self._step = 0.0
        self._stood = 0
        self.value = 0.0

    def take(self, reading: float) -> float:
        """Take in a reading; return the standard deviation of the `value` that follows from it."""
        noise = self._noise
        if self._extreme is None or noise == 0.0:
            self._extreme = self._mean = self.value = reading
            return noise
        self._mean += _NOISE.memory * (reading - self._mean)
        beyond = self._way * (reading - self._extreme) / noise
        turned = self._way * (reading - self.value) < -CHANCE.never * noise
        self._step += _NOISE.memory * (max(beyond, 0.0) - self._step)
        if not turned and beyond <= 0.0:  # it stands, or turns
            self._stood += 1
            return noise * (_NOISE.overshoot if self._stood * _NOISE.memory > 1.0 else 1.0)
        self._extreme, self._stood = reading, 0
        if turned:
            self._way = -self._way
        way = self._way
        value = reading - way * noise * highest_of_noise(self._step)
        if self._step < _NOISE.slow and not turned:
            value = way * min(way * value, way * self._mean + noise)
        if turned or way * (value - self.value) > 0.0:
            self.value = value
        return noise


class RunSettings(NamedTuple):
    """What of the last seconds is compared."""

    most: int = 400
    """Moments of one tendon [1]. Chosen: a march then takes a millisecond."""
    most_of_machine: int = 150
    """Moments of a machine [1]. Chosen: a march then takes some milliseconds."""
    begins: float = 0.4
    """Share of the time since a fault began that is left out, as it may still have grown [1]; chosen."""
    grows: float = 3.0
    """Time for which a fault grows at most [s]; chosen."""
    together: float = 5.0
    """Moments that count as one [1]. Chosen: errors of model and drive stay alike for so long."""
    near: int = 3
    """Moments on each side in which the steepest slope over the drive counts [1]. Chosen: a turn is that
    long."""
    huber: float = 8.0
    """Standard deviations from which a residual counts less [1]; chosen: a wrong model may be far off."""


RUN = RunSettings()


def grown(after: Sequence[Moment]) -> list[Moment]:
    """Return the moments at which a fault has grown, which had begun by the first of them at the latest."""
    return list(compress(after, _has_grown(np.array([one.time for one in after]))))


def _has_grown(times: Vector) -> NDArray[np.bool_]:
    begun = times - times[0]
    return begun >= min(RUN.begins * begun[-1], RUN.grows)


class RunFromHere(ABC):
    """Moments after a filter's last step, for models with other numbers.

    Parameters
    ----------
    sound
        The filter before the first of them.
    after
        The moments, in order.
    drives
        Channels that drive.
    channels
        What may be compared.
    most
        Moments that are, at most.
    """

    def __init__(
        self,
        sound: Ensemble,
        after: Sequence[Moment],
        drives: Sequence[str],
        channels: Sequence[str],
        most: int,
    ) -> None:
        step = -(-len(after) // most)
        self.drives, self._channels, self._arcs = drives, channels, after[-1].arcs
        sensors = sound.rig.sensors
        trackers = [DriveTracker(math.sqrt(noise_variance(sensors.get(name)))) for name in drives]
        drive, sd = np.empty((len(drives), len(after))), np.empty((len(drives), len(after)))
        for i, moment in enumerate(after):  # all of them, as noise is less than what is between two of a few
            for j, (tracker, given) in enumerate(zip(trackers, self._driven(moment.readings), strict=True)):
                sd[j, i], drive[j, i] = tracker.take(given), tracker.value
        chosen = np.arange(len(after) - 1, -1, -step)[::-1]
        times = np.array([after[i].time for i in chosen])
        self._times = times
        self._spans = np.maximum(np.diff(times, prepend=sound.time), 1e-6)
        self._drive, self._sd = drive[:, chosen], sd[:, chosen]
        self._chosen = [after[i] for i in chosen]
        self._readings = np.array([self._read(after[i].readings, sound.muted) for i in chosen]).T
        self._readings[:, ~_has_grown(times)] = math.nan
        variances = [noise_variance(sensors.get(one)) for one in channels]
        self._noise = np.sqrt(np.maximum(variances, 1e-12))
        self._sd_of = self._noise[:, None] * np.ones(len(chosen))
        self._weigh(sound)

    @property
    def count(self) -> float:
        """How many independent readings are compared [1]."""
        return max(float(np.isfinite(self._readings).sum()) / RUN.together, 1.0)

    def distances(self, rig: Rig) -> dict[str, float]:
        """Return the median distance of each channel that is read from a rig, in standard deviations."""
        off = np.abs(self._readings - self._predicted(rig, self._drive)) / self._sd_of
        read = zip(self._channels, off, strict=True)
        return {name: float(np.nanmedian(one)) for name, one in read if np.isfinite(one).any()}

    def ranges(self, rig: Rig) -> Iterator[tuple[str, Vector, Vector]]:
        """Yield each channel with what was read and what a rig predicts for it, in its noises [1]."""
        predicted = self._predicted(rig, self._drive)
        for name, read, there, noise in zip(
            self._channels, self._readings, predicted, self._noise.tolist(), strict=True
        ):
            used = np.isfinite(read)
            yield name, read[used] / noise, there[used] / noise

    def left(self, rig: Rig) -> Vector:
        """Return the standardised residuals of a rig, less for moments that count as one.

        Raises
        ------
        FitError
            Where the tendon finds no equilibrium.
        """
        off = (self._readings - self._predicted(rig, self._drive)) / self._sd_of
        return off[np.isfinite(self._readings)] / math.sqrt(RUN.together)

    @property
    def huber(self) -> float:
        """Residual of `left` from which it counts less [1]."""
        return RUN.huber / math.sqrt(RUN.together)

    @abstractmethod
    def _predicted(self, rig: Rig, drive: Matrix) -> np.ndarray:
        """Return what each channel should read [channels, moments] with the drives [drives, moments]."""

    @abstractmethod
    def _driven(self, readings: Any) -> Sequence[float]:
        """Return what was read of each drive [drives]."""

    @abstractmethod
    def _read(self, readings: Any, muted: set[str]) -> Sequence[float]:
        """Return what was read of each channel; NaN where nothing that is used [channels]."""

    def _weigh(self, sound: Ensemble) -> None:
        """Count what the drive's own error does to each reading, by the steepest slope near it."""
        predicted = self._predicted(sound.rig_now(), self._drive)
        self._readings[~np.isfinite(predicted)] = math.nan
        sd = np.sqrt((self._sd**2).sum(axis=0))
        moved = np.maximum(np.sqrt((np.diff(self._drive) ** 2).sum(axis=0)), sd[1:])
        slope = np.abs(np.diff(predicted, axis=1)) / moved
        padded = np.pad(slope, ((0, 0), (RUN.near, RUN.near + 1)), mode="edge")
        steepest = np.lib.stride_tricks.sliding_window_view(padded, 2 * RUN.near + 1, axis=1).max(axis=2)
        self._sd_of = np.hypot(self._sd_of, steepest * sd)


class TendonFromHere(RunFromHere):
    """The same of one tendon.

    Parameters
    ----------
    sound, after
        As of `RunFromHere`.
    """

    def __init__(self, sound: RigFilter, after: Sequence[Moment]) -> None:
        self.by_force = after[0].readings.by_force
        self._edge = sound.edge
        self._memory = sound.now.memory.mean(axis=0)
        name = "tension_in_N" if self.by_force else "displacement_in_m"
        super().__init__(sound, after, (name,), CHANNELS, RUN.most)

    def _predicted(self, rig: Rig, drive: Matrix) -> np.ndarray:
        setup = setup_of(rig)
        arcs = Arcs.exact(self._arcs.length, rig.route.angle_gain * self._arcs.angle)
        plant = model_of(setup, arcs, "displacement_in_m", self._edge).plant
        plant.set(PLANT.swift, 0.0)
        given = drive[0]
        if self.by_force:
            given = np.maximum((given - setup.tension_in_offset_N) / setup.tension_in_gain, 0.0)
        done, _, out, _ = core.march(
            len(self._edge),
            plant.block,
            self._memory,
            self.by_force,
            self._spans,
            given,
            np.array([one.warmth for one in self._chosen]),
            np.ones(len(given), dtype=np.int64),
            0,
        )
        if done < len(given):
            raise FitError("there is no equilibrium of the tendon: take smaller steps")
        read = sensed(setup, out, self._memory[-len(HELD) + HELD.time] + np.cumsum(self._spans))
        return np.array([read[name] for name in CHANNELS])

    def _driven(self, readings: Any) -> Sequence[float]:
        given = readings.tension_in if self.by_force else readings.displacement_in
        return (0.0 if given is None else given,)

    def _read(self, readings: Any, muted: set[str]) -> Sequence[float]:
        return used(readings, muted)


def highest_of_noise(step: float) -> float:
    """Return how far the highest of all readings so far is above the last true value, on the average [1].

    The drive moves by `step` from reading to reading; all in standard deviations of a reading. Derived: a
    curve through what 4000 simulated motions gave, to 0.14 from 0.03 to 4.
    """
    return 0.5 * math.log1p((0.65 / max(step, 1e-3)) ** 1.2)

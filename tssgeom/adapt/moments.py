"""The last seconds of a stream as a run, for models with other numbers; docs/model.md (207)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.adapt.drive import DriveTracker
from tssgeom.adapt.readings import CHANNELS, Readings, noise_variance
from tssgeom.adapt.rig_filter import RigFilter
from tssgeom.arrays import Vector
from tssgeom.core.constants_tendon_rows import HELD, PLANT
from tssgeom.errors import FitError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.model import model_of, setup_of
from tssgeom.tendon.bars.sensors import sensed


class Moment(NamedTuple):
    """What came in at one time."""

    time: float
    arcs: Arcs
    readings: Readings
    warmth: float
    """Temperature above that of the first frame [K]."""


class RunSettings(NamedTuple):
    """What of the last seconds is compared."""

    most: int = 400
    """Moments [1]. Chosen: a march then takes a millisecond."""
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


_RUN = RunSettings()


class RunFromHere:
    """Moments after a filter's last step, for models with other numbers.

    Parameters
    ----------
    sound
        The filter before the first of them.
    after
        The moments, in order.
    """

    def __init__(self, sound: RigFilter, after: Sequence[Moment]) -> None:
        step = -(-len(after) // _RUN.most)
        self._edge, self._arcs = sound.edge, after[-1].arcs
        self.by_force = after[0].readings.by_force
        name = "tension_in_N" if self.by_force else "displacement_in_m"
        tracker = DriveTracker(math.sqrt(noise_variance(sound.rig.sensors.get(name))))
        drive, sd = np.empty(len(after)), np.empty(len(after))
        for i, moment in enumerate(after):  # all of them, as noise is less than what is between two of a few
            read = moment.readings
            given = read.tension_in if self.by_force else read.displacement_in
            sd[i], drive[i] = tracker.take(0.0 if given is None else given), tracker.value
        chosen = np.arange(len(after) - 1, -1, -step)[::-1]
        times = np.array([after[i].time for i in chosen])
        self._memory = sound.memory[: len(sound.members)].mean(axis=0)
        self._spans = np.maximum(np.diff(times, prepend=sound.time), 1e-6)
        self._drive, self._sd = drive[chosen], sd[chosen]
        self._warmth = np.array([after[i].warmth for i in chosen])
        self._elapsed = self._memory[-len(HELD) + HELD.time] + np.cumsum(self._spans)
        self._readings = np.array([_channels(after[i].readings, sound.muted) for i in chosen]).T
        begun = times - times[0]
        self._readings[:, begun < min(_RUN.begins * begun[-1], _RUN.grows)] = math.nan
        variances = [noise_variance(sound.rig.sensors.get(one)) for one in CHANNELS]
        self._sd_of = np.sqrt(np.maximum(variances, 1e-12))[:, None] * np.ones(len(chosen))
        self._weigh(sound)

    @property
    def count(self) -> float:
        """How many independent readings are compared [1]."""
        return max(float(np.isfinite(self._readings).sum()) / _RUN.together, 1.0)

    def distances(self, rig: Rig) -> dict[str, float]:
        """Return the median distance of each channel that is read from a rig, in standard deviations."""
        off = np.abs(self._readings - self._predicted(rig, self._drive)) / self._sd_of
        read = zip(CHANNELS, off, strict=True)
        return {name: float(np.nanmedian(one)) for name, one in read if np.isfinite(one).any()}

    def left(self, rig: Rig) -> Vector:
        """Return the standardised residuals of a rig, less for moments that count as one.

        Raises
        ------
        FitError
            Where the tendon finds no equilibrium.
        """
        off = (self._readings - self._predicted(rig, self._drive)) / self._sd_of
        return off[np.isfinite(self._readings)] / math.sqrt(_RUN.together)

    @property
    def huber(self) -> float:
        """Residual of `left` from which it counts less [1]."""
        return _RUN.huber / math.sqrt(_RUN.together)

    def _predicted(self, rig: Rig, drive: Vector) -> np.ndarray:
        setup = setup_of(rig)
        arcs = Arcs.exact(self._arcs.length, rig.route.angle_gain * self._arcs.angle)
        plant = model_of(setup, arcs, "displacement_in_m", self._edge).plant
        plant.set(PLANT.swift, 0.0)
        given = drive
        if self.by_force:
            given = np.maximum((drive - setup.tension_in_offset_N) / setup.tension_in_gain, 0.0)
        ones = np.ones(len(drive), dtype=np.int64)
        done, _, out, _ = core.march(
            len(self._edge),
            plant.block,
            self._memory,
            self.by_force,
            self._spans,
            given,
            self._warmth,
            ones,
            0,
        )
        if done < len(drive):
            raise FitError("there is no equilibrium of the tendon: take smaller steps")
        read = sensed(setup, out, self._elapsed)
        return np.array([read[name] for name in CHANNELS])

    def _weigh(self, sound: RigFilter) -> None:
        """Count what the drive's own error does to each reading, by the steepest slope near it."""
        predicted = self._predicted(sound.rig_now(), self._drive)
        moved = np.maximum(np.abs(np.diff(self._drive)), self._sd[1:])
        slope = np.abs(np.diff(predicted, axis=1)) / moved
        padded = np.pad(slope, ((0, 0), (_RUN.near, _RUN.near + 1)), mode="edge")
        steepest = np.lib.stride_tricks.sliding_window_view(padded, 2 * _RUN.near + 1, axis=1).max(axis=2)
        self._sd_of = np.hypot(self._sd_of, steepest * self._sd)


def _channels(readings: Readings, muted: set[str]) -> list[float]:
    read = (None if readings.by_force else readings.tension_in, readings.tension_out, readings.elongation)
    return [math.nan if v is None or name in muted else v for name, v in zip(CHANNELS, read, strict=True)]

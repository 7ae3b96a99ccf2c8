"""What is read of a tendon, and what is known of it after that."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import ROUNDING
from tssgeom.rig import Sensor
from tssgeom.route.pieces import Arcs

CHANNELS = ("tension_in_N", "tension_out_N", "elongation_m")
"""What the filter takes as readings, beside the drive."""


class Readings(NamedTuple):
    """What was measured at one time; None where it was not."""

    tension_in: float | None = None
    displacement_in: float | None = None
    tension_out: float | None = None
    elongation: float | None = None
    commanded: bool = False
    """Whether the drive is a command that counts as carried out: the true one, without noise."""

    @property
    def by_force(self) -> bool:
        """Whether the tension drives: a position is the better drive where both are measured."""
        return self.displacement_in is None


class Moment(NamedTuple):
    """What came in at one time."""

    time: float
    """[s]"""
    arcs: Arcs
    """The route, of a machine as sensed."""
    readings: Any
    """`Readings` of one tendon, or `MachineReadings`."""
    warmth: float = 0.0
    """Temperature above that of the first frame [K]."""


@dataclass(frozen=True, slots=True)
class FollowedRig:
    """What is known of the rig and of both ends after a frame."""

    keys: tuple[str, ...]
    values: Vector
    """[d] In the units of the keys."""
    covariance: Matrix
    """[d, d]"""
    ends: Vector
    """[4] T_in, T_out [N], x_in, x_out [m], of a machine those of tendon 1."""
    ends_se: Vector
    """[4]"""
    off: Vector
    """[channels] Readings less what was expected [N, m]; NaN where there is none to use."""
    off_sd: Vector
    """[channels] Its standard deviation [N, m]."""
    beyond: Vector
    """[channels] How far a reading is off, over the most that noise, rig and drive explain at once [1]."""

    read: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Of a machine: what each channel should read, and its standard error, by name."""

    @property
    def se(self) -> Vector:
        """[d] Standard errors."""
        return np.sqrt(np.diag(self.covariance))


def noise_variance(sensor: Sensor | None) -> float:
    """Return the variance of a reading by the stated noise and resolution of its sensor."""
    return 0.0 if sensor is None else sensor.noise**2 + sensor.resolution**2 / 12.0


def used(readings: Readings, muted: Collection[str]) -> list[float]:
    """Return what was read of each of `CHANNELS`; NaN where nothing, what drives, or is muted."""
    pull = None if readings.by_force else readings.tension_in
    read = zip(CHANNELS, (pull, readings.tension_out, readings.elongation), strict=True)
    return [math.nan if value is None or name in muted else value for name, value in read]


def lagged(now: Vector, before: Vector, read: Vector, lag: Vector | float, span: float) -> Vector:
    """Return what sensors [n] with a lag [s] read after a time [s]; docs/model.md (62).

    Parameters
    ----------
    now, before
        True values now and then; straight between.
    read
        What they read then; NaN at the begin.
    lag, span
        The lag, and the time between.
    """
    if span <= 0.0:
        return np.where(np.isnan(read), now, read)
    lag = np.maximum(lag, ROUNDING.relative * span)
    behind = (now - before) / span * lag
    return np.where(np.isnan(read), now, now - behind + (read - before + behind) * np.exp(-span / lag))


def mean_and_sd(values: Matrix) -> tuple[Vector, Vector]:
    """Return mean and standard deviation of each column; numpy's own take three times as long."""
    mean, variance = mean_and_variance(values)
    return mean, np.sqrt(variance)


def mean_and_variance(values: Matrix) -> tuple[Vector, Vector]:
    """Return mean and variance of each column."""
    mean = values.sum(axis=0) / len(values)
    deviation = values - mean
    return mean, (deviation * deviation).sum(axis=0) / (len(values) - 1)


def mean_and_covariance(values: Matrix) -> tuple[Vector, Matrix]:
    """Return the mean of each column, and the covariance of all."""
    mean = values.sum(axis=0) / len(values)
    deviation = values - mean
    return mean, deviation.T @ deviation / (len(values) - 1)

"""Limits of a rig in one more run: as stated, or as far as the runs of a campaign went.

Source: docs/discovery.md, "Designed experiments".
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import SettingsError
from tssgeom.identify.fit import Point
from tssgeom.identify.prediction import run_channels
from tssgeom.identify.readings import Reading
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.rig import Rig, Sensor
from tssgeom.statistics import EVIDENCE_SCALE


@dataclass(frozen=True, slots=True)
class LimitSettings:
    """How limits are read off runs."""

    through: int = 4
    """Steps over which a speed is taken; chosen: corners that were added to a drive make short steps."""


LIMITS = LimitSettings()

KEYS: Mapping[str, str] = {
    "tension_N": "greatest proximal tension",
    "least_tension_N": "least proximal tension",
    "speed_mm_per_s": "greatest speed of the drive",
    "travel_mm": "greatest position of the drive, from the pretensioned state",
    "duration_s": "longest run",
}
"""Limits that can be stated, and what each is."""


@dataclass(frozen=True, slots=True)
class RunLimits:
    """What one more run stays within; the first five are `KEYS`, in their units."""

    tension_N: float
    least_tension_N: float
    speed_mm_per_s: float
    travel_mm: float
    duration_s: float
    interval_s: float
    """Least time from sample to sample [s]."""
    samples: int
    """Most samples of a run."""
    stated: tuple[str, ...] = ()
    """Keys that the user stated; the others are what the runs reached."""

    @property
    def values(self) -> dict[str, float]:
        """The limits by their keys."""
        return {key: getattr(self, key) for key in KEYS}

    def widened(self, key: str, factor: float) -> RunLimits:
        """Return the limits with one of them multiplied."""
        return replace(self, **{key: getattr(self, key) * factor})


def forbidding(limits: RunLimits) -> SettingsError:
    """Return the error of limits within which the search has no run."""
    words = ", ".join(f"{key}={value:.3g}" for key, value in limits.values.items())
    return SettingsError(f"limits forbid every run ({words}): allow more with --limits, of {', '.join(KEYS)}")


def limits_of(runs: Sequence[Reading], rig: Rig, at: Point, stated: Mapping[str, float]) -> RunLimits:
    """Return the limits of the next run: as stated, else what the runs reached; within those of the drive.

    Parameters
    ----------
    runs
        All runs of a campaign, held out ones too.
    rig, at
        The nominal rig, and the model that computes tensions and positions that were not measured.
    stated
        By `KEYS`, in their units.

    Raises
    ------
    SettingsError
        Where a limit is unknown, no positive number, beyond that of the rig's drive, or forbids every run.
    """
    reached = [_reached(run, rig, at) for run in runs]
    interval = min(float(np.median(np.diff(run.time))) for run in runs)
    return within_limits(reached, rig, stated, interval, max(len(run.time) for run in runs))


def within_limits(
    reached: Sequence[Mapping[str, float]],
    rig: Rig,
    stated: Mapping[str, float],
    interval_s: float,
    samples: int,
) -> RunLimits:
    """Return the limits of the next run from what each run reached, by `KEYS`; errors of `limits_of`."""
    for key, value in stated.items():
        if key not in KEYS:
            raise SettingsError(f"--limits {key}: no such limit: known are {', '.join(KEYS)}")
        if not (math.isfinite(value) and value > 0.0):
            raise SettingsError(f"--limits {key}={value:g}: give a finite value > 0 ({KEYS[key]})")
    bounds = _of_drive(rig)
    for key in stated.keys() & bounds.keys():
        if stated[key] > bounds[key]:
            raise SettingsError(
                f"--limits {key}={stated[key]:g} is beyond drive.limits, {bounds[key]:g}: give less"
            )
    scale = rig.sensors.get("tension_in_N", Sensor()).full_scale
    tension = max(each["tension_N"] for each in reached)
    default = {
        "tension_N": min(tension, (1.0 - PLAUSIBLE.slight) * scale) if scale > 0.0 else tension,
        "least_tension_N": max(min(each["least_tension_N"] for each in reached), 0.0),
        "speed_mm_per_s": max(each["speed_mm_per_s"] for each in reached),
        "travel_mm": max(each["travel_mm"] for each in reached),
        "duration_s": max(each["duration_s"] for each in reached),
    }
    default |= {key: min(default[key], most) for key, most in bounds.items()}
    limits = RunLimits(
        **{**default, **stated},
        interval_s=interval_s,
        samples=samples,
        stated=tuple(stated),
    )
    _check(limits, rig)
    return limits


def _of_drive(rig: Rig) -> dict[str, float]:
    """Return the limits of the drive itself, by `KEYS`."""
    given, values = rig.drive.limits, dict[str, float]()
    if given.tension_N is not None:
        values["tension_N"] = given.tension_N
    if given.speed_m_per_s is not None:
        values["speed_mm_per_s"] = 1e3 * given.speed_m_per_s
    if given.displacement_m is not None:
        values["travel_mm"] = 1e3 * given.displacement_m[1]
    return values


def _reached(run: Reading, rig: Rig, at: Point) -> dict[str, float]:
    """Return the extremes of one run by `KEYS`."""
    channels = run_channels(run, at.rig(rig), at.effects)
    tension, position = channels["tension_in_N"], channels["displacement_in_m"]
    return {
        "tension_N": float(tension.max()),
        "least_tension_N": float(tension.min()),
        "speed_mm_per_s": 1e3 * top_speed(run.time, position),
        "travel_mm": 1e3 * float(np.abs(position).max()),
        "duration_s": float(run.time[-1] - run.time[0]),
    }


def top_speed(time: Vector, position: Vector) -> float:
    """Return the greatest speed of a run [m/s], over a few steps; `time` [n] s, `position` [n] m."""
    k = min(LIMITS.through, len(time) - 1)
    speeds = np.abs(position[k:] - position[:-k]) / (time[k:] - time[:-k])
    return float(np.quantile(speeds, 1.0 - EVIDENCE_SCALE.false_alarms))


def _check(limits: RunLimits, rig: Rig) -> None:
    """Refuse limits within which the drive cannot move."""
    rest = rig.tendon.pretension_N
    if limits.tension_N <= max(rest, limits.least_tension_N):
        raise SettingsError(
            f"limits forbid every run: tension_N={limits.tension_N:g} is not above the pretension {rest:g} N "
            f"and least_tension_N={limits.least_tension_N:g}: allow more with --limits tension_N=…"
        )
    if limits.least_tension_N > rest:
        raise SettingsError(
            f"limits forbid every run: least_tension_N={limits.least_tension_N:g} is above the pretension "
            f"{rest:g} N, from which runs begin: allow less with --limits least_tension_N=…"
        )
    if limits.duration_s < (fewest := PLAUSIBLE.fewest_rows) * limits.interval_s:
        raise SettingsError(
            f"limits forbid every run: duration_s={limits.duration_s:g} is less than {fewest} samples of "
            f"{limits.interval_s:.3g} s: allow more with --limits duration_s=…"
        )

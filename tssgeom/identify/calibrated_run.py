"""A run as calibration takes it: which readings count, what is fitted, and what the rig would have measured.

The model of the run and its fit are those of `discover`; docs/model.md (70), (71).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Vector, read_only
from tssgeom.effects.kinds import PATHS
from tssgeom.errors import SettingsError
from tssgeom.identify.campaign import Route
from tssgeom.identify.fit import Point
from tssgeom.identify.machine_drive_noise import with_turns_between
from tssgeom.identify.prediction import Stack, run_channels, stacked
from tssgeom.identify.readings import Reading, at_times, in_order, with_added
from tssgeom.identify.turning import Legs, legs, with_turns
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.statistics import EVIDENCE_SCALE
from tssgeom.tendon.bars.model import BARS, Drive
from tssgeom.tendon.simulation import Measured


@dataclass(frozen=True, slots=True)
class RunLimits:
    """Which readings of a run calibration uses. All are chosen, on the runs of `benchmarks.calibration`."""

    most_readings: int = 1500
    """Readings of a tension as drive; a longer run is thinned; chosen."""
    most_positions: int = 200
    """Readings of a position as drive; a longer run is thinned; chosen: of 400 readings, intervals of ρ hold
    three quarters of the runs of `benchmarks.calibration`, of 200 nine in ten."""
    floor: float = 0.4
    """Of the highest tension: the elongation counts above it at the latest [1]; chosen."""
    floor_out: float = 0.1
    """Of the floor of the elongation: the distal tension counts above it [1]; chosen."""


@dataclass(frozen=True, slots=True)
class TakeUpPrior:
    """What is assumed of the slack of a run beforehand. All are chosen, on what the paper's rig shows."""

    slack_m: float = 3e-3
    """Standard deviation of the slack that is taken up [m]; the paper's is 1.69 mm."""
    scale_N: float = 1.3
    """Tension over which it is taken up [N]; the paper's is linear from 4 N on."""
    factor: float = 0.5
    """Standard deviation of its logarithm [1]."""


RUN_LIMITS = RunLimits()
_TAKE_UP = TakeUpPrior()
NAMES = {
    "tension_in_N": "tension_in",
    "tension_out_N": "tension_out",
    "elongation_m": "elongation",
    "displacement_in_m": "elongation",
}
"""Channels as users of calibration see them."""


@dataclass(frozen=True, slots=True)
class Zero:
    """A number of the run that is fitted beside friction and compliance; `u` counts standard deviations."""

    name: str
    unit: str
    sd: float
    """Standard deviation of its prior; of its logarithm where it has a `centre`."""
    centre: float = 0.0
    """Median of the prior of a number that is positive; else 0."""

    def value(self, u: float) -> float:
        """Return the number in its unit."""
        return self.centre * math.exp(self.sd * u) if self.centre else self.sd * u


@dataclass(frozen=True, slots=True)
class CalibratedRun:
    """One run, ready to be fitted."""

    reading: Reading
    zeros: tuple[Zero, ...]
    legs: Legs
    """The drive; the samples of the reading are those of the drive and its turns."""
    warnings: tuple[str, ...]
    tension: Vector | None = None
    """[n] T_in as measured, monotone from turn to turn; None where it is not measured [N]."""

    @property
    def shows_stretch(self) -> bool:
        """Whether compliance shows in the run."""
        return self.reading.drive == "displacement_in_m" or not self.reading.measured.keys().isdisjoint(PATHS)

    def stack(self) -> Stack:
        """Return the readings as one vector."""
        return stacked([self.reading])

    def predicted(self, at: Point, nominal: Rig, bars: int = BARS) -> Vector:
        """Return what all readings should have been [rows] [N, m]."""
        return self.stack().flat([self.channels(at, nominal, bars)])

    def on(self, arcs: Arcs) -> CalibratedRun:
        """Return the same run on another route."""
        route = replace(self.reading.route, arcs=arcs)
        return replace(self, reading=replace(self.reading, route=route))

    def values(self, at: Point) -> dict[str, float]:
        """Return the zeros in their units, by name."""
        return {zero.name: zero.value(u) for zero, u in zip(self.zeros, at.zeros, strict=True)}

    def channels(self, at: Point, nominal: Rig, bars: int = BARS) -> dict[str, Vector]:
        """Return the predicted reading of each channel [n]; docs/model.md (71)."""
        value, reading = self.values(at), self.reading
        offset = value.get("elongation_offset", 0.0)
        by_position = reading.drive == "displacement_in_m"
        shifts = np.array([value.get(f"turn_{k + 1}", 0.0) for k in range(len(self.legs.turns))])
        taken_up, over = value.get("take_up", 0.0), value.get("take_up_tension", 1.0)
        drive = reading.given[reading.drive] if self.tension is None else with_turns(self.legs, shifts)
        if by_position:
            taken_up = max(taken_up, 0.0)  # one below 0 would imitate a stiffness that noise hides
            drive = drive - offset
            if self.tension is not None:
                drive = drive + taken_up * np.exp(-self.tension / over)
        out = run_channels(reading, at.rig(nominal), bars=bars, drive=drive)
        out["tension_out_N"] = out["tension_out_N"] + value.get("tension_out_offset", 0.0)
        slack = taken_up * np.exp(-out["tension_in_N"] / over)
        for name in ("elongation_m", "displacement_in_m"):
            out[name] = out[name] + offset - slack
        return out


def calibrated_run(
    measured: Measured, arcs: Arcs, rig: Rig, from_tension: float, drive: Drive | None = None
) -> CalibratedRun:
    """Choose what counts in a run, and what it identifies.

    Without a `drive` it is the tension, unless that is missing. Where it is the position although the tension
    is measured, levels of its turns are fitted as those of a tension are; docs/model.md (275).

    Raises SettingsError where there is no drive or no response.
    """
    with_tension = measured.tension_in is not None
    drive = drive or ("tension_in_N" if with_tension else "displacement_in_m")
    by_force = drive == "tension_in_N"
    column = measured.tension_in if by_force else measured.displacement_in
    if column is None:
        raise SettingsError("the run has no drive: give a column tension_in_N or displacement_in_m")
    sound = in_order(measured.time, column)
    if measured.tension_in is not None:
        sound &= np.isfinite(measured.tension_in)
    kept = np.flatnonzero(sound)
    most = RUN_LIMITS.most_readings if with_tension else RUN_LIMITS.most_positions
    kept = kept[:: max(1, -(-len(kept) // most))]
    if len(kept) < PLAUSIBLE.fewest_rows:
        raise SettingsError(
            f"the run has {len(kept)} readings of its drive: give at least {PLAUSIBLE.fewest_rows}"
        )
    if by_force and not float(np.max(column[kept])) > 0.0:
        raise SettingsError(
            f"tension_in_N is at most {float(np.max(column[kept])):g} N: a tendon only pulls: change its sign"
        )
    _check_stretch(measured, arcs)
    spring = with_tension and measured.elongation is None and measured.displacement_in is not None
    if spring and rig.load.stiffness_N_per_m == 0.0:
        raise SettingsError(
            "displacement_in_m holds the stretch of the load's spring, and load.stiffness_N_per_m is 0; "
            "give the stiffness, or a column elongation_m or displacement_out_m"
        )
    time = measured.time[kept]
    drive_legs = legs(column[kept], time, of_position=with_tension and not by_force)
    values, turns = drive_legs.values, drive_legs.turns
    tension = None
    if measured.tension_in is not None:
        tension = values if by_force else legs(measured.tension_in[kept], time).values
    floor = 0.0 if tension is None else min(from_tension, RUN_LIMITS.floor * float(tension.max()))
    answering = {
        "tension_in_N": None if by_force else measured.tension_in,
        "tension_out_N": measured.tension_out,
        "displacement_in_m": measured.displacement_in if spring and by_force else None,
        "elongation_m": measured.elongation,
    }
    counting = dict(_counting(answering, kept, tension, floor))
    if not counting:
        raise SettingsError(
            f"no response with {EVIDENCE_SCALE.fewest} readings above {floor:g} N: "
            "give tension_out_N, elongation_m or both"
        )
    added = np.zeros(len(values) + (len(turns) if with_tension else 0), dtype=bool)
    samples = values
    if tension is not None:
        added[turns + np.arange(len(turns))] = True
        time = with_turns_between(time, turns)
        samples, tension = with_turns(drive_legs, np.zeros(len(turns))), with_turns_between(tension, turns)
    given = {"time_s": time, drive: read_only(samples)}
    if measured.temperature is not None and np.isfinite(measured.temperature).any():
        given["temperature_C"] = at_times(measured.time, measured.temperature, time)
    answers = {name: read_only(with_added(each, added)) for name, each in counting.items()}
    nowhere = np.zeros((0, 3))
    route = Route("the route", arcs, nowhere, np.zeros(0))
    noise = {drive: drive_legs.noise} | dict.fromkeys(answers, 1.0)
    reading = Reading("the run", route, False, drive, given, answers, noise)
    zeros = tuple(_zeros(counting, drive_legs, by_force=by_force, with_tension=with_tension))
    warnings = tuple(_warnings(reading, measured, rig, spring, len(turns) > 0))
    return CalibratedRun(reading, zeros, drive_legs, warnings, tension)


def _check_stretch(measured: Measured, arcs: Arcs) -> None:
    """Refuse an elongation by half of the route: its unit is wrong."""
    column = measured.elongation
    most = 0.0 if column is None or not np.isfinite(column).any() else float(np.nanmax(np.abs(column)))
    if most > PLAUSIBLE.largest_strain * arcs.total_length:
        raise SettingsError(
            f"the elongation reaches {most:.3g} m on a route of {arcs.total_length:.3g} m: check its unit, "
            "elongation_m or elongation_mm"
        )


def _counting(
    answering: Mapping[str, Vector | None], kept: np.ndarray, tension: Vector | None, floor: float
) -> Iterator[tuple[str, Vector]]:
    """Yield channels with NaN where a reading does not count: slack, missing, or the same digits again."""
    for name, column in answering.items():
        least = RUN_LIMITS.floor_out * floor if name == "tension_out_N" else floor
        if column is None:
            continue
        taut = True if tension is None else tension >= least
        used = np.flatnonzero(np.isfinite(column[kept]) & taut)
        used = used[_once(column[kept][used])]
        if len(used) >= EVIDENCE_SCALE.fewest:
            out = np.full(len(kept), np.nan)
            out[used] = column[kept][used]
            yield name, out


def _once(readings: Vector) -> np.ndarray:
    """Return the middle of each run of equal readings: digits that stand still count once."""
    edges = np.concatenate(([0], np.flatnonzero(np.diff(readings)) + 1, [len(readings)]))
    return (edges[:-1] + edges[1:] - 1) // 2


def _zeros(
    answers: Mapping[str, Vector], drive: Legs, *, by_force: bool, with_tension: bool
) -> Iterator[Zero]:
    """Yield what is fitted beside friction and compliance: a zero may be as far off as its channel reads."""
    paths = [values for name, values in answers.items() if name in PATHS]
    if "tension_out_N" in answers:
        yield Zero("tension_out_offset", "N", _largest(answers["tension_out_N"]))
    if paths or not by_force:
        yield Zero("elongation_offset", "m", _largest(paths[0] if by_force else drive.values))
    if with_tension and (paths or not by_force):
        yield Zero("take_up", "m", _TAKE_UP.slack_m)
        yield Zero("take_up_tension", "N", _TAKE_UP.factor, _TAKE_UP.scale_N)
    for k, sd in enumerate(drive.fitted_se if with_tension else ()):
        yield Zero(f"turn_{k + 1}", "N" if by_force else "m", sd)


def _largest(readings: Vector) -> float:
    return float(np.nanmax(np.abs(readings)))


def _warnings(reading: Reading, measured: Measured, rig: Rig, spring: bool, turns: bool) -> Iterator[str]:
    arcs, drive = reading.route.arcs, reading.given[reading.drive]
    by_force = reading.drive == "tension_in_N"
    if not turns:
        yield (
            "the drive never turns back: a pull and a release are needed for friction, compliance and zeros"
        )
    if spring or not by_force:
        yield (
            f"the distal spring of {rig.load.stiffness_N_per_m:g} N/m is taken from the rig: "
            "its error goes into the compliance"
        )
    start = float(drive[0]) if by_force else 0.0
    if by_force and start > rig.tendon.pretension_N + 0.2 * float(np.ptp(drive)):
        yield (
            f"the run begins at {start:.3g} N, the pretension is {rig.tendon.pretension_N:g} N: "
            "what happened before is not known"
        )
    if rig.shape.angle_gain_sd == 0.0 and arcs.total_angle_se == 0.0:
        yield "the angle of the route is taken as exact: set shape.angle_gain_sd in the rig"
    if measured.tension_out is None:
        yield "no tension_out_N: friction shows by its hysteresis in the elongation alone"

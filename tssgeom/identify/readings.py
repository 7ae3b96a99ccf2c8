"""Runs made ready to be compared: which channel drives, which answer, and which readings are none.

Source: docs/discovery.md, "How it decides", steps 1 and 2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Vector, read_only
from tssgeom.channel_names import unit_of
from tssgeom.errors import SettingsError
from tssgeom.identify.campaign import Campaign, Route, Run
from tssgeom.identify.drive import calmed, turning_points, with_corners
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.plausibility.series import missing_remarks
from tssgeom.rig import Rig, Sensor
from tssgeom.route.noise import STATED
from tssgeom.statistics import reading_noise
from tssgeom.tendon.bars.model import Drive


@dataclass(frozen=True, slots=True)
class ReadingLimits:
    """Which readings and which noise are used.

    Frozen on the development seeds of `benchmarks.discovery`.
    """

    cycles: int = 3
    """One of so many cycles, the last, is held out, or predicted; chosen: two remain to be fitted."""
    at_rest: float = 20.0
    """Of its noise: a first position below it is the zero [1]; chosen."""
    position_worth: float = 5.0
    """Of the noise of T_in: the tension drives where the position makes more of it [1]; chosen."""


READING = ReadingLimits()
_FEW = 7 + 1  # readings that show no noise; derived: differences of seven are taken

RESPONSES = (
    "tension_in_N",
    "tension_out_N",
    "displacement_in_m",
    "elongation_m",
    "displacement_out_m",
)
"""Channels that a run may answer in, in the order of reports."""


@dataclass(frozen=True, slots=True)
class Reading:
    """One run as the workflow uses it; rows without time or drive are gone."""

    name: str
    route: Route
    held_out: bool
    drive: Drive
    given: Mapping[str, Vector]
    """What the model is given: `time_s`, the drive without its noise, `temperature_C` where measured."""
    measured: Mapping[str, Vector]
    """[n] The channels that answer; NaN where a reading is missing or saturated."""
    noise: Mapping[str, float]
    """Standard deviation of white noise, digits included, of answers and drive [N, m]."""

    @property
    def time(self) -> Vector:
        """[n] [s]."""
        return self.given["time_s"]


def readings(campaign: Campaign, drive: Drive | None = None) -> tuple[tuple[Reading, ...], tuple[str, ...]]:
    """Return the runs, one at least to be fitted, and notes about them, a sentence each.

    Without a `drive` it is the position, unless that is missing or far noisier than the proximal tension.

    Raises SettingsError where a run cannot be used: no drive, no answer, too few readings.
    """
    if not campaign.runs:
        raise SettingsError(f"{campaign.name}: no runs; list at least one [[run]]")
    notes = list(campaign.notes)
    runs, note = (campaign.runs, []) if campaign.held_out_fixed else with_held_out(campaign.runs)
    notes += note
    drive = drive or _drive(campaign.rig, runs)
    made = []
    for run in runs:
        reading, about = _read(run, campaign.rig, drive)
        made.append(reading)
        notes += about
    if len(made) == 1:
        made, about = _by_cycles(made[0])
        notes += about
    return tuple(made), tuple(notes)


def _by_cycles(reading: Reading) -> tuple[list[Reading], list[str]]:
    """Hold out the last third of the cycles of the only run; it stays whole where it has too few."""
    turns = turning_points(reading.given[reading.drive], reading.noise[reading.drive])
    cycles = (len(turns) + 1) // 2
    if cycles < READING.cycles:
        return [reading], [
            f"There is one run of {cycles} whole cycles, so nothing is held out: the result was not checked."
        ]
    kept = cycles - cycles // READING.cycles
    first = int(turns[2 * kept - 1])
    parts = (np.arange(len(reading.time)) < first, np.arange(len(reading.time)) >= first)
    parts[1][0] = True  # the zero of a channel is that of its first reading
    measured = [{name: np.where(part, v, np.nan) for name, v in reading.measured.items()} for part in parts]
    held = f"{reading.name}, cycles {kept + 1} to {cycles}"
    note = f"There is one run: its last third was held out before anything was fitted ({held})."
    return [
        replace(reading, measured=measured[0]),
        replace(reading, name=held, measured=measured[1], held_out=True),
    ], [note]


def with_held_out(runs: tuple[Run, ...]) -> tuple[tuple[Run, ...], list[str]]:
    """Hold a run out where none is: one whose route no other run has, if there is one."""
    if all(run.held_out for run in runs):
        raise SettingsError("all runs are held out: leave at least one to be fitted")
    if any(run.held_out for run in runs):
        return runs, []
    if len(runs) == 1:
        return runs, []  # its last cycles will be, if it has enough
    routes = [run.route.name for run in runs]
    alone = [k for k, name in enumerate(routes) if routes.count(name) == 1]
    chosen = alone[-1] if alone and len(set(routes)) > 1 else len(runs) - 1
    why = "no other run is on its route" if chosen in alone else "it is the last"
    note = f"{runs[chosen].name} was held out before anything was fitted, as {why}."
    return tuple(replace(run, held_out=k == chosen) for k, run in enumerate(runs)), [note]


def _drive(rig: Rig, runs: tuple[Run, ...]) -> Drive:
    """Return the channel that drives: the position, unless that is missing or far noisier than T_in."""
    if all("displacement_in_m" in run.columns for run in runs):
        if not all("tension_in_N" in run.columns for run in runs):
            return "displacement_in_m"
        time = runs[0].columns["time_s"]
        position = noise_of(rig, "displacement_in_m", time, runs[0].columns["displacement_in_m"])
        force = noise_of(rig, "tension_in_N", time, runs[0].columns["tension_in_N"])
        stiffness = 1.0 / max(rig.tendon.compliance_per_N * runs[0].route.arcs.total_length, 1e-9)
        return (
            "displacement_in_m" if position * stiffness <= READING.position_worth * force else "tension_in_N"
        )
    if all("tension_in_N" in run.columns for run in runs):
        return "tension_in_N"
    raise SettingsError(
        "the runs have no drive in common: each needs displacement_in_m [m], or each tension_in_N [N]"
    )


def noise_of(rig: Rig, channel: str, time: Vector, column: Vector) -> float:
    """Return white noise with digits: as specified, or as the readings show where that is much more."""
    stated = rig.sensors.get(channel, Sensor()).reading_noise
    there = in_order(time, column)
    displayed = reading_noise(column[there], time[there]) if np.count_nonzero(there) > _FEW else 0.0
    if stated == 0.0 or displayed > STATED.far_less * stated:
        return max(displayed, 1e-12)
    return stated


def in_order(time: Vector, column: Vector) -> np.ndarray:
    """Return which rows have a time, later than all before, and a reading [n] bool."""
    there = np.isfinite(time) & np.isfinite(column)
    there[there] = np.concatenate(([True], np.diff(np.maximum.accumulate(time[there])) > 0.0))
    return there


def _read(run: Run, rig: Rig, drive: Drive) -> tuple[Reading, list[str]]:
    columns, notes = run.columns, list[str]()
    if drive not in columns:
        raise SettingsError(f"{run.name}: {drive} drives the other runs and is missing here; add it")
    kept = in_order(columns["time_s"], columns[drive])
    lost = len(kept) - int(kept.sum())
    if lost:
        notes.append(
            f"{run.name}: {lost} of {len(kept)} samples have no time or no {drive} and are left out."
        )
    if kept.sum() < PLAUSIBLE.fewest_rows:
        raise SettingsError(
            f"{run.name}: {int(kept.sum())} usable samples; give {PLAUSIBLE.fewest_rows} or more"
        )
    answers = {name: columns[name] for name in RESPONSES if name in columns and name != drive}
    notes += [f"{run.name}: {each.text}" for each in missing_remarks(answers)]
    measured = {}
    for name, column in answers.items():
        measured[name], about = _clean(column[kept], rig.sensors.get(name, Sensor()))
        notes += [f"{run.name}: {name}: {each}" for each in about]
        if not np.isfinite(measured[name]).any():
            del measured[name]
    if not measured:
        raise SettingsError(f"{run.name}: nothing answers the drive; measure one of {', '.join(RESPONSES)}")
    time = columns["time_s"][kept]
    noise = {name: noise_of(rig, name, time, column) for name, column in measured.items()}
    noise[drive] = noise_of(rig, drive, time, columns[drive][kept])
    notes += _notes_on_noise(run.name, rig, noise)
    calm, about = _zeroed(calmed(columns[drive][kept], noise[drive], time), drive, noise[drive])
    notes += [f"{run.name}: {each}" for each in about]
    time, calm, added = with_corners(time, calm, noise[drive])
    given = {"time_s": time, drive: calm}
    measured = {name: read_only(with_added(column, added)) for name, column in measured.items()}
    if "temperature_C" in columns and np.isfinite(columns["temperature_C"]).sum() > 1:
        given["temperature_C"] = at_times(columns["time_s"], columns["temperature_C"], time)
    inputs = {name: read_only(column) for name, column in given.items()}
    return Reading(run.name, run.route, run.held_out, drive, inputs, measured, noise), notes


def _zeroed(calm: Vector, drive: Drive, noise: float) -> tuple[Vector, list[str]]:
    """Let a position begin at rest at zero, where it plainly does but for the noise of one reading."""
    if drive != "displacement_in_m" or calm[0] == 0.0:
        return calm, []
    if abs(calm[0]) < READING.at_rest * noise:
        return calm - calm[0], []
    return calm, [f"the drive begins at {calm[0]:.3g} m, taken as a pull from rest in the first sample."]


def _clean(column: Vector, sensor: Sensor) -> tuple[Vector, list[str]]:
    """Take out readings at the end of the scale."""
    out, notes = np.array(column, dtype=float), list[str]()
    if sensor.full_scale > 0.0:
        over = np.abs(out) >= sensor.full_scale * (1.0 - 1e-9)
        if over.any():
            notes.append(f"{int(over.sum())} readings are at the end of the scale and are left out.")
            out[over] = np.nan
    return read_only(out), notes


def _notes_on_noise(name: str, rig: Rig, noise: Mapping[str, float]) -> list[str]:
    out = []
    for channel, used in noise.items():
        stated = rig.sensors.get(channel, Sensor()).reading_noise
        unit = unit_of(channel)
        if stated == 0.0:
            out.append(
                f"{name}: {channel} has no noise stated in the rig; its readings show {used:.2g} {unit}."
            )
        elif used > stated:
            out.append(
                f"{name}: {channel} is noisier than stated, {used:.2g} {unit} and not {stated:.2g} {unit}; "
                "the former counts."
            )
    return out


def with_added(column: Vector, added: np.ndarray) -> Vector:
    """Return a column with no reading where a corner was added."""
    out = np.full(len(added), np.nan)
    out[~added] = column
    return out


def at_times(time: Vector, column: Vector, wanted: Vector) -> Vector:
    """Return a column at other times, straight lines between its readings."""
    there = np.isfinite(column) & np.isfinite(time)
    return np.interp(wanted, time[there], column[there])

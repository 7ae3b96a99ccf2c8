"""A measured run of a machine: what is given, what answers, what is not known; docs/model.md (180)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.channel_names import numbered
from tssgeom.errors import SettingsError
from tssgeom.identify.machine_drive_noise import (
    NoisyInputs,
    is_followed,
    is_noisy,
    noisy_inputs,
    with_turns_between,
)
from tssgeom.identify.readings import READING, with_added
from tssgeom.identify.turning import Legs, legs, turns_between_readings, with_turns
from tssgeom.mechanism import answering, tendon_count
from tssgeom.plausibility.digits import clock_remarks
from tssgeom.plausibility.kinds import Remark
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.plausibility.machines import (
    angle_remarks,
    direction_remarks,
    load_sign_remarks,
    sign_remarks,
)
from tssgeom.plausibility.rules import warnings_of
from tssgeom.plausibility.series import Series, missing_remarks
from tssgeom.rig import Rig, Sensor
from tssgeom.route.pieces import Arcs
from tssgeom.statistics import EVIDENCE_SCALE, digit_noise, reading_noise, turns
from tssgeom.tendon.machine_history import DriveName
from tssgeom.tendon.machine_simulation import (
    current_notes,
    drive_channels,
    drive_of,
    with_torque,
)


@dataclass(frozen=True, slots=True)
class MachineRunLimits:
    """Which readings of a run of a machine are used. All are chosen."""

    most_samples: int = 600
    """Samples of a run; a longer one is thinned, its turns stay; chosen for the speed of a fit."""
    zero: float = 0.3
    """Standard deviation of the zero of a channel, of its range [1]; chosen."""


LIMITS = MachineRunLimits()


@dataclass(frozen=True, slots=True)
class MachineRun:
    """One run, ready to be fitted."""

    name: str
    given: Mapping[str, Vector]
    """[s] Time, drive, and what acts at the end."""
    measured: Mapping[str, Vector]
    """[s] The channels that answer; NaN where a reading is missing."""
    held_out: np.ndarray
    """[s] Whether a sample is held out while the fit is checked."""
    routes: tuple[Arcs, ...]
    drive: DriveName
    end_given: bool
    tendons: int
    inputs: NoisyInputs
    """What acts and is noisy."""
    noise: Mapping[str, float]
    """Standard deviation of one reading of each channel that answers, by all its readings; no less than that
    of its digits, and than the rig states."""
    legs: Legs | None = None
    """The one channel that drives, a tension or a position beside a force, whose turns have levels of their
    own; (70), (71), (276)."""
    notes: tuple[str, ...] = ()
    bends: Mapping[str, Mapping[str, Vector]] = field(default_factory=dict)
    """By key of a fitted number: how the channels change where its bends are a standard error off; (286)."""

    def at_readings(self, values: Vector) -> Vector:
        """Return values [s] of samples at those of the run alone, without turns between two of them."""
        if self.legs is None:
            return values
        at = self.legs.turns
        return np.delete(values, at + np.arange(len(at)))


def machine_run(
    name: str, columns: Mapping[str, Vector], routes: Sequence[Arcs], rig: Rig, *, most: int | None = None
) -> MachineRun:
    """Choose what is given and what answers in a run.

    Parameters
    ----------
    name
        Of the run, for messages.
    columns
        `time_s` and channels, in SI; NaN where a reading is missing.
    routes
        One for all tendons, or one each.
    rig
        The machine.
    most
        Samples of the run; a longer one is thinned.

    Raises
    ------
    SettingsError
        Where there is no drive, no answer, or too little of either, or a channel has the wrong sign.
    """
    count = tendon_count(rig.drive, rig.end)
    columns = with_torque(columns, rig)
    read = Series(columns, rig)
    signs = [*sign_remarks(read), *direction_remarks(read), *angle_remarks(read)]
    warnings = warnings_of(name, [*clock_remarks(read), *signs])
    drive = drive_of(columns, count)
    given_names = ["time_s", *drive_channels(drive, count)]
    end_given = rig.end.given == "angle"
    if end_given and "joint_angle_rad" not in columns:
        raise SettingsError(f"{name}: end.given is 'angle', but the run has no joint_angle_rad: add it")
    beside = "joint_angle_rad" if end_given else "joint_torque_Nm"
    if rig.end.kind == "joint" and beside in columns:
        given_names.append(beside)
    sound = np.all([np.isfinite(columns[each]) for each in given_names], axis=0)
    rows = np.flatnonzero(sound)
    if len(rows) < EVIDENCE_SCALE.fewest:
        raise SettingsError(
            f"{name}: {len(rows)} samples with {given_names[1]}: give {EVIDENCE_SCALE.fewest} or more"
        )
    most = most or LIMITS.most_samples
    pulled = drive_channels(drive, count) if drive == "tension_in" else ()
    channels = answering(rig.drive, rig.end)
    measured = [columns[each][rows] for each in channels if each in columns.keys() - given_names]
    steps = {each for each in drive_channels(drive, count) if is_followed(columns[each][rows], measured)}
    moved = {} if steps else _position_beside_force(columns, rows, drive, count)
    read = (*pulled, *moved, *steps)
    noisy = noisy_inputs(columns, rows, [each for each in given_names[1:] if each not in read])
    given = {each: noisy.readings.get(each, columns[each][rows]) for each in given_names}
    levelled = {
        each: legs(given[each], given["time_s"], noise, of_position=True, calm=each == "motor_angle_rad")
        for each, noise in moved.items()
    }
    motion = given[given_names[1]]
    turning = np.concatenate([turns_of(motion), *(each.turns for each in levelled.values())])
    kept = _thinned(len(rows), turning, most)
    rows, given = rows[kept], {each: np.ascontiguousarray(values[kept]) for each, values in given.items()}
    pulls = {each: legs(given[each], given["time_s"], 0.0 if each in steps else None) for each in pulled}
    pulls |= {each: _kept_legs(made, kept) for each, made in levelled.items()}
    given |= {each: made.values for each, made in pulls.items()}
    noisy = replace(
        noisy,
        kept=kept,
        at=np.arange(len(kept)),
        pulls={each: made for each, made in pulls.items() if is_noisy(made.values, made.noise)},
    )
    answers = {
        each: columns[each][rows]
        for each in channels
        if each in columns
        and each not in given_names
        and np.isfinite(columns[each][rows]).sum() >= EVIDENCE_SCALE.fewest
    }
    if not answers:
        known = ", ".join(each for each in channels if each not in given_names)
        raise SettingsError(f"{name}: nothing answers to {given_names[1]}: give one of {known}")
    held_out = _held_out(given[given_names[1]])
    notes = tuple(
        f"{each} is not used: the rig has no such channel, or has it numbered by tendon"
        for each in columns
        if each not in (*given_names, *answers, "temperature_C", "motor_current_A")
    )
    noise = {
        each: _noise_of(columns[each], columns["time_s"], rig.sensors.get(each, Sensor())) for each in answers
    }
    missing = missing_remarks({f"{each} of {name}": columns[each] for each in (*given_names, *answers)})
    notes += (*current_notes(columns, rig), *warnings, *(each.text for each in missing))
    run = MachineRun(
        *(name, given, answers, held_out, tuple(routes), drive, end_given, count, noisy, noise),
        notes=notes,
    )
    run = with_drive_known(run, rig.drive.lag_s)
    return _with_turns_between(run, *pulls.values()) if len(pulls) == 1 else run


def _noise_of(readings: Vector, time: Vector, sensor: Sensor) -> float:
    """Return the noise that readings show, and no less than what their digits and the rig state."""
    there = np.isfinite(readings) & np.isfinite(time)
    displayed = reading_noise(readings[there], time[there])
    return max(displayed, digit_noise(readings[there]), sensor.reading_noise)


def _position_beside_force(
    columns: Mapping[str, Vector], rows: np.ndarray, drive: DriveName, count: int
) -> dict[str, float]:
    """Return the one position that drives and its noise, where its force is measured too; (276), (277)."""
    channel, *more = drive_channels(drive, count)
    if drive not in ("displacement_in", "motor_angle_rad") or more:
        return {}
    forces = [each for each in (*numbered("tension_in_N", count), "motor_torque_Nm") if each in columns]
    known = any(np.isfinite(columns[each][rows]).sum() >= EVIDENCE_SCALE.fewest for each in forces)
    readings = columns[channel][rows]
    noise = reading_noise(readings)
    if not known or not is_noisy(readings, noise):
        return {}
    levelled = drive == "displacement_in" or turns_between_readings(readings, noise)
    return {channel: noise} if levelled else {}


def _kept_legs(made: Legs, kept: np.ndarray) -> Legs:
    """Return a drive at some of its readings, its turns among them."""
    return replace(made, values=made.values[kept], turns=np.searchsorted(kept, made.turns))


def with_drive_known(run: MachineRun, lag: float) -> MachineRun:
    """Return a run with NaN for the readings at which a drive with this lag [s] is unknown."""
    time = run.given["time_s"]
    known = (time + lag >= time[0]) & (time + lag <= time[-1])
    measured = {name: np.where(known, values, np.nan) for name, values in run.measured.items()}
    return run if known.all() else replace(run, measured=measured)


def _with_turns_between(run: MachineRun, made: Legs) -> MachineRun:
    """Return the run with a sample at each turn of its drive, between two readings; docs/model.md (70)."""
    at, samples = made.turns, len(run.held_out)
    added = np.zeros(samples + len(at), dtype=bool)
    added[at + np.arange(len(at))] = True
    given = {name: with_turns_between(values, at) for name, values in run.given.items()}
    given[drive_channels(run.drive, run.tendons)[0]] = with_turns(made, np.zeros(len(at)))
    measured = {name: with_added(values, added) for name, values in run.measured.items()}
    held_out = np.insert(run.held_out, at, False)
    return replace(run, given=given, measured=measured, held_out=held_out, legs=made)


def straight_between_readings(run: MachineRun) -> MachineRun:
    """Return a run whose motor goes straight from reading to reading; docs/model.md (304)."""
    if run.legs is None or not run.legs.calm:
        return run
    made, (channel, *_) = run.legs.straight(), drive_channels(run.drive, run.tendons)
    pulls = {name: each.straight() if each.calm else each for name, each in run.inputs.pulls.items()}
    given = {**run.given, channel: with_turns(made, np.zeros(len(made.turns)))}
    return replace(run, given=given, legs=made, inputs=replace(run.inputs, pulls=pulls))


def turns_apart(run: MachineRun, straight: MachineRun) -> bool:
    """Whether turns of a run and of the same run that goes straight between readings can be distinguished."""
    return run.legs is not None and straight.legs is not None and run.legs.differs_from(straight.legs)


def thinned(run: MachineRun, most: int) -> MachineRun:
    """Return a run of at most about so many samples, turns of the drive with them."""
    made, channel = run.legs, drive_channels(run.drive, run.tendons)[0]
    given, measured = (
        {name: run.at_readings(values) for name, values in each.items()} for each in (run.given, run.measured)
    )
    motion, held_out = given[channel], run.at_readings(run.held_out)
    at = _thinned(len(motion), turns_of(motion) if made is None else made.turns, most)
    given = {name: np.ascontiguousarray(values[at]) for name, values in given.items()}
    measured = {name: values[at] for name, values in measured.items()}
    noisy = replace(run.inputs, at=run.inputs.at[at])
    run = replace(run, given=given, measured=measured, held_out=held_out[at], inputs=noisy, legs=None)
    return run if made is None else _with_turns_between(run, _kept_legs(made, at))


def _thinned(samples: int, edges: np.ndarray, most: int) -> np.ndarray:
    """Return which samples stay: evenly chosen ones, and those at which the drive turns."""
    if samples <= most:
        return np.arange(samples)
    return np.union1d(np.unique(np.linspace(0, samples - 1, most).round().astype(int)), edges)


def turns_of(motion: Vector) -> np.ndarray:
    """Return the samples at which a drive begins, turns and ends."""
    return turns(motion, PLAUSIBLE.turn_share * float(np.ptp(motion)))


def _held_out(motion: Vector) -> np.ndarray:
    """Return which samples belong to the last cycles of the drive."""
    edges = turns_of(motion)
    legs_made = len(edges) - 1
    out = np.zeros(len(motion), dtype=bool)
    if legs_made >= 4:
        held = 2 * max(1, round(0.5 * legs_made / READING.cycles))
        out[edges[-1 - held] + 1 :] = True
    return out


def load_remarks(runs: Sequence[MachineRun], rig: Rig) -> list[Remark]:
    """Return the rule that the load of runs breaks together, where the motor does not hold it."""
    return list(load_sign_remarks([Series({**run.given, **run.measured}, rig) for run in runs]))

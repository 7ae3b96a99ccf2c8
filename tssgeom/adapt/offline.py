"""A recorded run that is followed as `live` would, and smoothed afterwards; docs/model.md (200) to (208)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec
import numpy as np

from tssgeom.adapt.ensemble import Ensemble
from tssgeom.adapt.follower import Alert, Follower
from tssgeom.adapt.kinds import with_noise
from tssgeom.adapt.machine_readings import MachineReadings, channels_read
from tssgeom.adapt.readings import CHANNELS, FollowedRig, Readings
from tssgeom.adapt.smoothing import NumberHistory, SmoothedNumbers
from tssgeom.arrays import Matrix, Vector
from tssgeom.channel_names import unit_of
from tssgeom.errors import FitError, SettingsError
from tssgeom.mechanism import tendon_count
from tssgeom.result import Result
from tssgeom.rig import Rig
from tssgeom.statistics import reading_noise
from tssgeom.tendon.machine_simulation import drive_channels, drive_of, with_torque
from tssgeom.tendon.moving import MovingRoute
from tssgeom.tendon.simulation import Measured

_SLICE = 3e-3  # of work on an alert [s]; measured: eight frames of each mechanism
_EXACT = 0.01  # of the noise assumed of a channel [1]; chosen: readings with less are computed, or filtered
_SMOOTHED = 0.1  # between two steps of the smoothing [s]; chosen: far below any drift


class MachineColumns(NamedTuple):
    """Columns of the run of a machine, [n] each; NaN where a reading is missing."""

    time: Vector
    """[s]."""
    channels: Mapping[str, Vector]
    """What was measured, by channel."""

    @property
    def temperature(self) -> None:
        """None: temperature does not act on a machine."""
        return None


class AlertRow(NamedTuple):
    """A disagreement between readings and model, with the likeliest mechanism; empty until compared."""

    time: float
    """When it was certain [s]."""
    since: float
    """[s]"""
    channel: str
    phase: str
    mechanism: str = ""
    where: str = ""
    probability: float = math.nan
    """Of the mechanism, among those that were tried [1]."""
    sentence: str = ""


@dataclass(frozen=True, slots=True)
class Stretch:
    """Part of a run in which the same numbers are followed."""

    keys: tuple[str, ...]
    numbers: SmoothedNumbers


@dataclass(frozen=True, slots=True, repr=False)
class FollowedRun(Result):
    """What following a run gives."""

    time: Vector
    """[n] [s]"""
    ends: Matrix
    """[n, 4] T_in, T_out [N], x_in, x_out [m]; NaN in rows that were not used."""
    ends_se: Matrix
    """[n, 4] Standard errors."""
    stretches: tuple[Stretch, ...]
    """In the order of time; a new one begins where a mechanism was taken into the rig."""
    alerts: tuple[AlertRow, ...]
    rig: Rig
    """As it is at the end."""
    last: FollowedRig
    """What is known at the end."""
    lost: int
    """Rows in which the tendon has no equilibrium."""
    channels: Mapping[str, Matrix] = field(default_factory=dict)
    """[n, 2] Of a machine: what each channel should read, and its standard error, by name."""

    @property
    def keys(self) -> tuple[str, ...]:
        """Every number that was followed at some time."""
        return tuple(dict.fromkeys(key for stretch in self.stretches for key in stretch.keys))


class RunFollower:
    """Follows a recorded run from row to row.

    Parameters
    ----------
    rig
        The rig as its file has it.
    route
        The route over time.
    columns
        The run: a drive without missing samples, and at least one reading beside it.
    seed
        Of the filter.

    Attributes
    ----------
    rig
        That rig, with a noise of each channel.
    notes
        Each channel whose noise was not stated, with what is taken: as its readings show, or, where they are
        exact, what is assumed.

    Raises
    ------
    SettingsError
        Where nothing is measured beside the drive, or the drive lacks a value.
    """

    def __init__(
        self, rig: Rig, route: MovingRoute, columns: Measured | MachineColumns, *, seed: int = 0
    ) -> None:
        self.rig, self.notes = _with_noise(rig, columns)
        self._follower, self._route, self._columns = Follower(self.rig, seed=seed), route, columns
        n = len(columns.time)
        self._ends, self._ends_se = np.full((n, 4), math.nan), np.full((n, 4), math.nan)
        self._histories = list[tuple[tuple[str, ...], NumberHistory]]()
        self._filter: Ensemble | None = None
        self._smoothed = -math.inf
        self._alert: Alert | None = None
        self._alerts = list[AlertRow]()
        self._lost = 0
        self._channels = dict[str, Matrix]()

    def rows(self) -> Iterator[int]:
        """Follow the run; yield after each row its index.

        Raises
        ------
        FitError
            Where the tendon finds no equilibrium in any row.
        """
        run, before = self._columns, math.nan
        for i, time in enumerate(run.time.tolist()):
            arcs = self._route.at(time)
            if isinstance(run, MachineColumns):
                arcs = self._follower.carried.lies_on(arcs)
            try:
                known = self._follower.take(arcs, _readings(run, i), time, _reading(run.temperature, i))
            except FitError:
                self._lost += 1
                if self._follower.known is None and i + 1 == len(run.time):
                    raise
            else:
                self._keep(i, time, known)
            for _ in range(1 if math.isnan(before) else max(1, round((time - before) / _SLICE))):
                self._follower.work()
            self._note_alert(time)
            before = time
            yield i

    def result(self) -> FollowedRun:
        """Return what is known after the rows so far."""
        assert self._follower.known is not None, "follow `rows` first"
        return FollowedRun(
            self._columns.time,
            self._ends,
            self._ends_se,
            tuple(
                Stretch(keys, numbers)
                for keys, history in self._histories
                if len((numbers := history.smoothed()).time)
            ),
            tuple(self._alerts),
            self._follower.rig,
            self._follower.known,
            self._lost,
            self._channels,
        )

    def _keep(self, row: int, time: float, known: FollowedRig) -> None:
        now = self._follower.filter
        assert now is not None
        if now is not self._filter:
            if (
                self._histories and self._alert is not None
            ):  # readings after a fault are no evidence of the time before
                self._histories[-1][1].cut(self._alert.since)
            self._histories.append((now.keys, NumberHistory(len(now.keys))))
            self._filter, self._smoothed = now, -math.inf
        if time >= self._smoothed + _SMOOTHED:
            self._histories[-1][1].take(time, known.values, known.covariance, now.drift.variance)
            self._smoothed = time
        self._ends[row], self._ends_se[row] = known.ends, known.ends_se
        for name, pair in known.read.items():
            if name not in self._channels:
                self._channels[name] = np.full((len(self._ends), 2), math.nan)
            self._channels[name][row] = pair

    def _note_alert(self, time: float) -> None:
        alert = self._follower.alert
        if alert is self._alert or alert is None:
            return
        before, self._alert = self._alert, alert
        row = AlertRow(time, alert.since, alert.channel, alert.phase)
        if before is not None and (before.since, before.channel) == (alert.since, alert.channel):
            row = self._alerts.pop()
        if alert.explanations:
            first = alert.explanations[0]
            row = row._replace(
                mechanism=first.mechanism,
                where=first.where,
                probability=first.probability,
                sentence=first.sentence,
            )
        self._alerts.append(row)


def _readings(run: Measured | MachineColumns, row: int) -> Readings | MachineReadings:
    if isinstance(run, MachineColumns):
        values = {name: float(column[row]) for name, column in run.channels.items()}
        return MachineReadings({name: value for name, value in values.items() if not math.isnan(value)})
    channels = (run.tension_in, run.displacement_in, run.tension_out, run.elongation)
    tension_in, displacement_in, tension_out, elongation = (_reading(one, row) for one in channels)
    return Readings(tension_in, displacement_in, tension_out, elongation)


def _reading(channel: Vector | None, row: int) -> float | None:
    return None if channel is None or math.isnan(channel[row]) else float(channel[row])


def _with_noise(rig: Rig, run: Measured | MachineColumns) -> tuple[Rig, tuple[str, ...]]:
    """Return the rig with a noise of each channel, and a note on each that it did not state."""
    columns = _checked_machine(rig, run) if isinstance(run, MachineColumns) else _checked(run)
    rig, lacking = with_noise(rig, columns)
    sensors, notes = dict(rig.sensors), list[str]()
    for name in (each for each in columns if each in lacking):
        there = np.isfinite(columns[name])
        noise, how = reading_noise(columns[name][there], run.time[there]), "as the readings show"
        if noise <= _EXACT * sensors[name].noise:
            noise, how = sensors[name].noise, "assumed"
        sensors[name] = msgspec.structs.replace(sensors[name], noise=noise)
        notes.append(f"sensors.{name}.noise is not stated: {noise:.2g} {unit_of(name)}, {how}")
    return msgspec.structs.replace(rig, sensors=sensors), tuple(notes)


def _checked(run: Measured) -> dict[str, Vector]:
    """Return what drives and what answers, by channel."""
    by_force = run.displacement_in is None
    drive, beside = ("tension_in_N", 1) if by_force else ("displacement_in_m", 0)
    columns = (run.tension_in, run.tension_out, run.elongation)
    measured = {
        name: column
        for name, column in list(zip(CHANNELS, columns, strict=True))[beside:]
        if column is not None
    }
    if not measured:
        raise SettingsError(
            f"the run has {drive} and no reading beside it: to follow a rig, add a column tension_in_N, "
            "tension_out_N or elongation_m that does not drive"
        )
    driving = run.tension_in if by_force else run.displacement_in
    _require_every_row(run.time, drive, driving)
    return measured if driving is None else {drive: driving, **measured}


def _checked_machine(rig: Rig, run: MachineColumns) -> dict[str, Vector]:
    """Return what drives and what answers, by channel."""
    count = tendon_count(rig.drive, rig.end)
    known = channels_read(rig)
    drives = drive_channels(drive_of(with_torque(run.channels, rig), count), count)
    measured = [name for name in known if name in run.channels and name not in drives]
    if not measured:
        raise SettingsError(
            f"the run has {', '.join(drives)} and no reading beside it: to follow a rig, add a channel that "
            "answers (docs/machines.md)"
        )
    for name in drives:
        _require_every_row(run.time, name, run.channels.get(name))
    return {name: run.channels[name] for name in (*drives, *measured) if name in run.channels}


def _require_every_row(time: Vector, drive: str, column: Vector | None) -> None:
    if column is not None and len(missing := np.flatnonzero(np.isnan(column))):
        raise SettingsError(f"{drive} has no value at time_s = {time[missing[0]]:g}: fill every row")

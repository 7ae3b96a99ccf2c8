"""What a rig of given friction, compliance and zeros would have measured; docs/model.md (70), (71)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from msgspec.structs import replace as changed
from numpy.typing import NDArray

from tssgeom.arrays import Vector
from tssgeom.errors import SettingsError
from tssgeom.identify.measured import Measured
from tssgeom.identify.turning import Legs, legs
from tssgeom.rig import Friction, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.bar_state import pretensioned_bars
from tssgeom.tendon.bars.base import step as bar_step
from tssgeom.tendon.bars.model import predict
from tssgeom.tendon.bars.with_effects import effective_setup
from tssgeom.tendon.history import driven
from tssgeom.tendon.state import rest_tension

_MOST_STRAIN = 0.5  # of the route, before the unit of an elongation is doubted [1]
_MOST_READINGS = {True: 1500, False: 200}  # driven by force, by position
_MOST_TURNS = 8
_BARS = 40
_UNITS = {"friction": "1", "compliance": "1/N", "tension_out_offset": "N", "take_up_tension": "N"}
_WANTED = ("friction", "compliance", "tension_out_offset", "elongation_offset")
_LOGARITHMIC = ("friction", "compliance", "take_up_tension")
_FACTOR = math.log(2.5)  # one standard deviation of what is assumed of friction and compliance beforehand


@dataclass(frozen=True, slots=True)
class Channel:
    """One measured response."""

    name: str
    unit: str
    readings: Vector
    """[m] At the readings that count."""
    used: NDArray[np.intp]
    """[m] Which readings of the run count."""


Play = Callable[..., tuple[Vector, Vector, Vector]]
"""Of a rig and shifts of the turning points [N]: proximal and distal tension [N], and the elongation [m]."""


@dataclass(frozen=True, slots=True)
class Clock:
    """When the readings of a drive were taken, and at which temperature."""

    time: Vector
    """[n] [s]."""
    temperature: Vector
    """[n] [°C]."""


def _player(drive: Legs, arcs: Arcs, clock: Clock) -> Play:
    """Return what drives the tendon through a run; it remembers its last answers, as fits ask twice."""

    @lru_cache(maxsize=4)
    def unit(friction: Friction, pretension: float, *shifts: float) -> tuple[Vector, Vector, Vector]:
        tension_in, sequence, kept = _turned(drive, shifts)
        tendon = Tendon(compliance_per_N=1.0, pretension_N=pretension)
        run = driven(sequence, arcs, Rig(tendon=tendon, friction=friction))
        return tension_in, run.tension_out[kept], run.elongation[kept]

    def play(rig: Rig, *shifts: float) -> tuple[Vector, Vector, Vector]:
        if effective_setup(rig) is not None:
            return _played(drive, arcs, clock, rig, shifts)
        tension_in, out, stretch = unit(rig.friction, rig.tendon.pretension_N, *shifts)
        return tension_in, out, rig.tendon.compliance_per_N * stretch

    return play


def _played(
    drive: Legs, arcs: Arcs, clock: Clock, rig: Rig, shifts: tuple[float, ...]
) -> tuple[Vector, Vector, Vector]:
    """Go through the run with the effects of the rig; a turn lies halfway to the reading before it."""
    tension_in, sequence, kept = _turned(drive, shifts)
    turns = drive.turns
    run = {
        "time_s": np.insert(clock.time, turns, 0.5 * (clock.time[turns - 1] + clock.time[turns])),
        "tension_in_N": sequence,
        "temperature_C": np.insert(clock.temperature, turns, clock.temperature[turns]),
    }
    seen = predict(run, arcs, rig, drive="tension_in_N")
    return tension_in, seen["tension_out_N"][kept], seen["elongation_m"][kept]


def _turned(drive: Legs, shifts: tuple[float, ...]) -> tuple[Vector, Vector, NDArray[np.bool_]]:
    """Return the tension at each reading [N], the same with the turns between, and which are readings."""
    at = np.maximum(drive.turn_values + np.array(shifts), 0.0)
    tension_in = _bounded(drive, at)
    sequence = np.insert(tension_in, drive.turns, at)
    kept = np.ones(len(sequence), dtype=bool)
    kept[drive.turns + np.arange(len(at))] = False
    return tension_in, sequence, kept


@dataclass(frozen=True, slots=True)
class Forward:
    """A run, and what is assumed of its rig before it is fitted."""

    names: tuple[str, ...]
    prior_mean: Vector
    prior_sd: Vector
    channels: tuple[Channel, ...]
    first_sigma: Vector
    missing: tuple[str, ...]
    """Names of what the columns of the run cannot tell."""
    warnings: tuple[str, ...]
    clock: Clock
    drive: Legs
    by_force: bool
    spring_counts: bool
    """True: the elongation was read at the drive alone, and holds the stretch of the distal spring."""
    play: Play
    arcs: Arcs
    rig: Rig

    def on(self, arcs: Arcs) -> Forward:
        """Return the same run on another route."""
        return replace(self, arcs=arcs, play=_player(self.drive, arcs, self.clock))

    def natural(self, k: int, value: float) -> float:
        """Parameter number `k` in its own unit."""
        return math.exp(value) if self.names[k] in _LOGARITHMIC else value

    def unit_of(self, name: str) -> str:
        """Return the unit of a parameter."""
        return "N" if name.startswith("turn_") else _UNITS.get(name, "m")

    def residuals(self, p: Vector) -> list[Vector]:
        """Return what the model gives less what was read, channel by channel."""
        seen = self.predicted(p)
        return [seen[each.name][each.used] - each.readings for each in self.channels]

    def predicted(self, p: Vector) -> dict[str, Vector]:
        """Return what every channel would have shown, [n] each; docs/model.md (71)."""
        value = {name: self.natural(k, p[k]) for k, name in enumerate(self.names)}
        rig = changed(
            self.rig,
            friction=changed(self.rig.friction, coefficient=value["friction"]),
            tendon=changed(
                self.rig.tendon,
                compliance_per_N=value.get("compliance", self.rig.tendon.compliance_per_N),
            ),
        )
        offset = value.get("elongation_offset", 0.0)
        tension_in, out, elongation = (
            self._by_force(rig, value) if self.by_force else self._by_position(rig, offset)
        )
        if self.spring_counts:
            elongation = elongation + (out - rest_tension(rig)) / rig.load.stiffness_N_per_m
        slack = value.get("take_up", 0.0) * np.exp(-tension_in / value.get("take_up_tension", 1.0))
        return {
            "tension_in": tension_in,
            "tension_out": out + value.get("tension_out_offset", 0.0),
            "elongation": elongation + offset - slack,
        }

    def _by_force(self, rig: Rig, value: dict[str, float]) -> tuple[Vector, Vector, Vector]:
        shifts = [value.get(f"turn_{k + 1}", 0.0) for k in range(len(self.drive.turns))]
        return self.play(rig, *shifts)

    def _by_position(self, rig: Rig, offset: float) -> tuple[Vector, Vector, Vector]:
        if effective_setup(rig) is not None:
            return self._placed(rig, offset)
        state = pretensioned_bars(rig, self.arcs, _BARS)
        rows = np.empty((len(self.drive.values), 3))
        for k, place in enumerate(self.drive.values):
            state = bar_step(state, self.arcs, rig, displacement_in=float(place - offset))
            rows[k] = state.tension_in, state.tension_out, state.elongation
        return rows[:, 0], rows[:, 1], rows[:, 2]

    def _placed(self, rig: Rig, offset: float) -> tuple[Vector, Vector, Vector]:
        run = {
            "time_s": self.clock.time,
            "displacement_in_m": self.drive.values - offset,
            "temperature_C": self.clock.temperature,
        }
        seen = predict(run, self.arcs, rig, drive="displacement_in_m")
        return seen["tension_in_N"], seen["tension_out_N"], seen["elongation_m"]


def _bounded(drive: Legs, at: Vector) -> Vector:
    """Keep both legs beside each turn on its near side."""
    values = np.array(drive.values)
    edges = np.concatenate(([0], drive.turns, [len(values) - 1]))
    for k, turn in enumerate(at):
        near = slice(edges[k], edges[k + 2] + 1)
        peak = drive.turn_values[k] > values[edges[k]]
        values[near] = np.minimum(values[near], turn) if peak else np.maximum(values[near], turn)
    return values


def forward_model(measured: Measured, arcs: Arcs, rig: Rig, from_tension: float) -> Forward:
    """Choose what counts in a run, and what it can tell.

    Raises
    ------
    SettingsError
        Where there is no drive or no response.
    """
    by_force = measured.tension_in is not None
    readings = measured.tension_in if by_force else measured.displacement_in
    if readings is None:
        raise SettingsError("the run has no drive: give a column tension_in_N or displacement_in_m")
    kept = np.flatnonzero(np.isfinite(readings))
    kept = kept[:: max(1, -(-len(kept) // _MOST_READINGS[by_force]))]
    if len(kept) < 20:
        raise SettingsError(f"the run has {len(kept)} readings of its drive: give at least 20")
    _check_stretch(measured, arcs)
    drive, clock = legs(readings[kept]), _clock(measured, kept)
    floor = min(from_tension, 0.4 * float(drive.values.max())) if by_force else 0.0
    spring = by_force and measured.elongation is None and measured.displacement_in is not None
    if spring and rig.load.stiffness_N_per_m == 0.0:
        raise SettingsError(
            "displacement_in_m holds the stretch of the load's spring, and load.stiffness_N_per_m is 0; "
            "give the stiffness, or a column elongation_m or displacement_out_m"
        )
    channels = _channels(measured, kept, drive.values, floor, spring, by_force)
    names, mean, sd = _parameters(channels, drive, rig, by_force)
    return Forward(
        names=names,
        prior_mean=mean,
        prior_sd=sd,
        channels=channels,
        first_sigma=np.array([max(0.01 * float(np.ptp(each.readings)), 1e-9) for each in channels]),
        missing=tuple(name for name in _WANTED if name not in names),
        warnings=tuple(_warnings(measured, drive, arcs, rig, spring, by_force)),
        clock=clock,
        drive=drive,
        by_force=by_force,
        spring_counts=spring,
        play=_player(drive, arcs, clock),
        arcs=arcs,
        rig=rig,
    )


def _check_stretch(measured: Measured, arcs: Arcs) -> None:
    """Refuse a tendon that grows by half of its route, which none does."""
    told = measured.elongation
    most = 0.0 if told is None or not np.isfinite(told).any() else float(np.nanmax(np.abs(told)))
    if most > _MOST_STRAIN * arcs.total_length:
        raise SettingsError(
            f"the elongation reaches {most:.3g} m on a route of {arcs.total_length:.3g} m: check its unit, "
            "elongation_m or elongation_mm"
        )


def _clock(measured: Measured, kept: NDArray[np.intp]) -> Clock:
    time, told = measured.time[kept], measured.temperature
    if told is None or not np.isfinite(told).any():
        return Clock(time, np.zeros(len(time)))
    seen = np.isfinite(told)
    return Clock(time, np.interp(time, measured.time[seen], told[seen]))


def _channels(
    measured: Measured, kept: NDArray[np.intp], drive: Vector, floor: float, spring: bool, by_force: bool
) -> tuple[Channel, ...]:
    found = list[Channel]()
    candidates = (
        ("tension_out", "N", measured.tension_out, 0.1 * floor),
        ("elongation", "m", measured.displacement_in if spring else measured.elongation, floor),
    )
    for name, unit, column, least in candidates:
        if column is None:
            continue
        used = np.flatnonzero(np.isfinite(column[kept]) & ((drive >= least) | (not by_force)))
        used = used[_once(column[kept][used])]
        if len(used) >= 10:
            found.append(Channel(name, unit, column[kept][used], used))
    if not found:
        raise SettingsError(
            f"no response with 10 readings above {floor:g} N: give tension_out_N, elongation_m or both"
        )
    return tuple(found)


def _once(readings: Vector) -> NDArray[np.intp]:
    """Return the middle of each run of equal readings: digits that stand still tell one thing once."""
    edges = np.concatenate(([0], np.flatnonzero(np.diff(readings)) + 1, [len(readings)]))
    return (edges[:-1] + edges[1:] - 1) // 2


def _parameters(
    channels: tuple[Channel, ...], drive: Legs, rig: Rig, by_force: bool
) -> tuple[tuple[str, ...], Vector, Vector]:
    """Names, means and standard deviations of what is assumed beforehand."""
    seen = {each.name for each in channels}
    stretch = "elongation" in seen or not by_force
    rows = [("friction", math.log(max(rig.friction.coefficient, 0.01)), _FACTOR)]
    if stretch:
        rows.append(("compliance", math.log(max(rig.tendon.compliance_per_N, 1e-6)), _FACTOR))
    if "tension_out" in seen:
        rows.append(("tension_out_offset", 0.0, 0.2 * float(drive.values.max()) if by_force else 2.0))
    if stretch:
        rows.append(("elongation_offset", 0.0, 10e-3 if by_force else 2e-3))
    if "elongation" in seen and by_force:
        rows += [("take_up", 0.0, 3e-3), ("take_up_tension", math.log(1.3), 0.5)]
    if by_force:
        se = drive.turn_se[:_MOST_TURNS]
        rows += [(f"turn_{k + 1}", 0.0, max(float(each), 1e-6)) for k, each in enumerate(se)]
    names, mean, sd = zip(*rows, strict=True)
    return names, np.array(mean), np.array(sd)


def _warnings(
    measured: Measured, drive: Legs, arcs: Arcs, rig: Rig, spring: bool, by_force: bool
) -> list[str]:
    told = list[str]()
    if not len(drive.turns):
        told.append(
            "the drive never turns back: it takes a pull and a release to tell friction, compliance and zeros"
        )
    if spring or not by_force:
        told.append(
            f"the distal spring of {rig.load.stiffness_N_per_m:g} N/m is taken from the rig: "
            "its error goes into the compliance"
        )
    start = float(drive.values[0]) if by_force else 0.0
    if by_force and start > rig.tendon.pretension_N + 0.2 * float(np.ptp(drive.values)):
        told.append(
            f"the run begins at {start:.3g} N, the pretension is {rig.tendon.pretension_N:g} N: "
            "what happened before is not known"
        )
    if rig.shape.angle_gain_sd == 0.0 and arcs.total_angle_se == 0.0:
        told.append("the angle of the route is taken as exact: set shape.angle_gain_sd in the rig")
    if measured.tension_out is None:
        told.append("no tension_out_N: friction is seen by its hysteresis in the elongation alone")
    return told

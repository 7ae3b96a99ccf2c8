"""Where in the physics something may be missing, and the free law that each mechanism has there.

A law is a curve through a few knots over what was measured; u = 0 is the base model. Source: docs/model.md
(185) to (189); P. H. C. Eilers, B. D. Marx, Flexible smoothing with B-splines and penalties, Stat. Sci. 11
(1996).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.channel_names import unit_of
from tssgeom.core.constants_tendon_rows import TABLE
from tssgeom.effects import AnyEffect, ChannelLag, CreepLaw, FrictionLaw, SensorLaw, StretchLaw
from tssgeom.effects.laws import FrictionOver, SensorOver, StretchOf
from tssgeom.identify.prediction import CELLS, Stack
from tssgeom.identify.readings import Reading
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs


@dataclass(frozen=True, slots=True)
class KnotSettings:
    """Where the knots of a law lie, and how far it may go."""

    usual: int = 7
    """Knots over tension, speed, time, travel, position and reading; chosen: two or three for each bend of a
    law that has been met, three for each decade of speed."""
    over_curvature: int = 4
    """Knots; chosen: a route has a few curvatures."""
    along: int = 10
    """Knots over the arc length; chosen: a tenth of the length is what several routes can part."""
    creep_s: tuple[float, ...] = (0.02, 0.1, 0.5)
    """Of the duration of a run: times of creep [1]; chosen: they cover the run."""
    reported: int = 25
    """Points of a curve in a report; chosen."""
    slow: float = 0.03
    """Of the fastest speed: the slowest knot but that at rest [1]; chosen."""
    stretch: float = 0.1
    """Of the elastic stretch at the greatest tension: unit of a stretch [1]; chosen."""
    load: float = 0.5
    """Of how far torques go: unit of a load [1]; chosen."""
    sensor_unit: float = 5.0
    """Of the noise: unit of the error of a sensor [1]; chosen."""
    sensor_share: float = 0.01
    """Of what was read: the same for machines, where it is more [1]; chosen: a wheel 1 % off its centre."""
    drift_share: float = 0.1
    """The same over time, where it is more [1]; chosen: three swings in a run are within what is tried."""
    lag_s: float = 0.05
    """Unit of a lag, and of the time in which friction follows the speed [s]; chosen."""


KNOTS = KnotSettings()
FINEST = KnotSettings(usual=TABLE.most, over_curvature=TABLE.most, along=TABLE.most)
"""As many knots as a law of a rig can have; with more, bands hold no more often, (294)."""
_MOST = math.log(10.0)  # of ln f: friction by more than a factor of ten is at its bound


@dataclass(frozen=True, slots=True)
class Mechanism:
    """One free law: what it acts on, over what, and the effect that a vector u of its knots makes."""

    name: str
    """As in a report: `friction_over_speed`; with the channel, or which end, behind a colon."""
    x: Vector
    """[k] Knots, in SI; of creep, which has times for knots, any number of times since a step of tension."""
    warped: Vector
    """[k] The knots where steps are even to the law: its differences are taken there, over 0 to 1."""
    effect: Callable[[Vector], AnyEffect]
    """Takes u [k]; raises SettingsError beyond what physics allows."""
    value: Callable[[Vector], Vector]
    """Takes u [k]; gives the law at x, in SI; friction without the coefficient."""
    unit: str
    """Of the value."""
    over: str
    """Name of x with its unit, as in a report."""
    lower: float | Vector = -math.inf
    """Least u."""
    upper: float | Vector = math.inf
    pinned: bool = False
    """Whether the law is 0 at its first knot."""
    rising: bool = False
    """Whether u are the steps from knot to knot, none of which falls."""
    more: int = 0
    """Numbers behind those of the knots, which the law is no curve of."""
    has_slope: bool = False
    """Whether the base model has a number for the slope of the law, beside that for its level."""
    is_straight: bool = False
    """Whether readings follow the law in straight lines, however far it goes."""

    @property
    def size(self) -> int:
        """Numbers that are fitted."""
        return len(self.warped) - self.pinned + self.more


def mechanisms(stack: Stack, rig: Rig, knots: KnotSettings = KNOTS) -> tuple[Mechanism, ...]:
    """Return the free laws that these readings could show."""
    return tuple(one for make in _MAKERS for one in make(stack, rig, knots))


def friction_law(over: FrictionOver, x: Vector, unit: str) -> Mechanism:
    """Return friction over what it depends on, from knots and the unit of these."""
    knots = tuple(x.tolist())

    def effect(u: Vector) -> AnyEffect:
        return FrictionLaw(over=over, x=knots, factor=tuple(np.exp(u).tolist()))

    even = (x - x[0]) / (x[-1] - x[0])
    name = f"{over}_{unit}"
    bounds = (-_MOST, _MOST)
    return Mechanism(f"friction_over_{over}", x, even, effect, np.exp, "1", name, *bounds)


def speed_law(x: Vector) -> Mechanism:
    """Return friction over speed that follows it within a time; docs/model.md (185)."""
    knots, most = tuple(x.tolist()), np.append(np.full(len(x), _MOST), np.inf)

    def value(u: Vector) -> Vector:
        return np.exp(u[:-1])

    def effect(u: Vector) -> AnyEffect:
        with np.errstate(over="ignore"):  # the law refuses what is infinite
            memory = KNOTS.lag_s * float(np.exp(u[-1]))
        return FrictionLaw(over="speed", x=knots, factor=tuple(value(u).tolist()), memory_s=memory)

    even = np.linspace(0.0, 1.0, len(x))
    law = "friction_over_speed", x, even, effect, value, "1", "speed_m_per_s"
    return Mechanism(*law, -most, most, more=1)


def _frictions(stack: Stack, rig: Rig, knots: KnotSettings) -> Iterator[Mechanism]:
    runs = stack.readings
    least, most = _tensions(runs, rig)
    if most - least > PLAUSIBLE.slight * most:
        yield friction_law("tension", np.linspace(least, most, knots.usual), "N")
    yield from speed_and_route_laws(_fastest(runs), [run.route.arcs for run in runs], knots)
    travel, time = max(_travel(run) for run in runs), max(float(np.ptp(run.time)) for run in runs)
    yield friction_law("travel", np.linspace(0.0, travel, knots.usual), "m")
    yield friction_law("time", np.linspace(0.0, time, knots.usual), "s")
    if all("displacement_in_m" in run.given for run in runs):
        pulled = np.concatenate([run.given["displacement_in_m"] for run in runs])
        if np.ptp(pulled) > 0.0:
            low, high = float(pulled.min()), float(pulled.max())
            yield friction_law("position", np.linspace(low, high, knots.usual), "m")


def speed_and_route_laws(fast: float, arcs: Sequence[Arcs], knots: KnotSettings) -> Iterator[Mechanism]:
    """Yield friction over speed up to the fastest [m/s], and over curvature and arc length of the routes."""
    if fast > 0.0:
        yield speed_law(fast * np.concatenate(([0.0], np.geomspace(KNOTS.slow, 1.0, knots.usual - 1))))
    bends = np.concatenate([each.angle / each.length for each in arcs])
    curved = bends[bends > 0.0].tolist()
    if curved and max(curved) - min(curved) > PLAUSIBLE.slight * max(curved):
        yield friction_law("curvature", np.linspace(min(curved), max(curved), knots.over_curvature), "per_m")
    length = min(each.total_length for each in arcs)
    yield friction_law("arc_length", np.linspace(0.0, length, knots.along), "m")


def _stretches(stack: Stack, rig: Rig, knots: KnotSettings) -> Iterator[Mechanism]:
    _, most = _tensions(stack.readings, rig)
    length = min(run.route.arcs.total_length for run in stack.readings)
    strain = KNOTS.stretch * rig.tendon.compliance_per_N * most
    x = _over_tension(most, knots.usual)
    which: tuple[tuple[StretchOf, str, float, str], ...] = (
        ("sheath", "strain_over_tension", strain, "1"),
        ("proximal", "stretch_at_end:proximal", strain * length, "m"),
        ("distal", "stretch_at_end:distal", strain * length, "m"),
        ("load", "load_over_position", strain * length, "m"),
    )
    channels = {name for run in stack.readings for name in run.measured}
    for of, name, unit, si in which:
        if of != "load" or channels & {"displacement_out_m", "elongation_m"}:
            yield _stretch(of, name, x, unit, si)


def strain_law(compliance: float, most: float, knots: int) -> Mechanism:
    """Return the strain of a sheath over tension, from its compliance [1/N] and the greatest tension [N]."""
    unit = KNOTS.stretch * compliance * most
    return _stretch("sheath", "strain_over_tension", _over_tension(most, knots), unit, "1")


def _over_tension(most: float, knots: int) -> Vector:
    """Return knots of a stretch [knots] [N], denser where it is less."""
    return np.concatenate(([0.0], most * np.linspace(0.0, 1.0, knots)[1:] ** 1.5))


def _stretch(of: StretchOf, name: str, x: Vector, unit: float, si: str) -> Mechanism:
    """Return a stretch over tension; that of an end has no compliance beside it, so that no step may fall."""
    knots, rising = tuple(x.tolist()), of in ("proximal", "distal")

    def value(u: Vector) -> Vector:
        return unit * np.concatenate(([0.0], np.cumsum(u) if rising else u))

    def effect(u: Vector) -> AnyEffect:
        return StretchLaw(of=of, x=knots, stretch=tuple(value(u).tolist()))

    lower = 0.0 if rising else -math.inf
    law = name, x, np.sqrt(x / x[-1]), effect, value, si, "tension_N", lower
    return Mechanism(*law, pinned=True, rising=rising)


def creep_law(times: Vector, since: Vector) -> Mechanism:
    """Return late strain by elements with some times, reported at times since a step of tension [s]."""
    share = -np.expm1(-since[:, None] / times)

    def value(u: Vector) -> Vector:
        return KNOTS.stretch * share @ u

    def effect(u: Vector) -> AnyEffect:
        return CreepLaw(time_s=tuple(times.tolist()), ratio=tuple((KNOTS.stretch * u).tolist()))

    return Mechanism(
        "strain_over_time", since, np.linspace(0.0, 1.0, len(times)), effect, value, "1", "time_s", lower=0.0
    )


def _creeps(stack: Stack, rig: Rig, knots: KnotSettings) -> Iterator[Mechanism]:
    span = max(float(np.ptp(run.time)) for run in stack.readings)
    times = span * np.array(KNOTS.creep_s)  # what is faster is elastic to these readings
    yield creep_law(times, np.linspace(times[0], span, KNOTS.reported))


def _sensors(stack: Stack, rig: Rig, knots: KnotSettings) -> Iterator[Mechanism]:
    runs = stack.readings
    span = max(float(np.ptp(run.time)) for run in runs)
    for channel in dict.fromkeys((*(name for run in runs for name in run.measured), runs[0].drive)):
        columns = [run.measured.get(channel, run.given.get(channel)) for run in runs]
        read = np.concatenate([column[np.isfinite(column)] for column in columns if column is not None])
        scale = KNOTS.sensor_unit * max(run.noise.get(channel, 0.0) for run in runs)
        if channel in CELLS and np.ptp(read) > 0.0:
            x = np.linspace(float(read.min()), float(read.max()), knots.usual)
            yield sensor_law(channel, "reading", x, scale, unit_of(channel))
            yield sensor_law(
                channel, "time_gain", np.linspace(0.0, span, knots.usual), scale / read.max(), "1"
            )
        yield sensor_law(channel, "time", np.linspace(0.0, span, knots.usual), scale, unit_of(channel))
    yield _lag(runs[0].drive)


_SENSOR_LAWS: dict[SensorOver, str] = {
    "reading": "sensor_curve",
    "time": "sensor_drift",
    "time_gain": "sensor_gain_drift",
}


def sensor_law(channel: str, over: SensorOver, x: Vector, scale: float, unit: str) -> Mechanism:
    """Return what a channel reads beside the truth, over it or over time; docs/model.md (188), (344)."""
    knots = tuple(x.tolist())

    def value(u: Vector) -> Vector:
        return scale * u

    def effect(u: Vector) -> AnyEffect:
        return SensorLaw(channel=channel, over=over, x=knots, error=tuple(value(u).tolist()))

    name = f"{_SENSOR_LAWS[over]}:{channel}"
    even = (x - x[0]) / (x[-1] - x[0])
    label = channel if over == "reading" else "time_s"
    return Mechanism(name, x, even, effect, value, unit, label, is_straight=True)


def _lag(channel: str) -> Mechanism:
    """Return the lag of the drive, which is one number and no curve."""

    def value(u: Vector) -> Vector:
        return KNOTS.lag_s * u

    def effect(u: Vector) -> AnyEffect:
        return ChannelLag(lag_s=float(value(u)[0]), channel=channel)  # type: ignore[arg-type]

    x = np.zeros(1)
    return Mechanism(f"sensor_lag:{channel}", x, x, effect, value, "s", "channel", lower=0.0)


_MAKERS = (_frictions, _stretches, _creeps, _sensors)


def _tensions(runs: Sequence[Reading], rig: Rig) -> tuple[float, float]:
    """Return the least and greatest tension that was measured, else that the drive would make [N]."""
    read = [run.measured.get(name, run.given.get(name)) for run in runs for name in CELLS]
    there = [column[np.isfinite(column)] for column in read if column is not None]
    if there:
        values = np.concatenate(there)
        return max(float(np.quantile(values, 0.005)), 0.0), float(values.max())
    pulled = max(float(np.ptp(run.given[run.drive])) for run in runs)
    length = min(run.route.arcs.total_length for run in runs)
    soft = rig.tendon.compliance_per_N * length + 1.0 / max(rig.load.stiffness_N_per_m, 1e-9)
    return 0.0, rig.tendon.pretension_N + pulled / soft


def _fastest(runs: Sequence[Reading]) -> float:
    """Return the speed of the drive's end that is passed in a hundredth of the samples [m/s]."""
    name = "displacement_in_m"
    for columns in ([run.given for run in runs], [run.measured for run in runs]):
        own = [(each[name], run.time) for each, run in zip(columns, runs, strict=True) if name in each]
        if own:
            speeds = np.concatenate([np.abs(np.gradient(*each)) for each in own])
            return float(np.nanquantile(speeds, 0.99))
    return 0.0


def _travel(run: Reading) -> float:
    column = run.given.get("displacement_in_m", run.measured.get("displacement_in_m"))
    if column is None:
        return 0.01 * len(run.time)
    return float(np.abs(np.diff(column[np.isfinite(column)])).sum())

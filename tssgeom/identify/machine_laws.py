"""Free laws of a machine: friction and stretch of its tendons by curves, as waves of their prior.

A fit of a machine counts every number in standard deviations of what is assumed of it. The values of a law at
its knots are assumed together; what is fitted are the waves that make them up. Source: docs/model.md (311).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, product

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector
from tssgeom.channel_names import numbered, unit_of_key
from tssgeom.core.constants_tendon_rows import TABLE
from tssgeom.effects import AnyEffect, LoadLaw
from tssgeom.identify.law_fit import LAW_FIT
from tssgeom.identify.law_smoothness import law_precision
from tssgeom.identify.machine_run import MachineRun
from tssgeom.identify.mechanisms import (
    KNOTS,
    Mechanism,
    friction_law,
    sensor_law,
    speed_and_route_laws,
    speed_law,
    strain_law,
)
from tssgeom.mechanism import OF_END
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.rig import Rig

ANGLE = OF_END["joint"][0]


@dataclass(frozen=True, slots=True)
class WaveSettings:
    """Which waves of a law are fitted."""

    least: float = 0.02
    """Of u at some knot: waves that stay below it are left out [1]; chosen: friction by two hundredths."""
    step: float = 0.1
    """Of u at some knot: step of a derivative [1]; chosen."""


WAVES = WaveSettings()


@dataclass(frozen=True, slots=True, eq=False)
class FreeLaw:
    """A law of a mechanism; each wave of it has a standard deviation of one."""

    mechanism: Mechanism
    roughness: float
    waves: Matrix
    """[k, waves] u at the knots."""

    @property
    def name(self) -> str:
        """Of the mechanism."""
        return self.mechanism.name

    @property
    def size(self) -> int:
        """Numbers that are fitted."""
        return self.waves.shape[1]

    def effect(self, numbers: Vector) -> AnyEffect:
        """Return the effect; raises SettingsError beyond what physics allows."""
        return self.mechanism.effect(self.waves @ numbers)

    def at_bound(self, numbers: Vector) -> bool:
        """Whether the law is at a bound that physics does not give."""
        return bool(np.any(np.abs(self.waves @ numbers) >= self.mechanism.upper))

    @property
    def steps(self) -> Vector:
        """Steps of derivatives by each wave [waves]."""
        return np.asarray(WAVES.step / np.abs(self.waves).max(axis=0))

    def as_rough(self, orders: tuple[int, ...] = (2,), least: float = WAVES.least) -> tuple[FreeLaw, ...]:
        """Return the law with every prior that leaves it a wave: roughness and order of what it holds."""
        priors = product(orders, LAW_FIT.roughness)
        every = (_free_law(self.mechanism, rough, order, least) for order, rough in priors)
        return tuple(one for one in every if one.size)

    def with_knots(self, count: int) -> FreeLaw:
        """Return a law of friction with so many knots, all waves of which are kept."""
        one = self.mechanism
        over = one.name.removeprefix("friction_over_")
        if over == one.name:
            return _free_law(one, self.roughness, least=0.0)
        even = np.linspace(0.0, 1.0, count)
        x = core.tabulated(core.table_of(one.warped, one.x), even)
        if over == "speed":
            return _free_law(speed_law(x), self.roughness, least=0.0)
        finer = friction_law(over, x, one.over.removeprefix(f"{over}_"))  # type: ignore[arg-type]
        return _free_law(replace(finer, warped=even), self.roughness, least=0.0)

    def numbers_of(self, other: FreeLaw, numbers: Vector) -> Vector:
        """Return the numbers with which this law goes through the knots of another one [waves]."""
        theirs, own = other.mechanism, self.mechanism
        curve, more = np.split(other.waves @ numbers, [theirs.size - theirs.more])
        values = np.concatenate([np.zeros(int(theirs.pinned)), curve])
        there = core.tabulated(core.table_of(theirs.warped, values), own.warped)[int(own.pinned) :]
        return np.asarray(np.linalg.pinv(self.waves) @ np.concatenate([there, more]), dtype=np.float64)


def _free_law(one: Mechanism, roughness: float, order: int = 2, least: float = WAVES.least) -> FreeLaw:
    """Return a law that does not do what the base model has a number for; docs/model.md (311)."""
    covariance = np.linalg.inv(law_precision(one, roughness, LAW_FIT.level, order))
    of_base = one.x[1:, None] / one.x[-1] if one.pinned else np.ones((one.size - one.more, 1))
    if one.has_slope:
        of_base = np.column_stack([of_base, one.x / np.abs(one.x).max()])
    of_base = np.pad(of_base, ((0, one.more), (0, 0)))
    others = np.eye(one.size) - of_base @ np.linalg.pinv(of_base)
    size, waves = np.linalg.eigh(others @ covariance @ others)
    waves = (waves * np.sqrt(np.maximum(size, 0.0)))[:, : of_base.shape[1] - 1 : -1]  # not the base model's
    return FreeLaw(one, roughness, waves[:, np.abs(waves).max(axis=0) > least])


def free_laws(
    runs: Sequence[MachineRun], moved: Sequence[Mapping[str, Vector]], rig: Rig
) -> tuple[FreeLaw, ...]:
    """Return the laws that runs may show, each as straight as is tried.

    Parameters
    ----------
    runs
        What is fitted.
    moved
        Every channel of each run as a fitted machine has it.
    rig
        That machine.
    """
    every = _mechanisms(runs, moved, rig)
    return tuple(_free_law(one, LAW_FIT.roughness[0]).as_rough()[0] for one in every)


def _mechanisms(
    runs: Sequence[MachineRun], moved: Sequence[Mapping[str, Vector]], rig: Rig
) -> Iterator[Mechanism]:
    count, usual = runs[0].tendons, KNOTS.usual
    ends = [name for end in ("in", "out") for name in numbered(f"tension_{end}_N", count)]
    pulls = np.concatenate([each[name] for each in moved for name in ends])
    ways = [[each[name] for name in numbered("displacement_in_m", count)] for each in moved]
    times = [run.given["time_s"] for run in runs]
    least, most = float(np.quantile(pulls, 0.005)), float(pulls.max())
    if most - least > PLAUSIBLE.slight * most:
        yield friction_law("tension", np.linspace(max(least, 0.0), most, usual), "N")
        yield strain_law(rig.tendon.compliance_per_N, most, usual)
    speeds = np.concatenate(
        [np.abs(np.diff(way) / np.diff(time)) for time, own in zip(times, ways, strict=True) for way in own]
    )
    fast = float(np.quantile(speeds, 0.99))
    yield from speed_and_route_laws(fast, [each for run in runs for each in run.routes], KNOTS)
    every = list(chain.from_iterable(ways))
    travel = max(float(np.abs(np.diff(way)).sum()) for way in every)
    repeats, longest = len(runs) > 1, max(float(np.ptp(each)) for each in times)
    if repeats and travel > 0.0:  # of one run nothing repeats what else changes on its way
        yield friction_law("travel", np.linspace(0.0, travel, usual), "m")
        yield friction_law("time", np.linspace(0.0, longest, usual), "s")
    if rig.end.kind == "joint":
        read = [run.measured.get(ANGLE, own[ANGLE]) for run, own in zip(runs, moved, strict=True)]
        turned = np.concatenate([[0.0], *(each[np.isfinite(each)] for each in read)])
        if np.ptp(turned) > 0.0:
            low, high = float(turned.min()), float(turned.max())
            yield load_law(low, high, rig.end.radius_m * (most - least))
    for channel in dict.fromkeys(name for run in runs for name in run.measured):
        those = [run for run in runs if channel in run.measured]
        read = np.concatenate([run.measured[channel] for run in those])
        least, most = float(np.nanmin(read)), float(np.nanmax(read))
        if most > least:
            noise = KNOTS.sensor_unit * max(run.noise[channel] for run in those)
            scale = max(noise, KNOTS.sensor_share * (most - least))
            x = np.linspace(least, most, usual)
            yield sensor_law(channel, "reading", x, scale, unit_of_key(channel))
            if repeats:  # what swings needs as many knots as a rig can hold, (351)
                since = np.linspace(0.0, longest, TABLE.most)
                far = max(noise, KNOTS.drift_share * (most - least))
                yield sensor_law(channel, "time", since, far, unit_of_key(channel))
    low, high = min(float(way.min()) for way in every), max(float(way.max()) for way in every)
    if high > low:
        yield friction_law("position", np.linspace(low, high, usual), "m")


def load_law(low: float, high: float, torque: float) -> Mechanism:
    """Return the torque of a joint over its angle [rad], from how far torques go [N·m]; (350)."""
    x = np.linspace(low, high, TABLE.most - 1)  # so that one may lie amid the others
    x[np.abs(x).argmin()] = 0.0  # whatever its load
    rest, knots, unit = x == 0.0, tuple(x.tolist()), KNOTS.load * torque

    def value(u: Vector) -> Vector:
        return unit * (u - u[rest])

    def effect(u: Vector) -> AnyEffect:
        return LoadLaw(x=knots, torque=tuple(value(u).tolist()))

    even = (x - x[0]) / (x[-1] - x[0])
    return Mechanism("load_over_position", x, even, effect, value, "N·m", ANGLE, has_slope=True)

"""Laws that are curves: what friction, stretch or a sensor does where no formula of the library fits.

Each is a list of points, with a cubic between them that does not overshoot (PCHIP), and constant beyond its
ends. Source: F. N. Fritsch, R. E. Carlson, Monotone piecewise cubic interpolation, SIAM J. Numer. Anal. 17
(1980); docs/model.md (185) to (188).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar, Literal, TypeAlias

import numpy as np

from tssgeom import core
from tssgeom.arrays import Vector
from tssgeom.core.constants_tendon_rows import TABLE
from tssgeom.effects.kinds import Curve, Effect, Hook, Setup
from tssgeom.errors import SettingsError

FrictionOver = Literal["tension", "speed", "curvature", "arc_length", "travel", "time", "position"]
"""What friction may depend on, in N, m/s, 1/m, m, m, s, m."""
StretchOf = Literal["sheath", "proximal", "distal", "load"]
SensorOver = Literal["reading", "time", "time_gain"]
_FRICTION_TABLES = {
    "tension": "load",
    "speed": "speed",
    "curvature": "curvature",
    "arc_length": "arc",
    "travel": "travel",
    "time": "time",
    "position": "position",
}
_STRETCH_TABLES = {
    "sheath": "strain",
    "proximal": "stretch_in",
    "distal": "stretch_out",
    "load": "load_path",
}
OF_JOINT = "load of the joint"
"""The curve of a setup that acts on a joint, and not in a tendon."""
_MOST_FACTOR = 100.0  # chosen: more friction than that is a clamp


class FrictionLaw(Effect, frozen=True):
    """Friction over what it depends on: μ times a factor; docs/model.md (185).

    `travel` is the path that each contact has slid, `position` how far the tendon was pulled in.
    """

    hook: ClassVar[Hook] = "friction cone"
    over: FrictionOver
    x: tuple[float, ...]
    """[k] What friction depends on, increasing, in SI."""
    factor: tuple[float, ...]
    """[k] Friction over the coefficient of the rig [1]."""
    memory_s: float = 0.0
    """Time in which friction follows the speed [s]."""

    def __post_init__(self) -> None:
        check_points("friction_law", self.x, self.factor, "factor")
        if not 0.0 <= self.memory_s < math.inf or (self.memory_s and self.over != "speed"):
            raise SettingsError(
                f"effects.friction_law.memory_s is {self.memory_s:g} over {self.over}: give >= 0 s, "
                "and only over speed"
            )
        if min(self.factor) < 0.0 or max(self.factor) > _MOST_FACTOR:
            raise SettingsError(f"effects.friction_law.factor: give 0 to {_MOST_FACTOR:g}")

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this law in it."""
        setup = replace(setup, speed_memory_s=self.memory_s) if self.over == "speed" else setup
        return with_curve(setup, Curve(_FRICTION_TABLES[self.over], self.x, self.factor))


class StretchLaw(Effect, frozen=True):
    """Stretch over tension beside what the compliance gives; docs/model.md (186).

    Inside the sheath it is a strain; of the proximal or distal end, and of the load, a path in metres.
    """

    hook: ClassVar[Hook] = "bar law"
    of: StretchOf
    x: tuple[float, ...]
    """[k] Tension, increasing [N]."""
    stretch: tuple[float, ...]
    """[k] Strain [1] of the sheath, else path [m]."""

    def __post_init__(self) -> None:
        check_points("stretch_law", self.x, self.stretch, "stretch")

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this law in it.

        Raises SettingsError where the tendon would grow shorter under more tension.
        """
        y = np.array(self.stretch)
        soft = setup.load_stiffness**-1.0 if self.of == "load" and setup.load_stiffness > 0.0 else 0.0
        if self.of == "sheath":
            y, soft = y / setup.compliance, 1.0
        if np.any(np.diff(y) + soft * np.diff(self.x) < 0.0):
            raise SettingsError(
                f"effects.stretch_law of {self.of}: shorter under more tension; give a rising stretch"
            )
        return with_curve(setup, Curve(_STRETCH_TABLES[self.of], self.x, tuple(y.tolist())))


class CreepLaw(Effect, frozen=True):
    """Strain that follows the tension late, with up to three times; docs/model.md (57), (187).

    Kelvin–Voigt elements in a row. Source: as the effect `creep`.
    """

    hook: ClassVar[Hook] = "eigenstrain"
    time_s: tuple[float, ...]
    """[n] Time constants, increasing [s]."""
    ratio: tuple[float, ...]
    """[n] Creep of each in the end over elastic strain [1]."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.time_s) == len(self.ratio) <= _CREEPS:
            raise SettingsError(f"effects.creep_law: give one to {_CREEPS} times, and as many ratios")
        if not (min(self.time_s) > 0.0 and min(self.ratio) >= 0.0 and max(self.ratio) < _MOST_FACTOR):
            raise SettingsError("effects.creep_law: give positive times, and ratios from 0 on")

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this law in it; raises SettingsError where there is creep already."""
        if setup.creep_ratio or setup.more_creep:
            raise SettingsError("effects: creep is given twice; keep creep or creep_law")
        elements = [(r, t) for r, t in zip(self.ratio, self.time_s, strict=True) if r > 0.0]
        if not elements:
            return setup
        (ratio, time), *more = elements
        return replace(setup, creep_ratio=ratio, creep_time_s=time, more_creep=tuple(more))


class SensorLaw(Effect, frozen=True):
    """What a channel reads beside the truth, over the true value or over time; docs/model.md (188), (344)."""

    hook: ClassVar[Hook] = "observation"
    channel: str
    """Of one tendon or of a machine, by its name with the unit."""
    over: SensorOver
    """The true value, or time: of what adds to it (`time`), or of the gain (`time_gain`)."""
    x: tuple[float, ...]
    """[k] True value [N, m], or time since the run began [s]; increasing."""
    error: tuple[float, ...]
    """[k] Reading less truth [N, m]; of a gain over the truth [1]."""

    def __post_init__(self) -> None:
        check_points("sensor_law", self.x, self.error, "error")

    @property
    def curve(self) -> Curve:
        """Reading less truth, by the name that `with_curve` takes."""
        return Curve(f"{self.channel} over {self.over}", self.x, self.error)

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this law in it."""
        return with_curve(setup, self.curve)


class LoadLaw(Effect, frozen=True):
    """Torque against a joint over its angle, beside its stiffness and its weight; docs/model.md (350)."""

    hook: ClassVar[Hook] = "boundary"
    x: tuple[float, ...]
    """[k] Angle of the joint, increasing [rad]."""
    torque: tuple[float, ...]
    """[k] Against the joint [N·m]."""

    def __post_init__(self) -> None:
        check_points("load_law", self.x, self.torque, "torque")

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this law in it."""
        return with_curve(setup, Curve(OF_JOINT, self.x, self.torque))


Law: TypeAlias = FrictionLaw | StretchLaw | CreepLaw | SensorLaw | LoadLaw
"""Any law."""
_CREEPS = 3  # derived: elements of creep that the core has


def check_points(name: str, x: tuple[float, ...], y: tuple[float, ...], key: str) -> None:
    """Refuse points that make no curve.

    Raises
    ------
    SettingsError
        With what is wrong, and what to give.
    """
    where = f"effects.{name}"
    if not 2 <= len(x) <= TABLE.most or len(x) != len(y):
        raise SettingsError(f"{where}: {len(x)} x and {len(y)} {key}: give 2 to {TABLE.most} of each")
    if not np.isfinite([*x, *y]).all() or np.any(np.diff(x) <= 0.0):
        raise SettingsError(f"{where}: x has to increase, and all numbers have to be finite")


def with_curve(setup: Setup, curve: Curve) -> Setup:
    """Return the setup with one curve more; raises SettingsError where it has one for the same."""
    if any(each.table == curve.table for each in setup.curves):
        raise SettingsError(f"effects: two laws over the same ({curve.table}); keep one of them")
    return replace(setup, curves=(*setup.curves, curve))


def table(curve: Curve) -> Vector:
    """Return a curve as a table of the core [37]."""
    return core.table_of(np.array(curve.x), np.array(curve.y))


def curve_at(curve: Curve, at: Vector) -> Vector:
    """Return the values of a curve at some arguments, constant beyond its ends."""
    return core.tabulated(table(curve), np.ascontiguousarray(at, dtype=np.float64))

"""Numbers of a rig that are followed, and a plant as straight lines over them; docs/model.md (200), (201)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import msgspec
import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import KINDS, AnyEffect
from tssgeom.errors import SettingsError
from tssgeom.mechanism import channels_of
from tssgeom.rig import Follow, Rig, Sensor, with_values
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.model import model_of, setup_of

RIG_KEYS = (
    "friction.coefficient",
    "tendon.compliance_per_N",
    "tendon.pretension_N",
    "load.stiffness_N_per_m",
    "route.angle_gain",
)
"""Numbers of a rig, beside the parameters of effects, that can be followed."""


class DefaultDrift(NamedTuple):
    """What is followed where the rig states nothing. Chosen: what sheaths and load cells usually do."""

    friction_sd: float = 0.1
    """Standard deviation of friction at the start, and of its change in an hour, over its value [1]."""
    friction_hourly: float = 0.2
    zero_sd_N: float = 0.1
    """Of the zero of each tension [N]."""
    zero_hourly_N: float = 0.05


DEFAULT = DefaultDrift()
MACHINE_KEYS = (
    "drive.radius_m",
    "drive.coupling",
    "drive.play_rad",
    "drive.friction_Nm",
    "end.radius_m",
    "end.stiffness_Nm_per_rad",
    "end.gravity_Nm",
    "end.friction_Nm",
    "end.play_rad",
)
"""The same of a machine, beside `zero` and `gain` of each of its `sensors`."""
_SLOPE_STEP = 1e-3
"""Share of the scale of a number for its straight line [1]; chosen: rounding and bend are both far below."""
_LEAST_SHARE = 0.01  # of an arm or a gain, below which none goes [1]; chosen: far from any that works
_OF_RIG = (*RIG_KEYS, *MACHINE_KEYS, "sensors.")
_ZEROS = {"tension_in_N": "tension_in_offset.offset_N", "tension_out_N": "tension_out_offset.offset_N"}
_OF_DISTAL_CELL = ("tension_out_gain.", "tension_out_offset.", "load_cell_crosstalk.")
_SENSORS = 5  # numbers of `SensorNumbers`


class SensorNumbers(NamedTuple):
    """Gains and zeros of both tensions, and how much of T_in the distal cell reads."""

    gain_in: float
    zero_in: float
    gain_out: float
    zero_out: float
    crosstalk: float


@dataclass(frozen=True, slots=True)
class FollowedNumber:
    """One number of a rig that drifts."""

    key: str
    """`friction.coefficient`, or an effect and its parameter: `tension_in_offset.offset_N`."""
    value: float
    """In the rig."""
    sd: float
    """Standard deviation at the start, in its unit."""
    hourly_change: float
    """Standard deviation of its change in an hour, in its unit."""
    lower: float
    upper: float

    @property
    def of_sensor(self) -> bool:
        """Whether it changes what a sensor reads, and nothing else."""
        kind = KINDS.get(self.key.partition(".")[0])
        return self.key.startswith("sensors.") or (kind is not None and kind.hook == "observation")

    @property
    def scale(self) -> float:
        """A size of it that matters."""
        return max(self.sd, 0.01 * abs(self.value))


class Limits(NamedTuple):
    """Bounds and sizes of followed numbers, [d] each."""

    lower: Vector
    upper: Vector
    scale: Vector


@lru_cache(maxsize=64)
def limits_of(numbers: tuple[FollowedNumber, ...]) -> Limits:
    """Return bounds and sizes of numbers as arrays."""
    columns = [(one.lower, one.upper, one.scale) for one in numbers]
    return Limits(*np.ascontiguousarray(np.array(columns).reshape(-1, 3).T))


def followed_numbers(rig: Rig, measured: Sequence[str]) -> tuple[FollowedNumber, ...]:
    """Return what a rig names to be followed, else friction, and with either zeros of `measured` tensions.

    A zero that drifts and is not followed draws friction with it. Numbers of a load cell at the distal end
    are left out where T_out is not measured: nothing depends on them.

    Raises
    ------
    SettingsError
        Where a key is none that can be followed.
    """
    zeros = _machine_zeros(rig, measured) if rig.is_machine else _zeros(measured)
    named = (rig.adapt or _friction(rig)) | {key: one for key, one in zeros.items() if key not in rig.adapt}
    if "tension_out_N" not in measured and not rig.is_machine:
        named = {key: follow for key, follow in named.items() if not key.startswith(_OF_DISTAL_CELL)}
    return tuple(_number(rig, key, follow) for key, follow in named.items())


def _zeros(measured: Sequence[str]) -> dict[str, Follow]:
    zero = Follow(sd=DEFAULT.zero_sd_N, hourly_change=DEFAULT.zero_hourly_N)
    return {key: zero for channel, key in _ZEROS.items() if channel in measured}


def _machine_zeros(rig: Rig, measured: Sequence[str]) -> dict[str, Follow]:
    """Return the zeros of tensions and of the torque of a motor, which pulls with its arm."""
    zeros = dict[str, Follow]()
    for channel in measured:
        size = 1.0 if channel.startswith("tension_") else rig.drive.arm * (channel == "motor_torque_Nm")
        if size > 0.0:
            sd, hourly_change = size * DEFAULT.zero_sd_N, size * DEFAULT.zero_hourly_N
            zeros[f"sensors.{channel}.zero"] = Follow(sd=sd, hourly_change=hourly_change)
    return zeros


def _friction(rig: Rig) -> dict[str, Follow]:
    friction = rig.friction.coefficient
    sd, hourly_change = DEFAULT.friction_sd * friction, DEFAULT.friction_hourly * friction
    return {"friction.coefficient": Follow(sd=sd, hourly_change=hourly_change)}


def _number(rig: Rig, key: str, follow: Follow) -> FollowedNumber:
    table, _, name = key.partition(".")
    if key in RIG_KEYS:
        return FollowedNumber(key, getattr(getattr(rig, table), name), *_drift(follow), 0.0, math.inf)
    if rig.is_machine and (bounds := _machine_bounds(rig, key)) is not None:
        value, lower, upper = bounds
        return FollowedNumber(key, value, *_drift(follow), lower, upper)
    kind = KINDS.get(table)
    parameter = kind.parameters.get(name) if kind is not None else None
    if parameter is None or (rig.is_machine and kind is not None and kind.hook == "observation"):
        known = ", ".join(RIG_KEYS if not rig.is_machine else (*RIG_KEYS, *MACHINE_KEYS, "sensors.NAME.zero"))
        raise SettingsError(
            f"adapt.{key}: no number that can be followed: give {known}, or an effect and its parameter, "
            "as backlash.width_m (docs/formats.md, Rig)"
        )
    effect = next((one for one in rig.effects if isinstance(one, KINDS[table])), None)
    others = (each for each in msgspec.structs.fields(KINDS[table]) if each.required and each.name != name)
    if effect is None and any(others):
        raise SettingsError(f"adapt.{key}: the rig has no effect {table}: add it as [[effects]]")
    value = parameter.centre if effect is None else getattr(effect, name)
    return FollowedNumber(key, value, *_drift(follow), parameter.lower, parameter.upper)


def _machine_bounds(rig: Rig, key: str) -> tuple[float, float, float] | None:
    """Return value and bounds of a number of a machine that can be followed; None where it is none."""
    table, _, name = key.partition(".")
    if table == "sensors":
        channel, _, name = name.partition(".")
        if name not in ("zero", "gain") or channel not in channels_of(rig.drive, rig.end):
            return None
        lower = -math.inf if name == "zero" else _LEAST_SHARE
        return getattr(rig.sensors.get(channel, Sensor()), name), lower, math.inf
    if key not in MACHINE_KEYS:
        return None
    value = getattr(getattr(rig, table), name)
    lower = _LEAST_SHARE * value if name in ("radius_m", "coupling") else 0.0
    return value, lower, math.inf


def _drift(follow: Follow) -> tuple[float, float]:
    return follow.sd, follow.hourly_change


def with_numbers(rig: Rig, values: Mapping[str, float]) -> Rig:
    """Return a rig with other values of followed numbers, by key; effects that it lacks are added.

    Raises
    ------
    SettingsError
        Where a value is out of bounds.
    """
    of_rig = {key: value for key, value in values.items() if key.startswith(_OF_RIG)}
    effects = list[AnyEffect](rig.effects)
    for key, value in values.items():
        if key in of_rig:
            continue
        table, _, name = key.partition(".")
        at = next((i for i, one in enumerate(effects) if isinstance(one, KINDS[table])), None)
        if at is None:
            try:
                effects.append(msgspec.convert({"name": table, name: value}, AnyEffect))
            except msgspec.ValidationError as error:
                raise SettingsError(str(error)) from error
        else:
            effects[at] = msgspec.structs.replace(effects[at], **{name: value})
    changed = with_values(rig, of_rig) if of_rig else rig
    return msgspec.structs.replace(changed, effects=tuple(effects))


@dataclass(frozen=True, slots=True)
class StraightLines:
    """A plant and the sensors as straight lines over the followed numbers about some values; (201)."""

    about: Vector
    """[d] The values."""
    plant: Vector
    """The numbers of a `Plant` there."""
    slope: Matrix
    """[d, numbers] What 1 of each number adds to it."""
    sensors: Vector
    """[5] As `SensorNumbers`."""
    sensor_slope: Matrix
    """[d, 5]"""

    def of_tension_in(self, numbers: Matrix) -> tuple[Vector, Vector]:
        """Return the zero and the gain of T_in of members whose numbers are [n, d], each [n]."""
        gain, zero = (self.sensors[:2] + (numbers - self.about) @ self.sensor_slope[:, :2]).T
        return zero, gain


def straight_lines(
    rig: Rig, numbers: Sequence[FollowedNumber], about: Vector, arcs: Arcs, edge: Vector
) -> StraightLines:
    """Return plant and sensors about values [d] of the numbers, on a route with bars cut at `edge`."""

    def at(values: Vector) -> Vector:
        changed = with_values_of(rig, numbers, values)
        setup = setup_of(changed)
        bent = Arcs.exact(arcs.length, changed.route.angle_gain * arcs.angle)
        sensors = SensorNumbers(
            setup.tension_in_gain,
            setup.tension_in_offset_N,
            setup.tension_out_gain,
            setup.tension_out_offset_N,
            setup.crosstalk,
        )
        return np.concatenate((model_of(setup, bent, "displacement_in_m", edge).plant.block, sensors))

    first = at(about)
    plant, sensors = np.split(first, [-_SENSORS])
    parts = np.split(slopes(at, first, numbers, about), [-_SENSORS], axis=1)
    slope, sensor_slope = map(np.ascontiguousarray, parts)
    return StraightLines(about, plant, slope, sensors, sensor_slope)


def slopes(
    at: Callable[[Vector], Vector], first: Vector, numbers: Sequence[FollowedNumber], about: Vector
) -> Matrix:
    """Return what 1 of each number adds [d, k] to what `at` makes of all: of `about`, `first`."""
    out = np.zeros((len(about), len(first)))
    for i, one in enumerate(numbers):
        step = _SLOPE_STEP * one.scale
        step = -step if about[i] + step > one.upper else step
        moved = about.copy()
        moved[i] += step
        there = at(moved)
        changes = there != first  # a blocked load is infinitely stiff
        out[i, changes] = (there[changes] - first[changes]) / step
    return out


def with_values_of(rig: Rig, numbers: Sequence[FollowedNumber], values: Sequence[float] | Vector) -> Rig:
    """Return a rig with other values of followed numbers, as `with_numbers`."""
    return with_numbers(rig, {one.key: float(value) for one, value in zip(numbers, values, strict=True)})

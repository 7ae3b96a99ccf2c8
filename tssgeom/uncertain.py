"""Numbers of a rig that are not known, known with an error (`"unknown"`, `{ value = …, sd = … }`), or drift.

Source: docs/model.md (179), (200).
"""

from __future__ import annotations

import difflib
import itertools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import KINDS
from tssgeom.errors import SettingsError, require_at_least_zero

UNKNOWN = "unknown"
CORRELATIONS = "correlations"
"""The table of a rig file with the correlations of its errors."""
_OF_TENDON = re.compile(r"_\d+(?=_)")  # the number of a tendon in the name of a channel
_DIGITS = 1e-6  # of correlations in a file [1]; stated: numbers fewer than their keys have axes of less
_ROUNDED = 1e-3  # below 0 by as much for each number, an eigenvalue of correlations is 0 [1]; chosen: digits


class Unexplained(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a model left of measured runs beyond what their sensors explain, rms; 0 where it left nothing."""

    tension_in_N: float = 0.0
    """Of the proximal tension, where the position of the drive was given [N]."""
    tension_out_N: float = 0.0
    """Of the distal tension [N]."""
    elongation_m: float = 0.0
    """Of the elongation [m]."""
    displacement_out_m: float = 0.0
    """Of the movement of the load [m]."""
    joint_angle_rad: float = 0.0
    """Of the angle of a joint [rad]."""
    bending_x_rad: float = 0.0
    """Of the bending of a segment about x [rad]."""
    bending_y_rad: float = 0.0
    """Of the bending of a segment about y [rad]."""

    def __post_init__(self) -> None:
        for name, value in msgspec.structs.asdict(self).items():
            require_at_least_zero(f"unexplained.{name}", value, name.rpartition("_")[2])

    def __bool__(self) -> bool:
        """Whether it left anything."""
        return bool(self.given())

    def given(self) -> dict[str, float]:
        """Return what is not 0, by channel."""
        return {name: value for name, value in msgspec.structs.asdict(self).items() if value}

    @classmethod
    def beyond(cls, left: Iterable[tuple[str, float, float]]) -> Unexplained:
        """Return what is beyond the noise of channels, of each the most; docs/model.md (354).

        `left` are channels, the rms of what was left of each, and its noise [N, m, rad]; those of several
        tendons count as one, and channels without a number here not at all.
        """
        most = dict.fromkeys(cls.__struct_fields__, 0.0)
        for name, rms, noise in left:
            of = _OF_TENDON.sub("", name)
            if of in most and rms > noise:
                most[of] = max(most[of], math.sqrt(rms**2 - noise**2))
        return cls(**most)

    def of(self, channels: Sequence[str]) -> Vector:
        """Return that of channels, `tension_out_2_N` being the distal tension of a tendon [N, m, rad]."""
        left = self.given()
        return np.array([left.get(_OF_TENDON.sub("", name), 0.0) for name in channels])


NOTHING_LEFT = Unexplained()


class Follow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a number of a rig drifts, which `--adapt` follows; docs/model.md (200)."""

    sd: float
    """Its standard deviation at the start, in its unit."""
    hourly_change: float = 0.0
    """Standard deviation of its change in an hour, in its unit."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.sd) and self.sd > 0.0):
            raise SettingsError(f"adapt.*.sd is {self.sd:g}: give a finite value > 0")
        if not (math.isfinite(self.hourly_change) and self.hourly_change >= 0.0):
            raise SettingsError(f"adapt.*.hourly_change is {self.hourly_change:g}: give a finite value >= 0")


class Prior(NamedTuple):
    """What is assumed of a number: normal, or with a centre above 0 and `log` log-normal."""

    centre: float
    sd: float
    """Standard deviation of the number, or of its logarithm [1]."""
    log: bool = True

    def value(self, u: float) -> float:
        """Return the number that is `u` standard deviations from the centre."""
        return self.centre * math.exp(self.sd * u) if self.log else self.centre + self.sd * u

    def u(self, value: float) -> float:
        """Return how many standard deviations a number is from the centre."""
        return (math.log(value / self.centre) if self.log else value - self.centre) / self.sd


UNKNOWNS: Mapping[str, Prior] = {
    "friction.coefficient": Prior(0.15, 0.8),
    "tendon.compliance_per_N": Prior(3e-4, 1.5),
    "tendon.pretension_N": Prior(5.0, 1.2),
    "load.stiffness_N_per_m": Prior(1000.0, 2.0),
    "drive.radius_m": Prior(0.01, 1.0),
    "drive.coupling": Prior(1.0, 0.1),
    "drive.slack_m": Prior(1e-3, 1.5),
    "drive.play_rad": Prior(0.02, 1.5),
    "drive.friction_Nm": Prior(0.01, 2.0),
    "drive.lag_s": Prior(0.0, 0.3, log=False),
    "end.radius_m": Prior(0.006, 1.0),
    "end.stiffness_Nm_per_rad": Prior(0.1, 2.5),
    "end.gravity_Nm": Prior(0.05, 2.0),
    "end.gravity_at_rad": Prior(0.0, 1.0, log=False),
    "end.hardening_Nm_per_rad3": Prior(0.1, 2.5),
    "end.friction_Nm": Prior(0.005, 2.0),
    "end.play_rad": Prior(0.01, 1.5),
    "route.length_m": Prior(0.5, 0.5),
    "route.angle_rad": Prior(3.0, 0.8),
    "route.angle_gain": Prior(1.0, 0.3),
    "sensors.gain": Prior(1.0, 0.2),
    "sensors.lag_s": Prior(0.1, 1.2),
}
"""Chosen: what tendon-driven tools have, within a factor that holds two thirds of them. What is assumed of a
number of a rig that is "unknown"."""


@dataclass(frozen=True, slots=True)
class Uncertain:
    """One number of a rig that is not certain."""

    key: str
    """Where it stands: `friction.coefficient`, `effects[0].width_m`, `sensors.joint_angle_rad.lag_s`."""
    prior: Prior
    stated: bool
    """Whether the rig gives its value and error; else it is unknown."""
    correlation: Mapping[str, float] = field(default_factory=dict, hash=False)
    """By key, that of its error with errors of other numbers [1]; 0 with all that are not named."""


@dataclass(frozen=True, slots=True)
class RigErrors:
    """Errors of numbers of a rig, as a fit gives them."""

    keys: tuple[str, ...]
    sd: tuple[float, ...]
    """Standard deviation of each, in its unit."""
    correlation: Matrix
    """[numbers, numbers] [1]."""
    unexplained: Unexplained = NOTHING_LEFT
    """What the model left beside them."""

    def state(self, tables: dict[str, Any]) -> None:
        """Put them into the tables of a rig file, as text, each pair of correlations once."""
        for key, sd in zip(self.keys, self.sd, strict=True):
            change(tables, key, lambda value, sd=sd: f"{{ value = {value!r}, sd = {sd:.4g} }}")
        if self.unexplained:
            tables["unexplained"] = self.unexplained.given()
        together: dict[str, dict[str, float]] = {}
        names = [(k, one) for k, key in enumerate(self.keys) for one in keys_of(key)]
        for (a, one), (b, other) in itertools.combinations(names, 2):
            if value := round(float(self.correlation[a, b]), 6):
                together.setdefault(one, {})[other] = value
        if together:
            tables[CORRELATIONS] = together


CERTAIN = RigErrors((), (), np.eye(0))
"""No errors at all."""


def parted(tables: dict[str, Any]) -> tuple[dict[str, Any], tuple[Uncertain, ...]]:
    """Return the tables of a rig with a number for each one that is not certain, and those.

    Raises SettingsError where an error is no number above 0, nothing is known of what may be unknown, or
    correlations are of no numbers with an error, or contradict each other.
    """
    uncertain = list[Uncertain]()
    tables = dict(tables)
    together = tables.pop(CORRELATIONS, {})

    def visit(value: Any, key: str) -> Any:
        if value == UNKNOWN or (isinstance(value, dict) and value.keys() == {"value", "sd"}):
            uncertain.append(_uncertain(key, value, tables))
            return uncertain[-1].prior.centre
        if isinstance(value, dict):
            return {name: visit(item, f"{key}.{name}" if key else name) for name, item in value.items()}
        if isinstance(value, list):
            return [visit(item, f"{key}[{k}]") for k, item in enumerate(value)]
        return value

    known = visit(tables, "")
    return known, _correlated(uncertain, together) if together else tuple(uncertain)


def deviations(uncertain: Sequence[Uncertain]) -> Iterator[dict[str, float]]:
    """Yield, by key, what errors add up from: values one standard deviation to either side, two and two.

    Each pair moves the numbers along one principal axis of their errors; a number whose error goes with no
    other one has an axis of its own. Source: docs/model.md (212), (318).
    """
    value, way = np.linalg.eigh(_matrix(uncertain))
    alone = np.array_equal(value, np.ones(len(value)))
    axes = np.eye(len(value)) if alone else (way * np.sqrt(value)).T[value > _DIGITS][::-1]
    for axis in axes:
        moved = [(each, u) for each, u in zip(uncertain, axis.tolist(), strict=True) if u != 0.0]
        for sign in (-1.0, 1.0) if moved else ():
            yield {each.key: each.prior.value(sign * u) for each, u in moved}


def assumed(key: str, value: float, sd: float) -> Prior:
    """Return the prior of a number that is known with a standard deviation."""
    signed = key.startswith("sensors") and not key.endswith("drift_time_s")
    if value > 0.0 and not signed and not key.endswith(("gravity_at_rad", "lag_s")):
        return Prior(value, math.sqrt(math.log1p((sd / value) ** 2)))
    return Prior(value, sd, log=False)


def behind_gear(key: str, gear: float) -> Prior:
    """Return what is assumed of an unknown number; play and friction of a motor are before its gear."""
    prior = UNKNOWNS[key]
    factor = {"drive.play_rad": gear, "drive.friction_Nm": 1.0 / gear}.get(key, 1.0)
    return prior._replace(centre=factor * prior.centre)


def path_of(key: str) -> list[str | int]:
    """Return the steps to a key: names of tables, and numbers in lists."""
    return [int(part) if part.isdigit() else part for part in re.split(r"[.\[\]]+", key) if part]


def change(tables: dict[str, Any], key: str, made: Callable[[Any], Any]) -> None:
    """Put in the tables of a rig what is made of the value of a key; tuples on the way become lists."""
    for path in map(path_of, keys_of(key)):
        _change_at(tables, path, made)


def _change_at(tables: Any, path: Sequence[str | int], made: Callable[[Any], Any]) -> None:
    step, *more = path
    if isinstance(step, str) and more:
        tables.setdefault(step, {})
    if more and isinstance(tables[step], tuple):
        tables[step] = [*tables[step]]
    if more:
        _change_at(tables[step], more, made)
    else:
        tables[step] = made(tables.get(step) if isinstance(tables, dict) else tables[step])


def keys_of(key: str) -> list[str]:
    """Return the keys that share a number: `sensors.a.lag_s` and `sensors.b.lag_s` of `sensors.a+b.lag_s`."""
    first, *more = key.split(".")
    if first != "sensors" or not more:
        return [key]
    return [".".join([first, channel, *more[1:]]) for channel in more[0].split("+")]


def _matrix(uncertain: Sequence[Uncertain]) -> Matrix:
    """Return the correlations of errors [numbers, numbers]."""
    keys = [each.key for each in uncertain]
    rows = [
        [1.0 if key == each.key else each.correlation.get(key, 0.0) for key in keys] for each in uncertain
    ]
    return np.array(rows).reshape(len(keys), len(keys))


def _correlated(uncertain: Sequence[Uncertain], tables: Any) -> tuple[Uncertain, ...]:
    """Return numbers with the correlations of their errors, as a rig file gives them."""
    stated: dict[str, dict[str, float]] = {each.key: {} for each in uncertain if each.stated}
    if not isinstance(tables, dict) or not all(isinstance(row, dict) for row in tables.values()):
        raise SettingsError(f'{CORRELATIONS} is no table of tables: write "KEY" = {{ "OTHER KEY" = 0.5 }}')
    for one, other, value in ((a, b, value) for a, row in tables.items() for b, value in row.items()):
        name = f"{CORRELATIONS}: {one} and {other}"
        for key in (one, other):
            if key not in stated:
                raise SettingsError(f"{name}: {key} has no error: write it as {{ value = …, sd = … }}")
        if one == other or not isinstance(value, int | float) or not abs(value) <= 1.0:
            raise SettingsError(f"{name} = {value}: give a number from -1 to 1 for two numbers")
        if stated[one].get(other, value) != value:
            raise SettingsError(f"{name} stand there twice, with {stated[one][other]:g} and {value:g}")
        stated[one][other] = stated[other][one] = float(value)
    made = tuple(replace(each, correlation=stated.get(each.key, {})) for each in uncertain)
    if np.linalg.eigvalsh(_matrix(made))[0] < -_ROUNDED * len(made):
        raise SettingsError(f"{CORRELATIONS} contradict each other: no errors go together like this")
    return made


def _uncertain(key: str, value: Any, tables: dict[str, Any]) -> Uncertain:
    if value == UNKNOWN:
        return Uncertain(key, _of_unknown(key, tables), stated=False)
    numbers = [value["value"], value["sd"]]
    if not all(isinstance(each, int | float) and math.isfinite(each) for each in numbers) or numbers[1] <= 0:
        raise SettingsError(f"{key} = {value}: give a finite value, and an sd > 0")
    return Uncertain(key, assumed(key, float(numbers[0]), float(numbers[1])), stated=True)


def _of_unknown(key: str, tables: dict[str, Any]) -> Prior:
    if (effect := re.fullmatch(r"effects\[(\d+)\]\.(\w+)", key)) is not None:
        kind = KINDS.get(str(tables["effects"][int(effect[1])].get("name")))
        parameter = kind.parameters.get(effect[2]) if kind is not None else None
        if parameter is not None:
            return Prior(parameter.centre + parameter.typical, parameter.prior_sd, log=False)
    name = f"sensors.{key.rpartition('.')[2]}" if key.startswith("sensors.") else key
    if name not in UNKNOWNS:
        near = difflib.get_close_matches(name, UNKNOWNS, 1)
        known = ", ".join((*UNKNOWNS, "parameters of effects"))
        hint = f"did you mean {near[0]}?" if near else f"give a number; {known} can be"
        raise SettingsError(f"{key} cannot be unknown: {hint}")
    gear = tables.get("drive", {}).get("gear", 1.0)
    return behind_gear(name, float(gear) if isinstance(gear, int | float) and gear > 0.0 else 1.0)


def require_known(path: str | Path, uncertain: Sequence[Uncertain]) -> None:
    """Refuse a rig in which a number is "unknown", with a SettingsError."""
    unknown = ", ".join(each.key for each in uncertain if not each.stated)
    if unknown:
        raise SettingsError(f"{path}: {unknown} is unknown: give a value, or find it with tssgeom calibrate")

"""Numbers of a rig that are not known, known with an error (`"unknown"`, `{ value = …, sd = … }`), or drift.

Source: docs/model.md (179), (200).
"""

from __future__ import annotations

import difflib
import functools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, get_args

import msgspec

from tssgeom.effects import KINDS
from tssgeom.errors import SettingsError

UNKNOWN = "unknown"


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


def parted(tables: dict[str, Any]) -> tuple[dict[str, Any], tuple[Uncertain, ...]]:
    """Return the tables of a rig with a number for each one that is not certain, and those.

    Raises SettingsError where an error is no number above 0, or nothing is known of what may be unknown.
    """
    uncertain = list[Uncertain]()

    def visit(value: Any, key: str) -> Any:
        if value == UNKNOWN or (isinstance(value, dict) and value.keys() == {"value", "sd"}):
            uncertain.append(_uncertain(key, value, tables))
            return uncertain[-1].prior.centre
        if isinstance(value, dict):
            return {name: visit(item, f"{key}.{name}" if key else name) for name, item in value.items()}
        if isinstance(value, list):
            return [visit(item, f"{key}[{k}]") for k, item in enumerate(value)]
        return value

    return visit(tables, ""), tuple(uncertain)


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


def keys_of(key: str) -> list[str]:
    """Return the keys that share a number: `sensors.a.lag_s` and `sensors.b.lag_s` of `sensors.a+b.lag_s`."""
    first, *more = key.split(".")
    if first != "sensors" or not more:
        return [key]
    return [".".join([first, channel, *more[1:]]) for channel in more[0].split("+")]


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


def with_choices(reported: str, like: msgspec.Struct) -> str:
    """Return what msgspec reports of a file, and the nearest key or value of a struct of its form."""
    wrong = r"(?:Object contains unknown field `(\w+)`|Invalid enum value '(.*)')(?:.*`\$\.?(.*)`)?"
    match = re.match(wrong, reported)
    if match is None:
        return reported
    steps = [each for each in (match[3] or "").split(".") if each]
    last = steps.pop() if match[2] else ""
    try:
        types = {
            each.name: each.type for each in msgspec.structs.fields(functools.reduce(getattr, steps, like))
        }
        choices = list(map(str, get_args(types[last]) if match[2] else types))
    except (AttributeError, KeyError, TypeError):  # in a list, or in a table of the user's own names
        return reported
    near = difflib.get_close_matches(match[1] or match[2], choices, 1)
    hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(choices)}"
    return f"{reported}; {hint}"

"""What a machine may lack: effects of the library in every tendon, and numbers of its drive, end and sensors.

Source: docs/machines.md, "What a machine lacks"; docs/model.md (195).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import msgspec
import numpy as np

from tssgeom.channel_names import unit_of_key
from tssgeom.core.constants import CHANCE
from tssgeom.effects import KINDS, Library, snake, with_size
from tssgeom.identify.finding import RigNumber
from tssgeom.identify.fit import FIT
from tssgeom.identify.machine_laws import FreeLaw
from tssgeom.identify.machine_parameters import Parameter
from tssgeom.identify.machine_run import LIMITS, MachineRun
from tssgeom.identify.mechanism_names import CURVE_OF, MECHANISM_OF
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.rig import Rig, with_values
from tssgeom.uncertain import Prior, behind_gear, keys_of


@dataclass(frozen=True, slots=True)
class PartSettings:
    """What is assumed of the numbers of a part."""

    wide: float = 5.0
    """Of what is typical of a number: s.d. of its prior [1]; chosen: machines differ in size."""
    gain: float = 0.1
    """Standard deviation of the error of a gain [1]; chosen: a tenth, more is a wrong unit."""
    known: float = 0.5
    """Of a number that the rig gives: standard deviation of its error [1]; chosen: a half."""
    shares: tuple[float, ...] = (1.0, 0.2, 0.04)
    """Of the size from which a part starts: sizes at which it is tried [1]; chosen: apart by five."""
    pushed: float = 2.0
    """Scales from which a part is tried, apart by this factor from the typical one [1]; chosen."""


PARTS = PartSettings()


class Number(NamedTuple):
    """One number of a part."""

    name: str
    """As a report has it: `width_m`, `gain`."""
    key: str
    """Key of the rig, with `{}` for the position of the effect."""
    unit: str
    prior: Prior
    start: float
    """From which a fit starts where nothing better is known, in the unit."""
    lower: float = -math.inf
    upper: float = math.inf
    switch: bool = True
    """Whether the part does nothing where this number is at the centre of its prior."""


@dataclass(frozen=True, slots=True)
class Part:
    """One thing that a machine may lack."""

    name: str
    effect: Library | RigNumber | FreeLaw
    numbers: tuple[Number, ...]
    meaning: str = ""
    """In a clause, where it is no effect of the library."""

    @property
    def label(self) -> str:
        """Name, and what of it is a choice."""
        if isinstance(self.effect, RigNumber) and self.effect.key.startswith("sensors."):
            return f"{self.name} ({', '.join(key.split('.')[1] for key in keys_of(self.effect.key))})"
        end = getattr(self.effect, "end", "")
        return f"{self.name} ({end})" if end else self.name

    @property
    def mechanism(self) -> str | None:
        """The mechanism that it is a formula of; gain and drift are of the curves of their channel."""
        ends = (key.split(".")[-2:] for key in self.of_rig)
        curves = (f"{CURVE_OF[end]}:{channel}" for channel, end in ends if end in CURVE_OF)
        return next(curves, MECHANISM_OF.get(self.name))

    @property
    def laws(self) -> tuple[FreeLaw, ...]:
        """The law that it is; none of an effect or a number."""
        return (self.effect,) if isinstance(self.effect, FreeLaw) else ()

    @property
    def switch_at(self) -> int:
        """Where the number that switches the part on stands among its numbers."""
        return next(k for k, each in enumerate(self.numbers) if each.switch)

    @property
    def switch(self) -> Number:
        """The number that switches the part on."""
        return self.numbers[self.switch_at]

    @property
    def of_rig(self) -> frozenset[str]:
        """Keys of the numbers of the rig that it frees; none of an effect of the library."""
        return frozenset(keys_of(self.effect.key) if isinstance(self.effect, RigNumber) else ())

    def on(self, rig: Rig) -> tuple[Rig, tuple[Parameter, ...]]:
        """Return the rig with this part at nothing, and what is fitted of it."""
        if isinstance(self.effect, FreeLaw):
            unit = Prior(0.0, 1.0, log=False)
            names = (f"{self.label}: {each.name}" for each in self.numbers)
            return rig, tuple(Parameter(name, "1", unit, "law", key=self.name) for name in names)
        at = len(rig.effects)
        if not isinstance(self.effect, RigNumber):
            rig = msgspec.structs.replace(rig, effects=(*rig.effects, self.effect))
        made = [
            Parameter(f"{self.label}: {each.name}", each.unit, each.prior, "rig", key=each.key.format(at))
            for each in self.numbers
        ]
        return with_values(rig, {each.key: each.prior.centre for each in made}), tuple(made)


_VARIANTS = {
    "slack_take_up": ({"end": "proximal"}, {"end": "distal"}),
    "presliding": ({"law": "prandtl"}, {"law": "dahl"}),
}
_OF_CHANNELS = "channels of a machine have gains, lags and zeros of their own"
_NOT_HERE = {  # observation is by channel here; the pretension is a number of the rig
    "tension_in_gain": _OF_CHANNELS,
    "tension_out_gain": _OF_CHANNELS,
    "tension_in_offset": _OF_CHANNELS,
    "tension_out_offset": _OF_CHANNELS,
    "channel_lag": _OF_CHANNELS,
    "load_cell_crosstalk": _OF_CHANNELS,
    "load_friction": "friction of a joint is joint_friction",
    "load_play": "play behind a joint is end_play",
    "thermal_drift": "the model of a machine has no temperature",
    "pretension_error": "",
}


def parts_of(rig: Rig, free: Sequence[str], runs: Sequence[MachineRun]) -> tuple[Part, ...]:
    """Return what may act in a machine and show in its runs; `free` are keys that the fit has anyway."""
    return (*_of_library(rig, free, runs), *_of_rig(rig, free, runs))


def absent_parts(rig: Rig, runs: Sequence[MachineRun]) -> Mapping[str, str]:
    """Return by name the effects of the library that are not tried on a machine, and why."""
    why = {name: reason for name, reason in _NOT_HERE.items() if reason}
    if any(run.drive == "motor_angle_rad" for run in runs):
        why["backlash"] = "play of the motor is drive_play"
    if any(run.drive in ("tension_in", "motor_torque_Nm") for run in runs):
        why["backlash"] = "forces drive, which have no play"
    if rig.end.kind == "carried":
        why["backlash"] = "play of what carries both ends is drive_play"
    if all(_one_curvature(run) for run in runs):
        why["curvature_dependent_friction"] = "all routes have one curvature"
    return why


def _one_curvature(run: MachineRun) -> bool:
    bends = [
        angle / length
        for each in run.routes
        for length, angle in zip(each.length, each.angle, strict=True)
        if length > 0.0
    ]
    return max(bends) - min(bends) < 1e-9 * max(max(bends), 1.0)


def _of_library(rig: Rig, free: Sequence[str], runs: Sequence[MachineRun]) -> Iterator[Part]:
    absent = absent_parts(rig, runs)
    there = {snake(type(effect).__name__) for effect in rig.effects}
    for name, kind in KINDS.items():
        if name in absent or name in _NOT_HERE or name in there:
            continue
        if name == "hidden_bend" and {"route.angle_rad", "route.angle_gain"} & set(free):
            continue  # the angle that the fit has is the bend
        for choice in _VARIANTS.get(name, ({},)):
            effect = msgspec.structs.replace(with_size(kind), **choice)
            numbers = tuple(_library_numbers(effect))
            if any(each.switch for each in numbers):
                yield Part(name, effect, numbers)


def _library_numbers(effect: Library) -> Iterator[Number]:
    switched = False
    for key, stated in effect.parameters.items():
        if not stated.fitted:
            continue
        if stated.switch:
            if switched:
                continue  # the first number of several is the one that is fitted
            switched = True
            prior = Prior(0.0, PARTS.wide * max(stated.prior_sd, abs(stated.typical)), log=False)
        else:
            prior = Prior(stated.typical, FIT.log_sd)
        key_of_rig = f"effects[{{}}].{key}"
        yield Number(
            *(key, key_of_rig, stated.unit, prior, stated.typical),
            *(stated.lower, stated.upper, stated.switch),
        )


DRIVE_LAG = "drive.lag_s"
"""Key of how much later the drive is recorded."""


class _Choice(NamedTuple):
    """A number of the rig that a part may free."""

    name: str
    key: str
    meaning: str


_CHOICES = (
    _Choice("drive_play", "drive.play_rad", "Play between motor and pulley"),
    _Choice("drive_friction", "drive.friction_Nm", "Coulomb friction of the motor, beside the tendons'"),
    _Choice("drive_slack", "drive.slack_m", "Slack of the second tendon at rest"),
    _Choice("drive_coupling", "drive.coupling", "The second tendon is let out more or less than the first"),
    _Choice("end_play", "end.play_rad", "Play between the joint and what measures its angle"),
    _Choice("joint_friction", "end.friction_Nm", "Coulomb friction of the joint itself"),
    _Choice("joint_weight", "end.gravity_Nm", "A weight that the joint carries"),
    _Choice("joint_hardening", "end.hardening_Nm_per_rad3", "The joint's load grows stiffer with its angle"),
    _Choice("end_stiffness", "end.stiffness_Nm_per_rad", "The joint is stiffer or softer than in the rig"),
    _Choice("load_stiffness", "load.stiffness_N_per_m", "The spring of the load is not that of the rig"),
    _Choice(
        "pretension_error", "tendon.pretension_N", "The tendons start at another tension than in the rig"
    ),
)
MEANINGS: Mapping[str, str] = {each.name: each.meaning for each in _CHOICES} | {
    "channel_gain": "A channel reads a share too much or too little",
    "channel_lag": "A channel passes a first-order filter before it is stored",
    "channel_drift": "The zero of a channel drifts during a run",
    "drive_lag": "The drive is recorded later, or earlier, than what answers",
    "channel_zero": "A channel of force or torque does not read zero where nothing pulls",
}
"""What each part is that is no effect of the library, in a clause."""


def _of_rig(rig: Rig, free: Sequence[str], runs: Sequence[MachineRun]) -> Iterator[Part]:
    answers, late = list(dict.fromkeys(name for run in runs for name in run.measured)), list[str]()
    for each in _CHOICES:
        if each.key not in free and _applies(each.key, rig, runs, answers):
            yield _freed(each, rig, runs)
    yield from drive_lag(rig, free, runs)
    for name in answers:
        known = rig.sensors.get(name)
        if f"sensors.{name}.gain" not in free and len(answers) > 1:
            centre = 1.0 if known is None else known.gain
            yield _of_channel("channel_gain", name, "gain", "1", Prior(centre, PARTS.gain, log=False))
        if f"sensors.{name}.drift_per_s" not in free and (known is None or known.drift_per_s == 0.0):
            yield _drift(name, runs)
        if f"sensors.{name}.lag_s" not in free and (known is None or known.lag_s == 0.0):
            late.append(name)
    cells = [name for name in late if name.startswith("tension")]  # one amplifier may read them all
    for name in (*late, *(["+".join(cells)] if len(cells) > 1 else [])):
        prior = Prior(0.0, PARTS.wide * _typical_lag(runs), log=False)
        yield _of_channel("channel_lag", name, "lag_s", "s", prior, 0.0)


def drive_lag(rig: Rig, free: Sequence[str], runs: Sequence[MachineRun]) -> Iterator[Part]:
    """Yield the part that moves the drive in time, where runs may show it; docs/model.md (178)."""
    if DRIVE_LAG in free or rig.drive.lag_s != 0.0 or any(_by_tension(run) for run in runs):
        return  # a tension whose turns are fitted has its own times
    prior = Prior(0.0, PARTS.wide * _typical_lag(runs), log=False)
    number = Number("lag_s", DRIVE_LAG, "s", prior, 0.2 * prior.sd)
    yield Part("drive_lag", RigNumber(key=DRIVE_LAG), (number,), MEANINGS["drive_lag"])


def presliding(rig: Rig, free: Sequence[str], runs: Sequence[MachineRun]) -> tuple[Part, ...]:
    """Return the part of contacts that give way, where only turns show the pretension of two tendons."""
    alone = "tendon.pretension_N" in free and all(run.tendons == 2 for run in runs)
    if not alone or rig.drive.slack_m > 0.0 or "drive.slack_m" in free:
        return ()
    return tuple(part for part in _of_library(rig, free, runs) if part.name == "presliding")


def _by_tension(run: MachineRun) -> bool:
    return run.legs is not None and run.drive == "tension_in"


def _drift(channel: str, runs: Sequence[MachineRun]) -> Part:
    """Return the drift of a channel, by about a tenth of its range over the longest run."""
    measured = [run.measured[channel] for run in runs if channel in run.measured]
    span = max(float(np.nanmax(each) - np.nanmin(each)) for each in measured)
    longest = max(float(np.ptp(run.given["time_s"])) for run in runs)
    prior = Prior(0.0, LIMITS.zero * (span or 1.0) / longest, log=False)
    part = _of_channel("channel_drift", channel, "drift_per_s", unit_of_key(f"{channel}.drift_per_s"), prior)
    key, middle = f"sensors.{channel}.drift_time_s", 0.5 * longest
    ends = Number("drift_time_s", key, "s", Prior(middle, FIT.log_sd), middle, switch=False)
    return replace(part, numbers=(*part.numbers, ends))


def _typical_lag(runs: Sequence[MachineRun]) -> float:
    """Return the time between two samples [s], about what a filter takes."""
    return float(np.median(np.concatenate([np.diff(run.given["time_s"]) for run in runs])))


def _of_channel(
    name: str, channel: str, last: str, unit: str, prior: Prior, lower: float = -math.inf
) -> Part:
    key = f"sensors.{channel}.{last}"
    number = Number(last, key, unit, prior, prior.centre + 0.2 * prior.sd, lower)
    return Part(name, RigNumber(key=key), (number,), MEANINGS[name])


def _freed(each: _Choice, rig: Rig, runs: Sequence[MachineRun]) -> Part:
    table, last = each.key.split(".")
    now = float(getattr(getattr(rig, table), last))
    typical = behind_gear(each.key, rig.drive.gear).centre
    prior = Prior(now, PARTS.known * now if now > 0.0 else PARTS.wide * typical, log=False)
    of_drive = now == 0.0 and each.key == "drive.play_rad"
    start = (_least_play(runs) if of_drive else 0.0) or now + 0.1 * prior.sd
    number = Number(last, each.key, unit_of_key(each.key), prior, start, 0.0)
    return Part(each.name, RigNumber(key=each.key), (number,), each.meaning)


def _least_play(runs: Sequence[MachineRun]) -> float:
    """Return a play of the motor that its strokes and its noise let show [rad]; docs/model.md (296)."""
    by_angle = [run for run in runs if run.drive == "motor_angle_rad"]
    stroke = max(float(np.ptp(run.given[run.drive])) for run in by_angle)
    noise = max(run.inputs.noise.get(run.drive, 0.0) for run in by_angle)
    return max(PLAUSIBLE.negligible * stroke, CHANCE.clear * noise)


def _applies(key: str, rig: Rig, runs: Sequence[MachineRun], answers: Sequence[str]) -> bool:
    """Whether a number of the rig acts in any of the runs, and shows there."""
    tensions = any("tension" in name or "torque" in name for name in (*answers, *runs[0].given))
    joint = rig.end.kind == "joint"
    by_angle = any(run.drive == "motor_angle_rad" for run in runs)
    pair = rig.drive.kind == "pair"
    return {
        "drive.play_rad": by_angle,
        "drive.friction_Nm": "motor_torque_Nm" in answers,
        "drive.slack_m": pair,
        "drive.coupling": pair,
        "end.play_rad": joint and "joint_angle_rad" in answers,
        "end.friction_Nm": joint and all(run.drive != "motor_torque_Nm" for run in runs),
        "end.gravity_Nm": joint,
        "end.hardening_Nm_per_rad3": joint,
        "end.stiffness_Nm_per_rad": rig.end.kind in ("joint", "segment") and tensions,
        "load.stiffness_N_per_m": rig.end.kind == "spring",
        "tendon.pretension_N": True,
    }[key]

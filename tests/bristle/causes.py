"""Causes: what is wrong with a rig, under the mechanism that it belongs to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.bristle import laws
from tests.bristle.chain import Bristles, Table
from tests.bristle.rig import Rig
from tests.bristle.sheath import bent_more

Array = np.ndarray
Reading = Callable[[Array, Array], Array]
"""What a sensor makes of a course of true values at times [s]."""

FULL = ("full", "elongation", "no_load_cell", "drive_end", "force")
POSITION = ("full", "elongation", "no_load_cell", "drive_end")
LOAD_CELL = ("full", "elongation", "force")
LOAD_MOVE = ("full", "no_load_cell")


@dataclass(slots=True)
class Case:
    """A rig on the way to a campaign, and what a cause adds to it."""

    rig: Rig
    rng: np.random.Generator
    size: float
    peak: float
    """Highest tension of the load [N]."""
    seconds: float
    """Longest run [s]."""
    acts: dict[str, Any] = field(default_factory=dict)
    """Arguments of `laws.Acts`."""
    readings: dict[str, list[Reading]] = field(default_factory=dict)
    """By channel."""
    believed: dict[str, float] = field(default_factory=dict)
    """Errors of the rig file."""
    parameters: dict[str, float] = field(default_factory=dict)
    law: tuple[str, str, Callable[[Array], Array]] | None = None
    """What the law is over, its unit, and the law."""

    def reads(self, channel: str, reading: Reading) -> None:
        """Put a reading behind those of a channel."""
        self.readings.setdefault(channel, []).append(reading)


@dataclass(frozen=True, slots=True)
class Cause:
    """A cause: its mechanism, the library's name where the formula is exactly that, and where it shows."""

    mechanism: str
    build: Callable[[Case], None]
    formula: str | None = None
    plans: tuple[str, ...] = FULL
    rates: tuple[float, ...] = (20.0, 50.0, 100.0, 200.0)
    """Sampling [1/s] of runs; few make long, slow ones."""


_SLOW = (20.0, 25.0)
_SPREAD = (20.0, 60.0, 200.0)


def _friction(kind: str, law: laws.Law, case: Case, unit: str = "1") -> None:
    case.acts[f"over_{kind}"] = law
    case.law = (kind, unit, law)


def _stribeck(case: Case) -> None:
    decay = case.rng.uniform(3e-3, 6e-3)
    _friction("speed", laws.stribeck(0.25 * case.size, decay, 6.0 * case.size, 10e-3), case)


def _saturating(case: Case) -> None:
    _friction("tension", laws.saturating(0.8 * case.size, 4.0, 8.0), case)


def _quadratic(case: Case) -> None:
    sheath = case.rig.sheaths[0]
    bend = sheath.bend(sheath.s)
    reference = float(np.trapezoid(bend**2, sheath.s) / sheath.total_angle)
    _friction("bend", laws.quadratic(0.5 * case.size, reference), case)


def _stretches(case: Case) -> None:
    length = case.rig.sheaths[0].length
    first, second = case.rng.uniform(0.2, 0.4) * length, case.rng.uniform(0.6, 0.8) * length
    rough, smooth = (first, second) if case.rng.random() < 0.5 else (second, first)
    parts = ((rough, 0.09 * length, 1.0 * case.size), (smooth, 0.09 * length, -0.6 * case.size))
    _friction("s", laws.stretches(parts, 0.02 * length), case)


def _unequal(case: Case) -> None:
    by = 0.12 * case.size
    case.acts["unequal"] = by
    case.law = ("direction", "1", lambda side: 1.0 + by * side)


def _worn(case: Case) -> None:
    _friction("travel", laws.worn(-0.3 * case.size, case.rng.uniform(8e-3, 20e-3)), case)


def _run_in(case: Case) -> None:
    _friction("travel", laws.run_in(0.35 * case.size, case.rng.uniform(6e-3, 12e-3)), case)


def _warming(case: Case) -> None:
    _friction("time", laws.warming(-0.3 * case.size, case.rng.uniform(4.0, 7.0)), case)


def _power_strain(case: Case) -> None:
    rho = case.rig.compliance
    table = laws.power_strain(rho, 1.0 - 0.35 * case.size, 10.0)
    case.rig.strain = table
    case.law = ("tension", "1", lambda t: np.interp(t, table.value, table.x) - rho * np.asarray(t))


def _creep(case: Case, creep: tuple[tuple[float, float], ...]) -> None:
    case.acts |= {"creep": creep, "compliance": case.rig.compliance}
    case.law = ("time", "1", laws.crept(creep))


def _power_creep(case: Case) -> None:
    _creep(case, laws.prony(0.25, 0.1 * case.size))


def _two_time_creep(case: Case) -> None:
    _creep(case, ((0.08 * case.size, 0.7), (0.15 * case.size, 8.0)))


def _load_play(case: Case) -> None:
    width = 0.3e-3 * case.size
    case.reads("displacement_out", lambda value, _: laws.play(value, width))
    case.parameters["play_m"] = width


def _drive_play(case: Case) -> None:
    case.rig.drive_play = case.parameters["play_m"] = 0.3e-3 * case.size


def _inside(play: Callable[[Case], None]) -> Callable[[Case], None]:
    """A play of which each run has a part to take up when it begins."""

    def build(case: Case) -> None:
        play(case)
        share = case.parameters["open_share"] = float(case.rng.uniform(0.3, 0.7))
        case.rig.drive_play_open = share * case.rig.drive_play
        if not case.rig.drive_play:
            width = case.parameters["play_m"]
            case.readings.clear()
            case.reads(
                "displacement_out", lambda value, _: laws.play(value, width, share * width) - share * width
            )

    return build


def _presliding(case: Case) -> None:
    breakaway = 0.2e-3 * case.size
    at, share = laws.dahl(breakaway)
    case.rig.bristles = Bristles(breakaway_m=at, share=share)
    case.parameters["breakaway_m"] = breakaway
    case.law = (
        "slip",
        "1",
        lambda x: sum(w * np.minimum(np.asarray(x) / z, 1.0) for w, z in zip(share, at, strict=True)),
    )


def _curved(channel: str, power: int) -> Callable[[Case], None]:
    def build(case: Case) -> None:
        height, top = 0.35 * case.size, 20.0

        def bow(tension: Array) -> Array:
            q = np.asarray(tension) / top
            return height * (4.0 * q * (1.0 - q) if power == 2 else 10.4 * q * (1.0 - q) * (0.5 - q) * 2.0)

        case.reads(channel, lambda value, _: value + bow(value))
        case.law = (channel, "N", bow)

    return build


def _drifting(channel: str, height: float, kind: str) -> Callable[[Case], None]:
    def build(case: Case) -> None:
        seconds, most = case.seconds, height * case.size

        def drift(t: Array) -> Array:
            x = np.asarray(t) / seconds
            if kind == "root":
                return most * np.sqrt(x)
            if kind == "late":
                return most * x**2.5
            return most * np.sin(1.4 * np.pi * x)

        case.reads(channel, lambda value, t: value + drift(t))
        case.law = ("time", "N" if channel.startswith("tension") else "m", drift)

    return build


def _gain_drifting(channel: str, most: float) -> Callable[[Case], None]:
    def build(case: Case) -> None:
        seconds, size = case.seconds, case.size

        def gain(t: Array) -> Array:
            return most * size * (np.asarray(t) / seconds) ** 1.5

        case.reads(channel, lambda value, t: value * (1.0 + gain(t)))
        case.law = ("time", "1", gain)

    return build


def _late(channel: str, delay: float) -> Callable[[Case], None]:
    def build(case: Case) -> None:
        lag = delay * case.size
        case.reads(channel, lambda value, t: laws.late(value, t, lag))
        case.parameters["lag_s"] = lag

    return build


def _stiffening(case: Case) -> None:
    rig = case.rig
    most = (case.peak - rig.pretension) / rig.stiffness
    rise = 0.12 * case.size * rig.stiffness / most**2
    x = np.linspace(-0.2 * most, 1.5 * most, 400)
    extra = rise * np.abs(x) ** 3 * np.sign(x)
    load = rig.load = Table(x, rig.pretension + rig.stiffness * x + extra)

    moved = Table(load.value, load.x)

    def beyond(tension: Array) -> Array:
        """Return the movement beyond that of the spring."""
        at = np.array([moved.at(each) for each in np.atleast_1d(tension)])
        return at - (tension - rig.pretension) / rig.stiffness

    case.law = ("tension_out", "m", beyond)


def _end_stretch(case: Case) -> None:
    rig, height = case.rig, 1.2e-3 * case.size

    def stretch(tension: Array) -> Array:
        return height * (tension / (tension + 5.0) - rig.pretension / (rig.pretension + 5.0))

    tension = np.linspace(0.0, 100.0, 2000)
    rig.pull = Table(stretch(tension), tension)
    case.law = ("tension_in", "m", lambda t: stretch(np.asarray(t)))


def _preload(case: Case) -> None:
    error = 0.8 * case.size
    case.believed["pretension"] = case.rig.pretension - error
    case.parameters["error_N"] = error


def _bend(case: Case) -> None:
    rig = case.rig
    at, angle = case.rng.uniform(0.25, 0.75) * rig.sheaths[0].length, 0.6 * case.size
    rig.sheaths = [bent_more(sheath, at, angle, 8e-3) for sheath in rig.sheaths]
    case.parameters |= {"at_m": float(at), "angle_rad": angle}
    case.law = ("s", "rad", lambda s: angle * np.clip((np.asarray(s) - at) / 8e-3 + 0.5, 0.0, 1.0))


def _near_fitting(case: Case) -> None:
    case.rig.near_friction = case.parameters["force_N"] = 0.5 * case.size


def _load_fitting(case: Case) -> None:
    case.rig.load_friction = case.parameters["force_N"] = 0.5 * case.size


def _load_friction(case: Case) -> None:
    """A load that slides on a bench: it moves late, though the cell before it reads what pulls."""
    case.rig.load_friction = case.parameters["force_N"] = 0.5 * case.size
    case.rig.cell_at_tendon = True


def _zero(channel: str, height: float) -> Callable[[Case], None]:
    def build(case: Case) -> None:
        case.parameters["offset_N"] = offset = height * case.size
        case.reads(channel, lambda value, _: value + offset)

    return build


def _gain(channel: str, by: float) -> Callable[[Case], None]:
    def build(case: Case) -> None:
        case.parameters["gain"] = gain = 1.0 + by * case.size
        case.reads(channel, lambda value, _: gain * value)

    return build


CAUSES: dict[str, Cause] = {
    "stribeck": Cause("friction_over_speed", _stribeck, plans=POSITION, rates=_SPREAD),
    "saturating": Cause("friction_over_tension", _saturating),
    "quadratic_bend": Cause("friction_over_curvature", _quadratic),
    "two_stretches": Cause("friction_over_arc_length", _stretches),
    "unequal": Cause("friction_over_direction", _unequal, "asymmetric_friction"),
    "wear": Cause("friction_over_travel", _worn, "friction_drift"),
    "running_in": Cause("friction_over_travel", _run_in),
    "warming": Cause("friction_over_time", _warming, rates=_SLOW),
    "power_strain": Cause("strain_over_tension", _power_strain),
    "power_creep": Cause("strain_over_time", _power_creep, rates=_SLOW),
    "two_time_creep": Cause("strain_over_time", _two_time_creep, rates=_SLOW),
    "load_play": Cause("play_at_load", _load_play, "load_play", LOAD_MOVE),
    "drive_play": Cause("play_at_drive", _drive_play, "backlash", plans=POSITION),
    "load_play_inside": Cause("play_at_load", _inside(_load_play), "load_play", LOAD_MOVE),
    "drive_play_inside": Cause("play_at_drive", _inside(_drive_play), "backlash", plans=POSITION),
    "presliding": Cause("presliding", _presliding, "presliding"),
    "curved_tension_in": Cause("sensor_curve", _curved("tension_in", 2)),
    "curved_tension_out": Cause("sensor_curve", _curved("tension_out", 3), plans=LOAD_CELL),
    "drifting_tension_out": Cause(
        "sensor_drift", _drifting("tension_out", 0.35, "root"), plans=LOAD_CELL, rates=_SLOW
    ),
    "drifting_displacement_in": Cause(
        "sensor_drift", _drifting("displacement_in", 0.25e-3, "late"), plans=("force",), rates=_SLOW
    ),
    "drifting_displacement_out": Cause(
        "sensor_drift", _drifting("displacement_out", 0.25e-3, "wave"), plans=LOAD_MOVE, rates=_SLOW
    ),
    "gain_drifting_out": Cause(
        "sensor_gain_drift", _gain_drifting("tension_out", 0.08), plans=LOAD_CELL, rates=_SLOW
    ),
    "late_tension_out": Cause(
        "sensor_lag", _late("tension_out", 0.1), "channel_lag", LOAD_CELL, (50.0, 100.0)
    ),
    "late_drive": Cause("sensor_lag", _late("tension_in", 0.08), "channel_lag", ("force",), (50.0, 100.0)),
    "stiffening_load": Cause("load_over_position", _stiffening, plans=("full", "elongation", "no_load_cell")),
    "end_stretch": Cause("stretch_at_end", _end_stretch),
    "preload": Cause("preload", _preload, "pretension_error"),
    "bend": Cause("route_angle", _bend, "hidden_bend"),
    "near_fitting": Cause("friction_at_end", _near_fitting, "end_fitting_friction_proximal"),
    "load_fitting": Cause("friction_at_end", _load_fitting, "end_fitting_friction_distal", plans=LOAD_CELL),
    "load_friction": Cause("friction_at_load", _load_friction, "load_friction", ("full", "elongation")),
    "zero_out": Cause("sensor_zero", _zero("tension_out", 0.35), "tension_out_offset", LOAD_CELL),
    "zero_in": Cause("sensor_zero", _zero("tension_in", 0.35), "tension_in_offset", ("full", "elongation")),
    "gain_out": Cause("sensor_gain", _gain("tension_out", 0.05), "tension_out_gain", LOAD_CELL),
    "gain_in": Cause("sensor_gain", _gain("tension_in", 0.05), "tension_in_gain", ("full", "elongation")),
}
"""By name; a clean campaign has none of them."""

"""What may be wrong with a rig, each a change of its physics or its instruments.

Typical sizes are such as rigs show: tenths of a newton, tenths of a millimetre. Names and parameters are
those of rig files; what the workflow has no name for is `OUTSIDE`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, slots=True)
class Change:
    """What a cause does to a rig."""

    parameters: dict[str, float | str]
    """As a report should find them, in SI; the first is the amplitude."""
    physics: dict[str, object] = field(default_factory=dict)
    sensors: dict[str, dict[str, object]] = field(default_factory=dict)
    """Faults of the sensor of each channel."""
    sway_rad: float = 0.0
    """How far the widest turn of a route swings in each run."""
    slip_m: float = 0.0
    """How far the zero of the distal encoder jumps within a run."""
    warm_N_per_K2: float = 0.0
    """What the distal cell adds for the square of the warming."""


Cause = Callable[[float, np.random.Generator, float], Change]
"""From size (1 is typical), random numbers and the length of the sheath [m]."""


def _one(parameter: str, typical: float, physics: str, *, signed: bool = False, **fixed: float) -> Cause:
    """A cause with one amplitude, within 15 % of typical, that is one number of the physics."""

    def change(size: float, rng: np.random.Generator, length: float) -> Change:
        value = size * _amplitude(rng, typical, signed)
        return Change({parameter: value}, {physics: value, **fixed})

    return change


def _two(parameter: str, typical: float, physics: str, second: str, about: float, law: str) -> Cause:
    """A cause whose second number, of which nobody knows more than 25 %, is no matter of size."""

    def change(size: float, rng: np.random.Generator, length: float) -> Change:
        value = size * _amplitude(rng, typical, signed=False)
        scale = about * rng.uniform(0.75, 1.25)
        return Change({parameter: value, second: scale}, {physics: value, law: scale})

    return change


def _amplitude(rng: np.random.Generator, typical: float, signed: bool) -> float:
    sign = rng.choice([-1.0, 1.0])
    return typical * rng.uniform(0.85, 1.15) * (sign if signed else 1.0)


def _creep(size: float, rng: np.random.Generator, length: float) -> Change:
    ratio, time = size * _amplitude(rng, 0.06, signed=False), rng.uniform(12.0, 25.0)
    return Change({"ratio": ratio, "time_s": time}, {"creep_ratios": (ratio,), "creep_times_s": (time,)})


def _hidden_bend(size: float, rng: np.random.Generator, length: float) -> Change:
    angle, at = size * rng.uniform(0.5, 0.7), length * rng.uniform(0.25, 0.75)
    return Change({"angle_rad": angle, "at_m": at}, {"bend_angle_rad": angle, "bend_at_m": at})


def _pretension(size: float, rng: np.random.Generator, length: float) -> Change:
    error = size * _amplitude(rng, 0.6, signed=True)
    return Change({"error_N": error}, {"pretension_error_N": error})


def _gain(channel: str) -> Cause:
    def change(size: float, rng: np.random.Generator, length: float) -> Change:
        error = size * _amplitude(rng, 0.03, signed=True)
        return Change({"gain_error": error}, sensors={channel: {"gain": 1.0 + error}})

    return change


def _offset(channel: str) -> Cause:
    def change(size: float, rng: np.random.Generator, length: float) -> Change:
        offset = size * _amplitude(rng, 0.25, signed=True)
        return Change({"offset_N": offset}, sensors={channel: {"offset": offset}})

    return change


def _lag(size: float, rng: np.random.Generator, length: float) -> Change:
    lag, channel = (
        size * _amplitude(rng, 0.08, signed=False),
        str(rng.choice(["tension_in_N", "tension_out_N"])),
    )
    return Change({"lag_s": lag, "channel": channel}, sensors={channel: {"lag_s": lag}})


def _late_recorder(size: float, rng: np.random.Generator, length: float) -> Change:
    """All distal channels come from another recorder, whose clock is 60 to 100 ms late."""
    delay = size * 0.08 * rng.uniform(0.75, 1.25)
    channels = ("tension_out_N", "elongation_m", "displacement_out_m")
    late: dict[str, dict[str, object]] = {name: {"delay_s": delay} for name in channels}
    return Change({"lag_s": delay, "channel": "distal"}, sensors=late)


def _crosstalk(size: float, rng: np.random.Generator, length: float) -> Change:
    share = size * _amplitude(rng, 0.02, signed=True)
    return Change({"share": share}, sensors={"tension_out_N": {"crosstalk": {"tension_in_N": share}}})


INSIDE: dict[str, Cause] = {
    "load_dependent_friction": _one("exponent", -0.2, "load_exponent"),
    "velocity_dependent_friction": _one("gain", 0.08, "speed_gain"),
    "viscous_drag": _one("coefficient_Ns_per_m2", 300.0, "viscous_drag_Ns_per_m2"),
    "straight_section_friction": _one("force_N_per_m", 0.7, "straight_friction_N_per_m"),
    "curvature_dependent_friction": _one("gain_m", 0.012, "curvature_gain_m"),
    "asymmetric_friction": _one("asymmetry", 0.08, "asymmetry", signed=True),
    "friction_drift": _two("gain", 0.35, "wear_gain", "travel_m", 0.02, "wear_travel_m"),
    "end_fitting_friction_proximal": _one("force_N", 0.4, "fitting_in_N"),
    "end_fitting_friction_distal": _one("force_N", 0.4, "fitting_out_N"),
    "hidden_bend": _hidden_bend,
    "sheath_clearance": _one("clearance_m_per_rad", 1e-4, "clearance_m"),
    "slack_take_up": _two("slack_m", 5e-4, "take_up_in_m", "scale_N", 2.0, "take_up_in_scale_N"),
    "toe_region": _two("strain", 8e-4, "toe_strain", "scale_N", 2.0, "toe_scale_N"),
    "creep": _creep,
    "series_compliance_proximal": _one("compliance_m_per_N", 2e-5, "series_in_m_per_N"),
    "series_compliance_distal": _one("compliance_m_per_N", 2e-5, "series_out_m_per_N"),
    "thermal_drift": _one("expansion_per_K", 2e-5, "expansion_per_K"),
    "pretension_error": _pretension,
    "backlash": _one("width_m", 1.5e-4, "backlash_m"),
    "tension_in_gain": _gain("tension_in_N"),
    "tension_out_gain": _gain("tension_out_N"),
    "tension_in_offset": _offset("tension_in_N"),
    "tension_out_offset": _offset("tension_out_N"),
    "channel_lag": _lag,
    "load_cell_crosstalk": _crosstalk,
}
"""The library's effects, by name."""

CHOICES: dict[str, Cause] = {"late_recorder": _late_recorder}
"""Effects of the library with a choice that is not in the benchmark."""


def _stribeck(size: float, rng: np.random.Generator, length: float) -> Change:
    """Friction that fell with speed and grows again, late, in a dwell."""
    gain = size * _amplitude(rng, 0.3, signed=False)
    law = {"stribeck_gain": gain, "stribeck_speed_m_per_s": 1e-3, "speed_lag_s": 0.5}
    return Change({"gain": gain}, law)


def _rough_stretch(size: float, rng: np.random.Generator, length: float) -> Change:
    """A stretch of the sheath with more friction wherever it bends, as a route may or may not do there."""
    gain, start = size * _amplitude(rng, 1.5, signed=False), length * rng.uniform(0.2, 0.5)
    law = {"profile_s_m": (start, start, start + 0.3 * length, start + 0.3 * length)}
    return Change({"gain": gain}, {**law, "profile": (1.0, 1.0 + gain, 1.0 + gain, 1.0)})


def _sway(size: float, rng: np.random.Generator, length: float) -> Change:
    """The route swings while it is taken for still."""
    sway = size * _amplitude(rng, 0.4, signed=True)
    return Change({"sway_rad": sway}, sway_rad=sway)


def _wandering_cell(size: float, rng: np.random.Generator, length: float) -> Change:
    drift = size * _amplitude(rng, 0.3, signed=True)
    fault = {"drift": drift, "drift_time_s": rng.uniform(15.0, 40.0)}
    return Change({"drift_N": drift}, sensors={"tension_out_N": fault})


def _slipping_encoder(size: float, rng: np.random.Generator, length: float) -> Change:
    slip = size * _amplitude(rng, 8e-5, signed=True)
    return Change({"slip_m": slip}, slip_m=slip)


def _warm_cell(size: float, rng: np.random.Generator, length: float) -> Change:
    warm = size * _amplitude(rng, 0.04, signed=True)
    return Change({"warm_N_per_K2": warm}, warm_N_per_K2=warm)


def _bent_cell(size: float, rng: np.random.Generator, length: float) -> Change:
    """A load cell ten times less straight than it is specified."""
    bow = size * _amplitude(rng, 0.01, signed=False)
    return Change({"nonlinearity": bow}, sensors={"tension_in_N": {"nonlinearity": bow}})


OUTSIDE: dict[str, Cause] = {
    "stribeck_with_lag": _stribeck,
    "rough_stretch": _rough_stretch,
    "swaying_route": _sway,
    "wandering_load_cell": _wandering_cell,
    "slipping_encoder": _slipping_encoder,
    "warm_load_cell": _warm_cell,
    "bent_load_cell": _bent_cell,
}
"""Causes that the library holds no name for."""

PAIRS: tuple[tuple[str, str], ...] = (
    ("creep", "tension_out_offset"),
    ("load_dependent_friction", "backlash"),
    ("hidden_bend", "tension_in_gain"),
    ("viscous_drag", "series_compliance_proximal"),
    ("slack_take_up", "asymmetric_friction"),
    ("thermal_drift", "end_fitting_friction_distal"),
    ("friction_drift", "channel_lag"),
    ("sheath_clearance", "tension_out_gain"),
    ("pretension_error", "velocity_dependent_friction"),
    ("toe_region", "straight_section_friction"),
    ("curvature_dependent_friction", "load_cell_crosstalk"),
    ("end_fitting_friction_proximal", "series_compliance_distal"),
)
"""Pairs that no known tie joins."""

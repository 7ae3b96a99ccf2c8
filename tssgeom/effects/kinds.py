"""What every effect states: parameters, bounds, priors, where it acts and its ties; and what it changes."""

import math
import re
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, NamedTuple

import msgspec

from tssgeom.errors import SettingsError

Hook = Literal["friction cone", "route", "bar law", "eigenstrain", "boundary", "observation"]
Channel = Literal[
    "tension_in_N",
    "tension_out_N",
    "elongation_m",
    "displacement_in_m",
    "displacement_out_m",
]

LOSSES: tuple[Channel, ...] = (
    "tension_out_N",
    "elongation_m",
    "displacement_in_m",
    "displacement_out_m",
)
"""Channels that answer to friction when the proximal tension is given."""
PATHS: tuple[Channel, ...] = ("elongation_m", "displacement_in_m")
"""Channels that answer to added stretch when the proximal tension is given."""
ANSWERS: tuple[Channel, ...] = (
    "tension_in_N",
    "tension_out_N",
    "elongation_m",
    "displacement_out_m",
)
"""Channels that answer when the proximal position is given."""
DISTAL: tuple[Channel, ...] = ("tension_out_N", "displacement_out_m", "elongation_m")
"""Channels that a recorder at the distal end stores."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of an effect; the prior is normal about `centre` and cut at the bounds."""

    unit: str
    """Unit as in a report; "1" for none."""
    lower: float
    upper: float
    typical: float
    """A size that is met in practice."""
    prior_sd: float
    """Standard deviation of the prior, in the parameter's unit."""
    centre: float = 0.0
    """Where the prior stands: 0 for what may be absent, else the value that a scale usually has."""
    switch: bool = True
    """True where zero switches the effect off."""
    fitted: bool = True
    """False for a scale that runs seldom determine."""


@dataclass(frozen=True, slots=True)
class Tie:
    """What no fit can distinguish from the effect, and the experiment that can."""

    gauge: str
    """Name of the tie in docs/model.md, G1 to G10."""
    partners: tuple[str, ...]
    """Other effects, or `rig.` and a key of the rig, that together give the same data."""
    where: str
    """The condition under which the tie is exact."""
    breaks: str
    """The experiment that breaks it."""


class Bend(NamedTuple):
    """A bend that the sensed route does not show."""

    middle_m: float
    """Arc length of its middle [m]."""
    angle_rad: float
    """Curve angle that it adds [rad]."""
    width_m: float
    """Arc length over which it bends [m]."""


class Curve(NamedTuple):
    """A law as points; which of the core's tables it is, or which sensor's."""

    table: str
    x: tuple[float, ...]
    """[k] Increasing, in SI."""
    y: tuple[float, ...]
    """[k] In SI."""


@dataclass(frozen=True, slots=True)
class Setup:
    """One run's physics as numbers: the rig's own and what its effects add; the defaults are the base model.

    Source: docs/model.md (50)-(62).
    """

    friction: float
    """Coulomb coefficient μ [1]."""
    compliance: float
    """Strain per tension ρ [1/N]."""
    pretension: float
    """Tension before the run T_0 [N]."""
    load_stiffness: float
    """Distal spring; 0 is a dead weight, inf a fixed end [N/m]."""

    # friction
    load_exponent: float = 0.0
    load_reference_N: float = 10.0
    speed_gain: float = 0.0
    speed_reference_m_per_s: float = 1e-3
    speed_memory_s: float = 0.0
    drag_Ns_per_m2: float = 0.0
    straight_friction_N_per_m: float = 0.0
    curvature_gain_m: float = 0.0
    asymmetry: float = 0.0
    wear_gain: float = 0.0
    wear_travel_m: float = 0.05
    fitting_in_N: float = 0.0
    fitting_out_N: float = 0.0
    fitting_in_exponent: float = 0.0
    fitting_out_exponent: float = 0.0
    presliding_m: float = 0.0
    presliding_reference_N: float = 10.0
    presliding_law: str = "prandtl"

    # route
    bends: tuple[Bend, ...] = ()
    """Bends that the sensed route does not show."""
    clearance_m_per_rad: float = 0.0
    clearance_scale_N: float = 2.0

    # elasticity
    take_up_in_m: float = 0.0
    take_up_in_scale_N: float = 2.0
    take_up_out_m: float = 0.0
    take_up_out_scale_N: float = 2.0
    toe_strain: float = 0.0
    toe_scale_N: float = 2.0
    creep_ratio: float = 0.0
    creep_time_s: float = 20.0
    more_creep: tuple[tuple[float, float], ...] = ()
    """Ratio [1] and time [s] of further elements of creep."""
    series_in_m_per_N: float = 0.0
    series_out_m_per_N: float = 0.0
    expansion_per_K: float = 0.0

    # boundary
    backlash_m: float = 0.0
    backlash_open_m: float = 0.0
    load_friction_N: float = 0.0

    # sensors
    tension_in_gain: float = 1.0
    tension_out_gain: float = 1.0
    tension_in_offset_N: float = 0.0
    tension_out_offset_N: float = 0.0
    crosstalk: float = 0.0
    load_play_m: float = 0.0
    load_play_open_m: float = 0.0
    lags: tuple[tuple[Channel, float], ...] = ()
    """Channel and time constant [s] of each lag."""
    distal_delay_s: float = 0.0
    """How late the recorder of all distal channels is."""

    curves: tuple[Curve, ...] = ()
    """Laws that are no formula; docs/model.md (185) to (188)."""


def snake(name: str) -> str:
    """Return a class name as it stands in a rig file: HiddenBend is hidden_bend."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


class Effect(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="name", tag=snake
):
    """What all effects share: bounds that are checked, and what the workflow needs of each."""

    hook: ClassVar[Hook]
    by_force: ClassVar[tuple[Channel, ...]] = LOSSES
    """Channels that the effect may touch when the proximal tension is given."""
    by_position: ClassVar[tuple[Channel, ...]] = ANSWERS
    """Channels that the effect may touch when the proximal position is given."""
    needs: ClassVar[tuple[str, ...]] = ()
    """Columns without which a run shows nothing of the effect."""
    parameters: ClassVar[dict[str, Parameter]] = {}
    ties: ClassVar[tuple[Tie, ...]] = ()
    sets: ClassVar[dict[str, str]] = {}
    """Numbers of a setup, and the own number that each is."""
    adds: ClassVar[dict[str, str]] = {}
    """Numbers of a setup, and the own number that is added to each."""

    def on(self, setup: Setup) -> Setup:
        """Return the setup with this effect in it."""
        given = {name: getattr(self, own) for name, own in self.sets.items()}
        more = {name: getattr(setup, name) + getattr(self, own) for name, own in self.adds.items()}
        return replace(setup, **given, **more)

    def __post_init__(self) -> None:
        for key, allowed in self.parameters.items():
            value = getattr(self, key)
            if not (math.isfinite(value) and allowed.lower <= value <= allowed.upper):
                unit = "" if allowed.unit == "1" else f" {allowed.unit}"
                raise SettingsError(
                    f"effects.{snake(type(self).__name__)}.{key} is {value:g}{unit}: "
                    f"give {allowed.lower:g} to {allowed.upper:g}{unit}"
                )

"""What every effect says of itself: parameters with bounds and priors, where it acts, what it is tied to."""

import math
import re
from dataclasses import dataclass
from typing import ClassVar, Literal

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
    """What no fit can tell apart from the effect, and the experiment that can."""

    gauge: str
    """Name of the tie in docs/model.md, G1 to G10."""
    partners: tuple[str, ...]
    """Other effects, or `rig.` and a key of the rig, that together give the same data."""
    where: str
    """The condition under which the tie is exact."""
    breaks: str
    """The experiment that breaks it."""


def snake(name: str) -> str:
    """Return a class name as it stands in a rig file: HiddenBend is hidden_bend."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


class Effect(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="name", tag=snake
):
    """What all effects share: bounds that are checked, and what the workflow wants to know of each."""

    hook: ClassVar[Hook]
    by_force: ClassVar[tuple[Channel, ...]] = LOSSES
    """Channels that the effect may touch when the proximal tension is given."""
    by_position: ClassVar[tuple[Channel, ...]] = ANSWERS
    """Channels that the effect may touch when the proximal position is given."""
    needs: ClassVar[tuple[str, ...]] = ()
    """Columns without which a run shows nothing of the effect."""
    parameters: ClassVar[dict[str, Parameter]] = {}
    ties: ClassVar[tuple[Tie, ...]] = ()

    def __post_init__(self) -> None:
        for key, told in self.parameters.items():
            value = getattr(self, key)
            if not (math.isfinite(value) and told.lower <= value <= told.upper):
                unit = "" if told.unit == "1" else f" {told.unit}"
                raise SettingsError(
                    f"effects.{snake(type(self).__name__)}.{key} is {value:g}{unit}: "
                    f"give {told.lower:g} to {told.upper:g}{unit}"
                )

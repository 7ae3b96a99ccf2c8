"""One visual language: names, units and colours of quantities and timelines in every picture.

The palette itself is in `colours`; every picture takes names, units and colours from here.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from tssgeom.channel_names import quantity_of, unit_of, words_of
from tssgeom.view import colours

TIMELINE = "time"
"""Timeline of seconds."""
COUNT = "sample"
"""Timeline of counted samples: runs of unlike length, one after the other."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """Name, unit and colours of a quantity."""

    symbol: str
    words: str
    unit: str
    factor: float
    """Units of a picture in one SI unit [1]."""
    ink: str
    """Colour on white."""

    @property
    def rgb(self) -> tuple[int, int, int]:
        """Colour on the dark ground of a recording."""
        return colours.rgb_of(colours.on_dark(self.ink))

    @property
    def label(self) -> str:
        """Symbol and unit."""
        return f"{self.symbol} [{self.unit}]"

    @property
    def title(self) -> str:
        """Words, symbol and unit, for an axis."""
        return f"{self.words} {self.label}"


_SOFT = "#697386"
TENSION_IN = Quantity("T_in", "input tension", "N", 1.0, colours.TENSION_IN)
TENSION_OUT = Quantity("T_out", "output tension", "N", 1.0, colours.TENSION_OUT)
ELONGATION = Quantity("δ", "elongation", "mm", 1e3, colours.ELONGATION)
DISPLACEMENT_IN = Quantity("x_in", "input displacement", "mm", 1e3, colours.TENSION_IN)
DISPLACEMENT_OUT = Quantity("x_out", "output displacement", "mm", 1e3, colours.TENSION_OUT)
ANGLE = Quantity("Φ", "curve angle", "°", 57.29577951308232, colours.ANGLE)
ARC_LENGTH = Quantity("s", "arc length", "mm", 1e3, _SOFT)
CURVATURE_AT = Quantity("κ", "curvature", "1/m", 1.0, "#5b6474")
TENSION_AT = Quantity("T", "tension", "N", 1.0, colours.TENSION_OUT)
TIME = Quantity("t", "time", "s", 1.0, _SOFT)

SYMBOL = re.compile(r"(?<![\w$])(Δ?[TxyzbIdθτδμ])_(in|out|tip|[mjs0xyz])(,\d+)?(?!\w|\.\w)")
"""A symbol with its subscript, as `T_in` or `T_in,2`: letter, subscript, number."""

CHANNELS = {
    "tension_in_N": TENSION_IN,
    "tension_out_N": TENSION_OUT,
    "elongation_m": ELONGATION,
    "displacement_in_m": DISPLACEMENT_IN,
    "displacement_out_m": DISPLACEMENT_OUT,
}
"""Quantities that runs measure, by the names of their columns."""


_OF_MACHINES = {
    "motor_angle": ("θ_m", "motor angle"),
    "motor_torque": ("τ_m", "motor torque"),
    "motor_current": ("I_m", "motor current"),
    "joint_angle": ("θ_j", "joint angle"),
    "joint_torque": ("τ_j", "joint torque"),
    "bending_x": ("b_x", "bending towards x"),
    "bending_y": ("b_y", "bending towards y"),
    "tip_x": ("x_tip", "tip in x"),
    "tip_y": ("y_tip", "tip in y"),
    "tip_z": ("z_tip", "tip in z"),
}
_PICTURED = {"rad": ("°", 57.29577951308232), "m": ("mm", 1e3), "Nm": ("mN·m", 1e3), "A": ("mA", 1e3)}
_NUMBERED = re.compile(r"(.*)_(\d+)_([A-Za-z]+)")


def quantity(name: str) -> Quantity:
    """Return how a channel is pictured, of one tendon or of a machine: `tension_in_2_N` as `T_in,2`."""
    if name in CHANNELS:
        return CHANNELS[name]
    numbered = _NUMBERED.fullmatch(name)
    if numbered and f"{numbered[1]}_{numbered[3]}" in CHANNELS:
        of_one = CHANNELS[f"{numbered[1]}_{numbered[3]}"]
        words = f"{of_one.words} of tendon {numbered[2]}"
        return replace(of_one, symbol=f"{of_one.symbol},{numbered[2]}", words=words)
    unit = unit_of(name)
    symbol, words = _OF_MACHINES.get(quantity_of(name), (words_of(name),) * 2)
    pictured, factor = _PICTURED.get(unit, (unit, 1.0))
    return Quantity(symbol, words, pictured, factor, _SOFT)

"""One visual language: names, units and colours of quantities and timelines in every picture.

The palette itself is in `colours`; every picture takes names, units and colours from here.
"""

from __future__ import annotations

from dataclasses import dataclass

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
    rgb: tuple[int, int, int]
    """Colour on the dark ground of a recording."""
    ink: str
    """Colour on paper."""

    @property
    def label(self) -> str:
        """Symbol and unit."""
        return f"{self.symbol} [{self.unit}]"

    @property
    def title(self) -> str:
        """Words, symbol and unit, for an axis."""
        return f"{self.words} {self.label}"


TENSION_IN = Quantity("T_in", "input tension", "N", 1.0, colours.TENSION_IN, "#1d2330")
TENSION_OUT = Quantity("T_out", "output tension", "N", 1.0, colours.TENSION_OUT, "#0072b2")
ELONGATION = Quantity("δ", "elongation", "mm", 1e3, colours.ELONGATION, "#d55e00")
DISPLACEMENT_IN = Quantity("x_in", "input displacement", "mm", 1e3, colours.TENSION_IN, "#1d2330")
DISPLACEMENT_OUT = Quantity("x_out", "output displacement", "mm", 1e3, colours.TENSION_OUT, "#0072b2")
ANGLE = Quantity("Φ", "curve angle", "°", 57.29577951308232, colours.ANGLE, "#a3508a")
ARC_LENGTH = Quantity("s", "arc length", "mm", 1e3, colours.AXIS, "#697386")
CURVATURE_AT = Quantity("κ", "curvature", "1/m", 1.0, colours.SENSED, "#5b6474")
TENSION_AT = Quantity("T", "tension", "N", 1.0, colours.TENSION_OUT, "#0072b2")
TIME = Quantity("t", "time", "s", 1.0, colours.AXIS, "#697386")

FIRST, SECOND = colours.ELONGATION, colours.ANGLE
"""Colours of A and B where two things are compared."""

CHANNELS = {
    "tension_in_N": TENSION_IN,
    "tension_out_N": TENSION_OUT,
    "elongation_m": ELONGATION,
    "displacement_in_m": DISPLACEMENT_IN,
    "displacement_out_m": DISPLACEMENT_OUT,
}
"""Quantities that runs measure, by the names of their columns."""

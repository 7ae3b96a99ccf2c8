"""Units of laboratory files, as factors to SI.

Cited: the SI brochure (9th edition) for prefixes; NIST SP 811, appendix B, for inch, foot, pound-force,
ounce-force and kilogram-force (international pound 0.45359237 kg).
"""

from __future__ import annotations

import math
import re
import unicodedata
from typing import NamedTuple

from tssgeom.plausibility.limits import STANDARD_GRAVITY

FORCE, LENGTH, TIME, TEMPERATURE, ANGLE, CURVATURE, TORQUE, CURRENT = (
    *("force", "length", "time", "temperature", "angle", "curvature", "torque", "current"),
)
_POUND = 0.45359237
_INCH = 0.0254


class Unit(NamedTuple):
    """One unit: a value of 1 in it is `factor` (+ `offset`) in SI; temperatures are in °C."""

    symbol: str
    quantity: str
    factor: float
    offset: float = 0.0

    @property
    def conversion(self) -> str:
        """How a value becomes SI, as a note states it: " × 9.80665"; empty where it stays."""
        times = "" if self.factor == 1.0 else f" × {self.factor:.9g}"
        return times + (f" {'+-'[self.offset < 0]} {abs(self.offset):.6g}" if self.offset else "")


_SPELLED: dict[str, dict[str, float]] = {
    FORCE: {
        "N newton newtons": 1.0,
        "mN millinewton": 1e-3,
        "uN": 1e-6,
        "cN": 1e-2,
        "daN": 10.0,
        "kN": 1e3,
        "kgf kp kg": STANDARD_GRAVITY,
        "gf g gram grams p": STANDARD_GRAVITY * 1e-3,
        "lbf lb lbs pound pounds": _POUND * STANDARD_GRAVITY,
        "ozf oz": _POUND * STANDARD_GRAVITY / 16,
    },
    LENGTH: {
        "m metre meter metres meters": 1.0,
        "dm": 1e-1,
        "cm centimetre centimeter centimetres centimeters": 1e-2,
        "mm millimetre millimeter millimetres millimeters": 1e-3,
        "um micron microns micrometre micrometer": 1e-6,
        "nm": 1e-9,
        'in inch inches " zoll': _INCH,
        "mil thou": _INCH * 1e-3,
        "ft foot feet": 12 * _INCH,
    },
    TIME: {
        "s sec secs second seconds sek": 1.0,
        "ms msec millisecond milliseconds": 1e-3,
        "us usec microsecond microseconds": 1e-6,
        "ns nsec": 1e-9,
        "min minute minutes": 60.0,
        "h hr hour hours std": 3600.0,
    },
    ANGLE: {"rad radian radians": 1.0, "mrad": 1e-3, "deg degree degrees °": math.pi / 180},
    TORQUE: {
        "Nm N·m N*m newtonmetre": 1.0,
        "mNm mN·m mN*m": 1e-3,
        "Ncm N·cm": 1e-2,
        "Nmm N·mm": 1e-3,
        "lbf·in lbf*in lbfin": _POUND * STANDARD_GRAVITY * _INCH,
        "ozf·in ozf*in ozfin": _POUND * STANDARD_GRAVITY * _INCH / 16,
    },
    CURRENT: {"A ampere ampère amps": 1.0, "mA": 1e-3},
    TEMPERATURE: {"C °C degC celsius": 1.0},
    CURVATURE: {
        "1/m /m m^-1 m-1 per_m rad/m rad_per_m": 1.0,
        "1/mm /mm mm^-1 mm-1 per_mm rad/mm rad_per_mm": 1e3,
        "1/cm /cm cm^-1 per_cm": 1e2,
        "deg/m °/m deg_per_m": math.pi / 180,
        "deg/mm °/mm deg_per_mm": 1e3 * math.pi / 180,
    },
}

UNITS: dict[str, Unit] = {
    spelling: Unit(spelling, quantity, factor)
    for quantity, spelled in _SPELLED.items()
    for spellings, factor in spelled.items()
    for spelling in spellings.split()
} | {
    **dict.fromkeys(("K", "kelvin"), Unit("K", TEMPERATURE, 1.0, -273.15)),
    **dict.fromkeys(("F", "°F", "degF"), Unit("°F", TEMPERATURE, 5 / 9, -160 / 9)),
}
"""Units by their symbols."""
_ANY_CASE = {symbol.lower(): unit for symbol, unit in reversed(UNITS.items())}
SI = {
    FORCE: "N",
    LENGTH: "m",
    TIME: "s",
    TEMPERATURE: "C",
    CURVATURE: "per_m",
    ANGLE: "rad",
    TORQUE: "Nm",
    CURRENT: "A",
}
"""Unit of each quantity that channels are held in."""


def plain(text: str) -> str:
    """Return a text with one spelling of each sign: µ and μ as u, full-width letters narrow."""
    return unicodedata.normalize("NFKC", text).replace("μ", "u").replace("º", "°").strip()


def unit_of(text: str) -> Unit | None:
    """Return the unit of a symbol, None where it is none; the case counts where it has to (mN, MN)."""
    symbol = plain(text).strip("[](){}<> ").rstrip(".")
    symbol = re.sub(r"\s*\*\*\s*", "^", symbol)
    unit = UNITS.get(symbol) or (_ANY_CASE.get(symbol.lower()) if symbol != "MN" else None)
    if unit is None and (product := UNITS.get(re.sub(r"[\s.*·⋅-]+", "", symbol))) is not None:
        return product if product.quantity == TORQUE else None  # N mm, N.mm, mN-m; m s is no ms
    return unit


def scaled_unit(text: str) -> Unit | None:
    """Return a unit with a factor before it, as `--map` takes it: "mm", "-N", "0.2094mm"."""
    match = re.fullmatch(r"\s*([-+]?\d*\.?\d+(?:[eE][-+]?\d+)?|-)?\s*[*×]?\s*(\S+)\s*", text)
    if match is None or (unit := unit_of(match[2])) is None:
        return None
    times = {None: 1.0, "-": -1.0}.get(match[1]) or float(match[1])
    if not math.isfinite(times) or times == 0:
        return None
    return unit._replace(symbol=text.strip(), factor=times * unit.factor)

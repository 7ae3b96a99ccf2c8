"""What the name of a channel, a column or a number states: its quantity, then its unit.

`tension_in_N` is the quantity `tension_in` in N, `speed_m_per_s` the quantity `speed` in m/s.
"""

from __future__ import annotations

from collections.abc import Iterator

_NUMERATORS = {"N", "Nm", "mNm", "Ns", "m", "mm", "rad", "deg", "s", "A", "mA", "C", "K", "px"}
"""Units that may stand before `per`; a name with another word there counts something per the unit."""


def _parts(name: str) -> tuple[str, str]:
    """Return the quantity, and the unit as the name spells it; a name of one word has no unit."""
    quantity, _, unit = name.rpartition("_")
    if not quantity.endswith("_per"):
        return (quantity, unit) if quantity else (name, "")
    quantity = quantity.removesuffix("_per")
    stem, _, numerator = quantity.rpartition("_")
    if stem and numerator in _NUMERATORS:
        return stem, f"{numerator}_per_{unit}"
    return quantity, f"per_{unit}"


def quantity_of(name: str) -> str:
    """Return a name without its unit: `tension_in` of `tension_in_N`."""
    return _parts(name)[0]


def unit_of(name: str) -> str:
    """Return the unit at the end of a name: `N` of `tension_in_N`, `rad/s` of `rate_rad_per_s`."""
    unit = _parts(name)[1]
    return f"1/{unit.removeprefix('per_')}" if unit.startswith("per_") else unit.replace("_per_", "/")


def words_of(name: str) -> str:
    """Return the quantity of a name in words: `tension in` of `tension_in_N`."""
    return quantity_of(name).replace("_", " ")


def marked(name: str, mark: str) -> str:
    """Return a name with a mark before its unit: `tension_in_se_N` of `tension_in_N` and `se`."""
    quantity, unit = _parts(name)
    return f"{quantity}_{mark}_{unit}" if unit else f"{quantity}_{mark}"


def numbered(name: str, count: int) -> Iterator[str]:
    """Yield the channel of each tendon: `tension_in_N` of one, `tension_in_1_N` … of several."""
    yield from (name,) if count == 1 else (marked(name, str(k + 1)) for k in range(count))


_OF_KEYS = {
    "_per_N": "1/N",
    "_N_per_m": "N/m",
    "_Nm_per_rad": "N·m/rad",
    "_Nm_per_rad3": "N·m/rad³",
    "_Nm": "N·m",
    "_N": "N",
    "_m": "m",
    "_rad": "rad",
    "_A": "A",
    "_s": "s",
}


def unit_of_key(key: str) -> str:
    """Return the unit of a number of a rig or of a run as it is printed, 1 where its name ends in none.

    The zero of a sensor has the unit of its channel, a drift that by s.
    """
    if key.endswith(".drift_per_s"):
        return f"{unit_of_key(key.removesuffix('.drift_per_s'))}/s"
    name = key.removesuffix(".zero")
    return next((unit for ending, unit in _OF_KEYS.items() if name.endswith(ending)), "1")

"""Checks of single arguments of the public calls, with few imports: `import tssgeom` stays quick."""

from __future__ import annotations

from typing import Any

from tssgeom.errors import SettingsError


def tension_of(given: Any) -> float:
    """Return a tension that is a number.

    Raises
    ------
    SettingsError
        Where it is a text or another object.
    """
    try:
        if isinstance(given, str | bytes):
            raise TypeError
        return float(given)
    except (TypeError, ValueError) as error:
        raise SettingsError(f"tension_in is {given!r}: give a number in N") from error


def in_metres(lengths: Any, unit: str | None) -> Any:
    """Return an array of another unit in metres.

    Raises
    ------
    SettingsError
        Where the unit is none of length.
    """
    import numpy as np

    from tssgeom.io.formats.recording import PER_METRE

    if unit not in PER_METRE:
        raise SettingsError(f"unit is {unit!r}: give one of {', '.join(map(repr, PER_METRE))}")
    return np.asarray(lengths, np.float64) / PER_METRE[unit]


def require_no_unit(unit: str | None, what: str) -> None:
    """Refuse a unit beside what is in metres.

    Raises
    ------
    SettingsError
        Where one is given.
    """
    if unit is not None:
        raise SettingsError(f"unit is {unit!r}, but {what} is in m: leave unit out")

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
    """Return an array in mm in metres.

    Raises
    ------
    SettingsError
        Where the unit is another one.
    """
    if unit != "mm":
        raise SettingsError(f"unit is {unit!r}: give 'mm' or 'm'")
    import numpy as np

    return np.asarray(lengths, np.float64) / 1e3


def require_no_unit(unit: str | None, what: str) -> None:
    """Refuse a unit beside what is in metres.

    Raises
    ------
    SettingsError
        Where one is given.
    """
    if unit is not None:
        raise SettingsError(f"unit is {unit!r}, but {what} is in m: leave unit out")

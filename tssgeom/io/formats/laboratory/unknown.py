"""Names of keys and arrays that no reader reads: which may be meant, and whether that changes a result."""

from __future__ import annotations

import difflib
from collections.abc import Collection
from functools import lru_cache

from tssgeom.errors import ShapeError
from tssgeom.io.formats.laboratory.names import QUANTITIES, canonical, meaning_of
from tssgeom.io.formats.laboratory.units import FORCE, TIME

_SIMILAR = 0.75
"""Similarity at which a name is a misspelt one (`difflib`); chosen: a letter left out or exchanged."""
_MOST = 32
"""Unknown names of a frame or file that are compared; chosen: twice those known, in 3 ms, the first time."""
_LONGEST = 64
"""Characters of a name that are compared and repeated; chosen: three times those of the longest known one."""


def unknown_names(
    names: Collection[str], known: Collection[str], *, driven: bool, every: bool = False
) -> tuple[str, ...]:
    """Return a warning for each name that is not known and resembles one that is.

    The frames of one sender have the same names, so the last answers are kept.

    Parameters
    ----------
    names
        The names that are not known.
    known
        The names that are.
    driven
        Whether something else drives the tendon.
    every
        Whether names that resemble no known one have a warning too.

    Raises
    ------
    ShapeError
        Where a name may be a drive, and nothing else drives the tendon: the default would be a wrong result.
    """
    compared = sorted(name if len(name) <= _LONGEST else name[:_LONGEST] + "…" for name in names)
    more = len(compared) - _MOST if every else 0
    warnings = _compared(tuple(compared[:_MOST]), tuple(sorted(known)), driven, every)
    return (*warnings, f"{more} more names are not read") if more > 0 else warnings


@lru_cache(64)  # chosen: senders of as many kinds
def _compared(names: tuple[str, ...], known: tuple[str, ...], driven: bool, every: bool) -> tuple[str, ...]:
    warnings = list[str]()
    for name in names:
        nearest = _nearest(name, known)
        if nearest is None:
            warnings += [f"{name!r} is not read"] if every else []
            continue
        text = f"{name!r} is not read: the nearest name is {nearest}"
        meaning = meaning_of(name)
        force = meaning is not None and meaning.quantity == FORCE
        if not driven and (
            force or nearest.startswith(("tension_in", "displacement_")) or "_target_" in nearest
        ):
            raise ShapeError(f"{text}; nothing else drives the tendon: rename it, or leave it out")
        warnings.append(text)
    return tuple(warnings)


def _nearest(name: str, known: tuple[str, ...]) -> str | None:
    """Return the known name that another one resembles: by what it measures, else by its letters."""
    meaning = meaning_of(name)
    channel = "" if meaning is None else {"force": "tension_in"}.get(meaning.channel, meaning.channel)
    channel = "displacement_in" if channel == "displacement" else channel
    if channel in QUANTITIES and canonical(channel) in known:
        return canonical(channel)
    measures = meaning is not None and bool(meaning.quantity)
    if meaning is not None and meaning.quantity == TIME:  # it is no drive, whatever its letters
        known = tuple(each for each in known if (of := meaning_of(each)) and of.quantity == TIME)
    near = difflib.get_close_matches(name, known, 1, 0.0 if measures else _SIMILAR)
    return near[0] if near else None

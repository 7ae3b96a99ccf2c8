"""Names of keys and arrays that no reader knows: which may be meant, and whether that changes a result."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable

from tssgeom.errors import ShapeError
from tssgeom.io.formats.laboratory.names import QUANTITIES, canonical, meaning_of
from tssgeom.io.formats.laboratory.units import FORCE

_SIMILAR = 0.75
"""Similarity at which a name is a misspelt one (`difflib`); chosen: a letter left out or exchanged."""


def unknown_names(names: Iterable[str], known: Collection[str], *, driven: bool) -> tuple[str, ...]:
    """Return a warning for each name that is not known and resembles one that is.

    Parameters
    ----------
    names
        The names that are not known.
    known
        The names that are.
    driven
        Whether something else drives the tendon.

    Raises
    ------
    ShapeError
        Where a name may be a drive, and nothing else drives the tendon: the default would be a wrong result.
    """
    warnings = list[str]()
    for name in names:
        nearest = _nearest(name, known)
        if nearest is None:
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


def _nearest(name: str, known: Collection[str]) -> str | None:
    """Return the known name that another one resembles: by what it measures, else by its letters."""
    meaning = meaning_of(name)
    channel = "" if meaning is None else {"force": "tension_in"}.get(meaning.channel, meaning.channel)
    channel = "displacement_in" if channel == "displacement" else channel
    if channel in QUANTITIES and canonical(channel) in known:
        return canonical(channel)
    measures = meaning is not None and bool(meaning.quantity)
    near = difflib.get_close_matches(name, sorted(known), 1, 0.0 if measures else _SIMILAR)
    return near[0] if near else None

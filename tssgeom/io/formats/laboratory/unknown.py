"""Keys and names that no reader reads: which may be meant, and whether that changes a result."""

from __future__ import annotations

import difflib
from collections.abc import Collection
from functools import lru_cache
from typing import NamedTuple

import msgspec

from tssgeom.errors import ShapeError
from tssgeom.io.formats.columns import OF_MACHINE, of_machine
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


_number_decoder = msgspec.json.Decoder(float | None)
_keys_decoder = msgspec.json.Decoder(dict[str, msgspec.Raw])
_DRIVES = ("tension_in_N", "displacement_in_m", "displacement_target_m", "tension_out_target_N")
_CARRIED = frozenset(("covariance_mm2",))
"""Keys of other commands, which no reader needs."""


class OtherKeys(NamedTuple):
    """What a line has beside its own fields."""

    of_machine: dict[str, float] | None
    warnings: tuple[str, ...]
    """One for each key that is not read, with the one that it resembles."""


NO_OTHERS = OtherKeys(None, ())


def other_keys(text: bytes, known: Collection[str]) -> OtherKeys:
    """Return what a line has beside the keys that are `known`.

    Raises ShapeError where a key that is not read may be a drive, and nothing else drives the tendon; where a
    reading of a machine is no number.
    """
    held = _keys_decoder.decode(text)
    given = {name: _number(name, held[name]) for name in held.keys() & OF_MACHINE.keys()}
    machine = of_machine({name: value for name, value in given.items() if value is not None})
    unknown = held.keys() - set(known) - _CARRIED - given.keys()
    driven = machine is not None or any(bytes(held[key]) != b"null" for key in _DRIVES if key in held)
    warnings = unknown_names(unknown, known, driven=driven, every=True) if unknown else ()
    return OtherKeys(machine, warnings)


def _number(name: str, text: msgspec.Raw) -> float | None:
    try:
        return _number_decoder.decode(text)
    except msgspec.DecodeError as error:
        raise ShapeError(f'{name}: {error}: write "{name}" as a number') from error

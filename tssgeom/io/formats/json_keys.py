"""Keys of a JSON line beside the fields of every frame: readings of a machine, and what is unknown."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import msgspec

from tssgeom.errors import ShapeError
from tssgeom.io.formats.columns import OF_MACHINE, of_machine
from tssgeom.io.formats.laboratory.unknown import unknown_names

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

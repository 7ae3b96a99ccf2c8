"""Columns by statement of the user: `--map "NAME=channel[:unit]"`, `columns.toml`, `[columns]` of a rig."""

from __future__ import annotations

import codecs
import difflib
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import msgspec

from tssgeom.errors import SettingsError
from tssgeom.io.formats.laboratory.names import EXACT, QUANTITIES, canonical, channel_text
from tssgeom.io.formats.laboratory.units import Unit, plain, scaled_unit, unit_of
from tssgeom.io.formats.paths import SETTINGS_BYTES, bytes_of
from tssgeom.toml_keys import with_short_keys

FILE = "columns.toml"
"""Name of the file beside the data."""
IGNORE = "ignore"


class Mapped(NamedTuple):
    """One column as the user names it."""

    channel: str
    """A name of QUANTITIES, or IGNORE."""
    unit: Unit | None
    """None where the name of the column or the channel states it."""
    origin: str
    """Origin of the statement: "--map", the file or the rig."""
    named: Unit | None = None
    """Unit in the name of the channel, for a column that states none."""


class _Listed(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of `columns.toml`; a shell that writes it empties it first, as for `check --suggest >`."""

    columns: dict[str, str] = msgspec.field(default_factory=dict[str, str])


class ColumnMap:
    """Columns by name, of an option and of a rig; the file beside the data is read with each table.

    The option comes first, then the file beside the data, then the rig.
    """

    def __init__(self, options: Iterable[str] = (), rig: Mapping[str, str] | None = None) -> None:
        given = [_option(text) for text in options]
        self._options = dict(given)
        if len(self._options) < len(given):
            names = [name for name, _ in given]
            twice = next(name for name in names if names.count(name) > 1)
            raise SettingsError(f"--map {twice!r} is given twice: keep one")
        self._rig = {name: mapped(name, text, "rig [columns]") for name, text in (rig or {}).items()}
        self.reported = set[str]()
        """Notes that have been printed."""
        self.unused = set(self._options)
        """Names of the option that no file has had so far."""

    def of(self, path: Path) -> Mapping[str, Mapped]:
        """Return the statements on the columns of a file, by name.

        Raises SettingsError where the file beside the data cannot be used.
        """
        return {**self._rig, **_beside(path.parent), **self._options}

    def with_rig(self, rig: Mapping[str, str]) -> ColumnMap:
        """Return the same options with the statements of a rig on columns."""
        other = ColumnMap((), rig)
        other._options, other.reported, other.unused = self._options, self.reported, self.unused
        return other

    def anew(self) -> ColumnMap:
        """Return the same statements, of which no file has had a name so far."""
        other = ColumnMap()
        other._options, other._rig, other.unused = self._options, self._rig, set(self._options)
        return other

    @property
    def options(self) -> dict[str, str]:
        """The option as text, for a record of the settings."""
        return {
            name: channel_text(each.channel, each.unit or each.named) for name, each in self._options.items()
        }

    def use(self, names: Iterable[str]) -> None:
        """Note that a file has these columns."""
        held = {plain(name) for name in names}
        self.unused.difference_update({name for name in self.unused if plain(name) in held})


NO_MAP = ColumnMap()


def _option(text: str) -> tuple[str, Mapped]:
    name, sign, meant = text.rpartition("=")
    if not sign or not name.strip() or not meant.strip():
        raise SettingsError(
            f'--map {text!r}: write "NAME=channel[:unit]", such as "Pos=displacement_in_m:mm"'
        )
    return name.strip(), mapped(name.strip(), meant, "--map")


def mapped(name: str, text: str, origin: str) -> Mapped:
    """Read "channel[:unit]".

    Raises SettingsError where there is no such channel or unit, or the unit is one of another quantity.
    """
    whole, _, given = (part.strip() for part in text.partition(":"))
    channel, own = _channel(whole)
    if channel is None:
        known = (*QUANTITIES, *EXACT, IGNORE)
        near = difflib.get_close_matches(whole, known, 1)
        hint = f"did you mean {near[0]}?" if near else f"channels are {', '.join(map(canonical, QUANTITIES))}"
        raise SettingsError(f"{origin}: {name!r} is to be {whole!r}, which is no channel: {hint}")
    unit = scaled_unit(given) if given else own
    if given and (unit is None or unit.quantity != QUANTITIES.get(channel, "")):
        quantity = QUANTITIES.get(channel) or "a channel without unit"
        raise SettingsError(f"{origin}: {name!r} is to be {text!r}: {given!r} is no unit of {quantity}")
    return Mapped(channel, unit if given or whole not in EXACT else None, origin, own)


def _channel(text: str) -> tuple[str | None, Unit | None]:
    """Return the channel that a text names, with the unit in its name."""
    if text == IGNORE or text in QUANTITIES:
        return text, None
    for channel in sorted(QUANTITIES, key=len, reverse=True):
        unit = unit_of(text[len(channel) + 1 :]) if text.startswith(f"{channel}_") else None
        if unit is not None and unit.quantity == QUANTITIES[channel]:
            return channel, unit
    return None, None


@lru_cache(maxsize=256)
def _beside(folder: Path) -> Mapping[str, Mapped]:
    """Read `columns.toml` in a folder, once in a process."""
    path = folder / FILE
    if not path.exists():
        return {}
    content = bytes_of(path, SETTINGS_BYTES).removeprefix(codecs.BOM_UTF8)
    try:
        listed = msgspec.toml.decode(with_short_keys(content), type=_Listed)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SettingsError(f"{path}: {error}: mend it (docs/formats.md, Laboratory files)") from error
    return {name: mapped(name, text, str(path)) for name, text in listed.columns.items()}


def same_name(one: str, other: str) -> bool:
    """Whether two names of columns are one but for spaces and signs."""
    return plain(one) == plain(other)

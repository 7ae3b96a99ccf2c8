"""The tendon's state on disk, so that a restarted stream continues from it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from tssgeom.adapt.saved import SavedFilter, filter_object, filter_of
from tssgeom.atomic import write_text
from tssgeom.errors import SettingsError
from tssgeom.io.formats.paths import bytes_of
from tssgeom.rig import Rig
from tssgeom.stream import Carried
from tssgeom.tendon.machine_saved import KIND, machine_from, machine_object
from tssgeom.tendon.machine_stream import CarriedMachine
from tssgeom.tendon.saved import state_object, state_of
from tssgeom.version import __version__

_ORIGIN = "origin"
_DIGITS = 16  # of the digest of a rig; chosen: no two rigs of a laboratory share them


class Origin(NamedTuple):
    """What a state was computed with."""

    program: str
    """Version of the program."""
    rig: str
    """First digits of the SHA-256 of the rig."""


def origin_of(rig: Rig) -> Origin:
    """Return the origin of states that this program computes with a rig."""
    encoded = msgspec.json.encode(rig, order="deterministic")
    return Origin(__version__, hashlib.sha256(encoded).hexdigest()[:_DIGITS])


def write_state(
    path: Path, state: Carried, followed: SavedFilter | None = None, origin: Origin | None = None
) -> None:
    """Write a state as JSON, and the filter of its rig where that is followed.

    Raises SourceError where the disk refuses.
    """
    saved = machine_object(state) if isinstance(state, CarriedMachine) else state_object(state)
    if followed is not None:
        saved["followed"] = filter_object(followed)
    if origin is not None:
        saved[_ORIGIN] = origin._asdict()
    write_text(path, json.dumps(saved, allow_nan=False) + "\n", durable=True)


def read_state(path: Path) -> Carried:
    """Read the state that `write_state` wrote, of a tendon or a machine, to the last bit.

    Raises SourceError where the file cannot be read; SettingsError where it holds no state, or one of another
    version.
    """
    saved = _object(path)
    try:
        return machine_from(saved) if saved.get("kind") == KIND else state_of(saved)
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}") from error


def origin_remark(path: Path, rig: Rig) -> str:
    """Return what a user has to know where a state has another origin; empty where it has none or the same.

    Raises SourceError or SettingsError where the file cannot be read.
    """
    saved, now = _object(path).get(_ORIGIN), origin_of(rig)
    if not isinstance(saved, dict):
        return ""
    other = []
    if saved.get("rig") != now.rig:
        other.append("another rig")
    if (program := saved.get("program")) != now.program:
        other.append(f"tssgeom {program!s:.20} (this is {now.program})")
    if not other:
        return ""
    return f"{path}: the state is of {' and '.join(other)}: its tensions are kept; remove it to start anew"


def read_filter(path: Path, rig: Rig) -> SavedFilter | None:
    """Read the filter of a rig that `write_state` wrote, to the last bit; None where there is none.

    Raises SourceError where the file cannot be read; SettingsError where it is broken, of another version, or
    follows other numbers than the rig names.
    """
    saved = _object(path).get("followed")
    if saved is None:
        return None
    try:
        return filter_of(saved, rig)
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}") from error


def _object(path: Path) -> dict[str, Any]:
    content = bytes_of(path)
    try:
        saved = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"{path}: no JSON ({error}): remove it and start anew") from error
    return saved if isinstance(saved, dict) else {}

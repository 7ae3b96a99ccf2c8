"""The tendon's state on disk, so that a restarted stream continues from it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tssgeom.adapt.saved import SavedFilter, filter_object, filter_of
from tssgeom.atomic import write_text
from tssgeom.errors import SettingsError
from tssgeom.io.formats.paths import bytes_of
from tssgeom.rig import Rig
from tssgeom.tendon.saved import state_object, state_of
from tssgeom.tendon.state import TendonState


def write_state(path: Path, state: TendonState, followed: SavedFilter | None = None) -> None:
    """Write a state as JSON, and the filter of its rig where that is followed.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    saved = state_object(state)
    if followed is not None:
        saved["followed"] = filter_object(followed)
    write_text(path, json.dumps(saved, allow_nan=False) + "\n")


def read_state(path: Path) -> TendonState:
    """Read the state that `write_state` wrote, to the last bit.

    Raises
    ------
    SourceError
        Where the file cannot be read.
    SettingsError
        Where it holds no state, or one of another version.
    """
    saved = _object(path)
    try:
        return state_of(saved)
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}") from error


def read_filter(path: Path, rig: Rig) -> SavedFilter | None:
    """Read the filter of a rig that `write_state` wrote, to the last bit; None where there is none.

    Raises
    ------
    SourceError
        Where the file cannot be read.
    SettingsError
        Where it is broken, of another version, or follows other numbers than the rig names.
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

"""The tendon's state on disk, so that a restarted stream continues from it."""

from __future__ import annotations

import json
from pathlib import Path

from tssgeom.atomic import write_text
from tssgeom.errors import SettingsError
from tssgeom.io.formats.paths import bytes_of
from tssgeom.tendon.saved import state_object, state_of
from tssgeom.tendon.state import TendonState


def write_state(path: Path, state: TendonState) -> None:
    """Write a state as JSON.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    write_text(path, json.dumps(state_object(state), allow_nan=False) + "\n")


def read_state(path: Path) -> TendonState:
    """Read the state that `write_state` wrote, to the last bit.

    Raises
    ------
    SourceError
        Where the file cannot be read.
    SettingsError
        Where it holds no state, or one of another version.
    """
    content = bytes_of(path)
    try:
        saved = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"{path}: no JSON ({error}): remove it and start anew") from error
    try:
        return state_of(saved if isinstance(saved, dict) else {})
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}") from error

"""The tendon's state on disk, so that a stream goes on where it was when it is started again."""

from __future__ import annotations

import json
from pathlib import Path

from tssgeom.atomic import write_text
from tssgeom.errors import SettingsError, SourceError
from tssgeom.tendon.saved import state_object, state_of
from tssgeom.tendon.state import TendonState


def write_state(path: Path, state: TendonState) -> None:
    """Write a state as JSON, whole or not at all.

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
    try:
        saved = json.loads(path.read_bytes())
    except OSError as error:
        raise SourceError(f"{path}: cannot be read ({error.strerror}): check the path") from error
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"{path}: no JSON ({error}): remove it and start anew") from error
    try:
        return state_of(saved if isinstance(saved, dict) else {})
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}") from error

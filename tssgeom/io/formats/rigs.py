"""Rig files: written whole, with where their numbers come from as comments."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import tomli_w

from tssgeom.atomic import write_text
from tssgeom.rig import Rig


def write_rig(path: Path, rig: Rig, provenance: Sequence[str] = ()) -> None:
    """Write a rig as TOML, which `read_rig` reads back alike.

    Parameters
    ----------
    path
        The file; an older one gives way only when it is done.
    rig
        The rig.
    provenance
        Lines that tell where its numbers come from; they become comments.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    comments = "".join(f"# {' '.join(line.split())}\n" for line in provenance)
    tables = _without_none(msgspec.to_builtins(rig, enc_hook=float))  # fits give numpy's floats
    write_text(path, comments + "\n" * bool(comments) + tomli_w.dumps(tables))


def _without_none(value: Any) -> Any:
    """Leave out what is not set, for which TOML has no word."""
    if not isinstance(value, dict):
        return value
    return {key: _without_none(item) for key, item in value.items() if item not in (None, {}, ())}

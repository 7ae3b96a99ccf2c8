"""The arithmetic of a frame, compiled ahead of time; see core.h for shapes, units and return codes."""

from __future__ import annotations

from pathlib import Path

_HERE = Path(__file__).parent


def _rebuilt() -> None:
    """Build the library again where an editable installation has a source that is newer than it."""
    from tssgeom.core import build  # not in a wheel

    if not build.is_stale(_HERE):
        return
    from filelock import FileLock  # needed for building only

    with FileLock(_HERE / ".build.lock"):
        if build.is_stale(_HERE):
            build.build(_HERE)


if (_HERE / "build.py").exists():
    _rebuilt()

from tssgeom.core._entries import *  # noqa: E402, F403

"""The arithmetic of a frame, compiled ahead of time; see core.h for shapes, units and return codes."""

from __future__ import annotations

from pathlib import Path

_HERE = Path(__file__).parent


def _rebuilt() -> None:
    """Build the library again where an editable installation has a source that is newer than it."""
    from tssgeom.core import build  # noqa: PLC0415 - not in a wheel

    library = _HERE / build.LIBRARY
    made = library.stat().st_mtime if library.exists() else 0.0
    if all(each.stat().st_mtime <= made for each in build.sources()):
        return
    from filelock import FileLock  # noqa: PLC0415 - needed for building only

    with FileLock(_HERE / ".build.lock"):
        made = library.stat().st_mtime if library.exists() else 0.0
        if any(each.stat().st_mtime > made for each in build.sources()):
            build.build(_HERE)


if (_HERE / "build.py").exists():
    _rebuilt()

from tssgeom.core._entries import *  # noqa: E402, F403

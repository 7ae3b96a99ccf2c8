"""`tssgeom view`: the Rerun viewer on what a command wrote, or a picture of it."""

from __future__ import annotations

from pathlib import Path

from pipelines.console import complain
from tssgeom.errors import SourceError
from tssgeom.view.viewer import open_viewer, screenshot


def run(path: Path, *, screenshot_to: Path | None, web: bool) -> int:
    """Open the viewer, or write a picture, and return the exit status."""
    recordings = recordings_in(path)
    if screenshot_to is None:
        return open_viewer(recordings, web=web)
    if len(recordings) > 1:
        complain(f"{path}: the picture shows {recordings[0].name}, the first of {len(recordings)} recordings")
    screenshot(recordings[0], screenshot_to)
    return 0


def recordings_in(path: Path) -> list[Path]:
    """Return a recording, or those inside a folder in the order of their names.

    Raises
    ------
    SourceError
        Where there is none.
    """
    if not path.exists():
        raise SourceError(f"{path}: no such file or folder: name what a command wrote")
    found = sorted(path.rglob("*.rrd")) if path.is_dir() else [path]
    shown = [file for file in found if not file.name.startswith(".")]
    if not shown:
        raise SourceError(f"{path}: no recording (.rrd) in this folder: run tssgeom batch --out {path}")
    return shown

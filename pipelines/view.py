"""`tssgeom view`: the Rerun viewer on what a command wrote, on two of them side by side, or a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from pipelines.console import complain, say
from tssgeom.atomic import replacing
from tssgeom.errors import SettingsError, SourceError
from tssgeom.view.scene.viewer import open_viewer, screenshot


def run(paths: Sequence[Path], *, screenshot_to: Path | None, web: bool, out: Path | None) -> int:
    """Open the viewer, or write a picture or the recording of a comparison, and return the exit status.

    Raises
    ------
    SettingsError
        Where there are more than two paths, or a folder for a comparison but only one path.
    SourceError
        Where there is no recording, or none that both have.
    """
    if len(paths) > 2:
        raise SettingsError(f"{len(paths)} paths: give one to look at, or two to compare")
    if len(paths) == 1:
        if out is not None:
            raise SettingsError(f"--out {out}: it is for a comparison: give two recordings or folders")
        return _show(recordings_in(paths[0]), paths[0], screenshot_to, web=web)
    asked = pairs(*paths)
    if out is not None:
        compared = _compared(asked, out)
        say(f"comparison: {', '.join(map(str, compared))}")
        if screenshot_to is not None:
            return _show(compared, out, screenshot_to, web=web)
        return 0
    with TemporaryDirectory(prefix="tssgeom-") as folder:
        return _show(_compared(asked, Path(folder)), paths[1], screenshot_to, web=web)


def _show(recordings: Sequence[Path], given: Path, screenshot_to: Path | None, *, web: bool) -> int:
    if screenshot_to is None:
        return open_viewer(recordings, web=web)
    if len(recordings) > 1:
        complain(
            f"{given}: the picture shows {recordings[0].name}, the first of {len(recordings)} recordings"
        )
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


def pairs(first: Path, second: Path) -> dict[str, tuple[Path, Path]]:
    """Return what is compared, by name: two recordings, or those of one name in two folders.

    Raises
    ------
    SourceError
        Where a folder has no recording, or of several none has its like in the other.
    """
    sides = recordings_in(first), recordings_in(second)
    if all(len(side) == 1 for side in sides):
        a, b = sides[0][0], sides[1][0]
        return {a.stem if a.stem == b.stem else f"{a.stem}_and_{b.stem}": (a, b)}
    named = [{file.stem: file for file in side} for side in sides]
    common = {name: (file, named[1][name]) for name, file in named[0].items() if name in named[1]}
    if not common:
        raise SourceError(f"{first} and {second}: no recording has its like by name: name two .rrd files")
    return common


def _compared(asked: dict[str, tuple[Path, Path]], folder: Path) -> list[Path]:
    from tssgeom.view.scene.compare.comparison import write_comparison

    written = list[Path]()
    for name, (a, b) in asked.items():
        written.append(folder / f"{name}.rrd")
        with replacing(written[-1]) as draft:
            write_comparison(draft, a, b)
    return written

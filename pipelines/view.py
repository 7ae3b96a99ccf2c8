"""`tssgeom view`: the Rerun viewer on what a command wrote, on two of them side by side, or a picture.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from pipelines.interruption import ending_this_step
from pipelines.terminal import print_line, print_message


def view(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="PATH [PATH]",
            help="What a command wrote, a recording or a folder; two are compared side by side.",
        ),
    ],
    screenshot: Annotated[
        Path | None, typer.Option("--screenshot", help="Write a PNG instead; works with no display.")
    ] = None,
    clean: Annotated[
        bool, typer.Option("--clean", help="With --screenshot: without the viewer's menu and time bar.")
    ] = False,
    web: Annotated[bool, typer.Option("--web", help="Open in the web browser.")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", help="Write the recording of a comparison into DIR instead.")
    ] = None,
) -> None:
    """Open the Rerun viewer on what a command wrote, or on two of them side by side."""
    raise typer.Exit(_open(paths, screenshot, out, web=web, clean=clean))


def _open(paths: Sequence[Path], screenshot: Path | None, out: Path | None, *, web: bool, clean: bool) -> int:
    """Open the viewer, or write a picture or the recording of a comparison, and return the exit status."""
    from tssgeom.atomic import temporary_folder
    from tssgeom.errors import SettingsError

    if clean and screenshot is None:
        raise SettingsError("--clean is for a picture: give --screenshot PNG too")
    if len(paths) > 2:
        raise SettingsError(f"{len(paths)} paths: give one to view, or two to compare")
    if len(paths) == 1:
        if out is not None:
            raise SettingsError(f"--out {out}: it is for a comparison: give two recordings or folders")
        return _show(recordings_in(paths[0]), paths[0], screenshot, web=web, clean=clean)
    compared = pairs(*paths)
    if out is not None:
        written = _compared(compared, out)
        print_line(f"comparison: {', '.join(map(str, written))}")
        return 0 if screenshot is None else _show(written, out, screenshot, web=web, clean=clean)
    with temporary_folder() as folder:
        return _show(_compared(compared, folder), paths[1], screenshot, web=web, clean=clean)


def _show(recordings: Sequence[Path], given: Path, screenshot: Path | None, *, web: bool, clean: bool) -> int:
    from tssgeom.view.scene import viewer

    if screenshot is None:
        with ending_this_step():
            return viewer.open_viewer(recordings, web=web)
        return 0
    if len(recordings) > 1:
        print_message(
            f"{given}: the picture shows {recordings[0].name}, the first of {len(recordings)} recordings"
        )
    viewer.screenshot(recordings[0], screenshot, clean=clean)
    return 0


def recordings_in(path: Path) -> list[Path]:
    """Return a recording, or those inside a folder in the order of their names.

    Raises SourceError where there is none.
    """
    from tssgeom.errors import SourceError, require_file

    require_file(path)
    if not path.exists():
        raise SourceError(f"{path}: no such file or folder: name what a command wrote")
    files = sorted(path.rglob("*.rrd")) if path.is_dir() else [path]
    recordings = [file for file in files if not file.name.startswith(".")]
    if not recordings:
        raise SourceError(
            f"{path}: no recording (.rrd) in this folder: name one that analyse, batch, simulate, discover, "
            "paper or live --record wrote"
        )
    return recordings


def pairs(first: Path, second: Path) -> dict[str, tuple[Path, Path]]:
    """Return the pairs to compare, by name: two recordings, or those of one name in two folders.

    Raises SourceError where a folder has no recording, or where no name is in both folders.
    """
    from tssgeom.errors import SourceError

    sides = recordings_in(first), recordings_in(second)
    if all(len(side) == 1 for side in sides):
        a, b = sides[0][0], sides[1][0]
        return {a.stem if a.stem == b.stem else f"{a.stem}_and_{b.stem}": (a, b)}
    named = [{file.stem: file for file in side} for side in sides]
    common = {name: (file, named[1][name]) for name, file in named[0].items() if name in named[1]}
    if not common:
        raise SourceError(f"{first} and {second}: they share no name of a recording: name two .rrd files")
    return common


def _compared(compared: dict[str, tuple[Path, Path]], folder: Path) -> list[Path]:
    """Write the recording of each comparison, and return the files."""
    from tssgeom.view.scene.compare.comparison import write_comparison

    written = list[Path]()
    for name, (a, b) in compared.items():
        written.append(folder / f"{name}.rrd")
        write_comparison(written[-1], a, b)
    return written

"""The Rerun viewer as a program: opened on recordings, or run without a screen for a picture of one."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np
import rerun_cli
from rerun.chunk import Chunk, RrdReader
from rerun.experimental import ViewerClient

from tssgeom.arrays import Vector
from tssgeom.atomic import replacing, temporary_folder
from tssgeom.errors import SourceError, require_replaceable
from tssgeom.programs import running
from tssgeom.tendon.history import last_peak
from tssgeom.view.quantities import COUNT, TIMELINE

_HOST = "127.0.0.1"
_DRIVES = ["/series/tension_in", "/a/series/tension_in", "/series/tension_in_N", "/series/tension_in_1_N"]
_START_LIMIT = 60.0
"""Longest wait for the viewer to start and load [s]; it takes 3 s, and 20 s beside ten other processes."""
_NOTICES = 3.5
"""Time from its start until the viewer's notices have gone from the picture [s]."""
_MENU, _TIME_BAR = 37, 30
"""Heights of the viewer's menu and of its bar of the time [pixel]. Measured: pictures of Rerun 0.41."""
_WAIT = 1.2
"""Time to draw after the last change [s]."""


def open_viewer(
    paths: Sequence[Path], *, web: bool = False, announce: Callable[[str], object] = print
) -> int:
    """Open the viewer on recordings and wait until it is closed.

    Parameters
    ----------
    paths
        `.rrd` files; several are listed side by side in the viewer.
    web
        True: serve the viewer to a browser on this machine instead of opening a window.
    announce
        Called with a line that names the address to open, where `web` is True.

    Returns
    -------
    int
        Exit status of the viewer.

    Raises
    ------
    SourceError
        Where a file is missing or is no recording, or there is no display to open a window on.
    """
    for path in paths:
        require_recording(path)
    files = [str(path) for path in paths]
    options = _web_options(announce) if web else ["--port", "auto"]
    with _quiet() as environment, tempfile.TemporaryFile() as log:
        command = [binary(), *files, "--bind", _HOST, *options]
        try:
            status = subprocess.run(command, check=False, stderr=log, env=environment).returncode
        except KeyboardInterrupt:
            return 0
        if status > 0:
            raise _failure(paths[0], log)
    return status


def screenshot(
    path: Path,
    png: Path,
    size: tuple[int, int] = (1600, 900),
    *,
    at: float | None = None,
    clean: bool = False,
) -> None:
    """Take a picture of a recording as the viewer shows it; this needs no display.

    Parameters
    ----------
    path
        The `.rrd` file.
    png
        The picture to write.
    size
        Width and height of the picture [pixel].
    at
        Time of the run in the picture [s]; the moment of greatest tension by default.
    clean
        True: cut off the viewer's menu and the bar of the time.

    Raises
    ------
    SourceError
        Where the file is no recording, the picture cannot be written, or there is no graphics driver.
    """
    require_recording(path)
    require_replaceable(png)
    moment = moment_of_greatest_tension(path) if at is None else (TIMELINE, at)
    with temporary_folder() as folder:  # a viewer that finds no room for its picture gives no reason
        drawn = folder / "picture.png"
        with _headless(path, size) as viewer:
            if moment is not None:
                _go_to(viewer, *moment)
            time.sleep(_WAIT)
            viewer.save_screenshot(str(drawn))
        if not drawn.is_file():
            raise SourceError(
                f"{png}: the viewer wrote no picture: check that {folder.parent} can be written"
            )
        if clean:
            _cut_frame(drawn, timed=moment is not None)
        with replacing(png) as draft:
            shutil.copyfile(drawn, draft)


def _cut_frame(png: Path, *, timed: bool) -> None:
    """Cut the menu off the top of a picture of the viewer, and the bar of the time off its foot."""
    from matplotlib.image import imread, imsave

    pixels = imread(png)
    imsave(png, np.ascontiguousarray(pixels[_MENU : len(pixels) - (_TIME_BAR if timed else 0)]))


def _go_to(viewer: ViewerClient, timeline: str, moment: float) -> None:
    if timeline == COUNT:
        viewer.set_time(COUNT, sequence=int(moment), play_state="paused")
    else:
        viewer.set_time(timeline, duration=moment, play_state="paused")


def moment_of_greatest_tension(path: Path) -> tuple[str, float] | None:
    """Timeline and time [s, or number] of the last of the greatest peaks of the proximal tension.

    None for a static shape.

    Raises SourceError where the recording is cut short or damaged.
    """
    drives = dict[str, tuple[list[Vector], list[Vector]]]()
    for chunk in parts_of(path, _DRIVES):
        batch = chunk.to_record_batch()
        for timeline, unit in ((TIMELINE, 1e-9), (COUNT, 1.0)):
            if timeline in batch.schema.names:
                times, tensions = drives.setdefault(timeline, ([], []))
                times.append(unit * batch.column(timeline).cast("int64").to_numpy())
                tensions.append(batch.column("Scalars:scalars").flatten().to_numpy())
    for timeline, (times, tensions) in drives.items():
        return timeline, float(np.concatenate(times)[last_peak(np.concatenate(tensions))])
    return None


def parts_of(path: Path, entities: Sequence[str] | None = None) -> Iterator[Chunk]:
    """Yield the parts of a recording that belong to some entities, or all of them.

    Raises SourceError where the recording is cut short or damaged.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a file without a table of contents is read all the same
            parts = RrdReader(str(path)).stream()
        yield from parts if entities is None else parts.filter(content=list(entities))
    except (RuntimeError, ValueError) as error:
        why = str(error).rpartition(": ")[2]
        raise SourceError(f"{path}: the recording is cut short or damaged ({why}): write it anew") from error


def require_recording(path: Path) -> None:
    """Refuse a file that is no recording; raises SourceError where the file is missing or is no recording."""
    try:
        with path.open("rb") as stream:
            magic = stream.read(3)
    except OSError as error:
        raise SourceError(f"{path}: cannot read the recording ({error.strerror}): check the path") from error
    if magic != b"RRF":
        raise SourceError(f"{path}: no Rerun recording: give a .rrd file that tssgeom wrote")


def binary() -> str:
    """Path of the viewer itself; the `rerun` command beside Python only starts it."""
    name = "rerun.exe" if os.name == "nt" else "rerun"
    return str(Path(rerun_cli.__file__).parent / name)


def _web_options(announce: Callable[[str], object]) -> list[str]:
    web, grpc = _free_port(), _free_port()
    source = f"rerun%2Bhttp%3A%2F%2F{_HOST}%3A{grpc}%2Fproxy"
    announce(f"open http://{_HOST}:{web}/?url={source} in a browser; Ctrl-C ends it")
    sys.stdout.flush()
    return ["--serve-web", "--port", str(grpc), "--web-viewer-port", str(web)]


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((_HOST, 0))
        return int(probe.getsockname()[1])


@contextmanager
def _headless(path: Path, size: tuple[int, int]) -> Iterator[ViewerClient]:
    """Run a viewer without a window on a recording that is loaded, and end it afterwards."""
    port, began = _free_port(), time.monotonic()
    options = ["--headless", "--hide-welcome-screen", "--window-size", f"{size[0]}x{size[1]}"]
    command = [binary(), str(path), *options, "--bind", _HOST, "--port", str(port)]
    with _quiet() as environment, tempfile.TemporaryFile() as log:
        try:
            with running(command, stdout=log, stderr=log, env={**environment, "CI": "true"}) as viewer:
                yield _loaded(viewer, port, began)
        except (ConnectionError, RuntimeError, TimeoutError) as error:
            raise _failure(path, log) from error


@contextmanager
def _quiet() -> Iterator[dict[str, str]]:
    """Yield the environment of a viewer that writes errors alone, and remove the files that it leaves.

    With CI it also reports no use of it.
    """
    with temporary_folder() as folder:
        yield {**os.environ, "RUST_LOG": "error", **dict.fromkeys(("TMPDIR", "TMP"), str(folder))}


def _loaded(viewer: subprocess.Popen[bytes], port: int, began: float) -> ViewerClient:
    while not _answers(port):
        if viewer.poll() is not None or time.monotonic() > began + _START_LIMIT:
            raise ConnectionError("the viewer did not start")
        time.sleep(0.05)
    client = ViewerClient.connect(f"rerun+http://{_HOST}:{port}/proxy")
    while not client.get_state().recordings or client.get_state().loading:
        if viewer.poll() is not None or time.monotonic() > began + _START_LIMIT:
            raise ConnectionError("the viewer did not load the recording")
        time.sleep(0.1)
    while time.monotonic() < began + _NOTICES:
        client.get_state()  # makes the viewer draw, without which its notices stay for ever
        time.sleep(0.1)
    return client


def _answers(port: int) -> bool:
    try:
        with socket.create_connection((_HOST, port), timeout=0.2):
            return True
    except OSError:
        return False


def _failure(path: Path, log: IO[bytes]) -> SourceError:
    log.seek(0)
    text = re.sub(r"\x1b\[[0-9;]*m", "", log.read().decode(errors="replace"))
    if re.search(r"EventLoopError", text):
        return SourceError(
            f"{path}: there is no display for a window: --screenshot FILE.png writes a picture without one, "
            "--web opens it in a browser"
        )
    if re.search(r"render context|graphics adapter", text):
        return SourceError(
            f"{path}: no picture, as there is no Vulkan driver: install one that needs no graphics card "
            "(Debian, Ubuntu: apt-get install mesa-vulkan-drivers)"
        )
    message = next((line.strip() for line in text.splitlines() if line.strip()), "it gave no message")
    return SourceError(f"{path}: the Rerun viewer failed ({message}): run `rerun rrd verify {path}`")

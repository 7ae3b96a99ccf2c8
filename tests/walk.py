"""Count the walk of a result through the files: files entered, returns, and climbs.

    python -m tests.walk [frame | analysis | campaign] [--files]

The walk is that of a reader who follows each call to the function that it names and comes back, once for each
line that calls: loops and recursion are read once. A return is an entry to a file that was entered before
and left, by a call or after one. A climb is a call to a module of a higher layer, as pyproject.toml lists the
layers. The compiled core is one file, and a reader stays outside of it; an attribute that is computed
interrupts no reading. `frame` is the second frame of a stream through `process`; `analysis` is `analyse` of
one shape; `campaign` is `discover` of the files of a campaign. Each runs once before it counts, so that
imports do not. `--files` lists the files with how often each was entered.
"""

from __future__ import annotations

import argparse
import contextlib
import dis
import io
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_shapes"
_CORE = "tssgeom/core/"
GOALS = {"frame": (20, 50), "analysis": (25, 60), "campaign": (22, 30)}
"""Files and returns that are wanted at most."""


class Walk:
    """Files in the order in which a reader enters them."""

    def __init__(self) -> None:
        self.entered = Counter[str]()
        self.returns = self.climbs = 0
        self._read = set[tuple[str, int, str, int]]()
        self._path = list[str]()
        """Files of the calls that the reader is in."""
        self._calls = list[bool]()
        """Of each call on the stack, whether the reader follows it."""

    def event(self, frame: FrameType, event: str, _: Any) -> None:
        """Follow a call or its end; calls of other packages are passed through."""
        file = _file(frame)
        if file is None:
            return
        if event == "call":
            self._call(frame, file)
        elif event == "return" and self._calls and self._calls.pop():
            self._path.pop()
            if self._path and self._path[-1] != file:
                self._enter(self._path[-1])

    def _call(self, frame: FrameType, file: str) -> None:
        caller = _caller(frame)
        call = (*caller, file, frame.f_code.co_firstlineno)
        inside_core = bool(self._path) and self._path[-1].startswith(_CORE) and file.startswith(_CORE)
        skips = inside_core or _is_attribute(frame.f_back)
        follows = call not in self._read and all(self._calls) and not skips
        self._calls.append(follows)
        if not follows:
            return
        self._read.add(call)
        if self._path and self._path[-1] != file:
            self.climbs += _level(file) > _level(self._path[-1])
        if not self._path or self._path[-1] != file:
            self._enter(file)
        self._path.append(file)

    def _enter(self, file: str) -> None:
        self.returns += file in self.entered
        self.entered[file] += 1


def _file(frame: FrameType) -> str | None:
    path = Path(frame.f_code.co_filename)
    inside = path.is_relative_to(ROOT) and path != Path(__file__)
    return str(path.relative_to(ROOT)) if inside else None


def _caller(frame: FrameType) -> tuple[str, int]:
    above = frame.f_back
    return (above.f_code.co_filename, above.f_lineno) if above else ("", 0)


def _is_attribute(caller: FrameType | None) -> bool:
    """Whether a line only names an attribute, which is computed."""
    if caller is None:
        return False
    return dis.opname[caller.f_code.co_code[caller.f_lasti]].startswith("LOAD_")


def _layers() -> list[list[str]]:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]
    return [line.split(" | ") for line in contracts["contracts"][0]["layers"]]


_LAYERS = _layers()


def _level(file: str) -> int:
    """Return how high a file stands."""
    module = file.removesuffix(".py").replace("/", ".")
    for depth, layer in enumerate(_LAYERS):
        if any(module == name or module.startswith(f"{name}.") for name in layer):
            return -depth
    return -len(_LAYERS)


def frame() -> Callable[[], object]:
    """Return the second frame of a stream."""
    from tssgeom.engine import process
    from tssgeom.io.formats.files import open_recording
    from tssgeom.rig import Rig

    frames = open_recording(SAMPLES / "insertion.jsonl").frames
    results = process(iter(frames), Rig(), tension_in=15.0)
    next(results)
    return lambda: next(results)


def analysis() -> Callable[[], object]:
    """Return the analysis of one shape."""
    from tssgeom import analyse

    return lambda: analyse(SAMPLES / "helix.csv", tension_in=15.0)


def campaign() -> Callable[[], object]:
    """Return the discovery of one campaign, from its files to its report."""
    from pipelines.cli import main

    call = ["tssgeom", "discover", str(SAMPLES / "campaign_hidden_bend"), "--quiet", "--out"]

    def run() -> None:
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
            sys.argv = [*call, folder]
            try:
                main()
            except SystemExit as end:
                if end.code:
                    raise

    return run


WALKS = {"frame": frame, "analysis": analysis, "campaign": campaign}


def walked(name: str) -> Walk:
    """Return the walk of a result."""
    made = WALKS[name]()
    made()
    walk = Walk()
    sys.setprofile(walk.event)
    try:
        made()
    finally:
        sys.setprofile(None)
    return walk


def main() -> None:
    """Print the walks."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("names", nargs="*", help=", ".join(WALKS))
    parser.add_argument("--files", action="store_true", help="list the files")
    chosen = parser.parse_args()
    for name in chosen.names or WALKS:
        walk = walked(name)
        files, returns = GOALS[name]
        counts = f"{len(walk.entered)} files (goal {files}), {walk.returns} returns (goal {returns})"
        sys.stdout.write(f"{name}: {counts}, {walk.climbs} climbs\n")
        for file, count in walk.entered.most_common() if chosen.files else ():
            sys.stdout.write(f"  {count:4d}  {file}\n")


if __name__ == "__main__":
    main()

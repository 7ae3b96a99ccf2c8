"""Files of sensed shapes: which reader takes which, and which files of a folder are shapes."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from pathlib import Path

from tssgeom.errors import SourceError
from tssgeom.io.jsonl import open_jsonl
from tssgeom.io.longform import open_csv, open_parquet
from tssgeom.io.npz import open_npz
from tssgeom.io.recording import Recording

__all__ = ["READERS", "Recording", "find_inputs", "open_recording", "output_names"]

READERS: dict[str, Callable[[Path, str | None], Recording]] = {
    ".csv": open_csv,
    ".jsonl": open_jsonl,
    ".ndjson": open_jsonl,
    ".npz": open_npz,
    ".parquet": open_parquet,
}
"""The reader of each ending."""

RESULTS_MARK = "run.json"
"""A folder that holds this file holds results, no shapes."""
CAMPAIGN = "campaign.toml"
"""A folder that holds this file holds a campaign: measured runs beside shapes."""


def open_recording(path: str | Path, unit: str | None = None) -> Recording:
    """Open a file of sensed shapes.

    Parameters
    ----------
    path
        A CSV, JSON lines, NPZ or Parquet file.
    unit
        Unit of length, "mm" or "m", for a file that states none.

    Raises
    ------
    ShapeError
        Where the file as a whole cannot be used: unit or columns missing or mixed, no points.
    SourceError
        Where the file cannot be read, or has an ending that no reader takes.
    """
    path = Path(path)
    if not path.exists():
        raise SourceError(f"{path}: no such file: check the path")
    if path.is_dir():
        raise SourceError(f"{path}: a folder, not a file: name the files in it")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise SourceError(
            f"{path}: no reader takes {path.suffix or 'a file without ending'!r}: use {_endings()}"
        )
    return reader(path, unit)


def find_inputs(paths: Iterable[str | Path], besides: Collection[Path] = ()) -> list[Path]:
    """Return the given files, and the shape files inside given folders, each once.

    Folders are searched in depth and in the order of names. Hidden files and folders, campaigns,
    folders of results and those in `besides` are left out.

    Raises
    ------
    SourceError
        Where a folder holds no shape file.
    """
    left_out = {path.resolve() for path in besides}
    found: dict[Path, Path] = {}
    for path in map(Path, paths):
        files = sorted(_shapes_in(path, left_out)) if path.is_dir() else [path]
        if not files:
            raise SourceError(f"{path}: no shape file in this folder: put {_endings()} files there")
        for file in files:
            found.setdefault(file.resolve(), file)
    return list(found.values())


def output_names(paths: Sequence[Path]) -> dict[Path, str]:
    """Return a name for the outputs of each file: its stem, made longer where another file has it too.

    Added is what tells the files apart: the ending (`loop-csv`), the folder (`left-loop`), both, or a
    number. Letter case does not tell names apart, since some disks ignore it.
    """
    groups = dict[str, list[Path]]()
    for path in paths:
        groups.setdefault(path.stem.casefold(), []).append(path)
    names = {path: name for group in groups.values() for path, name in _told_apart(group).items()}
    return _numbered({path: names[path] for path in paths})


def _told_apart(paths: Sequence[Path]) -> dict[Path, str]:
    names = {path: path.stem for path in paths}
    ways: list[Callable[[Path], str]] = [
        lambda path: f"{path.stem}-{path.suffix.lstrip('.')}",
        lambda path: f"{path.resolve().parent.name}-{path.stem}",
        lambda path: f"{path.resolve().parent.name}-{path.stem}-{path.suffix.lstrip('.')}",
    ]
    while ways and len({name.casefold() for name in names.values()}) < len(paths):
        names = dict(zip(paths, map(ways.pop(0), paths), strict=True))
    return names


def _numbered(names: dict[Path, str]) -> dict[Path, str]:
    """Add a number to every name that an earlier path has taken."""
    taken = set[str]()
    numbered = dict[Path, str]()
    for path, name in names.items():
        free = (name, *(f"{name}-{number}" for number in range(2, len(names) + 2)))
        numbered[path] = next(one for one in free if one.casefold() not in taken)
        taken.add(numbered[path].casefold())
    return numbered


def _shapes_in(folder: Path, left_out: Collection[Path]) -> Iterator[Path]:
    for where, folders, names in os.walk(folder):
        here = Path(where)
        if here.resolve() in left_out or {RESULTS_MARK, CAMPAIGN} & set(names):
            folders.clear()
            continue
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in names:
            if not name.startswith(".") and Path(name).suffix.lower() in READERS:
                yield here / name


def _endings() -> str:
    return ", ".join(READERS)

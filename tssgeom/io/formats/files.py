"""Files of sensed shapes: the reader of each, and the shapes in a folder."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from pathlib import Path

from tssgeom.errors import SourceError, TssgeomError, printable, require_file
from tssgeom.io.formats.colonoscope import is_colonoscope, open_colonoscope
from tssgeom.io.formats.jsonl import open_jsonl
from tssgeom.io.formats.laboratory.files import ENDINGS as TABLES
from tssgeom.io.formats.laboratory.mapping import NO_MAP, ColumnMap
from tssgeom.io.formats.laboratory.table import parts_of
from tssgeom.io.formats.meshes import ENDINGS as MESHES
from tssgeom.io.formats.meshes import is_lumen
from tssgeom.io.formats.ndi import is_ndi, open_ndi
from tssgeom.io.formats.npz import open_npz
from tssgeom.io.formats.paths import MARKUPS, PACKED, ending, part_of, split, stem
from tssgeom.io.formats.point_tables import names_recordings, open_table
from tssgeom.io.formats.recording import Recording
from tssgeom.io.formats.ros import is_bag, open_bag
from tssgeom.io.formats.slicer import markup_names, open_fcsv, open_markups
from tssgeom.io.formats.vtk import line_names, open_vtp

__all__ = ["READERS", "Recording", "find_inputs", "open_recording", "output_names"]

Reader = Callable[[Path, str | None], Recording]


_TOOLS = (".csv", ".tsv", ".txt")
"""Endings of tables that may be of tracked tools."""


def _open_table(path: Path, unit: str | None, columns: ColumnMap = NO_MAP) -> Recording:
    """Open a table: of tracked tools if the header of a text names their poses in a row, else of points."""
    if path.suffix.lower() in _TOOLS and is_ndi(path):
        return open_ndi(path, unit, columns)
    return open_table(path, unit, columns)


READERS: dict[str, Reader] = {
    **dict.fromkeys(TABLES, _open_table),
    ".jsonl": open_jsonl,
    ".ndjson": open_jsonl,
    ".npz": open_npz,
    MARKUPS: open_markups,
    ".fcsv": open_fcsv,
    ".vtp": open_vtp,
    ".mcap": open_bag,
    ".db3": open_bag,
}
"""The reader of each ending."""
ONLY_NAMED = (".txt", ".dat", ".lvm", ".txt.gz", ".dat.gz")
"""Endings of files that are read where they are named; in a folder they may be anything."""

_NO_DATA = (".toml", ".md")
"""Endings of files that stand beside data: settings and explanations."""
_HINTS = {
    ".json": f"one JSON object a line is .jsonl, Slicer's markups are {MARKUPS}, a run is a table (.csv)",
    **dict.fromkeys(MESHES, "a mesh is the wall of a lumen, no route: give it as --lumen"),
    ".vtk": "write the lines as .vtp",
}
"""What to do with files that resemble those of shapes, by ending."""

FOLDERS: tuple[tuple[Callable[[Path], bool], Reader], ...] = (
    (is_bag, open_bag),
    (is_colonoscope, open_colonoscope),
)
"""Test whether a folder is a recording, and its reader."""

_PARTS: dict[str, Callable[[Path], list[str]]] = {MARKUPS: markup_names, ".vtp": line_names}
"""Endings of files that may hold several shapes, and the names of these."""

_PART_READERS = (open_bag, open_markups, open_vtp, _open_table)
"""Readers that open one part of a file."""

RESULTS_MARK = "run.json"
"""A folder with this file holds results, no shapes."""
ANALYSIS_MARK = "result.json"
"""So does a folder with this file."""
UNFINISHED_MARK = ".batch"
"""So does a folder with this folder in it: a batch works there or was stopped there."""
CAMPAIGN = "campaign.toml"
"""A folder with this file holds a campaign: measured runs beside shapes."""
_MARKS = {RESULTS_MARK, ANALYSIS_MARK, CAMPAIGN}


def open_recording(path: str | Path, unit: str | None = None, columns: ColumnMap = NO_MAP) -> Recording:
    """Open a file of sensed shapes.

    Parameters
    ----------
    path
        A file or folder that a reader takes, or one part of a file as `FILE#PART`.
    unit
        Unit of length, such as "mm" or "in", where the file states none.
    columns
        The user's statements on columns of tables.

    Raises
    ------
    ShapeError
        Where the file as a whole cannot be used: unit or columns missing or mixed, no points.
    SourceError
        Where the file cannot be read, or has an ending that no reader takes.
    """
    path = Path(path)
    file, part = split(path)
    if not os.path.exists(file):  # also of a name that no disk takes
        raise SourceError(f"{path}: no such file: check the path")
    require_file(file)
    reader = _reader(file)
    if part is not None and reader not in _PART_READERS:
        raise SourceError(f"{file}: it holds one recording, there is no #{part} in it: leave that out")
    return _open_table(path, unit, columns) if reader is _open_table else reader(path, unit)


def _reader(file: Path) -> Reader:
    if file.is_dir():
        for fits, reader in FOLDERS:
            if fits(file):
                return reader
        raise SourceError(f"{file}: a folder, not a file: name the files in it")
    kind = ending(file)
    reader = READERS.get(kind)
    if (reader is None or kind in ONLY_NAMED) and _is_recording(file.parent):
        raise SourceError(f"{file}: a part of a recording: name the folder, {file.parent}")
    if reader is None:
        hint = _HINTS.get(kind.removesuffix(PACKED), f"use {_endings()}")
        raise SourceError(f"{file}: no reader takes {kind or 'a file without ending'!r}: {hint}")
    return reader


def find_inputs(
    paths: Iterable[str | Path], besides: Collection[Path] = (), columns: ColumnMap = NO_MAP
) -> list[Path]:
    """Return the given files, and the shape files and recordings inside given folders, each once.

    Of a file with several shapes each is returned by itself, as `FILE#PART`. Folders are searched in depth
    and in the order of names. Hidden files and folders, campaigns, folders of results and those in `besides`
    are left out.

    Raises SourceError where a folder holds no shape file.
    """
    left_out = {path.resolve() for path in besides}
    inputs: dict[Path, Path] = {}
    for path in map(Path, paths):
        folder, part = split(path)
        files = [path]
        if os.path.isdir(folder) and not _is_recording(folder):
            files = sorted(filter(_is_shape, _files_in(folder, left_out)))
            files = [file if part is None else part_of(file, part) for file in files]
        if not files:
            raise SourceError(f"{path}: no shape file in this folder: put {_endings()} files there")
        for shape in (each for file in files for each in _shapes_of(file, columns)):
            if os.path.islink(inputs.setdefault(key := real(shape), shape)) and not os.path.islink(shape):
                inputs[key] = shape  # by its own name
    return list(inputs.values())


def real(path: Path) -> Path:
    """Return the path without links; circular links stay, and opening them is an error."""
    return Path(os.path.realpath(path))


def _is_recording(folder: Path) -> bool:
    return any(fits(folder) for fits, _ in FOLDERS)


def _shapes_of(path: Path, columns: ColumnMap) -> list[Path]:
    """Return the shapes in a file: the path itself, but for a file of several of which it names none."""
    kind = ending(path)
    names = _PARTS.get(kind)
    if not (names or kind in TABLES) or split(path)[1] is not None or not os.path.isfile(path):
        return [path]
    try:
        parts = names(path) if names else _recordings_in(path, columns)
    except TssgeomError:
        return [path]  # opening it reports the reason
    return [path] if len(parts) == 1 else [part_of(path, name) for name in parts]


def _recordings_in(path: Path, columns: ColumnMap) -> list[str]:
    """Return the recordings in a table; most have one, and no column that could name several."""
    if ending(path) in (".csv", ".parquet") and not names_recordings(path, columns):
        return [path.name]
    return parts_of(path, columns, None)


def output_names(paths: Sequence[Path]) -> dict[Path, str]:
    """Return a name for the outputs of each file: its stem, made longer where another file has it too.

    A part of a file adds its own name. Equal names are made different by the ending (`loop-csv`), the folder
    (`left-loop`), both, or a number. Names that differ in letter case alone count as equal, since some disks
    ignore it.
    """
    groups = dict[str, list[Path]]()
    for path in paths:
        groups.setdefault(stem(path).casefold(), []).append(path)
    names = {path: name for group in groups.values() for path, name in _distinct(group).items()}
    return _numbered({path: names[path] for path in paths})


def _distinct(paths: Sequence[Path]) -> dict[Path, str]:
    names = {path: stem(path) for path in paths}
    ways: list[Callable[[Path], str]] = [
        lambda path: f"{stem(path)}-{_kind(path)}",
        lambda path: f"{_home(path)}-{stem(path)}",
        lambda path: f"{_home(path)}-{stem(path)}-{_kind(path)}",
    ]
    while ways and len({name.casefold() for name in names.values()}) < len(paths):
        names = dict(zip(paths, map(ways.pop(0), paths), strict=True))
    return names


def _kind(path: Path) -> str:
    return ending(path).strip(".").partition(".")[0] or "folder"


def _home(path: Path) -> str:
    return printable(Path(os.path.abspath(split(path)[0])).parent.name).replace("\\", "_")


def _numbered(names: dict[Path, str]) -> dict[Path, str]:
    """Add a number to every name that an earlier path has taken."""
    taken = dict[str, int]()
    numbered = dict[Path, str]()
    for path, name in names.items():
        one, number = name, taken.get(name.casefold(), 1)
        while one.casefold() in taken:
            number += 1
            one = f"{name}-{number}"
        taken[name.casefold()] = number
        taken.setdefault(one.casefold(), 1)
        numbered[path] = one
    return numbered


def left_out_of(paths: Iterable[str | Path], besides: Collection[Path] = ()) -> dict[str, int]:
    """Count the files in folders that no reader takes there, by their endings.

    Those in folders that `find_inputs` leaves out do not count, nor do settings and meshes beside shapes.
    """
    known = {path.resolve() for path in besides}
    folders = {real(folder) for path in paths if (folder := split(Path(path))[0]).is_dir()}
    files = {file for folder in folders if not _is_recording(folder) for file in _files_in(folder, known)}
    unread = [file for file in files if not (_is_shape(file) or is_lumen(file) or ending(file) in _NO_DATA)]
    return dict(sorted(Counter(ending(file) or file.name for file in unread).items()))


def _is_shape(file: Path) -> bool:
    """Whether a file or folder that stands in a folder is one of shapes."""
    kind = ending(file)
    return file.is_dir() or (kind in READERS and kind not in ONLY_NAMED)


def _files_in(folder: Path, left_out: Collection[Path]) -> Iterator[Path]:
    """Yield the files in a folder, and folders that are recordings."""
    for where, folders, names in os.walk(folder):
        here = Path(where)
        if here.resolve() in left_out or _MARKS & set(names) or UNFINISHED_MARK in folders:
            folders.clear()
            continue
        if _is_recording(here):
            folders.clear()
            yield here
            continue
        folders[:] = [name for name in folders if not name.startswith(".")]
        yield from (here / name for name in names if not name.startswith((".", "~$")))


def _endings() -> str:
    return ", ".join(READERS)

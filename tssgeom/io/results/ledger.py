"""What a batch has finished, noted input by input, so that it can be stopped at any moment and go on."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec
from filelock import FileLock, Timeout

from tssgeom.errors import SourceError, unwritable
from tssgeom.io.formats.files import UNFINISHED_MARK
from tssgeom.io.results.run_record import Input
from tssgeom.io.storage import Folder

HIDDEN = UNFINISHED_MARK
"""Folder of the notes, inside that of the results."""
ANY_SIZE = -1
"""Stands for the size of a file that differs a little each time it is written."""
_NOTES = f"{HIDDEN}/done"


class Done(msgspec.Struct, frozen=True, kw_only=True):
    """One input whose files are written, and all that the tables and the report at the end need of it."""

    key: str
    """Changes with the content of the input and with everything else that the results depend on."""
    input: Input
    row: dict[str, Any]
    """Its row in the summary."""
    told: dict[str, Any]
    """Its object in JSON."""
    lines: Sequence[str]
    """What is told of its rejected frames, a line each."""
    failures: Sequence[str]
    """What went wrong beside the tables, a line each."""
    report: dict[str, Any]
    """Its part of the report."""
    files: Mapping[str, int]
    """What was written, with the sizes [B] or `ANY_SIZE`."""
    figures: Mapping[str, int] = {}
    """The same of the folder for figures, where there is one."""


def key_of(parts: Mapping[str, Any]) -> str:
    """Return a digest of everything that the results of an input depend on."""
    return hashlib.sha256(msgspec.json.encode(parts, order="deterministic")).hexdigest()


def noted(folder: Folder, name: str) -> Done | None:
    """Return what is noted of an input; None where there is nothing that can be read."""
    text = folder.read(f"{_NOTES}/{name}.json")
    if text is None:
        return None
    try:
        return msgspec.json.decode(text, type=Done)
    except msgspec.MsgspecError:
        return None


def intact(folder: Folder, files: Mapping[str, int]) -> bool:
    """Whether the files of an input are there, each of the size that it was written with."""
    sizes = {name: folder.size(name) for name in files}
    return all(sizes[name] is not None and size in (ANY_SIZE, sizes[name]) for name, size in files.items())


def note(folder: Folder, name: str, done: Done) -> None:
    """Note an input whose files are all written.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    with folder.replacing(f"{_NOTES}/{name}.json") as draft:
        draft.write_bytes(msgspec.json.encode(done))


def forget(folder: Folder, name: str) -> None:
    """Remove the note of an input, and then its files, so that nothing is left of a version that is gone."""
    before = noted(folder, name)
    folder.remove([f"{_NOTES}/{name}.json"])
    folder.remove([] if before is None else list(before.files))


def forget_all(folder: Folder) -> None:
    """Remove the files and the notes of every input."""
    for file in folder.names(_NOTES):
        forget(folder, Path(file).stem)


@contextmanager
def locked(folder: Folder) -> Iterator[None]:
    """Keep other runs out of a folder; one that ends in any way gives it free. Elsewhere there is no lock.

    Raises
    ------
    SourceError
        Where another run writes there, or where the folder cannot be made.
    """
    if folder.here is None:
        yield
        return
    place = folder.here / HIDDEN
    lock = _acquired(folder, place)
    try:
        yield
    finally:
        lock.release()
        _remove_if_empty(place, folder.here)


def _acquired(folder: Folder, place: Path) -> FileLock:
    try:
        place.mkdir(parents=True, exist_ok=True)
        lock = FileLock(place / "lock", timeout=0)
        lock.acquire()
    except Timeout as error:
        raise SourceError(
            f"{folder.address}: another batch is writing there: wait for it, or give another --out"
        ) from error
    except OSError as error:
        raise unwritable(folder.address, error) from error
    return lock


def _remove_if_empty(place: Path, folder: Path) -> None:
    """Leave no folder behind in which nothing was written."""
    if place.is_dir() and {file.name for file in place.iterdir()} <= {"lock"}:
        with suppress(OSError):
            (place / "lock").unlink(missing_ok=True)
            place.rmdir()
            folder.rmdir()

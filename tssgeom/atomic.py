"""Files that are complete or absent: each is written as a hidden draft in its folder, then renamed.

`discard_drafts` removes what is unfinished, so that a process may end at any moment.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tssgeom.errors import require_replaceable, unwritable

_DRAFT = re.compile(r"\..+\.\d+\.[a-z]+")  # names that `replacing` gives
_drafts = set[Path]()  # files and folders of this process that are not finished


@contextmanager
def _discarded(draft: Path) -> Iterator[Path]:
    """Yield a draft, and remove on leaving what is left of it."""
    _drafts.add(draft)
    try:
        yield draft
    finally:
        _discard(draft)


def _discard(draft: Path) -> None:
    if draft.is_dir():
        shutil.rmtree(draft, ignore_errors=True)
    else:
        with suppress(OSError):
            draft.unlink(missing_ok=True)
    _drafts.discard(draft)


def discard_drafts() -> None:
    """Remove the drafts and temporary folders of this process; it is to end, whatever its threads do."""
    for draft in [*_drafts]:
        _discard(draft)


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Yield a folder for temporary files, and remove it on leaving."""
    with _discarded(Path(tempfile.mkdtemp(prefix="tssgeom-"))) as folder:
        yield folder


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a hidden path in the same folder to write to; on leaving, the draft is renamed to `path`.

    The folder is created where it is missing. A writing that fails or is interrupted leaves `path` as it was.

    Raises SourceError where `path` is no regular file, or the disk refuses; SpaceError where it is full.
    """
    draft = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        require_replaceable(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        with _discarded(draft):
            yield draft
            os.replace(draft, path)
    except OSError as error:
        raise unwritable(path, error) from error


def write_text(path: Path, text: str, *, durable: bool = False) -> None:
    """Write a complete text file, or leave `path` as it was; see `replacing`.

    Bytes of a name that are not UTF-8 are written as JSON escapes them. A durable file is on the disk
    before it replaces an older one, so that a loss of power leaves one of the two.
    """
    with (
        replacing(path) as draft,
        draft.open("w", encoding="utf-8", errors="backslashreplace", newline="\n") as file,
    ):
        file.write(text)
        if durable:
            file.flush()
            os.fsync(file.fileno())


@contextmanager
def replacing_all(folder: Path) -> Iterator[Path]:
    """Yield a hidden folder to write files to; on leaving, all of them move to `folder` together.

    A writing that fails or is interrupted leaves `folder` as it was, or absent.

    Raises SourceError where a name is taken by no regular file, or the disk refuses.
    """
    draft = folder / f".{os.getpid()}.draft"
    fresh = not folder.exists()
    try:
        with _discarded(draft):
            draft.mkdir(parents=True, exist_ok=True)
            yield draft
            written = sorted(draft.iterdir())
            for path in written:
                require_replaceable(folder / path.name)
            for path in written:
                os.replace(path, folder / path.name)
    except OSError as error:
        raise unwritable(folder, error) from error
    finally:
        if fresh:
            with suppress(OSError):
                folder.rmdir()  # succeeds only where the folder is empty


def remove_drafts(folder: Path) -> None:
    """Remove from one folder the drafts of `replacing` whose process was killed."""
    with suppress(OSError):
        for file in folder.iterdir():
            if _DRAFT.fullmatch(file.name):
                file.unlink(missing_ok=True)

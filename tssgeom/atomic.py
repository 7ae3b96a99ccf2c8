"""Files that are whole or not there: written beside their place, then moved into it."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tssgeom.errors import require_replaceable, unwritable

_DRAFT = re.compile(r"\..+\.\d+\.[a-z]+|\.\..+\.part")  # of replacing, and of a writer's own draft beside it


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a hidden path in the same folder to write to; on leaving, it takes the place of `path`.

    Where the writing fails or is interrupted, `path` is as it was before.

    Raises
    ------
    SourceError
        Where `path` is no regular file, or the disk refuses; SpaceError where it is full.
    """
    draft = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        require_replaceable(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        yield draft
        os.replace(draft, path)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all."""
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8", newline="\n")


@contextmanager
def replacing_all(folder: Path) -> Iterator[Path]:
    """Yield a hidden folder to write files to; on leaving, all of them move to `folder` together.

    Where the writing fails or is interrupted, `folder` is as it was before, or not there.

    Raises
    ------
    SourceError
        Where a place is taken by no regular file, or the disk refuses.
    """
    draft = folder / f".{os.getpid()}.draft"
    fresh = not folder.exists()
    try:
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
        shutil.rmtree(draft, ignore_errors=True)
        if fresh:
            with suppress(OSError):
                folder.rmdir()  # only where nothing is in it


def remove_drafts(folder: Path) -> None:
    """Remove from one folder what `replacing` left there when its process was killed."""
    with suppress(OSError):
        for file in folder.iterdir():
            if _DRAFT.fullmatch(file.name):
                file.unlink(missing_ok=True)

"""Files that a stream keeps: each has one stream that writes it, and no recording is lost or overwritten."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from tssgeom.errors import SourceError, require_replaceable, unwritable


@contextmanager
def locked(paths: Sequence[Path]) -> Iterator[None]:
    """Lock files against other streams; the end of a process frees them.

    The lock is a hidden file beside each, so that a folder in which nothing can be written is refused too.

    Raises
    ------
    SourceError
        Where another stream writes one of them, or where it cannot be written.
    """
    with ExitStack() as stack:
        for path in paths:
            require_replaceable(path)
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                stack.enter_context(_lock(path))
            except Timeout as error:
                raise SourceError(
                    f"{path}: another stream writes it: end that one, or name another file"
                ) from error
            except OSError as error:
                raise unwritable(path, error) from error
        yield


@contextmanager
def _lock(path: Path) -> Iterator[None]:
    path = path.resolve()
    lock = FileLock(path.with_name(f".{path.name}.lock"), timeout=0)
    with lock:
        try:
            yield
        finally:
            with suppress(OSError):
                os.unlink(lock.lock_file)


def unfinished(recording: Path) -> Path:
    """Return the hidden file in which a recording grows until it is finished."""
    return recording.with_name(f".{recording.stem}.part{recording.suffix}")


@contextmanager
def kept_recording(path: Path, report: Callable[[str], object]) -> Iterator[Path]:
    """Yield the file to record to, and keep those of earlier streams; `path` is locked already.

    What a killed stream left of a recording gets a name. Where the file exists, the new one has a number.

    Raises
    ------
    SourceError
        Where another stream writes there.
    """
    numbered = re.compile(rf"\.({re.escape(path.stem)}(?:-\d+)?)\.part{re.escape(path.suffix)}")
    for part in sorted(path.parent.iterdir()):
        if (match := numbered.fullmatch(part.name)) and part.stat().st_size:
            owner = path.with_name(f"{match[1]}{path.suffix}")
            with suppress(Timeout), ExitStack() as stack:
                if owner != path:
                    stack.enter_context(_lock(owner))
                kept = _free(owner)
                part.rename(kept)
                report(f"{kept}: what a stream recorded that did not end in order")
    fresh = _free(path)
    if fresh == path:
        yield path
        return
    report(f"{path} exists: this recording is {fresh}")
    with locked([fresh]):
        yield fresh


def _free(path: Path) -> Path:
    """Return a path, or the first with a number from 2 at which there is no file."""
    stem, number, fresh = path.stem, 2, path
    while fresh.exists() or (fresh != path and unfinished(fresh).exists()):
        fresh, number = path.with_name(f"{stem}-{number}{path.suffix}"), number + 1
    return fresh

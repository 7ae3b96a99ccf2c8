"""Files that a stream keeps: each has one stream that writes it, and no recording is lost or overwritten."""

from __future__ import annotations

import errno
import math
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock, Timeout

from tssgeom.errors import SettingsError, SourceError, printable, require_replaceable, unwritable


@contextmanager
def locked(paths: Sequence[Path]) -> Iterator[None]:
    """Lock files against other streams; the end of a process frees them.

    The lock is a hidden file beside each, so that a folder in which nothing can be written is refused too.

    Raises SourceError where another stream writes one of them, or where it cannot be written.
    """
    with ExitStack() as stack:
        for path in paths:
            require_replaceable(path)
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                stack.enter_context(_lock(path))
            except Timeout as error:
                if not Path(error.lock_file).exists():  # no file can be made in such a folder
                    missing = FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
                    raise unwritable(path, missing) from error
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


@dataclass(frozen=True, slots=True)
class Rotation:
    """When a recording ends and the next one begins."""

    size: float = math.inf
    """Size from which it does [B]."""
    age: float = math.inf
    """Time after which it does [s]."""

    def is_due(self, size: float, age: float) -> bool:
        """Whether a recording of a size [B] that began a time ago [s] has to end."""
        return size >= self.size or age >= self.age


_UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0, "MB": 1e6, "GB": 1e9, "MiB": 1 << 20, "GiB": 1 << 30}


def rotation_of(text: str) -> Rotation:
    """Return the rotation that a user wrote, such as 500MB or 30min.

    Raises SettingsError where it is no positive size or time.
    """
    match = re.fullmatch(r"\s*(\d+(?:\.\d*)?)\s*([A-Za-z]+)\s*", text)
    value = float(match[1]) * _UNITS.get(match[2], 0.0) if match else 0.0
    if match is None or not 0.0 < value < math.inf:
        raise SettingsError(
            f"--record-rotate {printable(text)}: no size or time: write a number and {', '.join(_UNITS)}"
        )
    return Rotation(size=value) if match[2].endswith("B") else Rotation(age=value)


@contextmanager
def kept_recording(path: Path, report: Callable[[str], object]) -> Iterator[Path]:
    """Yield the file to record to, and keep those of earlier streams; `path` is locked already.

    What a killed stream left of a recording gets a name. Where the file exists, the new one has a number.

    Raises SourceError where another stream writes there.
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
    with ExitStack() as stack:
        fresh = path
        if path.exists():
            fresh = stack.enter_context(next_recording(path))
            report(f"{path} exists: this recording is {fresh}")
        stack.callback(_remove_empty, unfinished(fresh))
        yield fresh


@contextmanager
def next_recording(path: Path) -> Iterator[Path]:
    """Lock and yield the recording after those that are there; its number is greater than theirs.

    Raises SourceError where another stream writes there.
    """
    fresh = _numbered(path)
    with locked([fresh]):
        yield fresh


def _remove_empty(part: Path) -> None:
    """Remove what a stream left that ended before its first frame."""
    with suppress(OSError):
        if not part.stat().st_size:
            part.unlink()


def _free(path: Path) -> Path:
    """Return a path, or where there is a file, the next one with a number."""
    return _numbered(path) if path.exists() else path


def _numbered(path: Path) -> Path:
    """Return a path with a number, from 2, that is greater than those of all recordings beside it."""
    ours = re.compile(rf"\.?{re.escape(path.stem)}-(\d+)(?:\.part)?{re.escape(path.suffix)}")
    taken = [int(match[1]) for one in path.parent.iterdir() if (match := ours.fullmatch(one.name))]
    return path.with_name(f"{path.stem}-{max(taken, default=1) + 1}{path.suffix}")

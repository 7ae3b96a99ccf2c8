"""Errors of tssgeom: each message states the fault, the value with its unit, and a hint."""

import errno
import os
from pathlib import Path

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


class TssgeomError(Exception):
    """Root of every error that tssgeom raises on purpose; its message is one line, whatever a file holds."""

    def __init__(self, message: object) -> None:
        super().__init__(" ".join(str(message).splitlines()))


class ShapeError(TssgeomError, ValueError):
    """A sensed shape that cannot be used, such as too few points or no unit."""


class SettingsError(TssgeomError, ValueError):
    """A rig or an option outside its bounds, or an unknown key."""


class FitError(TssgeomError):
    """A fit that did not converge on valid input."""


class SourceError(TssgeomError):
    """A file or stream that cannot be read or written."""


class SpaceError(SourceError):
    """No room is left where results are written."""


def refused(error: OSError) -> SourceError:
    """Return the error to raise where the system refused a file and no caller expected it."""
    where = f"{error.filename}: " if error.filename else ""
    return SourceError(f"{where}{error.strerror or error}: check the path and who may use it")


def require_replaceable(path: Path) -> None:
    """Refuse to replace a device, a pipe or a folder with a file.

    Raises
    ------
    SourceError
        Where `path` is one of them.
    """
    if path.exists() and not path.is_file():
        raise SourceError(f"{path}: is no file but a device, a pipe or a folder: name another file to write")


def unwritable(what: object, error: OSError) -> SourceError:
    """Return the error to raise where `what` could not be written; a full disk has a kind of its own."""
    if error.errno in _FULL:
        return SpaceError(f"{what}: no room left ({os.strerror(error.errno)}): free space and run again")
    return SourceError(f"{what}: cannot be written ({error.strerror or error}): check the folder")


def unreadable(what: object, error: OSError, hint: str = "check the path") -> SourceError:
    """Return the error to raise where `what` could not be read."""
    return SourceError(f"{what}: cannot be read ({error.strerror or error}): {hint}")


def first_line(error: Exception) -> str:
    """Return the first line of the text of an error, or the name of its kind where it has none."""
    return " ".join(str(error).partition("\n")[0].split()) or type(error).__name__

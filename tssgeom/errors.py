"""Errors of tssgeom: each message states the fault, the value with its unit, and a hint."""

import errno
import os
import re
from collections.abc import Sequence
from pathlib import Path

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_NO_MEMORY = re.compile(
    r"bad.alloc|(fail|unable).* alloc|(out of|insufficient|cannot allocate) memory|(start|spawn).* thread",
    re.IGNORECASE,
)
_HEAD, _TAIL = 1000, 500
"""Characters of a longer message that are kept at its beginning and end; chosen: they fit a terminal."""
_WRITTEN_OUT = {code: f"\\x{code:02x}" for code in (*range(32), *range(127, 160)) if code not in (9, 10)}
_WRITTEN_OUT |= {code: f"\\x{code - 0xDC00:02x}" for code in range(0xDC80, 0xDD00)}
_WRITTEN_OUT |= {code: f"\\u{code:04x}" for code in range(0xD800, 0xE000) if code not in _WRITTEN_OUT}
"""Control characters, and the surrogates by which Python names bytes of a file name that are not UTF-8."""


def printable(text: str) -> str:
    """Return a text whose control characters, and bytes that are not UTF-8, are written as hexadecimal."""
    return text.translate(_WRITTEN_OUT)


def listed(names: Sequence[str], most: int = 5) -> str:
    """Return names for a message, the first few of many; chosen."""
    return ", ".join(names[:most]) + ", …" * (len(names) > most)


def shortened(text: str) -> str:
    """Return a message without its middle where it is too long to be read."""
    cut = len(text) - _HEAD - _TAIL
    return text if cut <= 0 else f"{text[:_HEAD]} ... ({cut} characters) ... {text[-_TAIL:]}"


def on_one_line(text: str) -> str:
    """Return a message without its line breaks, printable and not too long to be read."""
    return shortened(printable(" ".join(text.splitlines())))


class TssgeomError(Exception):
    """Root of every error that tssgeom raises on purpose; its message is one line, whatever a file holds."""

    def __init__(self, message: object) -> None:
        super().__init__(on_one_line(str(message)))


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


def require(condition: bool, what: str, value: float, hint: str) -> None:
    """Raise a SettingsError with a value that is out of bounds."""
    if not condition:
        raise SettingsError(f"{what} is {value:g}: {hint}")


def require_at_least_zero(what: str, value: float, unit: str) -> None:
    """Refuse a value below 0 or above 1e12, with a SettingsError."""
    require(0 <= value <= 1e12, what, value, f"give a value from 0 to 1e12 {unit}".rstrip())


def refused(error: OSError) -> SourceError:
    """Return the error to raise where the system refused a file and no caller expected it."""
    where = f"{error.filename}: " if error.filename else ""
    return SourceError(f"{where}{error.strerror or error}: check the path and its permissions")


def require_replaceable(path: Path) -> None:
    """Refuse to replace a device, a pipe or a folder with a file, and a name that is not UTF-8.

    Raises SourceError where `path` is one of them.
    """
    require_utf8(path)
    if os.path.exists(path) and not path.is_file():
        raise SourceError(f"{path}: is no file but a device, a pipe or a folder: name another file to write")


def require_utf8(path: str | Path) -> None:
    """Refuse to write to a name that is not UTF-8, which libraries of tables and pictures cannot open.

    Raises SourceError where a byte of `path` is no part of a character.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError as error:
        raise SourceError(f"{path}: cannot be written, the name is not UTF-8: give another one") from error


def require_file(path: Path) -> None:
    """Refuse a device or a pipe, which may have no end.

    Raises SourceError where `path` exists and is neither a file nor a folder.
    """
    if os.path.exists(path) and not (path.is_file() or path.is_dir()):
        raise SourceError(f"{path}: a pipe or a device, which cannot be read twice: save it as a file")


def unwritable(what: object, error: OSError) -> SourceError:
    """Return the error to raise where `what` could not be written; a full disk has a kind of its own."""
    if error.errno in _FULL:
        return SpaceError(f"{what}: no room left ({os.strerror(error.errno)}): free space and run again")
    return SourceError(f"{what}: cannot be written ({error.strerror or error}): check the folder")


def unreadable(what: object, error: OSError, hint: str = "check the path") -> SourceError:
    """Return the error to raise where `what` could not be read."""
    return SourceError(f"{what}: cannot be read ({error.strerror or error}): {hint}")


def lacks_memory(error: BaseException) -> bool:
    """Whether the system refused memory or a part of a library, here or to what led to this error."""
    refused = isinstance(error, MemoryError | ImportError) or _NO_MEMORY.search(str(error)) is not None
    before = error.__cause__ or error.__context__
    return refused or (before is not None and lacks_memory(before))


def out_of_memory(error: Exception) -> SettingsError:
    """Return the error to raise where the system refused memory."""
    return SettingsError(f"{first_line(error)}: check the free memory, its limits, and the installation")


def fault_of(error: Exception) -> str:
    """Return why a saved object cannot be read; a KeyError states but the name of what is missing."""
    return f"it has no {error.args[0]!r}" if isinstance(error, KeyError) else first_line(error)


def broken_state(error: Exception) -> SettingsError:
    """Return the error of a saved state that cannot be read."""
    return SettingsError(f"the saved state is broken ({fault_of(error)}): remove it and start anew")


def first_line(error: Exception) -> str:
    """Return the first line of the text of an error, or the name of its kind where it has none."""
    return " ".join(str(error).partition("\n")[0].split()) or type(error).__name__

"""Paths of shape files: their bytes, and `FILE#PART`, one route of a file that holds several.

PART is the number of the route, its name or its topic.
"""

from __future__ import annotations

import math
import os
import re
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache, wraps
from pathlib import Path
from typing import Concatenate, NamedTuple, ParamSpec, TypeVar

from tssgeom.errors import SettingsError, ShapeError, SourceError, listed, printable, require_file, unreadable

Given = ParamSpec("Given")
Content = TypeVar("Content")

MARKUPS = ".mrk.json"
PACKED = ".gz"
LONGEST_LINE = 1 << 20
"""Bytes of the longest line that is read, 1 MiB: the limit of the stream; 20 000 points fit."""
MOST_MIB = "TSSGEOM_MOST_MIB"
"""Environment variable with the memory that one file may take [MiB]."""
_MOST_MIB, _MOST_DIGITS = "64", 10
"""Its default, and digits of a number beyond any memory. Chosen: with the copies and the objects that readers
make of it, a process stays below 1 GiB."""
SETTINGS_BYTES = 4 << 20
"""Bytes of the longest file of settings, such as `campaign.toml`; chosen: 40 000 runs fit."""
_LONGEST_NAME = 150
"""Bytes of the stem of a name of outputs; chosen: with endings and draft marks a name stays below 255."""
_LINES = {9: "_x09", 10: "_x0a"}
_NOT_IN_NAMES = re.compile(r"[^\w.-]+")


@contextmanager
def reading(path: Path, hint: str = "check the path") -> Iterator[None]:
    """Turn a refusal of the system to read `path` into an error with a hint; a pipe or device is one at once.

    Raises SourceError where the file cannot be read.
    """
    require_file(path)
    try:
        yield
    except OSError as error:
        raise unreadable(path, error, hint) from error


def bytes_of(path: Path, most: int | None = None, hint: str = "check the path") -> bytes:
    """Return the content of a file.

    Parameters
    ----------
    path
        The file.
    most
        Its greatest size [B]; None: `room`.
    hint
        What to check where the file cannot be read.

    Raises
    ------
    SourceError
        Where the file cannot be read, or is larger.
    """
    with reading(path, hint), path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        require_room(path, size, most)
        content = file.read(size + 1)
        require_room(path, len(content), most)
        return content + file.read((room() if most is None else most) - len(content))


def require_lines(path: Path, raw: bytes) -> bytes:
    """Return the content of a table in text, of which no line is longer than LONGEST_LINE.

    Raises ShapeError where one is.
    """
    begin = 0
    while len(raw) - begin > LONGEST_LINE:
        end = max(raw.rfind(mark, begin, begin + LONGEST_LINE + 1) for mark in (b"\n", b"\r"))
        if end < begin:
            number = raw.count(b"\n", 0, begin) + 1
            raise ShapeError(f"{path}: line {number} is longer than {LONGEST_LINE} bytes (1 MiB): divide it")
        begin = end + 1
    return raw


def size_of(path: Path) -> int:
    """Return the size of a file [B]; 0 where there is none, which its reader reports."""
    return path.stat().st_size if path.is_file() else 0


class Stamp(NamedTuple):
    """What changes where a file is written anew."""

    inode: int
    size: int
    modified: int
    """[ns]."""


def stamp_of(path: Path) -> Stamp:
    """Return the stamp of a file, by which what was read of it may be kept.

    Raises SourceError where there is no such file.
    """
    with reading(path):
        status = path.stat()
    return Stamp(status.st_ino, status.st_size, status.st_mtime_ns)


def kept_while_unchanged(
    read: Callable[Concatenate[Path, Given], Content],
) -> Callable[Concatenate[Path, Given], Content]:
    """Keep what was read of the last file until that is written anew: each part of it is an input of its own.

    Raises SourceError where there is no such file.
    """

    @lru_cache(maxsize=1)
    def kept(path: Path, stamp: Stamp, *given: Given.args, **named: Given.kwargs) -> Content:
        return read(path, *given, **named)

    @wraps(read)
    def of_stamp(path: Path, *given: Given.args, **named: Given.kwargs) -> Content:
        return kept(path, stamp_of(path), *given, **named)

    return of_stamp


def room() -> int:
    """Return how much of a file may be in memory at once [B]; the environment variable `MOST_MIB` sets it.

    Raises SettingsError where the variable is no whole number above 0.
    """
    text = os.environ.get(MOST_MIB, _MOST_MIB)
    if not (text.isdecimal() and text.isascii() and len(text) < _MOST_DIGITS and int(text)):
        raise SettingsError(f"{MOST_MIB} is {text!r}: give a whole number of MiB, such as {_MOST_MIB}")
    return int(text) << 20


def require_room(path: Path, size: float, most: int | None = None) -> None:
    """Refuse content that would take too much memory; what is read frame by frame needs room for one.

    Parameters
    ----------
    path
        The file.
    size
        Size of the content once it is unpacked, as the file declares it [B].
    most
        The limit [B]; None: `room`.

    Raises
    ------
    SourceError
        Where it is above the limit.
    """
    limit = room() if most is None else most
    if size > limit:
        how = f"set {MOST_MIB}={math.ceil(size / (1 << 20))}" if most is None else "make it smaller"
        raise SourceError(
            f"{path}: unpacked it takes {_mib(size)}, the limit is {_mib(limit)}: divide the file, or {how}"
        )


def _mib(size: float) -> str:
    return f"{size / (1 << 20):.4g} MiB"


def require_room_in_zip(path: Path) -> None:
    """Refuse a ZIP archive whose members declare more than `room`; a file that is none is left to its reader.

    Raises SourceError where it is too large, or cannot be read.
    """
    with reading(path), suppress(zipfile.BadZipFile), zipfile.ZipFile(path) as archive:
        require_room(path, sum(member.file_size for member in archive.infolist()))


def split(path: Path) -> tuple[Path, str | None]:
    """Return the file and the part of it that a path names; a file whose own name has a # is no part."""
    text = str(path)
    if "#" in text and not os.path.exists(path):
        for mark in re.finditer("#", text):
            file = Path(text[: mark.start()])
            if mark.start() and os.path.exists(file) and text[mark.end() :]:
                return file, text[mark.end() :]
    return path, None


def part_of(file: Path, part: str | int) -> Path:
    """Return the path that names one part of a file."""
    return Path(f"{file}#{part}")


def ending(path: Path) -> str:
    """Return the ending of a file in small letters; a Slicer markup and a packed file have two words."""
    name = split(path)[0].name.lower()
    packed = Path(name.removesuffix(PACKED)).suffix if name.endswith(PACKED) else ""
    return MARKUPS if name.endswith(MARKUPS) else f"{packed}{Path(name).suffix}"


def stem(path: Path) -> str:
    """Return the name of the outputs of a path: the file without its ending, then its part.

    What cannot be printed is written out, a byte that is not UTF-8 as `_xff`.
    """
    file, part = split(path)
    name = file.name if os.path.isdir(file) else file.name[: len(file.name) - len(ending(file))]
    if part is not None:
        name = f"{name}-{_NOT_IN_NAMES.sub('_', part).strip('_')}"
    if not name.isprintable():
        name = printable(name.translate(_LINES)).replace("\\", "_")
    return name.encode(errors="replace")[:_LONGEST_NAME].decode(errors="ignore")


def selected(path: Path, names: Sequence[str]) -> int:
    """Return the index of the part that a path names; without one, that of the only part there is.

    Raises ShapeError where there is no such part, or where there are several and none is named.
    """
    file, part = split(path)
    if part is None and len(names) == 1:
        return 0
    if part is None:
        raise ShapeError(
            f"{file}: it holds {len(names)} routes ({listed(names)}): name one, as {file}#{names[0]}"
        )
    number = int(part) - 1 if part.isdecimal() and len(part) <= _MOST_DIGITS else -1
    fits = 0 <= number < len(names)
    if fits and names[number] == part:
        return number  # without a search: there may be thousands
    if part in names:
        return names.index(part)
    if fits:
        return number
    raise ShapeError(f"{file}: no route {part!r} in it: it holds {listed(names)}")

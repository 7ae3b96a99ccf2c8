"""Paths of shape files: their bytes, and `FILE#PART`, one route of a file that holds several.

PART is the number of the route, its name or its topic.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from tssgeom.errors import ShapeError, unreadable

MARKUPS = ".mrk.json"
PACKED = ".gz"
LONGEST_LINE = 1 << 20
"""Bytes of the longest line that is read, 1 MiB: the limit of the stream; 20 000 points fit."""
_MOST_NAMED = 5  # names of routes in a message
_NOT_IN_NAMES = re.compile(r"[^\w.-]+")


@contextmanager
def reading(path: Path, hint: str = "check the path") -> Iterator[None]:
    """Turn a refusal of the system to read `path` into an error with a hint.

    Raises
    ------
    SourceError
        Where the file cannot be read.
    """
    try:
        yield
    except OSError as error:
        raise unreadable(path, error, hint) from error


def bytes_of(path: Path) -> bytes:
    """Return the content of a file.

    Raises
    ------
    SourceError
        Where the file cannot be read.
    """
    with reading(path):
        return path.read_bytes()


def split(path: Path) -> tuple[Path, str | None]:
    """Return the file and the part of it that a path names; a file whose own name has a # is no part."""
    text = str(path)
    if "#" in text and not path.exists():
        for mark in re.finditer("#", text):
            file = Path(text[: mark.start()])
            if file.exists() and text[mark.end() :]:
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
    """Return the name of the outputs of a path: the file without its ending, then its part."""
    file, part = split(path)
    name = file.name if file.is_dir() else file.name[: len(file.name) - len(ending(file))]
    return name if part is None else f"{name}-{_NOT_IN_NAMES.sub('_', part).strip('_')}"


def selected(path: Path, names: Sequence[str]) -> int:
    """Return the index of the part that a path names; without one, that of the only part there is.

    Raises
    ------
    ShapeError
        Where there is no such part, or where there are several and none is named.
    """
    file, part = split(path)
    if part is None and len(names) == 1:
        return 0
    listed = ", ".join(names[:_MOST_NAMED]) + (", ..." if len(names) > _MOST_NAMED else "")
    if part is None:
        raise ShapeError(f"{file}: it holds {len(names)} routes ({listed}): name one, as {file}#{names[0]}")
    if part in names:
        return names.index(part)
    if part.isdecimal() and 1 <= int(part) <= len(names):
        return int(part) - 1
    raise ShapeError(f"{file}: no route {part!r} in it: it holds {listed}")

"""One route of a file that holds several: `FILE#PART`, where PART is its number, its name or its topic."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from tssgeom.errors import ShapeError

MARKUPS = ".mrk.json"
_MOST_NAMED = 5
_NOT_IN_NAMES = re.compile(r"[^\w.-]+")


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
    """Return the ending of a file in small letters; that of a Slicer markup has two words."""
    name = split(path)[0].name.lower()
    return MARKUPS if name.endswith(MARKUPS) else Path(name).suffix


def stem(path: Path) -> str:
    """Return what the outputs of a path are called: the file without its ending, then its part."""
    file, part = split(path)
    name = file.name if file.is_dir() else file.name[: len(file.name) - len(ending(file))]
    return name if part is None else f"{name}-{_NOT_IN_NAMES.sub('_', part).strip('_')}"


def chosen(path: Path, names: Sequence[str]) -> int:
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

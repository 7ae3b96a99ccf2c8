"""Recordings of a colonoscope's coils: a folder with X.txt, Y.txt, Z.txt and T.txt, a line for each frame.

Cells are separated by semicolons; column 0 is the tip, so that each line runs from distal to proximal.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import BinaryIO

import numpy as np

from tssgeom.arrays import Vector, read_only
from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.formats.paths import LONGEST_LINE, reading, stem
from tssgeom.io.formats.recording import PER_METRE, Frames, Recording, given_unit
from tssgeom.stream import Frame, Rejected

FILES = ("X.txt", "Y.txt", "Z.txt", "T.txt")
_PER_SECOND = 1000.0  # T is in ms
_MISSING = (b"", b"nan", b"NaN")


def is_colonoscope(folder: Path) -> bool:
    """Whether a folder holds a recording; without Z.txt or T.txt too, which its reader reports."""
    return all((folder / name).is_file() for name in FILES[:2])


@dataclass(frozen=True, slots=True)
class CoilFrames(Frames):
    """The frames of a folder, a line each."""

    folder: Path
    per_metre: float

    def read(self) -> Iterator[Frame | Rejected]:
        """Yield the frames as the files hold them."""
        for number, lines in enumerate(_lines(self.folder), start=1):
            try:
                yield self._frame(lines)
            except ShapeError as error:
                yield Rejected(0, 0.0, f"line {number}: {error}")

    def _frame(self, lines: tuple[bytes, ...]) -> Frame:
        columns = [_numbers(name, line) for name, line in zip(FILES, lines, strict=True)]
        *axes, time = columns
        if len({len(axis) for axis in axes}) > 1:
            counts = ", ".join(f"{len(axis)} in {name}" for axis, name in zip(axes, FILES, strict=False))
            raise ShapeError(f"different numbers of coils, {counts}: mend the line")
        if not time.size:
            raise ShapeError("T.txt has no time: write it in ms")
        points = np.column_stack(axes)[::-1] / self.per_metre
        points[np.isnan(points).any(axis=1)] = np.nan
        return Frame(read_only(points), float(time[0]) / _PER_SECOND)


def open_colonoscope(path: Path, unit: str | None) -> Recording:
    """Open a folder of coil coordinates.

    Raises ShapeError where no unit is given, since the files state none, or where there is no line;
    SourceError where a file is missing or cannot be read.
    """
    missing = [name for name in FILES if not (path / name).is_file()]
    if missing:
        raise SourceError(f"{path}: no {missing[0]} in it: a recording has {', '.join(FILES)}")
    agreed = given_unit(path, unit, "a folder of X.txt, Y.txt, Z.txt and T.txt")
    count = sum(1 for _ in _lines(path))
    if not count:
        raise ShapeError(f"{path}: no line in {', '.join(FILES)}: write one for each frame")
    frames = CoilFrames(path, PER_METRE[agreed])
    return Recording(stem(path), path, agreed, "colonoscope", True, count, frames)


def _lines(folder: Path) -> Iterator[tuple[bytes, ...]]:
    """Yield the lines of the four files side by side, but for blank ones at the end."""
    blank = list[tuple[bytes, ...]]()
    with reading(folder, "check the folder"), ExitStack() as stack:
        files = [stack.enter_context((folder / name).open("rb")) for name in FILES]
        for lines in zip_longest(*map(_each, files), fillvalue=b""):
            blank.append(lines)
            if any(lines):
                yield from blank
                blank.clear()


def _each(file: BinaryIO) -> Iterator[bytes]:
    """Yield each line stripped; one that is too long comes in pieces, which no other file matches."""
    while line := file.readline(LONGEST_LINE):
        yield line.strip()


def _numbers(name: str, line: bytes) -> Vector:
    """Return the numbers of a line; an empty cell is a coil that was not observed."""
    cells = [cell.strip() for cell in line.removesuffix(b";").split(b";")] if line else []
    try:
        return np.array([np.nan if cell in _MISSING else float(cell) for cell in cells], dtype=np.float64)
    except ValueError as error:
        raise ShapeError(f"{name}: {error}: write numbers, separated by semicolons") from error

"""Tables of points that are too large for the memory, as blocks of rows; each pass reads the file anew."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv

from tssgeom.errors import ShapeError
from tssgeom.io.formats.columns import POINT, TIME, Columns, columns_of
from tssgeom.io.formats.longform import MOST_AT_ONCE, LongFrames
from tssgeom.io.formats.paths import reading, require_room, stem
from tssgeom.io.formats.recording import Frames, Recording
from tssgeom.io.formats.tables import (
    NO_ROW,
    Table,
    as_numbers,
    convert_options,
    filled,
    lowest_point,
    parquet_file,
    parquet_names,
    read_options,
    runs_of,
    slow_table,
    table_of,
)
from tssgeom.stream import Frame, Rejected

_BLANK_LINE = re.compile(rb"\n\r?\n\s*\S")
_OVERLAP = 4096  # bytes of a block in which a blank line that goes on in the next block begins; chosen


class BlockSizes(NamedTuple):
    """Parts of a large table that memory holds at a time."""

    part: int = 1 << 23
    """Size of a part of a file, and of the numbers of a part [bytes]; chosen: small beside any memory."""


SIZES = BlockSizes()


@dataclass(frozen=True, slots=True)
class CsvBlocks:
    """A CSV file."""

    path: Path
    names: Sequence[str]
    """All columns of the file."""
    columns: Columns
    clean: bool = True
    """Whether pyarrow can read it; otherwise it is read line by line, so that each fault has its line."""

    def blocks(self, wanted: Sequence[str]) -> Iterator[Table]:
        """Yield the rows in order; only the wanted columns are certain to be filled in.

        Raises SourceError where the file cannot be read; pyarrow.ArrowInvalid where a line of a clean file is
        no row of numbers.
        """
        yield from self._fast(wanted) if self.clean else self._slow()

    def _fast(self, wanted: Sequence[str]) -> Iterator[Table]:
        options = {
            "read_options": read_options(self.names, SIZES.part),
            "convert_options": convert_options(wanted),
        }
        first = 2
        with reading(self.path), self.path.open("rb") as file, pacsv.open_csv(file, **options) as reader:
            for batch in reader:
                yield table_of(self.columns, batch, "line", first)
                first += batch.num_rows

    def _slow(self) -> Iterator[Table]:
        with reading(self.path), self.path.open(encoding="utf-8", errors="replace") as file:
            next(file, None)
            first = 2
            while some := file.readlines(SIZES.part // 8):  # a number in a list takes eight times its digits
                yield slow_table(enumerate(some, start=first), self.names, self.columns)
                first += len(some)

    def has_blank_lines(self) -> bool:
        """Whether lines between others are blank; pyarrow leaves them out and loses count."""
        tail = b""
        with reading(self.path), self.path.open("rb") as file:
            while block := file.read(SIZES.part):
                if _BLANK_LINE.search(tail + block):
                    return True
                tail = (tail + block)[-_OVERLAP:]
        return False


@dataclass(frozen=True, slots=True)
class ParquetBlocks:
    """A Parquet file."""

    path: Path
    columns: Columns

    def blocks(self, wanted: Sequence[str]) -> Iterator[Table]:
        """Yield the rows in order, with the wanted columns filled in.

        Raises SourceError where the file cannot be read; ShapeError where a column holds no numbers.
        """
        first = 1
        with parquet_file(self.path, 1 << 20) as file:
            rows = max(SIZES.part // (8 * max(len(wanted), 1)), 1)
            for batch in file.iter_batches(rows, columns=list(wanted), use_threads=False):
                yield table_of(self.columns, as_numbers(self.path, batch), "row", first)
                first += batch.num_rows


Blocks = CsvBlocks | ParquetBlocks


def csv_blocks(path: Path, names: Sequence[str], given_unit: str | None) -> CsvBlocks:
    """Open a CSV file of these columns to be read in blocks; the errors are those of `read_csv`."""
    source = CsvBlocks(path, names, columns_of(path, names, given_unit))
    return replace(source, clean=not source.has_blank_lines())


def parquet_blocks(path: Path, given_unit: str | None) -> ParquetBlocks:
    """Open a Parquet file to be read in blocks; the errors are those of `read_parquet`."""
    return ParquetBlocks(path, columns_of(path, parquet_names(path), given_unit))


def joined(before: Table | None, after: Table) -> Table:
    """Put the rows of one table before those of another."""
    if before is None or not len(before):
        return after
    names = after.columns.names
    faults = {**before.faults} | {row + len(before): text for row, text in after.faults.items()}
    return Table(
        after.columns,
        {name: np.concatenate([before.values[name], after.values[name]]) for name in names},
        np.concatenate([before.number, after.number]),
        after.number_name,
        faults,
    )


def rows_from(table: Table, first: int) -> Table:
    """Return the rows of a table from one on."""
    return Table(
        table.columns,
        {name: values[first:] for name, values in table.values.items()},
        table.number[first:],
        table.number_name,
        {row - first: text for row, text in table.faults.items() if row >= first},
    )


@dataclass(frozen=True, slots=True)
class BlockFrames(Frames):
    """The frames of a table too large for the memory, of which a few blocks are held at a time."""

    source: Blocks
    lowest: float
    """The lowest point number of the file."""

    def read(self) -> Iterator[Frame | Rejected]:
        """Yield the frames as the file holds them."""
        rest: Table | None = None
        for block in self.source.blocks(self.source.columns.names):
            table = joined(rest, block)
            *whole, last = runs_of(table)
            yield from LongFrames(table, tuple(whole), self.lowest).read()
            rest = rows_from(table, int(last.min()))
        if rest is not None:
            yield from LongFrames(rest, runs_of(rest), self.lowest).read()


def open_large(path: Path, kind: str, source: Blocks) -> Recording:
    """Open a large table; a first pass over it counts the frames and detects faults.

    Raises ShapeError where it is one shape, or its points are numbered and their rows not in the order of
    time.
    """
    columns = source.columns
    if not columns.timed:
        raise ShapeError(
            f"{path}: one shape of more than {MOST_AT_ONCE >> 20} MiB: name the time of its frames {TIME}"
        )
    try:
        survey = _survey(source)
    except pa.ArrowInvalid:  # only the slow way gives each fault its line
        if not isinstance(source, CsvBlocks):
            raise
        source = replace(source, clean=False)
        survey = _survey(source)
    if columns.numbered and not survey.ordered:
        raise ShapeError(f"{path}: the rows are not in the order of {TIME}: sort so large a file by it first")
    if not survey.frames:
        raise ShapeError(f"{path}: {NO_ROW}")
    require_room(path, survey.most_rows * len(columns.names) * np.dtype(np.float64).itemsize)
    frames = BlockFrames(source, survey.lowest)
    return Recording(stem(path), path, columns.unit, kind, True, survey.frames, frames, columns.warnings)


class _Survey(NamedTuple):
    frames: int
    ordered: bool
    """Whether time never decreases, and is known from the first row on."""
    lowest: float
    most_rows: int
    """Of one frame."""


def _survey(source: Blocks) -> _Survey:
    wanted = [TIME, POINT] if source.columns.numbered else [TIME]
    frames, ordered, lowest, latest, rows, most_rows = 0, True, np.inf, np.nan, 0, 0
    for table in source.blocks(wanted):
        if not len(table):
            continue
        time = filled(np.concatenate(([latest], table.values[TIME])))
        step = np.nan_to_num(time, nan=-np.inf)
        begins = np.flatnonzero(step[1:] != step[:-1])
        frames += len(begins) + (frames == 0 and step[1] == step[0])
        counts = np.diff(np.concatenate(([-rows], begins, [len(table)])))
        rows, most_rows = int(counts[-1]), max(most_rows, int(counts.max()))
        ordered &= not np.isnan(time[1:]).any() and bool((step[1:] >= step[:-1]).all())
        lowest = min(lowest, lowest_point(table))
        latest = time[-1]
    return _Survey(frames, ordered, lowest, most_rows)

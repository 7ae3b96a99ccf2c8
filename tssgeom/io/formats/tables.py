"""CSV and Parquet files as columns of numbers, with the line of every cell that is no number."""

from __future__ import annotations

import codecs
import csv
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Vector
from tssgeom.errors import ShapeError, SourceError, first_line
from tssgeom.io.formats.columns import POINT, TIME, Columns, columns_of
from tssgeom.io.formats.paths import reading, require_room

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.csv as pacsv
    import pyarrow.parquet as papq

NO_ROW = "no row of points: write one row for each point"
_SMALL = 1 << 16
"""Size of a CSV file below which numpy reads it [B]; measured: that takes less than to import pyarrow."""
_MISSING = ["", "nan", "NaN", "NAN", "null", "NA"]


Rows = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Table:
    """Numbers of the columns that are read, in the file's units."""

    columns: Columns
    values: Mapping[str, Vector]
    """A column each; NaN where a cell is empty or could not be read."""
    number: NDArray[np.int64]
    """Number of each row in the file, from 1: of its line or of its row."""
    number_name: str
    """"line" or "row"."""
    faults: Mapping[int, str]
    """Fault of a row, by its index."""

    def __len__(self) -> int:
        return len(self.number)


def read_csv(path: Path, raw: bytes, names: list[str], given_unit: str | None) -> Table:
    """Read a comma-separated file under its header `names`.

    A small table of numbers alone is read by numpy, a larger one without faults by pyarrow, and any other
    line by line, so that each fault has its line.

    Raises ShapeError where columns are missing or unclear, or where there is no row.
    """
    columns = columns_of(path, names, given_unit)
    if b"\n\n" not in raw.rstrip() and b"\n\r\n" not in raw.rstrip():
        table = (_small if len(raw) < _SMALL else _fast)(path, raw, names, columns)
        if table is not None:
            return table
    return _slow(path, raw, names, columns)


def read_parquet(path: Path, given_unit: str | None) -> Table:
    """Read a Parquet file of the same columns.

    Raises ShapeError where columns are missing or unclear or hold no numbers, or where there is no row;
    SourceError where the file cannot be read.
    """
    with parquet_file(path) as file:
        columns = columns_of(path, file.schema_arrow.names, given_unit)
        table = parquet_columns(path, file, columns.names)
    return _table(path, columns, as_numbers(path, table), "row", 1)


def parquet_names(path: Path) -> list[str]:
    """Return the names of the columns of a Parquet file; raises SourceError where the file cannot be read."""
    with parquet_file(path) as file:
        return file.schema_arrow.names


@contextmanager
def parquet_file(path: Path, buffer: int = 0) -> Iterator[papq.ParquetFile]:
    """Open a Parquet file for a `with` block, and read it through a buffer of so many bytes.

    Raises SourceError where the file cannot be read.
    """
    import pyarrow as pa
    import pyarrow.parquet as papq

    try:
        with reading(path), path.open("rb") as held, papq.ParquetFile(held, buffer_size=buffer) as file:
            yield file
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise SourceError(
            f"{path}: cannot be read as Parquet ({first_line(error)}): write the file anew"
        ) from error


def parquet_columns(path: Path, file: papq.ParquetFile, names: Sequence[str]) -> pa.Table:
    """Read columns at once; raises SourceError where they take more memory than a file may."""
    require_room(path, parquet_size(file, names))
    return file.read(columns=list(names))


def parquet_size(file: papq.ParquetFile, names: Collection[str]) -> int:
    """Return how much memory columns of numbers take [B]."""
    return file.metadata.num_rows * len(names) * np.dtype(np.float64).itemsize


_Columns = TypeVar("_Columns", "pa.Table", "pa.RecordBatch")


def as_numbers(path: Path, table: _Columns) -> _Columns:
    """Return columns of any kind of number as float64.

    Raises ShapeError where a column holds something else.
    """
    import pyarrow as pa

    try:
        return table.cast(pa.schema([(name, pa.float64()) for name in table.schema.names]))
    except pa.ArrowException as error:
        raise ShapeError(f"{path}: a column holds no numbers ({first_line(error)}): write float64") from error


def plain_names(raw: bytes) -> list[str] | None:
    """Return the names of the columns from the beginning of a file; None where line 1 is no plain header."""
    first = raw.removeprefix(codecs.BOM_UTF8).partition(b"\n")[0]
    try:
        line = first.decode().strip()
    except UnicodeDecodeError:
        return None
    names = [name.strip().strip('"') for name in line.split(",")]
    broken = line.startswith("#") or not all(name and name.isprintable() for name in names)
    return None if broken or any(_is_number(name) for name in names) else names


def _small(path: Path, raw: bytes, names: list[str], columns: Columns) -> Table | None:
    """Read the rows of a small file; None where a line or a cell is empty or holds no number."""
    lines = raw.rstrip().decode("utf-8", errors="replace").splitlines()[1:]
    if not lines or not all(lines):
        return None
    try:
        numbers = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
    except ValueError:
        return None
    if numbers.shape[1] != len(names):
        return None
    values = {name: np.ascontiguousarray(numbers[:, names.index(name)]) for name in columns.names}
    return Table(columns, values, np.arange(2, 2 + len(lines)), "line", {})


def _fast(path: Path, raw: bytes, names: list[str], columns: Columns) -> Table | None:
    """Read the rows; None where a cell holds no number; raises ShapeError where there is no row."""
    import pyarrow as pa
    import pyarrow.csv as pacsv

    options = {"read_options": read_options(names), "convert_options": convert_options(columns.names)}
    try:
        return _table(path, columns, pacsv.read_csv(BytesIO(raw), **options), "line", 2)
    except pa.ArrowInvalid:
        return None


def read_options(names: Sequence[str], block: int | None = None) -> pacsv.ReadOptions:
    """Options of pyarrow to read a table under its header, `block` bytes at a time."""
    import pyarrow.csv as pacsv

    return pacsv.ReadOptions(use_threads=False, skip_rows=1, column_names=list(names), block_size=block)


def convert_options(wanted: Sequence[str]) -> pacsv.ConvertOptions:
    """Options of pyarrow to take the wanted columns, and them alone, as numbers."""
    import pyarrow as pa
    import pyarrow.csv as pacsv

    kinds = {name: pa.float64() for name in wanted}
    return pacsv.ConvertOptions(column_types=kinds, include_columns=list(wanted), null_values=_MISSING)


def _table(path: Path, columns: Columns, table: pa.Table, number_name: str, first: int) -> Table:
    if len(table) == 0:
        raise ShapeError(f"{path}: {NO_ROW}")
    return table_of(columns, table, number_name, first)


def table_of(columns: Columns, rows: pa.Table | pa.RecordBatch, number_name: str, first: int) -> Table:
    """Return rows of numbers, the first of which has the number `first`; columns that they lack are NaN."""
    present = set(rows.schema.names)
    missing = np.full(rows.num_rows, np.nan)
    values = {name: _numbers(rows[name]) if name in present else missing for name in columns.names}
    return Table(columns, values, np.arange(first, first + rows.num_rows), number_name, {})


def _numbers(column: pa.ChunkedArray | pa.Array) -> Vector:
    import pyarrow as pa

    plain = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
    return np.asarray(plain.to_numpy(zero_copy_only=False), dtype=np.float64)


def _slow(path: Path, raw: bytes, names: list[str], columns: Columns) -> Table:
    lines = raw.decode("utf-8", errors="replace").splitlines()[1:]
    table = slow_table(enumerate(lines, start=2), names, columns)
    if not len(table):
        raise ShapeError(f"{path}: {NO_ROW}")
    return table


def slow_table(lines: Iterable[tuple[int, str]], names: Sequence[str], columns: Columns) -> Table:
    """Read numbered lines one by one, with the fault of each."""
    values, numbers, faults = slow_columns(lines, names, columns.names)
    return Table(columns, values, numbers, "line", faults)


def slow_columns(
    lines: Iterable[tuple[int, str]], names: Sequence[str], wanted: Sequence[str]
) -> tuple[dict[str, Vector], NDArray[np.int64], dict[int, str]]:
    """Return the wanted columns of numbered lines, the number of each row, and faults by index of the row."""
    rows: list[list[float]] = []
    numbers_of_lines: list[int] = []
    faults: dict[int, str] = {}
    at = [names.index(name) for name in wanted]
    for line, row in lines:
        if not row.strip():
            continue
        cells = cells_of(row)
        if len(cells) != len(names):
            faults[len(rows)] = (
                f"line {line}: {len(cells)} columns, the header has {len(names)}: mend the line"
            )
        numbers = [_number(cells[k]) if k < len(cells) else np.nan for k in at]
        for name, k, number in zip(wanted, at, numbers, strict=True):
            if number is None:
                text = cells[k].strip()[:40]
                faults.setdefault(
                    len(rows), f"line {line}: {name} is {text!r}: write a number or leave it empty"
                )
        rows.append([np.nan if number is None else number for number in numbers])
        numbers_of_lines.append(line)
    by_column = np.array(rows, dtype=np.float64).reshape(len(rows), len(wanted)).T
    return dict(zip(wanted, by_column, strict=True)), np.array(numbers_of_lines, dtype=np.int64), faults


def cells_of(text: str) -> list[str]:
    """Return the cells of a line; the line itself where it cannot be cut."""
    try:
        return next(csv.reader([text]))
    except csv.Error:
        return [text]


def _number(cell: str) -> float | None:
    """Return the number in a cell: NaN for an empty one, None for one that is no number."""
    text = cell.strip()
    if text in _MISSING:
        return np.nan
    try:
        return float(text)
    except ValueError:
        return None


def _is_number(cell: str) -> bool:
    return bool(cell) and _number(cell) is not None


def lowest_point(table: Table) -> float:
    """Return the lowest point number of a table; infinity where points are not numbered."""
    numbers = table.values[POINT] if table.columns.numbered else np.zeros(0)
    return float(np.min(numbers[np.isfinite(numbers)], initial=np.inf))


def runs_of(table: Table) -> tuple[Rows, ...]:
    """Return the rows of each frame: of one time each, sorted where the points are numbered."""
    time = filled(table.values[TIME]) if table.columns.timed else np.zeros(len(table))
    order = np.arange(len(table))
    if table.columns.numbered:
        order = np.lexsort((table.values[POINT], time))
    # NaN times left over (the first rows) differ from each other: one run is made of them.
    step = np.nan_to_num(time[order], nan=-np.inf)
    return tuple(np.split(order, np.flatnonzero(step[1:] != step[:-1]) + 1))


def filled(time: Vector) -> Vector:
    """Give each row without a time the time of the row before it, so that its frame stays one."""
    missing = np.isnan(time)
    if not missing.any():
        return time
    known = np.where(missing, -1, np.arange(len(time)))
    latest = np.maximum.accumulate(known)
    return np.where(latest < 0, np.nan, time[latest])

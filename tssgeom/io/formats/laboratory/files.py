"""Tables in spreadsheets, arrays and columnar files."""

from __future__ import annotations

import re
import zipfile
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from datetime import date, datetime, time, timedelta
from functools import reduce
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from tssgeom.errors import ShapeError, SourceError, first_line
from tssgeom.io.formats.axes import any_header, note_of_axes, order_of_axes, require_frames_first
from tssgeom.io.formats.laboratory.assembled import table_of, with_length_unit
from tssgeom.io.formats.laboratory.matlab import matlab_variables
from tssgeom.io.formats.laboratory.raw import Column, RawTable, Row, column_of, decimal_of, is_data
from tssgeom.io.formats.laboratory.text import read_text
from tssgeom.io.formats.paths import bytes_of, ending, require_room, require_room_in_zip
from tssgeom.io.formats.tables import parquet_columns, parquet_file

TEXT = (".csv", ".tsv", ".txt", ".dat", ".lvm", ".csv.gz", ".tsv.gz", ".txt.gz", ".dat.gz")
SHEETS = (".xlsx", ".xls", ".ods")
_NAMES_OF_COLUMNS = ("names", "columns", "header", "headers", "labels", "channels", "varnames")
_CELL = re.compile(rb'\br="([A-Z]{1,4})(\d{1,9})"')
_UNITS_OF_COLUMNS = ("units", "unit")


def raw_tables(path: Path) -> list[RawTable]:
    """Read every table of a file; of one with a single table, that.

    Raises ShapeError where no table is in it; SourceError where the file cannot be read.
    """
    kind = ending(path)
    if kind in TEXT:
        return [read_text(path, bytes_of(path))]
    try:
        tables = _READERS[kind](path)
    except (ShapeError, SourceError):
        raise
    except Exception as error:  # readers of other libraries raise what they like on damaged files
        hint = "it is text: name it .csv" if kind in SHEETS and _is_text(path) else "write it anew"
        raise SourceError(f"{path}: cannot be read as {kind} ({first_line(error)}): {hint}") from error
    if not any(len(table) for table in tables):
        raise ShapeError(f"{path}: no table of numbers in it: write a header and a row for each sample")
    return [table for table in tables if len(table)]


def _is_text(path: Path) -> bool:
    """Whether a file is a table in text, as LabVIEW writes it under the ending of spreadsheets."""
    try:
        return len(read_text(path, bytes_of(path))) > 0
    except ShapeError:
        return False


def _sheets(path: Path) -> list[RawTable]:
    from python_calamine import CalamineWorkbook

    require_room_in_zip(path)
    content = bytes_of(path)
    require_room(path, _cells_in(content) * np.dtype(np.float64).itemsize)
    with CalamineWorkbook.from_filelike(BytesIO(content)) as book:
        sheets = {name: book.get_sheet_by_name(name).to_python() for name in book.sheet_names}
    tables = [_sheet(path, name, rows) for name, rows in sheets.items()]
    return [table for table in tables if table is not None]


def _cells_in(content: bytes) -> int:
    """Return how many cells the largest sheet of an .xlsx spans, which its reader makes all of."""
    most = 0
    with suppress(zipfile.BadZipFile), zipfile.ZipFile(BytesIO(content)) as book:
        for name in book.namelist():
            if name.startswith("xl/worksheets/"):
                named = set(_CELL.findall(book.read(name)))
                columns = max((_column_number(letters) for letters in {each[0] for each in named}), default=0)
                most = max(most, columns * max((int(row) for _, row in named), default=0))
    return most


def _column_number(letters: bytes) -> int:
    return reduce(lambda number, letter: 26 * number + letter - ord("A") + 1, letters, 0)


def _sheet(path: Path, title: str, values: list[list[Any]]) -> RawTable | None:
    rows = [Row(number, [_cell(value) for value in row]) for number, row in enumerate(values, 1)]
    rows = [row for row in rows if any(row.cells)]
    filled = [k for k in range(len(values[0]) if values else 0) if any(row.cells[k] for row in rows)]
    rows = [row._replace(cells=[row.cells[k] for k in filled]) for row in rows]
    widths = Counter(_width(row.cells) for row in rows if is_data(row.cells))
    if not widths:
        return None
    count = max(widths)
    rows = [row._replace(cells=row.cells[:count]) for row in rows]
    decimal = decimal_of([row.cells for row in rows if is_data(row.cells)])
    return table_of(path, rows, count, decimal, "row", (), title)


def _width(cells: list[str]) -> int:
    return max(k + 1 for k, cell in enumerate(cells) if cell)


def _cell(value: Any) -> str:
    if isinstance(value, timedelta):
        return repr(value.total_seconds())
    if isinstance(value, datetime | date | time):
        return value.isoformat(" ") if isinstance(value, datetime) else value.isoformat()
    return repr(value) if isinstance(value, float) else str(value).strip()


def _array(path: Path) -> list[RawTable]:
    with any_header():
        array = np.load(BytesIO(bytes_of(path)), allow_pickle=False)
    if not isinstance(array, np.ndarray):
        raise ShapeError(f"{path}: an archive, no array: name it .npz")
    if array.dtype.names:
        return [_of_columns({name: array[name].reshape(-1) for name in array.dtype.names})]
    return [_of_matrix(path, array)]


def _of_matrix(
    path: Path, array: np.ndarray, names: tuple[str, ...] = (), units: tuple[str, ...] = ()
) -> RawTable:
    """Return an array [n,k] of k columns, or [F,N,3] of points, as a table."""
    if array.dtype.kind not in "fiub":
        raise ShapeError(f"{path}: it holds no numbers but {array.dtype}: save float64")
    values = np.asarray(array, np.float64)
    if values.ndim == 3:
        order = order_of_axes(path, "array", values.shape)
        values = values.transpose(order)
        require_frames_first(path, "array", values[0], values[-1])
        frame, point = np.indices(values.shape[:2]).reshape(2, -1).astype(np.float64)
        x, y, z = values.reshape(-1, 3).T
        table = _of_columns({"frame": frame, "point": point, "x": x, "y": y, "z": z})
        return replace(table, notes=note_of_axes("array", order))
    if values.ndim != 2:
        raise ShapeError(f"{path}: an array of the size {array.shape}: save [N,3], [F,N,3] or a column each")
    if not names and values.shape[0] < values.shape[1] and values.shape[0] == 3:
        values = values.T
    numbered = names or tuple(str(k + 1) for k in range(values.shape[1]))
    rows = np.arange(1, len(values) + 1)
    return RawTable(numbered, tuple(np.ascontiguousarray(values.T)), units, rows, headed=bool(names))


def _of_columns(columns: Mapping[str, Any], units: Mapping[str, str] | None = None) -> RawTable:
    """Return named columns as a table; each is a vector of numbers, times or words."""
    names = tuple(columns)
    values = tuple(_column(np.asarray(each)) for each in columns.values())
    stated = tuple((units or {}).get(name, "") for name in names)
    rows = np.arange(1, max(map(len, values), default=0) + 1)
    return RawTable(names, values, stated if any(stated) else (), rows)


def _column(values: np.ndarray) -> Column:
    if values.dtype.kind == "M":
        since = (values - np.datetime64(0, "s")) / np.timedelta64(1, "ns")
        return since.astype(np.float64) * 1e-9
    if values.dtype.kind == "m":
        return (values / np.timedelta64(1, "ns")).astype(np.float64) * 1e-9
    if values.dtype.kind in "fiub":
        return values.astype(np.float64)
    return column_of(["" if value is None else str(value) for value in values.tolist()])[0]


def _matlab(path: Path) -> list[RawTable]:
    held = matlab_variables(path)
    while len(held) == 1 and isinstance(inner := next(iter(held.values())), dict):
        held = inner
    arrays = {
        name: value
        for name, value in held.items()
        if isinstance(value, np.ndarray) and value.dtype.kind in "fiub"
    }
    names = next((_words(held[key]) for key in held if key.lower() in _NAMES_OF_COLUMNS), ())
    stated = next((held[key] for key in held if key.lower() in _UNITS_OF_COLUMNS), ())
    units = _words(stated)
    alike = [
        name for name, array in arrays.items() if array.ndim == 2 and 3 in array.shape and array.size > 9
    ]
    if len({arrays[name].shape for name in alike}) < len(alike):
        raise ShapeError(f"{path}: {', '.join(alike)} may each be the points: save one of them")
    for array in sorted(arrays.values(), key=lambda each: -each.size):
        if array.ndim == 3 or (array.ndim == 2 and min(array.shape) > 1):
            table = _of_matrix(path, array, names if array.shape[-1] == len(names) else (), units)
            if table.units and len(units) != len(table.names):
                raise ShapeError(
                    f"{path}: {len(units)} units for {len(table.names)} columns: state one for each"
                )
            return [_with_length_unit(table, stated)]
    size = Counter(array.size for array in arrays.values() if array.ndim == 1).most_common(1)
    columns = {name: array for name, array in arrays.items() if size and array.size == size[0][0]}
    if not columns:
        raise ShapeError(
            f"{path}: no arrays of one length among {', '.join(held) or 'nothing'}: save columns"
        )
    of_name = dict(stated) if isinstance(stated, dict) else dict(zip(columns, units, strict=False))
    return [_with_length_unit(_of_columns(columns, of_name), stated)]


def _words(value: Any) -> tuple[str, ...]:
    """Return the words of a list; nothing where numbers are among them. An empty cell is read as no array."""
    words = list(value) if isinstance(value, list | np.ndarray) else []
    words = ["" if np.size(word) == 0 else word for word in words]
    return tuple(word.strip() for word in words) if all(isinstance(word, str) for word in words) else ()


def _with_length_unit(table: RawTable, stated: Any) -> RawTable:
    """Return a table whose coordinates are in the one unit that a variable `unit` states."""
    return with_length_unit(table, stated) if isinstance(stated, str) and not table.units else table


def _feather(path: Path) -> list[RawTable]:
    import pyarrow as pa

    content = bytes_of(path)
    try:
        file = pa.ipc.open_file(content)
        batches = (file.get_batch(k) for k in range(file.num_record_batches))
    except pa.ArrowInvalid:
        file = batches = pa.ipc.open_stream(content)
    held, size = list[pa.RecordBatch](), 0
    for batch in batches:
        size += max(batch.nbytes, batch.num_rows * batch.num_columns * np.dtype(np.float64).itemsize)
        require_room(path, size)
        held.append(batch)
    return [_of_arrow(pa.Table.from_batches(held, file.schema))]


def _parquet(path: Path) -> list[RawTable]:
    with parquet_file(path) as file:
        return [_of_arrow(parquet_columns(path, file, file.schema_arrow.names))]


def _of_arrow(table: Any) -> RawTable:
    units = {
        field.name: field.metadata[b"unit"].decode(errors="replace")
        for field in table.schema
        if field.metadata and b"unit" in field.metadata
    }
    columns = {field.name: table[i].to_numpy() for i, field in enumerate(table.schema)}
    return _of_columns(columns, units)


_READERS: dict[str, Callable[[Path], list[RawTable]]] = {
    **dict.fromkeys(SHEETS, _sheets),
    ".npy": _array,
    ".mat": _matlab,
    **dict.fromkeys((".feather", ".arrow"), _feather),
    ".parquet": _parquet,
}
ENDINGS = (*TEXT, *_READERS)
"""Endings of files that are read as tables."""

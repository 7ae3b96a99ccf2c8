"""Tables in text files: encoding, separator, decimal mark and comments are recognised."""

from __future__ import annotations

import csv
import re
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.formats.laboratory.assembled import finished, table_of
from tssgeom.io.formats.laboratory.headers import header_of
from tssgeom.io.formats.laboratory.raw import (
    ERRORS,
    MISSING,
    ROWS,
    Column,
    RawTable,
    Row,
    decimal_of,
    is_data,
    is_number,
)
from tssgeom.io.formats.laboratory.trackers import exported_lines
from tssgeom.io.formats.paths import require_lines, require_room, room

_COMMENTS = ("#", "%", "//", "!", "*")
_LABVIEW, _END_OF_HEADER = "LabVIEW Measurement", "***End_of_Header***"
_SPACES = " "
_SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas", "|": "bars", _SPACES: "spaces"}
EXPECTED = "write a header such as x_mm,y_mm,z_mm or time_s,tension_in_N,tension_out_N, comma-separated"
_NO_VALUES = re.compile(r"\*+\s*([,;|\t]\s*\**\s*)+")
"""A row of marks for what is lost, which begins as a comment may."""
_SIGN = re.compile("\N{MINUS SIGN}(?=[\\d.,])")
"""The minus sign of Unicode before a number, which some locales write."""
_BEGINS = {b"PK\x03\x04": ".xlsx", b"\xd0\xcf\x11\xe0": ".xls", b"PAR1": ".parquet", b"\x93NUMPY": ".npy"}
"""First bytes of files that are no text, and the ending of such files."""
_ENCODINGS = {"utf-16": "UTF-16", "utf-16-le": "UTF-16", "utf-16-be": "UTF-16", "cp1252": "Windows-1252"}


class TextLimits(NamedTuple):
    """Sizes of text; chosen."""

    head: int = 4096
    """Bytes by which an encoding is recognised."""
    fast: int = 1 << 22
    """Characters beyond which pyarrow reads the rows: less takes no longer line by line than its import."""


LIMITS = TextLimits()


@dataclass(frozen=True, slots=True)
class Form:
    """How the rows of a table are written."""

    separator: str
    decimal: str
    count: int
    """Number of columns."""


def read_text(path: Path, raw: bytes) -> RawTable:
    """Read the one table of a text.

    Raises ShapeError where it is no text, or no rows of numbers with a common number of columns are in it;
    SourceError where it cannot be unpacked.
    """
    text, notes = decoded(path, raw)
    lines = [(number, line) for number, line in enumerate(re.split(r"\r\n|\r|\n", text), 1) if line.strip()]
    if not lines:
        raise ShapeError(f"{path}: line 1 is empty: {EXPECTED}")
    lines, labview = _below_headers_of_labview(path, lines)
    notes += labview
    lines, head = exported_lines(lines)
    form = _form(path, lines[head:])
    if form.separator != ",":
        notes.append(f"separated by {_SEPARATORS[form.separator]}")
    if form.decimal == ",":
        notes.append("decimal comma")
    if len(text) > LIMITS.fast:
        head_rows = [_row(number, line, form) for number, line in lines[: ROWS.sample]]
        header = header_of(path, head_rows, form.count)
        below = lines[header.first :]
        columns = _fast([line for _, line in below], form) if header.names else None
        if columns is not None:
            number = np.array([number for number, _ in below], np.int64)
            names, units = tuple(header.names), tuple(header.units)
            return finished(RawTable(names, columns, units, number, "line", notes=tuple(notes)), header)
    every = [_row(number, line, form) for number, line in lines]
    return table_of(path, every, form.count, form.decimal, "line", notes)


def _below_headers_of_labview(
    path: Path, lines: Sequence[tuple[int, str]]
) -> tuple[Sequence[tuple[int, str]], list[str]]:
    """Return the table below the headers that LabVIEW writes into a measurement, and a note where it does.

    Raises ShapeError where there are several tables.
    """
    if not lines[0][1].startswith(_LABVIEW):
        return lines, []
    heads = [k for k, (_, line) in enumerate(lines) if line.startswith(_END_OF_HEADER)]
    if len(heads) > 2:
        where = lines[heads[2]][0]
        raise ShapeError(f"{path}: line {where}: LabVIEW wrote several segments: save each in its own file")
    if not heads or heads[-1] + 1 == len(lines):
        return lines, []
    (number, first), *data = lines[heads[-1] + 1 :]
    mark = "\t" if "\t" in first else ","
    head = {key: cells for key, *cells in (line.split(mark) for _, line in lines[: heads[-1]])}
    names = first.split(mark)
    if head.get("X_Dimension", [""])[0] == "Time":
        names[0] = names[0].replace("X_Value", "time_s")
    for k, unit in enumerate(head.get("Y_Unit_Label", [])[: len(names) - 1], start=1):
        names[k] += f" [{unit}]" if unit else ""
    return [(number, mark.join(names)), *data], ["LabVIEW's headers left out"]


def decoded(path: Path, raw: bytes) -> tuple[str, list[str]]:
    """Return the text of a file, unpacked where it is packed, and notes on how it was read.

    Raises ShapeError where it is no text; SourceError where it cannot be unpacked.
    """
    notes = list[str]()
    if raw[:2] == b"\x1f\x8b":
        raw = _unpacked(path, raw)
        notes.append("unpacked by gzip")
    require_lines(path, raw)
    for encoding in _encodings(raw.rstrip(b"\0")):
        try:
            whole = raw.decode(encoding).removeprefix("\ufeff")
        except UnicodeDecodeError:
            continue
        text = _SIGN.sub("-", whole.rstrip("\0"))
        if any(ord(sign) < ord(" ") and sign not in "\t\n\r\f\v" for sign in text[: LIMITS.head]):
            break
        notes += [f"{_ENCODINGS[encoding]} text"] if encoding in _ENCODINGS else []
        zeros = len(whole) - len(text)
        notes += [f"{zeros} zero bytes at the end left out"] if zeros else []
        return text, notes
    kind = next((kind for begin, kind in _BEGINS.items() if raw.startswith(begin)), None)
    hint = "save the table as CSV in UTF-8" if kind is None else f"it begins as {kind} does: name it so"
    raise ShapeError(f"{path}: line 1 is no UTF-8 text: {hint}")


def _unpacked(path: Path, raw: bytes) -> bytes:
    unpacker = zlib.decompressobj(wbits=31)
    try:
        text = unpacker.decompress(raw, room() + 1)
    except zlib.error as error:
        raise SourceError(f"{path}: cannot be unpacked ({error}): pack it anew by gzip") from error
    require_room(path, len(text))
    if not unpacker.eof:
        raise SourceError(f"{path}: it ends early: pack it anew by gzip")
    return text


def _encodings(raw: bytes) -> tuple[str, ...]:
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return ("utf-16",)
    head = raw[: LIMITS.head]
    if head.count(0) > len(head) // 4:
        return ("utf-16-le",) if head[1::2].count(0) > head[::2].count(0) else ("utf-16-be",)
    return ("utf-8", "cp1252")


def _is_comment(line: str) -> bool:
    text = line.lstrip(' "')
    lost = _NO_VALUES.fullmatch(text) is not None
    return text.startswith(_COMMENTS) and not lost and not text.lower().startswith(ERRORS)


def _row(number: int, line: str, form: Form) -> Row:
    """Return the cells of a line, without an empty one that a separator at its end makes."""
    if _is_comment(line):
        text = line.lstrip(' "').lstrip("".join(_COMMENTS)).strip()
        candidates = (_split(text, separator) for separator in (form.separator, *_SEPARATORS))
        return Row(number, next((cells for cells in candidates if len(cells) == form.count), [text]), True)
    cells = _split(line, form.separator)
    if len(cells) == form.count + 1 and not cells[-1]:
        cells.pop()
    return Row(number, cells)


def _split(line: str, separator: str) -> list[str]:
    if separator == _SPACES:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    except csv.Error:
        return [line]


def _form(path: Path, lines: Sequence[tuple[int, str]]) -> Form:
    """Recognise separator, number of columns and decimal mark from the rows of numbers."""
    sample = [line for _, line in lines[: ROWS.sample] if not _is_comment(line)]
    best, most = None, 0.0
    for separator in _SEPARATORS:
        split = [_split(line, separator) for line in sample]
        data = [cells for cells in split if is_data(cells)]
        if not data:
            continue
        counts = Counter(map(len, data))
        count = max(counts, key=lambda number: (counts[number], number))
        even = [cells for cells in data if len(cells) == count]
        score = len(even) * (sum(map(_numeric_share, even)) / len(even)) ** 2
        if all(not cells[-1] for cells in even) and not any(
            len(cells) == count and cells[-1] for cells in split
        ):
            count -= 1  # each line ends with a separator
        if count > 1 and score > most:
            best, most = Form(separator, decimal_of(even), count), score
    if best is None:
        raise ShapeError(f"{path}: no rows of numbers in it: {EXPECTED}")
    return best


def _numeric_share(cells: Sequence[str]) -> float:
    return sum(is_number(cell) or cell.lower() in MISSING for cell in cells) / len(cells)


def _fast(lines: Sequence[str], form: Form) -> tuple[Column, ...] | None:
    """Read many lines by pyarrow; None where a cell holds a word, or a line has other columns."""
    import pyarrow as pa
    import pyarrow.csv as pacsv

    spaced = form.separator == _SPACES
    names = [str(k) for k in range(form.count)]
    try:
        table = pacsv.read_csv(
            BytesIO("\n".join("\t".join(line.split()) for line in lines).encode())
            if spaced
            else BytesIO("\n".join(lines).encode()),
            read_options=pacsv.ReadOptions(use_threads=False, column_names=names),
            parse_options=pacsv.ParseOptions(delimiter="\t" if spaced else form.separator),
            convert_options=pacsv.ConvertOptions(
                column_types=dict.fromkeys(names, pa.float64()),
                decimal_point=form.decimal,
                null_values=["", "nan", "NaN", "NAN", "NA", "null", "-"],
            ),
        )
    except pa.ArrowInvalid:
        return None
    return tuple(np.asarray(table[name].to_numpy(), np.float64) for name in names)

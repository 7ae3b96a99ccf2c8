"""Rows of cells to a table: its header, and below it columns of numbers or of words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from tssgeom.io.formats.columns import AXES
from tssgeom.io.formats.laboratory.headers import Header, header_of
from tssgeom.io.formats.laboratory.names import split_unit
from tssgeom.io.formats.laboratory.raw import Column, RawTable, Row, column_of, is_data, may_be_group
from tssgeom.io.formats.laboratory.trackers import only_read
from tssgeom.io.formats.laboratory.wide import point_columns


def table_of(
    path: Path,
    rows: Sequence[Row],
    count: int,
    decimal: str,
    number_name: str,
    notes: Sequence[str],
    title: str = "",
) -> RawTable:
    """Return the table in some rows, of which one at least is data of `count` cells.

    Raises ShapeError where the program of a tracker wrote the file and no points are in it.
    """
    header = header_of(path, rows, count)
    names = header.names
    before = [row for k, row in enumerate(rows[: header.first]) if k not in header.rows and not row.comment]
    every = [*notes, *([f"{len(before)} lines before the table are not read"] if before else [])]
    kept, number, faults = list[list[str]](), list[int](), dict[int, str]()
    repeated, commented = 0, 0
    for row in rows[header.first :]:
        cells = row.cells
        if row.comment:
            commented += len(cells) == count and is_data(cells)
            continue
        if cells == names:
            repeated += 1
            continue
        if len(cells) != count:
            faults[len(kept)] = (
                f"{number_name} {row.number}: {len(cells)} columns, the header has {count}: mend the line"
            )
            cells = (cells + [""] * count)[:count]
        kept.append(cells)
        number.append(row.number)
    if commented:
        every.append(f"{commented} row{'s' * (commented > 1)} in comments not read")
    if repeated:
        every.append(f"{repeated} repeated headers are not read")
    columns = list[Column]()
    named = names or [str(k + 1) for k in range(count)]
    for k, name in enumerate(named):
        column, wrong = column_of([cells[k] for cells in kept], decimal)
        for row in wrong:
            where, cell = f"{number_name} {number[row]}", kept[row][k]
            grouped = decimal == "." and may_be_group(cell.strip())
            hint = (
                f"write {cell.strip().replace(',', '')} or a point"
                if grouped
                else "write a number or leave it empty"
            )
            faults.setdefault(row, f"{where}: {name} is {cell[:40]!r}: {hint}")
        columns.append(column)
    table = RawTable(
        *(tuple(named), tuple(columns), tuple(header.units), np.array(number, np.int64), number_name, faults),
        *(tuple(every), title),
        headed=bool(names),
    )
    return finished(table, header)


def finished(table: RawTable, header: Header) -> RawTable:
    """Return a table with what its header says beyond names and units."""
    table = replace(table, notes=(*table.notes, *header.notes), header_rows=header.naming)
    if header.export is not None:
        return only_read(table, header.export)
    if not header.length or table.units:
        return table
    return replace(
        with_length_unit(table, header.length), notes=(*table.notes, f"a comment states {header.length}")
    )


def with_length_unit(table: RawTable, stated: str) -> RawTable:
    """Return a table without units whose coordinates are in one that is stated for all."""
    names = table.names if table.headed else ("x", "y", "z") if len(table.names) == 3 else table.names
    points = {names[k] for k in chain(*point_columns(names).values()) if split_unit(names[k])[1] is None}
    units = tuple(stated if name in points.union(AXES) else "" for name in names)
    return replace(table, names=names, units=units)

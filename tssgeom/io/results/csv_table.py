"""A Parquet table as CSV, and channels against time as Parquet."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as papq

from tssgeom.arrays import Vector
from tssgeom.channel_names import words_of
from tssgeom.io.results.tables import field, write_table

_ROWS = 1 << 14  # that memory holds at once; chosen: as many as a row group of frames


def write_csv(table: Path, path: Path) -> None:
    """Write a Parquet table as CSV, a row group at a time; the texts of a list are joined by `; `."""
    import pyarrow.compute as pc
    import pyarrow.csv as pacsv

    with table.open("rb") as held, papq.ParquetFile(held) as source:
        schema = source.schema_arrow
        lists = [k for k, kind in enumerate(schema.types) if pa.types.is_list(kind)]
        plain = pa.schema(
            [each.with_type(pa.string()) if k in lists else each for k, each in enumerate(schema)]
        )
        with path.open("wb") as file, pacsv.CSVWriter(file, plain) as rows:
            for batch in source.iter_batches(_ROWS):
                columns = [
                    pc.call_function("binary_join", [column, pa.scalar("; ")]) if k in lists else column
                    for k, column in enumerate(batch.columns)
                ]
                rows.write_batch(pa.RecordBatch.from_arrays(columns, schema=plain))


def write_channels(path: Path, channels: Mapping[str, Vector]) -> None:
    """Write channels against time, a column each [s]; raises SourceError where the disk refuses."""
    schema = pa.schema([field(name, words_of(name)) for name in channels])
    write_table(path, pa.table(dict(channels), schema=schema))

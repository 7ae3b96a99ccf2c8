"""Channels of a machine over a run as a Parquet table."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as papq

from tssgeom.arrays import Vector
from tssgeom.atomic import replacing
from tssgeom.io.results.tables import field, plain_name


def write_channels(path: Path, channels: Mapping[str, Vector]) -> None:
    """Write channels against time, a column each [s].

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    schema = pa.schema([field(name, plain_name(name)) for name in channels])
    with replacing(path) as draft:
        papq.write_table(pa.table(dict(channels), schema=schema), draft)

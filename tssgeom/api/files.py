"""Results as data frames of other libraries, and as files."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tssgeom.api.presentation import drawing, presentation, table
from tssgeom.atomic import replacing, write_text
from tssgeom.errors import SettingsError
from tssgeom.result import for_json

if TYPE_CHECKING:
    import pandas as pd
    import polars as pl
    import pyarrow as pa

PICTURES = (".png", ".pdf", ".svg")
ENDINGS = (".csv", ".parquet", ".json", *PICTURES)


def to_pandas(result: object) -> pd.DataFrame:
    """Return a result as a data frame of pandas.

    Raises
    ------
    SettingsError
        Where pandas is not installed.
    """
    _library("pandas", "to_pandas")
    return table(result).to_pandas()


def to_polars(result: object) -> pl.DataFrame:
    """Return a result as a data frame of polars.

    Raises
    ------
    SettingsError
        Where polars is not installed.
    """
    return _library("polars", "to_polars").from_arrow(table(result))


def _library(name: str, call: str) -> Any:
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise SettingsError(f"{call} needs {name}, which is not installed: pip install {name}") from error


def save(result: object, path: Path) -> Path:
    """Write a result to a file by its ending; see `Result.save`.

    Raises
    ------
    SettingsError
        Where the ending is unknown.
    SourceError
        Where the disk refuses.
    """
    kind = path.suffix.lower()
    if kind not in ENDINGS:
        known = ", ".join(ENDINGS)
        raise SettingsError(f"{path}: no result is saved as {kind or 'a file without ending'}: use {known}")
    if kind == ".json":
        write_text(path, _json(result) + "\n")
    elif kind in PICTURES:
        _save_picture(result, path)
    else:
        with replacing(path) as draft:
            _write_table(table(result), draft, kind)
    return path


def _json(result: object) -> str:
    of = presentation(result)
    content = table(result).to_pylist() if of.json is None else of.json(result)
    return json.dumps(for_json(content), indent=1, ensure_ascii=False, allow_nan=False)


def _save_picture(result: object, path: Path) -> None:
    from tssgeom.view.figures.plots import NOTEBOOK, figure, save

    draw = drawing(result, None)
    with figure(NOTEBOOK) as canvas:
        draw(canvas.subplots())
    with replacing(path) as draft:
        save(canvas, draft)


def _write_table(columns: pa.Table, path: Path, kind: str) -> None:
    if kind == ".parquet":
        from tssgeom.io.results.tables import write_parquet

        write_parquet(path, columns)
        return
    import pyarrow as pa
    import pyarrow.csv as pacsv

    for k, each in enumerate(columns.schema):
        if pa.types.is_list(each.type):
            texts = ["; ".join(value or ()) for value in columns.column(k).to_pylist()]
            columns = columns.set_column(k, each.name, pa.array(texts, pa.string()))
    with path.open("wb") as file:
        pacsv.write_csv(columns, file)

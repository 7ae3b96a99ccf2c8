"""`tssgeom check --suggest`: the lines of `columns.toml` for some tables."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import tomli_w
import typer

from pipelines.inputs import Refusal, attempt
from pipelines.left_out import column_map
from pipelines.terminal import print_line, print_message
from tssgeom.atomic import write_text
from tssgeom.io.formats.laboratory.files import ENDINGS
from tssgeom.io.formats.laboratory.mapping import FILE, ColumnMap
from tssgeom.io.formats.laboratory.table import tables_of
from tssgeom.io.formats.paths import ending, split


def suggested(paths: Sequence[Path], options: Sequence[str], unit: str | None) -> int:
    """Print `columns.toml` for each folder, and write it where the user at a terminal agrees.

    Returns
    -------
    int
        0 done; 1 some files could not be read; 2 none could.
    """
    files = [path for given in paths for path in (sorted(given.iterdir()) if given.is_dir() else [given])]
    files = [split(path)[0] for path in files if ending(path) in ENDINGS]
    columns = column_map(options)
    folders, refused = dict[Path, dict[str, str]](), 0
    for file in dict.fromkeys(files):
        outcome = attempt(file, lambda file=file: _columns_of(file, columns, unit))
        if isinstance(outcome, Refusal):
            print_message(outcome.reason)
            refused += 1
            continue
        folders.setdefault(file.parent, {}).update(outcome)
    for folder, said in folders.items():
        _offer(folder / FILE, said)
    return 2 if refused == len(files) else int(refused > 0)


def _columns_of(file: Path, columns: ColumnMap, unit: str | None) -> dict[str, str]:
    """Return what the columns of a file are, and print what its header leaves open."""
    tables = tables_of(file, columns, unit)
    for table, result in tables:
        columns.use(table.names)
        for sentence in result.unclear:
            print_message(f"{file}: {sentence}; the suggestion is by name and range: check it")
    return {name: meant for _, result in tables for name, meant in result.suggested.items()}


def _offer(path: Path, said: dict[str, str]) -> None:
    if not said:
        print_line(f"# {path}: not needed, every column has a name of docs/formats.md")
        return
    text = tomli_w.dumps({"columns": said})
    print_line(f"# {path}\n{text.rstrip()}")
    if sys.stdin.isatty() and sys.stdout.isatty() and typer.confirm(f"write {path}?", default=True):
        write_text(path, text)

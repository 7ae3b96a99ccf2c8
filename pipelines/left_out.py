"""What a command leaves out: files in folders that no reader takes, and columns of --map that no file has."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path

from pipelines.terminal import print_message
from tssgeom.io.formats.files import ONLY_NAMED, left_out_of
from tssgeom.io.formats.laboratory.mapping import ColumnMap


def left_out_text(left_out: Mapping[str, int]) -> str:
    """Return the sentence on the files in folders that no reader takes."""
    texts = {ending: count for ending, count in left_out.items() if ending in ONLY_NAMED}
    others = {ending: count for ending, count in left_out.items() if ending not in texts}
    sentences = [f"{_counted(others)} left out, of no format of shapes: {_listed(others)}"] if others else []
    if texts:
        named = f"of an ending that is read where it is named, as in FOLDER/*{next(iter(texts))}"
        sentences.append(f"{_counted(texts)} left out, {named}: {_listed(texts)}")
    return "; ".join(sentences)


def _counted(files: Mapping[str, int]) -> str:
    count = sum(files.values())
    return f"{count} {'file' if count == 1 else 'files'}"


def _listed(files: Mapping[str, int]) -> str:
    return ", ".join(f"{ending} {count}" for ending, count in files.items())


def print_left_out(paths: Iterable[Path], besides: Collection[Path] = ()) -> None:
    """Print how many files in folders no reader takes, by ending."""
    if left_out := left_out_of(paths, besides):
        print_message(left_out_text(left_out))


_given = list[ColumnMap]()
"""Those of the command that runs."""


def column_map(options: Sequence[str] | None, rig: Mapping[str, str] | None = None) -> ColumnMap:
    """Return the statements of a command, whose end reports those that no file used.

    Raises SettingsError where one cannot be read.
    """
    said = ColumnMap(options or (), rig)
    _given.append(said)
    return said


def report_unused() -> None:
    """Print the names of `--map` that no file had, once."""
    names = {name for said in _given for name in said.unused}
    _given.clear()
    for name in sorted(names):
        print_message(f"warning: --map {name!r}: no file that was read has a column of this name")

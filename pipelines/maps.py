"""The user's statements on columns, `--map`: none of them is left out without a line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pipelines.terminal import print_message
from tssgeom.io.formats.laboratory.mapping import ColumnMap

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

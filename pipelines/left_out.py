"""Files in folders that no reader takes: how many, by ending."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from pipelines.terminal import print_message
from tssgeom.io.formats.files import left_out_of


def left_out_text(left_out: Mapping[str, int]) -> str:
    """Return the sentence on the files in folders that no reader takes."""
    listed = ", ".join(f"{ending} {count}" for ending, count in left_out.items())
    count = sum(left_out.values())
    return f"{count} {'file' if count == 1 else 'files'} left out, of no format of shapes: {listed}"


def print_left_out(paths: Iterable[Path], besides: Collection[Path] = ()) -> None:
    """Print how many files in folders no reader takes, by ending."""
    if left_out := left_out_of(paths, besides):
        print_message(left_out_text(left_out))

"""Files in folders that no reader takes: how many, by ending."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from pipelines.terminal import print_message
from tssgeom.io.formats.files import ONLY_NAMED, left_out_of


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

"""The files that are the inputs of a batch, at paths and addresses."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath

from pipelines.inputs import Refusal, attempt, inputs_of
from tssgeom.errors import printable
from tssgeom.io.formats.files import READERS, RESULTS_MARK, left_out_of, real
from tssgeom.io.formats.laboratory.mapping import ColumnMap
from tssgeom.io.storage import Folder, files_at, local


@dataclass(frozen=True, slots=True)
class Source:
    """A file that is an input."""

    address: str
    given: str
    """As the user wrote it, printable."""
    size: int


def sources_of(
    inputs: Sequence[str], folder: Folder, columns: ColumnMap
) -> tuple[list[Source], list[Refusal]]:
    """Return every file of the inputs once, and a refusal for each path or address without any."""
    sources, refusals, known = list[Source](), list[Refusal](), set[str]()
    for given in inputs:
        items = attempt(given, partial(_sources_at, given, folder, columns))
        for item in [items] if isinstance(items, Refusal) else items:
            if isinstance(item, Refusal):
                refusals.append(item)
            elif (same := _without_links(item.address)) not in known:
                sources.append(item)
                known.add(same)
    return sources, refusals


def _sources_at(given: str, folder: Folder, columns: ColumnMap) -> list[Source | Refusal]:
    path = local(given)
    if path is not None:
        return [
            item if isinstance(item, Refusal) else _local_source(item)
            for item in inputs_of([path], _besides(folder), columns)
        ]
    files = files_at(given)
    results = {str(PurePosixPath(address).parent) for address, _ in files if address.endswith(RESULTS_MARK)}
    return [
        Source(address, address, size)
        for address, size in files
        if (len(files) == 1 or PurePosixPath(address).suffix.lower() in READERS)
        and not any(str(above) in results for above in PurePosixPath(address).parents)
    ] or [Refusal(given, f"{given}: no shape file there: put {', '.join(READERS)} files there")]


def left_out_of_batch(inputs: Sequence[str], folder: Folder) -> dict[str, int]:
    """Count the files in folders of this machine that no reader takes there, by their endings."""
    paths = [path for given in inputs if (path := local(given)) is not None]
    return left_out_of(paths, _besides(folder))


def _besides(folder: Folder) -> list[Path]:
    return [] if folder.here is None else [folder.here]


def _local_source(path: Path) -> Source:
    size = 0
    with suppress(OSError):
        size = path.stat().st_size
    return Source(str(real(path.parent) / path.name), printable(str(path)), size)


def _without_links(address: str) -> str:
    path = local(address)
    return address if path is None else str(real(path))

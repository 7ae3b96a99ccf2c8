"""`tssgeom verify`: whether the results of a batch are as they were written.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from typing import Annotated

import typer

from pipelines.options import Json
from pipelines.terminal import print_json, print_line, print_message


def verify(
    folder: Annotated[str, typer.Argument(help="Folder or address that `tssgeom batch --out` wrote.")],
    as_json: Json = False,
) -> None:
    """Compare every table and the report of a batch with the checksums in its run.json."""
    from tssgeom.errors import SourceError
    from tssgeom.io.results.run_record import damaged, earlier_run
    from tssgeom.io.storage import Folder

    results = Folder.of(folder)
    record = earlier_run(results)
    if record is None or not record.sha256:
        raise SourceError(f"{folder}: no run.json with checksums in it: give the folder of a finished batch")
    changed = damaged(results, record.sha256)
    changed += [name for name in record.files if name not in record.sha256 and results.size(name) is None]
    for name in changed:
        print_message(f"{folder}/{name}: is not as it was written: run the batch again")
    if as_json:
        print_json({"files": len(record.files), "changed": changed})
    elif not changed:
        print_line(f"{folder}: {len(record.files)} files are as they were written")
    raise typer.Exit(1 if changed else 0)

"""`tssgeom samples`: the sample shapes, written anew bit for bit.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipelines.terminal import print_line


def samples(
    out: Annotated[Path, typer.Option("--out", help="Folder to write to.")] = Path("sample_shapes"),
) -> None:
    """Write the sample shapes anew, bit for bit."""
    from tssgeom.identify.synthetic import sample_campaigns
    from tssgeom.io.results.samples import write_samples
    from tssgeom.route import synthetic

    for path in write_samples(out, synthetic.samples(), synthetic.colon_lumen(), sample_campaigns()):
        print_line(str(path))

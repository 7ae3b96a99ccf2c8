"""`tssgeom samples`: the sample shapes, written anew bit for bit."""

from __future__ import annotations

from pathlib import Path

from pipelines.console import say
from tssgeom.identify.synthetic import sample_campaigns
from tssgeom.io.results.samples import write_samples
from tssgeom.route.synthetic import colon_lumen, samples


def run(out: Path) -> int:
    """Write the samples and return the exit status."""
    for path in write_samples(out, samples(), colon_lumen(), sample_campaigns()):
        say(str(path))
    return 0

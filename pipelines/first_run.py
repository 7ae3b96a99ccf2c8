"""What is said before a first run, which compiles for minutes without anything to show for it."""

from __future__ import annotations

import sys
from pathlib import Path

from tssgeom.route.arcs.equations import normal_equations


def announce_compiling() -> None:
    """Say on a terminal that code is about to be compiled, where none is kept from an earlier run."""
    if sys.stderr.isatty() and not _kept():
        said = "first run on this machine: compiling takes a minute or two; what is compiled is kept"
        print(said, file=sys.stderr, flush=True)  # noqa: T201


def _kept() -> bool:
    """Whether a kernel that every route needs is there, compiled by whatever version."""
    stats = getattr(normal_equations, "stats", None)  # none where numba is told not to compile
    return stats is None or any(Path(stats.cache_path).glob("*.normal_equations-*.nbi"))

"""Real measurements that nobody here made, beside what a user would do instead.

    python -m benchmarks.real [shapes | runs] [--quick] [--markdown]

The sets are read from ../shared/data, where each states its source and licence; one that is absent has
a line that states it. Without a part both are measured: `shapes` compares shapes, `runs` the error of
motor torques, joint angles and forces on cycles that were not fitted. `--quick` takes every tenth shape, and
fewer rows and runs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from benchmarks.real_runs import show_runs
from benchmarks.real_shapes import show_shapes
from benchmarks.tables import machine


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    options = _options(arguments)
    print(machine())
    broken = 0
    if options.part != "runs":
        broken = show_shapes(quick=options.quick, markdown=options.markdown)
    if options.part != "shapes":
        show_runs(quick=options.quick, markdown=options.markdown)
    return 1 if broken else 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary = (__doc__ or "").split("\n")[0]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.real", description=summary)
    parser.add_argument("part", nargs="?", choices=["shapes", "runs"], help="what is measured; both without")
    parser.add_argument("--quick", action="store_true", help="fewer shapes, runs and rows")
    parser.add_argument("--markdown", action="store_true", help="tables to paste into documents")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())

"""Accuracy of angle, elongation and pieces from noisy points, beside the bound and the peers.

    python -m benchmarks.accuracy [--quick] [--trials N] [--cell TEXT] [--all] [--markdown] [--jobs N]

The full run has 200 trials a cell and takes three hours of a core; `--quick` takes less than a minute and
fails where this project is clearly not what it says.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from itertools import groupby

import numpy as np

from benchmarks import cells
from benchmarks.cells import Cell
from benchmarks.report import Result, details, matrix
from benchmarks.routes import truth
from benchmarks.scores import METHODS, Outcome, bound, run, summary
from benchmarks.tables import machine
from benchmarks.targets import failings, targets

_TRIALS, _QUICK_TRIALS = 200, 24
_CHUNK = 10  # trials handed to a worker at a time

_LEGEND = """\
Φ rms, bias, worst: error of the accumulated curve angle, in per cent of Φ, on a line in mrad.
φ(s): greatest error along the route, root mean square over the trials, same unit.
δ: rms error of the elongation on the first pull to 15 N with the paper's tendon.
95 %: share [%] of intervals of ±1.96 standard errors that hold the truth, of Φ and of δ.
count: share [%] of trials with the true number of pieces. bound: Cramér–Rao, for the true pieces.
stations: known (even), or not told: even, jitter (sd a fifth of the spacing), random (uniform).
Peers get chord lengths where stations are not told, and always the true noise where they use one.
GCV spline runs every fourth trial of more than 100 points (it takes 0.2 s for 200 and 1 s for 1000)."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    options = _options(arguments)
    chosen = [cell for cell in _cells(options) if options.cell.lower() in cell.title.lower()]
    if not chosen:
        print(f"no cell has {options.cell!r} in its name; see benchmarks/cells.py")
        return 2
    trials = options.trials or (_QUICK_TRIALS if options.quick else _TRIALS)
    print(machine())
    print(f"settings: {len(chosen)} cells, {trials} trials each, {options.jobs} processes\n\n{_LEGEND}")
    begin = time.perf_counter()
    results = _print_groups(chosen, trials, options)
    print(f"\n{len(chosen)} cells in {time.perf_counter() - begin:.0f} s")
    if not options.quick:
        print("\n" + targets(results, markdown=options.markdown))
        return 0
    wrong = failings(results)
    print("\n".join(["FAILED", *wrong]) if wrong else "all loose bounds of the quick run hold")
    return 1 if wrong else 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.accuracy", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--quick", action="store_true", help="a few cells and trials, with loose assertions")
    parser.add_argument("--trials", type=int, default=0, help="trials a cell (200; quick 24)")
    parser.add_argument("--cell", default="", metavar="TEXT", help="only cells with TEXT in group or name")
    parser.add_argument(
        "--all", action="store_true", help="details of every estimator, not of the best peer only"
    )
    parser.add_argument("--markdown", action="store_true", help="tables to paste into documents")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes (one a core)")
    return parser.parse_args(arguments)


def _cells(options: argparse.Namespace) -> tuple[Cell, ...]:
    return cells.quick() if options.quick else cells.catalogue()


def _print_groups(chosen: Sequence[Cell], trials: int, options: argparse.Namespace) -> list[Result]:
    """Print each group of cells as soon as it is done."""
    results = []
    for group, members in groupby(
        _results(chosen, trials, options.jobs), key=lambda result: result.cell.group
    ):
        done = list(members)
        print(f"\n{'## ' if options.markdown else '== '}{group}\n")
        print(matrix(done, markdown=options.markdown))
        print("\n" + details(done, every=options.all, markdown=options.markdown), flush=True)
        results += done
    return results


def _results(chosen: Sequence[Cell], trials: int, jobs: int) -> Iterator[Result]:
    """Score all cells, in their order."""
    run(chosen[0], range(1))  # compiles what the workers will read from the cache
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        waiting = [(cell, _submitted(pool, cell, trials)) for cell in chosen]
        for cell, futures in waiting:
            yield _result(cell, [future.result() for future in futures], trials)


def _submitted(pool: ProcessPoolExecutor, cell: Cell, trials: int) -> list[Future[dict[str, Outcome]]]:
    parts = [range(first, min(first + _CHUNK, trials)) for first in range(0, trials, _CHUNK)]
    return [pool.submit(run, cell, part) for part in parts]


def _result(cell: Cell, parts: Sequence[dict[str, Outcome]], trials: int) -> Result:
    course = truth(cell.route, np.random.default_rng(0)).course
    pieces = len(course.length) if course is not None else 0
    return Result(
        cell=cell,
        bound=bound(cell, trials),
        shortest=0.0 if course is None else float(course.length.min() / course.total_length) * (cell.n - 1),
        summaries={name: summary([part[name] for part in parts], pieces) for name in METHODS},
    )


if __name__ == "__main__":
    sys.exit(main())

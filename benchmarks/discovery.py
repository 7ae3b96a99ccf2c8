"""How well the workflow finds what a model lacks, on campaigns that it has never seen.

    python -m benchmarks.discovery [--quick] [--effects NAME…] [--seeds N] [--split test] [--jobs 2]

The full run makes some 500 campaigns at four seeds; `--quick` makes seven. `--baselines` adds a sparse
regression (pysindy) and a Gaussian process (scikit-learn) on the files of single causes of typical size,
where they are installed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial

from rich.console import Console
from rich.progress import track

from benchmarks import discovery_report as report
from benchmarks.discovery_cases import cases, outcome
from benchmarks.discovery_scores import Outcome, both_named, verdict
from benchmarks.tables import machine

_SEEDS = 4
_QUICK_WRONG = 1  # of seven campaigns: where 97 % are right, more are wrong once in 60 runs


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    options = _options(arguments)
    chosen = cases(
        options.effects, options.seeds or (1 if options.quick else _SEEDS), options.split, quick=options.quick
    )
    if not chosen:
        print(f"no campaign has only {', '.join(options.effects)}; see tests/campaigns/causes.py")
        return 2
    print(machine())
    print(f"{len(chosen)} campaigns, {options.split} seeds, {options.jobs} processes")
    begin = time.perf_counter()
    outcomes = _outcomes(chosen, options)
    print(f"done in {time.perf_counter() - begin:.0f} s\n\n{_printed(outcomes, options)}")
    wrong = sum(not _right(one) for one in outcomes)
    return int(any(one.report is None for one in outcomes) or (options.quick and wrong > _QUICK_WRONG))


def _right(outcome: Outcome) -> bool:
    """Tell whether the verdict is the one that the cause asks for."""
    if outcome.group == "clean":
        return verdict(outcome.report) == "none"
    if outcome.group == "outside":
        return verdict(outcome.report) == "unknown"
    return both_named(outcome)


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.discovery", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--quick", action="store_true", help="seven campaigns")
    parser.add_argument(
        "--effects", nargs="*", default=[], metavar="NAME", help="only these causes, or clean"
    )
    parser.add_argument("--seeds", type=int, default=0, help="seeds of each cause (4; quick 1)")
    parser.add_argument("--split", choices=("development", "test"), default="development")
    parser.add_argument("--baselines", action="store_true", help="pysindy and scikit-learn on single causes")
    parser.add_argument("--markdown", action="store_true", help="tables to paste into documents")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    return parser.parse_args(arguments)


def _outcomes(chosen: Sequence, options: argparse.Namespace) -> list[Outcome]:
    work = partial(outcome, with_baselines=options.baselines)
    console = Console(stderr=True)
    with ProcessPoolExecutor(options.jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        return list(track(pool.map(work, chosen), "campaigns", len(chosen), console=console))


def _printed(outcomes: Sequence[Outcome], options: argparse.Namespace) -> str:
    parts = [
        draw(outcomes, markdown=options.markdown)
        for draw in (report.targets, report.confusions, report.limits, report.peers)
    ]
    return "\n\n".join([*parts, report.failures(outcomes)]).rstrip()


if __name__ == "__main__":
    sys.exit(main())

"""How well the workflow detects what a model lacks, on campaigns that were not used while it was made.

    python -m benchmarks.discovery [--quick] [--effects NAME…] [--seeds N] [--split test] [--jobs 2]

The full run makes some 500 campaigns at four seeds; `--quick` makes seven. `--generator second` takes
campaigns of another kind of simulator, and counts mechanisms and laws. `--baselines` adds a sparse
regression (pysindy) and a Gaussian process (scikit-learn) on the files of single causes of typical size,
where they are installed. `--propose` counts the runs that break a tie (`benchmarks.discovery_campaigns`).
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks import ABSENT, machine, number, options_parser, share, table
from benchmarks import discovery_scores as scores
from benchmarks.discovery_campaigns import Case, cases, compared, discovered, second_cases
from benchmarks.discovery_peers import baselines
from benchmarks.discovery_scores import Outcome, Sums, counted


def outcome(case: Case, *, with_baselines: bool) -> Outcome:
    """Make a campaign in a folder of its own, run the workflow on it, and return its report."""
    with TemporaryDirectory(prefix="discovery-") as room:
        folder = Path(room) / "campaign"
        truth = case.made(folder)
        begin = _worked_by_children()
        report, failure = discovered(folder, Path(room) / "out")
        seconds = _worked_by_children() - begin
        others = baselines(folder) if with_baselines and case.group == "single" else {}
    return Outcome(case.group, truth, report, seconds, failure, others)


def _worked_by_children() -> float:
    """Processor time of ended children [s], which other work beside them makes no longer."""
    times = os.times()
    return times.children_user + times.children_system


_DETECTED = 0.9  # share that must be right at a size and at all larger ones
_SIZE_OF = {"single": 1.0, "half": 0.5, "quarter": 0.25}


@dataclass(frozen=True, slots=True)
class Row:
    """One metric beside its target."""

    metric: str
    target: str
    value: float
    """NaN where nothing was measured."""
    text: str
    kept: bool


def target_rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """Return every metric that the workflow is held to."""

    def of(*groups: str) -> list[Outcome]:
        return [one for one in outcomes if one.group in groups]

    return [
        _least("right name first, typical size", counted(map(scores.right_first, of("single"))), 0.95),
        _least("right name or tie, half size", counted(map(scores.right_or_tied, of("half"))), 0.90),
        _most("names in a tie, half size (mean)", [float(scores.tie_size(one)) for one in of("half")], 2.0),
        _least("both names of a pair", counted(map(scores.both_named, of("pair"))), 0.80),
        _alarms(of("clean")),
        _least("outside the library: unknown", counted(map(_unknown, of("outside"))), 0.90),
        _rare("known, called unknown", counted(map(_unknown, _reported(of("single", "half")))), 0.05),
        _least(
            "channels missing: named, tied or unobservable", counted(map(scores.honest, of("partial"))), 0.9
        ),
        _least(
            "round turns, driven by force: right name",
            counted(map(scores.right_first, of("other drive"))),
            0.9,
        ),
        *_misfit_rows([scores.held_out_ratio(one.report) for one in of("single", "half", "pair")]),
        *_number_rows(of("single", "half", "pair"), of("clean")),
        *(
            _least(f"tie {tie} and its experiment named", counted(map(scores.tie_declared, of(tie))), 1.0)
            for tie in ("G1", "G4", "G5", "G6")
        ),
        _most(
            "processor time of a campaign [s] (median)",
            [one.seconds for one in _reported(outcomes)],
            10.0,
            np.median,
        ),
    ]


def _reported(outcomes: Sequence[Outcome]) -> list[Outcome]:
    return [one for one in outcomes if one.report is not None]


def _unknown(outcome: Outcome) -> bool:
    return scores.verdict(outcome.report) == "unknown"


def _alarms(clean: Sequence[Outcome]) -> Row:
    wrong = counted(scores.verdict(one.report) != "none" for one in clean)
    bound = scores.upper_bound(wrong.right, wrong.of) if wrong.of else math.nan
    row = _rare("false alarms, clean", wrong, 0.02)
    return Row(row.metric, row.target, row.value, f"{row.text}, below {share(bound)} %", row.kept)


def _misfit_rows(ratios: Sequence[float]) -> list[Row]:
    known = [ratio for ratio in ratios if not math.isnan(ratio)]
    return [
        _most("held-out misfit after / before (median)", known, 0.35, np.median),
        _rare("held-out misfit worse", counted(ratio > 1.0 for ratio in known), 0.05),
    ]


def _number_rows(faulty: Sequence[Outcome], clean: Sequence[Outcome]) -> list[Row]:
    position_errors, angle = scores.bends(faulty)
    errors, held = scores.parameters(faulty)
    inside, base = counted(held), base_held(clean)
    return [
        _most("hidden bend, position / L (median)", position_errors, 0.02, np.median),
        _most("hidden bend, angle (median)", angle, 0.10, np.median),
        _most("parameters, error (median)", errors, 0.10, np.median),
        Row(
            "parameters, 95 % intervals",
            "90 to 98 %",
            inside.share,
            inside.text,
            0.9 <= inside.share <= 0.98,
        ),
        Row("compliance, 95 % intervals, clean", "≥ 90 %", base.share, base.text, base.share >= 0.9),
    ]


def base_held(outcomes: Iterable[Outcome]) -> Sums:
    """Count 95 % intervals of the compliance that hold the truth, in reports that find nothing else."""
    held = list[bool]()
    for outcome in outcomes:
        if scores.verdict(outcome.report) == "none" and outcome.report:
            low, high = outcome.report["base"]["compliance_per_N"]["ci95"]
            held.append(low <= outcome.truth["compliance_per_N"] <= high)
    return counted(held)


def _least(metric: str, sums: Sums, bound: float) -> Row:
    return Row(metric, f"≥ {share(bound)} %", sums.share, sums.text, sums.share >= bound)


def _rare(metric: str, sums: Sums, bound: float) -> Row:
    return Row(metric, f"≤ {share(bound)} %", sums.share, sums.text, sums.share <= bound)


def _most(metric: str, values: Sequence[float], bound: float, middle: Callable[..., float] = np.mean) -> Row:
    value = float(middle(values)) if len(values) else math.nan
    return Row(metric, f"≤ {bound:g}", value, f"{number(value)} of {len(values)}", value <= bound)


def targets(outcomes: Sequence[Outcome], *, markdown: bool) -> str:
    """Write the table of targets; a metric without campaigns is neither kept nor missed."""
    rows = [
        [row.metric, row.target, ABSENT if math.isnan(row.value) else row.text, _mark(row)]
        for row in target_rows(outcomes)
    ]
    return table(["metric", "target", "reached", "kept"], rows, text_columns=2, markdown=markdown)


def _mark(row: Row) -> str:
    return ABSENT if math.isnan(row.value) else "yes" if row.kept else "NO"


def confusions(outcomes: Sequence[Outcome], *, markdown: bool) -> str:
    """Write for each cause what it was called, most often first: a matrix without its empty cells."""
    counts = dict[str, Counter[str]]()
    for outcome in outcomes:
        cause = " + ".join(outcome.causes) or "clean"
        counts.setdefault(cause, Counter())[scores.called(outcome)] += 1
    rows = [
        [cause, str(sum(row.values())), ", ".join(f"{name} {n}" for name, n in row.most_common())]
        for cause, row in counts.items()
    ]
    ordered = [[cause, called, of] for cause, of, called in rows]
    return table(["cause", "called", "of"], ordered, text_columns=2, markdown=markdown)


def limits(outcomes: Sequence[Outcome], *, markdown: bool) -> str:
    """Write the share of right names (or ties) by size, and the size from which on they are right."""
    rows = []
    for name in dict.fromkeys(one.causes for one in outcomes if one.group in _SIZE_OF):
        mine = [one for one in outcomes if one.causes == name and one.group in _SIZE_OF]
        by_size = {
            size: counted(scores.right_or_tied(one) for one in mine if one.group == group).share
            for group, size in _SIZE_OF.items()
        }
        limit = detection_limit(by_size)
        rows.append([name[0], *(share(by_size[size]) for size in (1.0, 0.5, 0.25)), number(limit, 2)])
    head = ["right or tied [%]", "size 1", "0.5", "0.25", "limit"]
    return table(head, rows, text_columns=1, markdown=markdown)


def detection_limit(shares: Mapping[float, float]) -> float:
    """Return the smallest size from which on at least 90 % are right; infinite where none is."""
    limit = math.inf
    for size in sorted(shares, reverse=True):
        if not shares[size] >= _DETECTED:
            break
        limit = size
    return limit


def peers(outcomes: Sequence[Outcome], *, markdown: bool) -> str:
    """Write names and held-out misfits of this project and of each baseline, on single causes."""
    mine = [one for one in outcomes if one.group == "single"]
    rows = [
        _peer(
            "this workflow", [(scores.called(o), o.causes[0], scores.held_out_ratio(o.report)) for o in mine]
        )
    ]
    for name in dict.fromkeys(key for one in mine for key in one.baselines):
        answers = [(o.baselines[name], o.causes[0]) for o in mine if name in o.baselines]
        rows.append(_peer(name, [(one.name, cause, one.held_out_ratio) for one, cause in answers]))
    head = ["single causes, typical size", "right name", "held-out misfit (median)", "worse"]
    return table(head, rows, text_columns=1, markdown=markdown)


def _peer(name: str, answers: Sequence[tuple[str, str, float]]) -> list[str]:
    ratios = [ratio for _, _, ratio in answers if not math.isnan(ratio)]
    named = counted(said == cause for said, cause, _ in answers if said)
    return [
        name,
        named.text,
        number(float(np.median(ratios))) if ratios else ABSENT,
        counted(ratio > 1.0 for ratio in ratios).text,
    ]


def failures(outcomes: Sequence[Outcome]) -> str:
    """Say in which campaigns there was no report, and why; nothing where all have one."""
    wrong = [one for one in outcomes if one.report is None]
    lines = [
        f"  {one.group} {' + '.join(one.causes) or 'clean'} seed {one.truth['seed']}: {one.failure}"
        for one in wrong
    ]
    return (
        "\n".join([f"{len(wrong)} of {len(outcomes)} campaigns have no report:", *lines[:10]])
        if wrong
        else ""
    )


_SEEDS = 4
_QUICK_WRONG = 1  # of seven campaigns: where 97 % are right, more are wrong once in 60 runs


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    options = _options(arguments)
    if options.propose:
        print(machine())
        print(compared(options.seeds or _SEEDS, options.first_seed, options.jobs, markdown=options.markdown))
        return 0
    made_by = second_cases if options.generator == "second" else cases
    chosen = made_by(
        options.effects, options.seeds or (1 if options.quick else _SEEDS), options.split, quick=options.quick
    )
    if not chosen:
        home = "tests/bristle" if options.generator == "second" else "tests/campaigns"
        print(f"no campaign has only {', '.join(options.effects)}; see {home}/causes.py")
        return 2
    print(machine())
    print(f"{len(chosen)} campaigns, {options.split} seeds, {options.jobs} processes")
    begin = time.perf_counter()
    outcomes = _outcomes(chosen, options)
    print(f"done in {time.perf_counter() - begin:.0f} s\n\n{_printed(outcomes, options)}")
    right = scores.right_by_mechanism if options.generator == "second" else _right
    wrong = sum(not right(one) for one in outcomes)
    return int(any(one.report is None for one in outcomes) or (options.quick and wrong > _QUICK_WRONG))


def _right(outcome: Outcome) -> bool:
    """Whether the verdict is the one that the cause requires."""
    if outcome.group == "clean":
        return scores.verdict(outcome.report) == "none"
    if outcome.group == "outside":
        return scores.verdict(outcome.report) == "unknown"
    return scores.both_named(outcome)


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__, "seven campaigns")
    parser.add_argument(
        "--effects", nargs="*", default=[], metavar="NAME", help="only these causes, or clean"
    )
    parser.add_argument("--seeds", type=int, default=0, help="seeds of each cause (4; quick 1)")
    parser.add_argument("--split", choices=("development", "test"), default="development")
    parser.add_argument("--baselines", action="store_true", help="pysindy and scikit-learn on single causes")
    parser.add_argument("--propose", action="store_true", help="runs that break a tie, designed or not")
    parser.add_argument("--first-seed", type=int, default=0, help="of --propose")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--generator", choices=("first", "second"), default="first", help="of the campaigns")
    options = parser.parse_args(arguments)
    if options.baselines and options.generator == "second":
        parser.error("--baselines read the files of the first generator only")
    return options


def _outcomes(chosen: Sequence, options: argparse.Namespace) -> list[Outcome]:
    work = partial(outcome, with_baselines=options.baselines)
    console = Console(stderr=True)
    with ProcessPoolExecutor(options.jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        return list(track(pool.map(work, chosen), "campaigns", len(chosen), console=console))


def _printed(outcomes: Sequence[Outcome], options: argparse.Namespace) -> str:
    if options.generator == "second":
        tables = scores.printed_by_mechanism(outcomes, markdown=options.markdown)
        return f"{tables}\n\n{failures(outcomes)}".rstrip()
    parts = [draw(outcomes, markdown=options.markdown) for draw in (targets, confusions, limits, peers)]
    return "\n\n".join([*parts, failures(outcomes)]).rstrip()


if __name__ == "__main__":
    sys.exit(main())

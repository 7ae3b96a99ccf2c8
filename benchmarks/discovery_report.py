"""The table of targets, the confusion matrix, the limits of detection and the peers, in print."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks import discovery_scores as scores
from benchmarks.discovery_scores import Outcome, Sums, counted
from benchmarks.tables import ABSENT, number, share, table

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
    inside, base = counted(held), scores.base_held(clean)
    return [
        _most("hidden bend, position / L (median)", position_errors, 0.02, np.median),
        _most("hidden bend, angle (median)", angle, 0.10, np.median),
        _most("parameters, error (median)", errors, 0.10, np.median),
        Row(
            "parameters, 95 % intervals",
            "90 to 98 %",
            inside.share,
            _of_all(inside),
            0.9 <= inside.share <= 0.98,
        ),
        Row("compliance, 95 % intervals, clean", "≥ 90 %", base.share, _of_all(base), base.share >= 0.9),
    ]


def _least(metric: str, sums: Sums, bound: float) -> Row:
    return Row(metric, f"≥ {share(bound)} %", sums.share, _of_all(sums), sums.share >= bound)


def _rare(metric: str, sums: Sums, bound: float) -> Row:
    return Row(metric, f"≤ {share(bound)} %", sums.share, _of_all(sums), sums.share <= bound)


def _most(metric: str, values: Sequence[float], bound: float, middle: Callable[..., float] = np.mean) -> Row:
    value = float(middle(values)) if len(values) else math.nan
    return Row(metric, f"≤ {bound:g}", value, f"{number(value)} of {len(values)}", value <= bound)


def _of_all(sums: Sums) -> str:
    return f"{share(sums.share)} % ({sums.right} of {sums.of})"


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
    counts = scores.confusion(outcomes)
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
        limit = scores.detection_limit(by_size)
        rows.append([name[0], *(share(by_size[size]) for size in (1.0, 0.5, 0.25)), number(limit, 2)])
    head = ["right or tied [%]", "size 1", "0.5", "0.25", "limit"]
    return table(head, rows, text_columns=1, markdown=markdown)


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
        _of_all(named) if named.of else ABSENT,
        number(float(np.median(ratios))) if ratios else ABSENT,
        _of_all(counted(ratio > 1.0 for ratio in ratios)) if ratios else ABSENT,
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

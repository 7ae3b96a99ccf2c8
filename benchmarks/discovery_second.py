"""The count on campaigns of the second generator: by mechanism, by formula, and by the law itself.

    python -m benchmarks.discovery --generator second [--effects NAME…] [--seeds N]

`tests/bristle` makes them. An answer is right by mechanism where the first effect of the report acts by the
mechanism of the truth; by formula where it has its name. The band of a law is held against the true law.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks import ABSENT, number, share, table
from benchmarks.discovery_campaigns import Case
from benchmarks.discovery_scores import Outcome, Sums, counted, held_out_ratio, ties, upper_bound, verdict
from tests.bristle import CAUSES, PAIR_CAUSES
from tssgeom.identify.mechanisms import MECHANISM_OF

NAMING = ("effect", "tie", "law", "partial")
"""Verdicts that name something."""
_QUICK = ("stribeck", "power_creep", "drive_play", "bend", "drifting_tension_out")
_CLEAN_FOR_ONE = 6  # clean campaigns for each seed of a cause
_GROUPS = {1.0: "single", 0.5: "half"}
_FREE_SLOPE = ("strain_over_tension", "sensor_curve")
_FREE_ZERO = (*_FREE_SLOPE, "stretch_at_end", "sensor_drift", "strain_over_time")


def cases(names: Sequence[str], seeds: int, split: str, *, quick: bool) -> list[Case]:
    """Return the campaigns of a run; `names` keeps to some causes, "clean" and "clean_pair" among them."""
    chosen = _QUICK if quick else tuple(CAUSES)
    made = list[Case]()
    for seed in range(seeds):
        clean = range(seed * _CLEAN_FOR_ONE, (seed + 1) * _CLEAN_FOR_ONE) if not quick else (seed,)
        made += [Case("clean", (), 1.0, "", number, split, "second") for number in clean]
        for size, group in _GROUPS.items():
            if quick and size != 1.0:
                continue
            made += [Case(group, (name,), size, "", seed, split, "second") for name in chosen]
        if not quick:
            made.append(Case("machine, clean", (), 1.0, "pair", seed, split, "second"))
            made += [Case("machine", (name,), 1.0, "", seed, split, "second") for name in PAIR_CAUSES]
    return [case for case in made if not names or _cause(case) in names]


def _cause(case: Case) -> str:
    return case.effects[0] if case.effects else "clean" if case.group == "clean" else "clean_pair"


def first_effect(outcome: Outcome) -> Mapping[str, Any] | None:
    """Return the strongest effect that a report names, or None."""
    if verdict(outcome.report) not in NAMING or outcome.report is None:
        return None
    return next(iter(outcome.report["effects"]), None)


def mechanism(effect: Mapping[str, Any] | None) -> str:
    """Return by which mechanism an effect of a report acts; empty of none and of an unknown name."""
    if effect is None:
        return ""
    return str(effect.get("mechanism") or MECHANISM_OF.get(str(effect.get("name")), ""))


def right_mechanism(outcome: Outcome) -> bool:
    """Whether the first effect acts by the mechanism of the truth."""
    return mechanism(first_effect(outcome)) == outcome.truth["mechanism"] != ""


def right_or_tied(outcome: Outcome) -> bool:
    """Whether it does so, or a tie that holds the first name holds one of that mechanism."""
    if right_mechanism(outcome):
        return True
    first = (first_effect(outcome) or {}).get("name")
    tied = [names for names in ties(outcome.report) if first in names]
    return any(MECHANISM_OF.get(name) == outcome.truth["mechanism"] for names in tied for name in names)


def right_formula(outcome: Outcome) -> bool:
    """Whether the first effect has the name of the truth's formula."""
    effect = first_effect(outcome)
    return effect is not None and effect.get("name") == outcome.truth["formula"]


def law_held(outcome: Outcome) -> float:
    """Return the share of points at which the band of the learned law holds the true one; NaN without a band.

    What no measurement separates from the base model is freed first: the factor of a law of friction, the
    zero of strains, readings and stretches, and the slope of strain and of a cell's curve.
    """
    effect, true = first_effect(outcome), outcome.truth["law"]
    law = effect.get("law") if effect else None
    if not law or not true or not right_mechanism(outcome):
        return math.nan
    if law.get("unit") != true["unit"]:
        return 0.0
    x, value = np.array(law["x"], dtype=float), np.array(law["value"], dtype=float)
    inside = (x >= true["x"][0]) & (x <= true["x"][-1])
    if not inside.any():
        return 0.0
    x, value = x[inside], value[inside]
    low, high = (np.array(law[key], dtype=float)[inside] for key in ("lo", "hi"))
    goal = _freed(np.interp(x, true["x"], true["value"]), x, value, outcome.truth["mechanism"])
    return float(np.mean((low <= goal) & (goal <= high)))


def _freed(goal: np.ndarray, x: np.ndarray, value: np.ndarray, kind: str) -> np.ndarray:
    """Return the true law [n] with what is free of it taken from a learned one [n]."""
    if kind.startswith("friction_over"):
        return goal * float(goal @ value) / float(goal @ goal)
    if kind in _FREE_SLOPE and len(x) > 2:
        slope, zero = np.polyfit(x, value - goal, 1)
        return goal + slope * x + zero
    return goal + float(np.mean(value - goal)) if kind in _FREE_ZERO else goal


def called(outcome: Outcome) -> str:
    """Return the answer in one word: the verdict and the first name, if there is one."""
    effect = first_effect(outcome)
    said = verdict(outcome.report)
    return said if effect is None else f"{said}: {effect.get('name') or mechanism(effect)}"


def printed(outcomes: Sequence[Outcome], *, markdown: bool) -> str:
    """Return the tables of a run."""
    return "\n\n".join([targets(outcomes, markdown=markdown), by_cause(outcomes, markdown=markdown)])


def targets(outcomes: Sequence[Outcome], *, markdown: bool) -> str:
    """Write what all campaigns reached, beside the targets."""

    def of(*groups: str) -> list[Outcome]:
        return [one for one in outcomes if one.group in groups]

    outside = [one for one in of("single", "half") if not one.truth["known"]]
    named = [one for one in of("single", "half") if one.truth["known"]]
    clean = counted(verdict(one.report) != "none" for one in of("clean"))
    bound = upper_bound(clean.right, clean.of) if clean.of else math.nan
    ratios = _known(held_out_ratio(one.report) for one in outside)
    bands = _known(law_held(one) for one in outside)
    rows = [
        ["mechanism right, full size", "≥ 95 %", counted(map(right_mechanism, of("single"))).text],
        ["mechanism right, half size", "≥ 90 %", counted(map(right_mechanism, of("half"))).text],
        ["mechanism right or tied", ABSENT, counted(map(right_or_tied, of("single", "half"))).text],
        ["formula right where it is in the library", "≥ 95 %", counted(map(right_formula, named)).text],
        ["false alarms, clean", "≤ 2 %", f"{clean.text}, below {share(bound)} %"],
        ["outside: mechanism right", "≥ 80 %", counted(map(right_mechanism, outside)).text],
        ["outside: held-out misfit after / before (median)", "≤ 0.35", _median(ratios)],
        ["outside: law within its band (mean share)", "93–97 %", _mean_share(bands)],
        ["machines: mechanism right", ABSENT, counted(map(right_mechanism, of("machine"))).text],
        [
            "machines, clean: none",
            ABSENT,
            counted(verdict(one.report) == "none" for one in of("machine, clean")).text,
        ],
    ]
    return table(["metric", "target", "reached"], rows, text_columns=2, markdown=markdown)


def by_cause(outcomes: Sequence[Outcome], *, markdown: bool) -> str:
    """Write for each mechanism, cause and size what it was called, what was right, and the law's share."""
    groups: dict[tuple[str, str, float], list[Outcome]] = {}
    for one in outcomes:
        key = (one.truth["mechanism"] or one.group, one.truth["cause"] or ABSENT, one.truth["size"])
        groups.setdefault(key, []).append(one)
    rows = []
    for (kind, cause, size), mine in sorted(groups.items()):
        answers = Counter(called(one) for one in mine)
        formula = [right_formula(one) for one in mine if one.truth["known"]]
        rows.append(
            [
                kind,
                cause,
                f"{size:g}",
                ", ".join(f"{name} {count}" for name, count in answers.most_common()),
                _count(counted(map(right_mechanism, mine))) if mine[0].truth["mechanism"] else ABSENT,
                _count(counted(formula)) if formula else ABSENT,
                _median(_known(held_out_ratio(one.report) for one in mine), count=False),
                _mean_share(_known(law_held(one) for one in mine), count=False),
            ]
        )
    head = ["mechanism", "cause", "size", "called", "mechanism", "formula", "held-out", "law held"]
    return table(head, rows, text_columns=4, markdown=markdown)


def _known(values: Any) -> list[float]:
    return [value for value in values if not math.isnan(value)]


def _count(sums: Sums) -> str:
    return f"{sums.right}/{sums.of}"


def _median(values: Sequence[float], *, count: bool = True) -> str:
    if not values:
        return ABSENT
    text = number(float(np.median(values)))
    return f"{text} of {len(values)}" if count else text


def _mean_share(values: Sequence[float], *, count: bool = True) -> str:
    if not values:
        return ABSENT
    text = f"{share(float(np.mean(values)))} %"
    return f"{text} of {len(values)}" if count else text


def right(outcome: Outcome) -> bool:
    """Whether the answer is the one that the cause requires."""
    if not outcome.truth["mechanism"]:
        return verdict(outcome.report) == "none"
    return right_mechanism(outcome)

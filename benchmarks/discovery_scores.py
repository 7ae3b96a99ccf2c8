"""What reports are worth beside the truth. Pure: reports and truths in, numbers and tables out.

Of the second generator (`tests/bristle`) an answer is right by mechanism where the first effect of the report
acts by the mechanism of the truth; by formula where it has its name. The band of a law is held against the
true law.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.stats import beta

from benchmarks import ABSENT, number, share, table
from tests.bristle.bands import band_share
from tssgeom.identify.mechanism_names import MECHANISM_OF

Report = Mapping[str, Any]
NAMING = ("effect", "tie", "law", "partial")
"""Verdicts that name something."""


@dataclass(frozen=True, slots=True)
class Baseline:
    """What a peer made of a campaign."""

    name: str
    """The one cause that it points at; empty for a peer that names nothing."""
    held_out_ratio: float
    """Held-out misfit after over before."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One campaign: its cause, and what the workflow and its peers made of it."""

    group: str
    truth: Mapping[str, Any]
    report: Report | None
    """None where the workflow wrote none."""
    seconds: float
    """Processor time of the workflow."""
    failure: str = ""
    baselines: Mapping[str, Baseline] = field(default_factory=dict)

    @property
    def causes(self) -> tuple[str, ...]:
        """Names of what was built in."""
        return tuple(self.truth["effects"])


@dataclass(frozen=True, slots=True)
class Sums:
    """Share of right answers."""

    right: int
    of: int

    @property
    def fraction(self) -> str:
        """Right ones of all, as a fraction."""
        return f"{self.right}/{self.of}"

    @property
    def share(self) -> float:
        """Right ones over all; NaN of none."""
        return self.right / self.of if self.of else math.nan

    @property
    def text(self) -> str:
        """The share in per cent, with both counts."""
        return f"{share(self.share)} % ({self.right} of {self.of})" if self.of else ABSENT


def counted(answers: Iterable[bool]) -> Sums:
    """Count the right ones."""
    results = list(answers)
    return Sums(sum(results), len(results))


def verdict(report: Report | None) -> str:
    """Return the verdict, "failed" where there is no report."""
    return "failed" if report is None else str(report["verdict"])


def names(report: Report | None) -> list[str]:
    """Return the effects that a report stands for, first one first."""
    named = verdict(report) in ("effect", "law", "tie", "partial")
    return [effect["name"] for effect in report["effects"]] if named and report is not None else []


def ties(report: Report | None) -> list[list[str]]:
    """Return the declared ties."""
    return [] if report is None else [list(tie) for tie in report.get("tie", [])]


def called(outcome: Outcome) -> str:
    """Return the answer of the workflow in one word: the first name, or the verdict."""
    named = names(outcome.report)
    return named[0] if named else verdict(outcome.report)


def right_first(outcome: Outcome) -> bool:
    """Whether the first name is the cause."""
    return names(outcome.report)[:1] == list(outcome.causes[:1])


def right_or_tied(outcome: Outcome) -> bool:
    """Whether the first name, or a tie that was declared with the first name in it, is the cause."""
    if right_first(outcome):
        return True
    first, cause = names(outcome.report)[:1], outcome.causes[0]
    return any(cause in tie and first[0] in tie for tie in ties(outcome.report)) if first else False


def honest(outcome: Outcome) -> bool:
    """Whether the cause is named, tied, or listed as unobservable."""
    hidden = outcome.report.get("unobservable", []) if outcome.report else []
    return right_or_tied(outcome) or (outcome.causes[0] in hidden and not names(outcome.report))


def tie_size(outcome: Outcome) -> int:
    """Return of how many names the answer leaves the choice, 1 without a tie."""
    first = names(outcome.report)[:1]
    return max([len(tie) for tie in ties(outcome.report) if first and first[0] in tie], default=1)


def both_named(outcome: Outcome) -> bool:
    """Whether every cause of a pair is named."""
    return set(outcome.causes) <= set(names(outcome.report))


def tie_declared(outcome: Outcome) -> bool:
    """Whether a tie with the cause is declared, and an experiment that breaks ties is given."""
    held = any(outcome.causes[0] in tie and len(tie) > 1 for tie in ties(outcome.report))
    return held and bool(outcome.report and outcome.report.get("breaks_tie"))


def gap(rms: Mapping[str, float], noise: Mapping[str, float]) -> float:
    """Return the misfit: the root mean over channels of what is beyond the noise, in units of it [1]."""
    return math.sqrt(float(np.mean([max((rms[name] / noise[name]) ** 2 - 1.0, 0.0) for name in rms])))


def held_out_ratio(report: Report | None) -> float:
    """Return the held-out misfit after over that before; NaN without a report or where there was none."""
    if report is None:
        return math.nan
    misfits = report["gap"]
    before, after = (gap(misfits[when]["held_out"], misfits["noise"]) for when in ("before", "after"))
    return after / before if before > 0.0 else math.nan


def parameters(outcomes: Iterable[Outcome]) -> tuple[list[float], list[bool]]:
    """Return relative errors, and whether the interval holds the truth, of every number of a right name."""
    errors, held = list[float](), list[bool]()
    for outcome in outcomes:
        for effect in outcome.report["effects"] if outcome.report and names(outcome.report) else []:
            for key, true in outcome.truth["parameters"].get(effect["name"], {}).items():
                estimate = effect["parameters"].get(key)
                if isinstance(true, float) and true and estimate:
                    errors.append(abs(estimate["value"] / true - 1.0))
                    low, high = estimate["ci95"]
                    held.append(low <= true <= high)
    return errors, held


def bends(outcomes: Iterable[Outcome]) -> tuple[list[float], list[float]]:
    """Return errors of position, over L, and of angle, relative, of named hidden bends from 0.3 rad on."""
    position, angle = list[float](), list[float]()
    for outcome in outcomes:
        true = outcome.truth["parameters"].get("hidden_bend", {})
        bends_named = (
            [e for e in outcome.report["effects"] if e["name"] == "hidden_bend"] if outcome.report else []
        )
        if bends_named and true.get("angle_rad", 0.0) >= 0.3:
            estimate = bends_named[0]["parameters"]
            position.append(abs(estimate["at_m"]["value"] - true["at_m"]) / outcome.truth["length_m"])
            angle.append(abs(estimate["angle_rad"]["value"] / true["angle_rad"] - 1.0))
    return position, angle


def upper_bound(wrong: int, of: int) -> float:
    """Return the one-sided 95 % Clopper-Pearson bound of a rate."""
    return 1.0 if wrong >= of else float(beta.ppf(0.95, wrong + 1, of - wrong))


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


def mechanism_or_tied(outcome: Outcome) -> bool:
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
    compliance under creep, the zero of strains, readings and stretches, and the slope of strain and of a
    cell's curve. Where the band is wide it counts less for that.
    """
    effect, true = first_effect(outcome), outcome.truth["law"]
    law = effect.get("law") if effect else None
    if not law or not true or not right_mechanism(outcome):
        return math.nan
    kind = outcome.truth["mechanism"]
    if law.get("unit") != ("1/N" if kind == "strain_over_time" else true["unit"]):
        return 0.0
    return band_share(law, true, kind)


def answer(outcome: Outcome) -> str:
    """Return the verdict and the first name, if there is one."""
    effect = first_effect(outcome)
    said = verdict(outcome.report)
    return said if effect is None else f"{said}: {effect.get('name') or mechanism(effect)}"


def printed_by_mechanism(outcomes: Sequence[Outcome], *, markdown: bool) -> str:
    """Return the tables of a run."""
    return "\n\n".join(
        [mechanism_targets(outcomes, markdown=markdown), by_cause(outcomes, markdown=markdown)]
    )


def mechanism_targets(outcomes: Sequence[Outcome], *, markdown: bool) -> str:
    """Write what all campaigns reached, beside the targets."""

    def of(*groups: str) -> list[Outcome]:
        return [one for one in outcomes if one.group in groups]

    outside = [one for one in of("single", "half") if not one.truth["known"]]
    named = [one for one in of("single", "half") if one.truth["known"]]
    clean = counted(verdict(one.report) != "none" for one in of("clean"))
    machines = counted(verdict(one.report) == "none" for one in of("machine, clean"))
    bound = upper_bound(clean.right, clean.of) if clean.of else math.nan
    ratios = _known(held_out_ratio(one.report) for one in outside)
    bands = _known(law_held(one) for one in outside)
    rows = [
        ["mechanism right, full size", "≥ 95 %", counted(map(right_mechanism, of("single"))).text],
        ["mechanism right, half size", "≥ 90 %", counted(map(right_mechanism, of("half"))).text],
        ["mechanism right or tied", ABSENT, counted(map(mechanism_or_tied, of("single", "half"))).text],
        ["formula right where it is in the library", "≥ 95 %", counted(map(right_formula, named)).text],
        ["false alarms, clean", "≤ 2 %", f"{clean.text}, below {share(bound)} %"],
        ["outside: mechanism right", "≥ 80 %", counted(map(right_mechanism, outside)).text],
        ["outside: held-out misfit after / before (median)", "≤ 0.35", _median(ratios)],
        ["outside: law within its band (mean share)", "93–97 %", _mean_share(bands)],
        ["machines: mechanism right", ABSENT, counted(map(right_mechanism, of("machine"))).text],
        ["machines, clean: none", ABSENT, machines.text],
    ]
    return table(["metric", "target", "reached"], rows, text_columns=2, markdown=markdown)


def by_cause(outcomes: Sequence[Outcome], *, markdown: bool) -> str:
    """Write for each mechanism, cause and size what it was called, what was right, and the law's share."""
    groups: dict[tuple[str, str, float], list[Outcome]] = {}
    for one in outcomes:
        kind, cause = one.truth["mechanism"] or one.group, one.truth["cause"] or ABSENT
        groups.setdefault((kind, cause, one.truth["size"]), []).append(one)
    rows = []
    for (kind, cause, size), mine in sorted(groups.items()):
        answers = Counter(answer(one) for one in mine)
        formula = [right_formula(one) for one in mine if one.truth["known"]]
        rows.append(
            [
                kind,
                cause,
                f"{size:g}",
                ", ".join(f"{name} {count}" for name, count in answers.most_common()),
                counted(map(right_mechanism, mine)).fraction if mine[0].truth["mechanism"] else ABSENT,
                counted(formula).fraction if formula else ABSENT,
                _median(_known(held_out_ratio(one.report) for one in mine), count=False),
                _mean_share(_known(law_held(one) for one in mine), count=False),
            ]
        )
    head = ["mechanism", "cause", "size", "called", "mechanism", "formula", "held-out", "law held"]
    return table(head, rows, text_columns=4, markdown=markdown)


def _known(values: Any) -> list[float]:
    return [value for value in values if not math.isnan(value)]


def _median(values: Sequence[float], *, count: bool = True) -> str:
    return _of(number(float(np.median(values))), values, count) if values else ABSENT


def _mean_share(values: Sequence[float], *, count: bool = True) -> str:
    return _of(f"{share(float(np.mean(values)))} %", values, count) if values else ABSENT


def _of(text: str, values: Sequence[float], count: bool) -> str:
    return f"{text} of {len(values)}" if count else text


def right_by_mechanism(outcome: Outcome) -> bool:
    """Whether the answer is the one that the cause requires."""
    if not outcome.truth["mechanism"]:
        return verdict(outcome.report) == "none"
    return right_mechanism(outcome)

"""What reports are worth beside the truth. Pure: reports and truths in, numbers out."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.stats import beta

from benchmarks import ABSENT, share

Report = Mapping[str, Any]
_DETECTED = 0.9  # share that must be right at a size and at all larger ones


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


def base_held(outcomes: Iterable[Outcome]) -> Sums:
    """Count 95 % intervals of the compliance that hold the truth, in reports that find nothing else."""
    held = list[bool]()
    for outcome in outcomes:
        if verdict(outcome.report) == "none" and outcome.report:
            low, high = outcome.report["base"]["compliance_per_N"]["ci95"]
            held.append(low <= outcome.truth["compliance_per_N"] <= high)
    return counted(held)


def upper_bound(wrong: int, of: int) -> float:
    """Return the one-sided 95 % Clopper-Pearson bound of a rate."""
    return 1.0 if wrong >= of else float(beta.ppf(0.95, wrong + 1, of - wrong))


def detection_limit(shares: Mapping[float, float]) -> float:
    """Return the smallest size from which on at least 90 % are right; infinite where none is."""
    limit = math.inf
    for size in sorted(shares, reverse=True):
        if not shares[size] >= _DETECTED:
            break
        limit = size
    return limit


def confusion(outcomes: Sequence[Outcome]) -> dict[str, Counter[str]]:
    """Count what each cause was called; no cause is "clean"."""
    table: dict[str, Counter[str]] = {}
    for outcome in outcomes:
        table.setdefault(" + ".join(outcome.causes) or "clean", Counter())[called(outcome)] += 1
    return table

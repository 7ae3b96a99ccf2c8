"""The finding put together from what the steps of the workflow left."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from tssgeom.identify.detection_limits import guards, size_over_guard
from tssgeom.identify.evidence import NORMAL, candidate, estimates
from tssgeom.identify.experiments import best_plans
from tssgeom.identify.finding import (
    Blame,
    Candidate,
    Estimate,
    Evidence,
    Experiment,
    HeatMap,
    RouteBlame,
)
from tssgeom.identify.held_out import HeldOut
from tssgeom.identify.problem import Fit, Point, Problem, refined
from tssgeom.identify.selection import Selection, Step, delta_bic, name_of, without
from tssgeom.identify.ties import Tied, close_rivals
from tssgeom.identify.verdict import Judged
from tssgeom.identify.wording import why_not
from tssgeom.rig import Rig


@dataclass(frozen=True, slots=True)
class Places:
    """Where the base model fails."""

    heat: HeatMap
    where: tuple[Blame, ...]
    along: tuple[RouteBlame, ...]
    gains: tuple[float, ...]
    """How much χ² falls by what each route wants."""


@dataclass(frozen=True, slots=True)
class Work:
    """What the steps left."""

    problem: Problem
    base: Fit
    chosen: Selection
    held: HeldOut | None
    judged: Judged
    absent: Mapping[str, str]
    """Effects that could not be tried, and why."""

    @property
    def misfit(self) -> float:
        """χ² for each reading of what was chosen [1]."""
        return self.chosen.fit.chi2 / self.chosen.problem.stack.size


def base_estimates(fit: Fit, nominal: Rig) -> dict[str, Estimate]:
    """Return friction and compliance with their 95 % intervals; the angle gain blurs friction."""
    spread = np.sqrt(np.diag(fit.covariance))[:2] * math.sqrt(max(fit.chi2 / len(fit.left), 1.0))
    spread[0] = math.hypot(spread[0], nominal.shape.angle_gain_sd)
    both = (("friction", fit.at.friction, "1"), ("compliance_per_N", fit.at.compliance, "1/N"))
    return {
        name: Estimate(value, unit, value * math.exp(-NORMAL * sd), value * math.exp(NORMAL * sd))
        for (name, value, unit), sd in zip(both, spread, strict=True)
    }


def found(work: Work) -> tuple[Candidate, ...]:
    """Return what was chosen, the strongest first, each with the evidence that it adds to the others."""
    fit = work.chosen.fit
    told = [_added(work, which) for which in range(len(fit.at.effects))]
    return tuple(sorted(told, key=lambda one: -one.evidence.delta_bic))


def _added(work: Work, which: int) -> Candidate:
    chosen = work.chosen
    problem, fit, effect = chosen.problem, chosen.fit, chosen.fit.at.effects[which]
    less = refined(problem, without(fit.at, which))
    size = size_over_guard(problem.stack, less.left - fit.left, guards(problem.stack, problem.rig))
    inflated = max(1.0, fit.chi2 / problem.stack.size)
    ratio = math.nan if work.held is None else work.held.ratio(fit.at)
    told = Evidence(
        delta_bic(less, fit, problem.stack.size), chosen.steps[0].threshold * inflated, size, ratio
    )
    return Candidate((name_of(effect),), (effect,), (estimates(fit, which),), told, "")


def ranking(work: Work, effects: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Return every effect that was tried on the base model, and what was chosen where that is several."""
    first = work.chosen.steps[0]
    singles = [_ranked(work, first, k) for k in range(len(first.tried))]
    if len(effects) < 2:
        return tuple(singles)
    chosen = work.chosen
    told = Candidate(
        tuple(one.names[0] for one in effects),
        tuple(one.effects[0] for one in effects),
        tuple(one.parameters[0] for one in effects),
        Evidence(
            delta_bic(chosen.base, chosen.fit, chosen.problem.stack.size),
            effects[0].evidence.threshold,
            max(one.evidence.size_over_guard for one in effects),
            effects[0].evidence.heldout_ratio,
        ),
        "",
    )
    return (told, *singles)


def _ranked(work: Work, first: Step, k: int) -> Candidate:
    one = first.tried[k]
    told = candidate(first, one, work.held, "")
    named = {name_of(effect) for effect in work.chosen.fit.at.effects}
    if one.name in named and work.judged.verdict != "unknown":
        return told
    if work.judged.verdict == "unknown" and first.passes(one):
        return replace(told, why_not=f"it was refused: {work.judged.reason}.")
    return replace(told, why_not=why_not(told, first.tried[0].delta_bic, first.needed(one)))


def experiments(work: Work, ties: Sequence[Tied]) -> tuple[Experiment, ...]:
    """Return what breaks the ties: from the menu for what was found, else in the words of the gauge."""
    out = list[Experiment]()
    last = next((now for now in reversed(work.chosen.steps) if now.tried and now.passes(now.tried[0])), None)
    rivals = close_rivals(last) if last is not None else []
    if last is not None and rivals and work.judged.verdict == "tie":
        names = (last.tried[0].name, *(one.name for one in rivals))
        out += best_plans(last.problem, last.tried[0].fit, [one.fit for one in rivals], names)
    out += [
        Experiment(tied.breaks, 0.0, tied.tie.names)
        for tied in ties
        if tied.breaks and not any(tied.tie.names == one.separates for one in out)
    ]
    return tuple(out)


def updated(rig: Rig, at: Point) -> Rig:
    """Return the rig with what was found."""
    return msgspec.structs.replace(at.rig(rig), effects=(*rig.effects, *at.effects))


def nominal(rig: Rig) -> Mapping[str, float]:
    """Return friction and compliance as the rig file had them."""
    return {"friction": rig.friction.coefficient, "compliance_per_N": rig.tendon.compliance_per_N}

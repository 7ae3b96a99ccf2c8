"""The finding put together from what the steps of the workflow left; docs/model.md (110)-(112), (115)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from tssgeom.arrays import Matrix
from tssgeom.identify.finding import (
    Candidate,
    Estimate,
    Evidence,
    Experiment,
    HeatMap,
    MisfitShare,
    RouteMisfit,
)
from tssgeom.identify.fit import Fit, Free, Point, Problem, refined
from tssgeom.identify.law_search import LawSearch
from tssgeom.identify.misfit import NO_CHANGE, HeldOut
from tssgeom.identify.screening import detection_limits, size_over_limit
from tssgeom.identify.selection import Selection, Step, Tried, close_candidates, delta_bic, name_of, without
from tssgeom.identify.ties import Tied, best_plans
from tssgeom.identify.verdict import Judgement, why_not
from tssgeom.rig import Rig
from tssgeom.statistics import NORMAL_95


def evidence_of(now: Step, one: Tried, held: HeldOut | None) -> Evidence:
    """Return the evidence for a candidate."""
    ratio = math.nan if held is None else held.ratio(one.fit.at)
    return Evidence(one.delta_bic, now.needed(one), one.size, ratio, -one.held.rise)


def estimates(fit: Fit, which: int, covariance: Matrix | None = None) -> dict[str, Estimate]:
    """Return the fitted numbers of one effect, with intervals; docs/model.md (115).

    `covariance` of all numbers [size or more] is that of the fit where it is not given.
    """
    diagonal = np.diag(fit.covariance if covariance is None else covariance)
    spread = np.sqrt(diagonal)[2:] * math.sqrt(fit.inflation)
    out = {}
    for free, sd in zip(fit.at.free, spread, strict=False):
        if free.effect == which:
            out[free.key] = _estimate(fit.at, free, float(sd))
    return out


def _estimate(at: Point, free: Free, sd: float) -> Estimate:
    effect = at.effects[free.effect]
    value = float(getattr(effect, free.key))
    u = free.u(value)
    low, high = (free.value(u + sign * NORMAL_95 * sd) for sign in (-1.0, 1.0))
    return Estimate(value, effect.parameters[free.key].unit, min(low, value), max(high, value))


def candidate(now: Step, one: Tried, held: HeldOut | None, why_not: str) -> Candidate:
    """Return a candidate with its evidence."""
    which = len(one.fit.at.effects) - 1
    effect = one.fit.at.effects[which]
    return Candidate(
        (name_of(effect),), (effect,), (estimates(one.fit, which),), evidence_of(now, one, held), why_not
    )


@dataclass(frozen=True, slots=True)
class Attribution:
    """Where the base model fails."""

    heat: HeatMap
    where: tuple[MisfitShare, ...]
    along: tuple[RouteMisfit, ...]
    gains: tuple[float, ...]
    """How much χ² falls by the fitted angle of each route."""


@dataclass(frozen=True, slots=True, eq=False)
class Work:
    """What the steps left."""

    problem: Problem
    base: Fit
    chosen: Selection
    held: HeldOut | None
    judged: Judgement
    absent: Mapping[str, str]
    """Effects that could not be tried, and why."""
    laws: LawSearch | None = None
    """Where no name explained the readings, and laws helped."""

    @property
    def chi2(self) -> float:
        """Squares of the readings that names, or else laws, leave [1]."""
        return self.chosen.fit.chi2 if self.laws is None else self.laws.fit.chi2


def base_estimates(problem: Problem, fit: Fit, others: Matrix) -> dict[str, Estimate]:
    """Return friction and compliance with their 95 % intervals, by all errors of routes; (115).

    `others` is what angles of routes may be off beside the directions that the fit counts [rows, m] [N, m].
    """
    at, nominal = fit.at, problem.rig
    own = np.diag(fit.covariance)[:2] * fit.inflation
    moved = fit.covariance @ (fit.jacobian.T @ problem.whitening.whitened(others))
    spread = np.sqrt(own + np.square(moved[:2]).sum(axis=1))
    spread[0] = math.hypot(spread[0], nominal.shape.angle_gain_sd)
    both = (("friction", at.friction, "1"), ("compliance_per_N", at.compliance, "1/N"))
    return {
        name: Estimate(value, unit, value * math.exp(-NORMAL_95 * sd), value * math.exp(NORMAL_95 * sd))
        for (name, value, unit), sd in zip(both, spread, strict=True)
    }


def chosen_effects(work: Work) -> tuple[Candidate, ...]:
    """Return what was chosen, the strongest first, each with the evidence that it adds to the others."""
    fit = work.chosen.fit
    candidates = [_added(work, which) for which in range(len(fit.at.effects))]
    return tuple(sorted(candidates, key=lambda one: -one.evidence.total))


def _added(work: Work, which: int) -> Candidate:
    chosen = work.chosen
    problem, fit, effect = chosen.problem, chosen.fit, chosen.fit.at.effects[which]
    less = refined(problem, without(fit.at, which))
    size = size_over_limit(problem.stack, less.left - fit.left, detection_limits(problem.stack, problem.rig))
    ratio = math.nan if work.held is None else work.held.ratio(fit.at)
    gain = delta_bic(less, fit, problem.stack.size)
    fall = 0.0 if work.held is None else -work.held.rise(less.at, fit.at)
    evidence = Evidence(gain, chosen.steps[0].threshold * fit.inflation, size, ratio, fall)
    return Candidate((name_of(effect),), (effect,), (estimates(fit, which),), evidence, "")


def ranking(work: Work, effects: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Return every effect that was tried on the base model, and what was chosen where that is several.

    The best is first, held-out runs included.
    """
    first = work.chosen.steps[0]
    tried = first.tried if work.held is None else [_held(work.held, first, one) for one in first.tried]
    best = max((one.evidence for one in tried), default=0.0)
    singles = [_ranked(work, first, one, best - one.evidence) for one in tried]
    singles.sort(key=lambda one: (bool(one.why_not), -one.evidence.total))
    if len(effects) < 2:
        return tuple(singles)
    chosen = work.chosen
    together = Candidate(
        tuple(one.names[0] for one in effects),
        tuple(one.effects[0] for one in effects),
        tuple(one.parameters[0] for one in effects),
        Evidence(
            delta_bic(chosen.base, chosen.fit, chosen.problem.stack.size),
            effects[0].evidence.threshold,
            max(one.evidence.size_over_limit for one in effects),
            effects[0].evidence.heldout_ratio,
            0.0 if work.held is None else -work.held.rise(chosen.base.at, chosen.fit.at),
        ),
        "",
    )
    return (together, *singles)


def _held(held: HeldOut, first: Step, one: Tried) -> Tried:
    """Return a candidate with what it changes on the held-out runs."""
    before = first.before.at
    return replace(one, held=held.change(before, before, one.fit.at))


def _ranked(work: Work, first: Step, one: Tried, less: float) -> Candidate:
    """Return a candidate that has so much less evidence than the best, and why it was passed over."""
    ranked = candidate(first, one, work.held, "")
    named = {name_of(effect) for effect in work.chosen.fit.at.effects}
    if one.name in named and work.judged.verdict != "unknown":
        return ranked
    if work.judged.verdict == "unknown" and first.passes(one):
        return replace(ranked, why_not=f"it was refused: {work.judged.reason}.")
    why = why_not(ranked, less, first.needed(one), one.held)
    return replace(ranked, why_not=why)


def refused(work: Work) -> tuple[str, ...]:
    """Say which part would have been taken next, had the held-out runs not become worse with it."""
    if work.laws is not None:
        offers = [(one.gain, one.label, one.veto) for one in work.laws.rounds[-1] if math.isinf(one.rise)]
    else:
        last = work.chosen.steps[-1]
        worse = [one for one in last.tried if math.isinf(one.held.rise)]
        tried = [one for one in worse if last.passes(replace(one, held=NO_CHANGE))]
        offers = [(one.delta_bic, one.name, one.held.worse) for one in tried]
    return tuple(f"{name} was not taken: {why}." for _, name, why in sorted(offers)[-1:])


def experiments(work: Work, ties: Sequence[Tied]) -> tuple[Experiment, ...]:
    """Return what breaks the ties: from the menu for what was chosen, else in the words of the gauge."""
    out = list[Experiment]()
    last = next((now for now in reversed(work.chosen.steps) if now.tried and now.passes(now.tried[0])), None)
    close = close_candidates(last) if last is not None else []
    if last is not None and close and work.judged.verdict == "tie":
        names = (last.tried[0].name, *(one.name for one in close))
        out += best_plans(last.problem, last.tried[0].fit, [one.fit for one in close], names)
    out += [
        Experiment(tied.breaks, 0.0, tied.tie.names)
        for tied in ties
        if tied.breaks and not any(tied.tie.names == one.separates for one in out)
    ]
    return tuple(out)


def updated(rig: Rig, at: Point) -> Rig:
    """Return the rig with the chosen effects."""
    return msgspec.structs.replace(at.rig(rig), effects=(*rig.effects, *at.effects))


def nominal(rig: Rig) -> Mapping[str, float]:
    """Return friction and compliance as the rig file had them."""
    return {"friction": rig.friction.coefficient, "compliance_per_N": rig.tendon.compliance_per_N}

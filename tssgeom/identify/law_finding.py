"""Laws that were taken, as a finding shows them: curves with bands, and evidence; docs/model.md (190)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.effects import AnyEffect
from tssgeom.errors import FitError
from tssgeom.identify.assembly import estimates
from tssgeom.identify.finding import Candidate, Evidence, LawCurve
from tssgeom.identify.law_fit import LawFit
from tssgeom.identify.law_search import LawSearch, Offer, as_fit, needed
from tssgeom.identify.law_smoothness import law_curve
from tssgeom.identify.misfit import HeldOut
from tssgeom.identify.screening import detection_limits, size_over_limit
from tssgeom.identify.selection import name_of
from tssgeom.statistics import NORMAL_95


def law_candidates(search: LawSearch, held: HeldOut | None) -> tuple[Candidate, ...]:
    """Return the parts that were taken, each with the evidence that it adds to the others, the best first."""
    fit = search.fit
    held_ratio = math.nan if held is None else held.ratio(fit.point)  # of all together
    named = [_formula(search, held_ratio, which) for which in range(len(fit.at.effects))]
    laws = [_law(search, held_ratio, which) for which in range(len(fit.terms))]
    return tuple(sorted([*named, *laws], key=lambda one: -one.evidence.total))


def law_ranking(search: LawSearch, chosen: tuple[Candidate, ...]) -> tuple[Candidate, ...]:
    """Return what was chosen, then what was offered in the first round, with why it was passed over."""
    names = {one.names for one in chosen}
    others = sorted((_offered(offer) for offer in search.rounds[0]), key=lambda one: -one.evidence.total)
    return (*chosen, *(one for one in others if one.names not in names))


def _offered(offer: Offer) -> Candidate:
    fit = offer.fit
    evidence = Evidence(offer.gain, needed(fit), math.nan, math.nan, -offer.rise)
    why = f"{offer.veto}." if offer.veto else ""
    if offer.name:
        which = len(fit.at.effects) - 1
        effect = fit.at.effects[which]
        return Candidate((offer.label,), (effect,), (estimates(as_fit(fit), which),), evidence, why)
    term = fit.terms[-1]
    return Candidate((offer.label,), (term.mechanism.effect(term.u),), ({},), evidence, why)


def _evidence(search: LawSearch, held_ratio: float, effect: AnyEffect, which: int) -> Evidence:
    fit, problem = search.fit, search.problem
    point = fit.point
    rest = tuple(one for one in point.effects if one != effect)
    try:
        change = problem.left(point) - problem.left(replace(point, effects=rest))
        size = size_over_limit(problem.stack, change, detection_limits(problem.stack, problem.rig))
    except FitError:  # the others alone find no equilibrium
        size = math.nan
    return Evidence(search.added[which], needed(fit), size, held_ratio, search.fallen[which])


def _formula(search: LawSearch, held_ratio: float, which: int) -> Candidate:
    effect = search.fit.at.effects[which]
    name = name_of(effect)
    numbers = estimates(as_fit(search.fit), which, search.fit.covariance)
    return Candidate((name,), (effect,), (numbers,), _evidence(search, held_ratio, effect, which), "")


def _law(search: LawSearch, held_ratio: float, which: int) -> Candidate:
    term = search.fit.terms[which]
    effect, name = term.mechanism.effect(term.u), term.mechanism.name.partition(":")[0]
    return Candidate(
        (name,),
        (effect,),
        ({},),
        _evidence(search, held_ratio, effect, len(search.fit.at.effects) + which),
        "",
        curve(search.fit, which, _nearest(search, term.mechanism.name)),
    )


def _nearest(search: LawSearch, mechanism: str) -> tuple[tuple[str, float], ...]:
    """Return the formulae of a mechanism that were offered beside its law, and the evidence they lack."""
    for offers in search.rounds:
        law = next((one for one in offers if one.mechanism == mechanism and not one.name), None)
        if law is not None and not law.veto:
            near = [one for one in offers if one.name and one.mechanism == mechanism.partition(":")[0]]
            return tuple((one.name, law.gain - one.gain) for one in near)
    return ()


def curve(fit: LawFit, which: int, nearest: tuple[tuple[str, float], ...] = ()) -> LawCurve:
    """Return a law over its support with its 95 % band; docs/model.md (190), (352).

    Friction is the coefficient itself, and late strain the whole compliance, whose error the band holds too.
    """
    term = fit.terms[which]
    if term.mechanism.name == "strain_over_time":
        return _compliance(fit, which, nearest)
    covariance = _covariance(fit, which, beside=0)
    size = term.mechanism.size
    return law_curve(term.mechanism, np.eye(size), term.u, covariance, fit.at.friction, nearest)


def _compliance(fit: LawFit, which: int, nearest: tuple[tuple[str, float], ...]) -> LawCurve:
    """Return a law of creep as the compliance over time, its band over all times of its elements; (352)."""
    one, fits = fit.terms[which].mechanism, (fit, *fit.others)
    evidence = np.array([each.log_evidence for each in fits]) / fit.inflation
    weight = np.exp(evidence - evidence.max())
    logs, variances = np.array([_log_compliance(each, which) for each in fits]).swapaxes(0, 1)
    variance = weight @ (variances + (logs - logs[0]) ** 2) / weight.sum()
    spread = NORMAL_95 * np.sqrt(variance)
    low, middle, high = (read_only(np.exp(logs[0] + off)) for off in (-spread, 0.0, spread))
    return LawCurve(one.over, read_only(one.x), middle, low, high, "1/N", nearest)


def _log_compliance(fit: LawFit, which: int) -> tuple[Vector, Vector]:
    """Return the logarithm of the compliance over the time since a step of tension, and its variance."""
    one, u = fit.terms[which].mechanism, fit.terms[which].u
    grown = 1.0 + one.value(u)
    slope = np.column_stack([one.value(unit) for unit in np.eye(one.size)]) / grown[:, None]
    both = np.column_stack([np.ones(len(grown)), slope])
    variance = np.einsum("ki,ij,kj->k", both, _covariance(fit, which, beside=1), both)
    return np.log(fit.at.compliance * grown), np.maximum(variance, 0.0)


def _covariance(fit: LawFit, which: int, beside: int) -> Matrix:
    """Return that of the logarithm of friction (0) or compliance (1), and of the numbers of a law."""
    start = fit.at.size + sum(term.mechanism.size for term in fit.terms[:which])
    rows = [beside, *range(start, start + fit.terms[which].mechanism.size)]
    return fit.inflation * fit.covariance[np.ix_(rows, rows)]

"""Laws that were taken, as a finding shows them: curves with bands, and evidence; docs/model.md (190)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.effects import AnyEffect
from tssgeom.errors import FitError
from tssgeom.identify.assembly import estimates
from tssgeom.identify.finding import Candidate, Evidence, LawCurve
from tssgeom.identify.law_fit import LawFit
from tssgeom.identify.law_search import LawSearch, Offer, as_fit, needed
from tssgeom.identify.mechanisms import KNOTS, Mechanism
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
    one = fit.terms[which].mechanism
    middle, variance = _averaged(fit, which)
    spread = NORMAL_95 * np.sqrt(variance)
    low, high = middle - spread, middle + spread
    if _is_logarithm(one):
        low, middle, high = np.exp(low), np.exp(middle), np.exp(high)
    x, (middle, low, high) = finer(one, middle, low, high)
    unit = "1/N" if one.name == _LATE else one.unit
    return LawCurve(one.over, read_only(x), read_only(middle), read_only(low), read_only(high), unit, nearest)


_LATE = "strain_over_time"


def _is_logarithm(one: Mechanism) -> bool:
    return one.name == _LATE or one.name.startswith("friction_over")


def _averaged(fit: LawFit, which: int) -> tuple[Vector, Vector]:
    """Return a law, and its variance about it over all times of creep; docs/model.md (352)."""
    middle, variance = _own(fit, which)
    if not fit.others:
        return middle, variance
    fits = (fit, *fit.others)
    each = np.array([one.log_evidence for one in fits]) / _inflation(fit)
    weight = np.exp(each - each.max())
    of_fits = [(middle, variance), *(_own(one, which) for one in fit.others)]
    spread = np.array([own + (there - middle) ** 2 for there, own in of_fits])
    return middle, weight @ spread / weight.sum()


def _own(fit: LawFit, which: int) -> tuple[Vector, Vector]:
    """Return a law of one fit and its variance; of friction and compliance the logarithm of the whole."""
    term = fit.terms[which]
    one, start = term.mechanism, fit.at.size + sum(t.mechanism.size for t in fit.terms[:which])
    own = slice(start, start + one.size - one.more)
    middle = one.value(term.u)
    if not _is_logarithm(one):
        slope = _slope(one)
        return middle, _inflation(fit) * np.diag(slope @ fit.covariance[own, own] @ slope.T)
    if one.name == _LATE:
        number, base = 1, fit.at.compliance  # in the order of the numbers of a point
        middle = 1.0 + middle
        slope = _slope(one) / middle[:, None]
    else:
        number, base = 0, fit.at.friction
        slope = np.eye(len(middle))
    variance = np.diag(slope @ fit.covariance[own, own] @ slope.T)
    variance = variance + fit.covariance[number, number] + 2.0 * slope @ fit.covariance[number, own]
    return np.log(base * middle), _inflation(fit) * np.maximum(variance, 0.0)


def _inflation(fit: LawFit) -> float:
    return max(1.0, fit.chi2 / max(len(fit.left), 1))


def _slope(one: Mechanism) -> Matrix:
    """Return the derivatives of a law that is linear in its numbers [k, n]."""
    return np.column_stack([one.value(unit) for unit in np.eye(one.size)])


def finer(one: Mechanism, *values: Vector) -> tuple[Vector, list[Vector]]:
    """Return the knots of a curve made dense, and values there; what has no knots as it is."""
    if len(one.x) != len(one.warped) or len(one.x) < 2:
        return one.x, list(values)
    dense = np.linspace(0.0, 1.0, KNOTS.reported)
    x = core.tabulated(core.table_of(one.warped, one.x), dense)
    return x, [core.tabulated(core.table_of(one.x, each), x) for each in values]

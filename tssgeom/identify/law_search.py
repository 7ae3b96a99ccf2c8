"""Search for laws and formulae together, where no formula alone explains the readings; docs/model.md (191).

Forward, one part at a time, each held against the runs that were not fitted; a part that does not help there,
or that ends at a bound, is not taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tssgeom.errors import FitError, SettingsError
from tssgeom.identify.fit import Fit, Point, Problem, explained, freed
from tssgeom.identify.law_fit import Added, LawFit, Score, Term, fitted, score, with_bands, with_finest_knots
from tssgeom.identify.mechanism_names import MECHANISM_OF
from tssgeom.identify.mechanisms import Mechanism, mechanisms
from tssgeom.identify.misfit import HeldOut
from tssgeom.identify.prediction import FINE, simulated
from tssgeom.identify.screening import Variant, detected_size, screening, variants
from tssgeom.identify.selection import SEARCH, name_of, without
from tssgeom.least_squares import SOLVER
from tssgeom.statistics import EVIDENCE_SCALE


@dataclass(frozen=True, slots=True)
class LawSearchSettings:
    """How laws are searched, and when one is taken."""

    fitted: int = 4
    """Laws, and formulae, that are fitted after their score test, and best of both that are fitted to the end
    and judged; models of all kinds that are separated, at most; chosen for speed."""


LAW_SEARCH = LawSearchSettings()


@dataclass(frozen=True, slots=True)
class Offer:
    """One part on top of a model, fitted."""

    mechanism: str
    name: str
    """Of the formula; empty of a free law."""
    fit: LawFit
    gain: float
    """2 Δ ln Z against the model without it [1]."""
    rise: float = 0.0
    """Of χ² of the held-out runs [1]; infinite where they contradict it."""
    veto: str = ""
    """Why it is not taken; empty where it is."""

    @property
    def evidence(self) -> float:
        """2 Δ ln Z, and by how much χ² of the held-out runs falls [1]."""
        return self.gain - self.rise

    @property
    def is_contradicted(self) -> bool:
        """Whether it is a law that the held-out runs alone speak against."""
        return bool(self.veto) and not self.name and self.rise > 0.0

    @property
    def separable(self) -> float:
        """What another part has to have more of evidence to be clearly better [1]."""
        return EVIDENCE_SCALE.strong * self.fit.inflation

    @property
    def label(self) -> str:
        """Its formula, else its mechanism without the channel, which is a choice of its effect."""
        return self.name or self.mechanism.partition(":")[0]


LESS = "another part has more evidence"
_NOT_THERE = "the held-out runs do not show it"


@dataclass(frozen=True, slots=True)
class LawSearch:
    """What was taken, and all that was offered in each round."""

    problem: Problem
    base: LawFit
    fit: LawFit
    added: tuple[float, ...]
    """By formula, then by law: 2 Δ ln Z against the model without it [1]."""
    fallen: tuple[float, ...]
    """By formula, then by law: how much χ² of the held-out runs falls against the model without it [1]."""
    rounds: tuple[tuple[Offer, ...], ...]

    @property
    def taken(self) -> bool:
        """Whether anything was."""
        return bool(self.fit.terms or self.fit.at.effects)


def searched(
    problem: Problem,
    base: Fit,
    formulas: Sequence[Variant],
    held: HeldOut | None,
    limits: Mapping[str, float],
    report: Callable[[str], None],
) -> LawSearch:
    """Take laws and formulae as long as one helps on what was not fitted.

    Parameters
    ----------
    problem, base
        Readings, and the model without any part.
    formulas
        Effects of the library that can be tried.
    held
        The runs that nothing is fitted to.
    limits
        What each channel may be off by its specification [N, m].
    report
        Is called with each step in words.
    """
    start = fitted(problem, base.at, ())
    assert start is not None  # it was fitted before
    now, rounds = start, list[tuple[Offer, ...]]()
    everything = mechanisms(problem.stack, problem.rig)
    for number in range(SEARCH.most):
        report(f"laws, part {number + 1}")
        offers = _offers(problem, base.at, now, everything, formulas, held, limits)
        rounds.append(tuple(offers))
        taken = next((one for one in offers if not one.veto), None)
        if taken is None:
            break
        now = taken.fit
        if explained(now.chi2, problem.stack.size):
            break
    least, added, fallen = _pruned(problem, now, held, start)
    fine = _finest(problem, least, held, start)
    if fine is not least:  # a part may have stood for what coarse knots could not follow
        least, added, fallen = _pruned(problem, fine, held, start)
    banded = with_bands(problem, least) if least.terms else least
    return LawSearch(problem, start, banded, added, fallen, tuple(rounds))


def law_promises_more(problem: Problem, base: Fit, names: Point) -> bool:
    """Whether a law that has no formula promises more than names give, without them; docs/model.md (320)."""
    start, named = fitted(problem, base.at, ()), fitted(problem, names, ())
    if start is None or named is None or not names.effects:
        return False
    given = 2.0 * (named.log_evidence - start.log_evidence)
    with_formula = {MECHANISM_OF[one.name] for one in variants(problem.stack)[0]}
    without = (
        one
        for one in mechanisms(problem.stack, problem.rig)
        if one.name.partition(":")[0] not in with_formula
    )
    promised = (score(problem, start, one) for one in without)
    return any(one is not None and one.gain > given for one in promised)


def _finest(problem: Problem, fit: LawFit, held: HeldOut | None, base: LawFit) -> LawFit:
    """Return a fit with as many knots as a rig can hold, where that fits as well; (294)."""
    if not fit.terms:
        return fit
    again = with_finest_knots(problem, fit)
    if (
        again is not None
        and 2.0 * (again.log_evidence - fit.log_evidence) > -needed(fit)
        and not any(term.at_bound for term in again.terms)
        and _holds_with_fine_bars(problem, held, again)
        and (held is None or not held.change(base.at, base.at, again.point).worse)
    ):
        return again
    return fit


def _pruned(
    problem: Problem, fit: LawFit, held: HeldOut | None, base: LawFit
) -> tuple[LawFit, tuple[float, ...], tuple[float, ...]]:
    """Return a model without the parts that later ones have made needless, and what each adds; (191).

    That is 2 Δ ln Z, and by how much χ² of the held-out runs falls.
    """
    named, added, fallen = len(fit.at.effects), list[float](), list[float]()
    if named + len(fit.terms) < 2:
        rise = 0.0 if held is None else held.rise(base.point, fit.point)
        return fit, (2.0 * (fit.log_evidence - base.log_evidence),), (-rise,)
    for which in range(named + len(fit.terms)):
        if which < named:
            at, terms = without(fit.at, which), fit.terms
        else:
            at, terms = fit.at, tuple(term for k, term in enumerate(fit.terms) if k != which - named)
        less = fitted(problem, at, terms)
        gain = np.inf if less is None else 2.0 * (fit.log_evidence - less.log_evidence)
        rise = 0.0 if held is None or less is None else held.rise(less.point, fit.point)
        if less is not None and gain - rise < needed(fit):
            return _pruned(problem, less, held, base)
        added.append(gain)
        fallen.append(-rise)
    return fit, tuple(added), tuple(fallen)


def needed(fit: LawFit) -> float:
    """Return what 2 Δ ln Z has to pass, more where a fit leaves more than the sensors explain; (191)."""
    return EVIDENCE_SCALE.very_strong * fit.inflation


def as_fit(fit: LawFit) -> Fit:
    """Return a fit with laws as one of effects; its jacobian is that of the named part."""
    return Fit(fit.point, fit.chi2, fit.residual, fit.jacobian[:, : fit.at.size], fit.left)


def _offers(
    problem: Problem,
    base: Point,
    now: LawFit,
    everything: Sequence[Mechanism],
    formulas: Sequence[Variant],
    held: HeldOut | None,
    limits: Mapping[str, float],
) -> list[Offer]:
    """Return the best laws and formulae on top of a model, the best first, each judged."""
    has = {term.mechanism.name for term in now.terms} | {name_of(effect) for effect in now.at.effects}
    scored = [score(problem, now, one) for one in everything if one.name not in has]
    best = sorted((one for one in scored if one is not None), key=lambda one: -one.gain)[: LAW_SEARCH.fitted]
    starts = [_law_start(now, one) for one in best if one.gain > 0.0]
    starts += _formula_starts(problem, now, [one for one in formulas if one.name not in has])
    offers = list[Offer]()
    for start in starts:
        fit = fitted(problem, start.at, start.terms, SOLVER.quick, start.added)
        if fit is not None:
            gain = 2.0 * (fit.log_evidence - now.log_evidence)
            offers.append(Offer(start.mechanism, start.name, fit, gain))
    offers.sort(key=lambda one: -one.gain)
    judged = [_judged(problem, base, now, one, held, limits) for one in offers[: LAW_SEARCH.fitted]]
    rest = [replace(one, veto=LESS) for one in offers[LAW_SEARCH.fitted :]]
    if held is not None:
        judged = [_finer(problem, base, now, one, held) if one.is_contradicted else one for one in judged]
    return in_order(judged) + rest


def in_order(judged: Sequence[Offer]) -> list[Offer]:
    """Return judged offers, that to be taken first.

    It is the one with most evidence, held-out runs included; a formula where a law is not clearly better.
    """
    sound = sorted((one for one in judged if not one.veto), key=lambda one: -one.evidence)
    close = [one for one in sound if sound[0].evidence - one.evidence < one.separable]
    first = next((one for one in close if one.name), sound[0] if sound else None)
    others = [replace(one, veto=LESS) for one in sound if one is not first]
    vetoed = [one for one in judged if one.veto]
    return ([] if first is None else [first]) + sorted([*others, *vetoed], key=lambda one: -one.gain)


class _Start(NamedTuple):
    """Where the fit of one part on top of a model starts."""

    mechanism: str
    name: str
    """Of the formula; empty of a free law."""
    at: Point
    terms: tuple[Term, ...]
    added: Added


def _law_start(now: LawFit, one: Score) -> _Start:
    added = Added(now.jacobian, now.jacobian.shape[1], one.columns)
    return _Start(one.term.mechanism.name, "", now.at, (*now.terms, one.term), added)


def _formula_starts(problem: Problem, now: LawFit, formulas: Sequence[Variant]) -> list[_Start]:
    """Return the formulae that promise most by straight lines, each in its best variant."""
    tests = sorted(screening(problem, as_fit(now), formulas).tests, key=lambda test: -test.gain)
    length = max(reading.route.arcs.total_length for reading in problem.stack.readings)
    out, named = list[_Start](), set[tuple[str, str]]()
    for test in tests:
        name, key = test.variant.name, (test.variant.name, test.variant.law)
        if key in named or len(named) >= LAW_SEARCH.fitted:
            continue
        named.add(key)
        typical = abs(test.variant.effect.parameters[test.variant.amplitude].typical)
        amplitude = min(max(test.amplitude, -3.0 * typical), 3.0 * typical) or 0.1 * typical
        effect = test.variant.sized(amplitude)
        free = freed(effect, len(now.at.effects), length, test.variant.free)
        at = replace(now.at, effects=(*now.at.effects, effect), free=(*now.at.free, *free))
        added = Added(now.jacobian, now.at.size)
        out.append(_Start(MECHANISM_OF[name], name, at, now.terms, added))
    return out


def _judged(
    problem: Problem, base: Point, now: LawFit, one: Offer, held: HeldOut | None, limits: Mapping[str, float]
) -> Offer:
    """Return an offer fitted to the end, with why it is not taken; docs/model.md (191)."""
    least = needed(one.fit)
    if one.gain < 0.5 * least:
        return replace(one, veto=f"its evidence of {one.gain:.1f} is below {least:.1f}")
    fit = fitted(problem, one.fit.at, one.fit.terms) or one.fit
    gain = 2.0 * (fit.log_evidence - now.log_evidence)
    one = replace(one, fit=fit, gain=gain)
    if gain < least:
        return replace(one, veto=f"its evidence of {gain:.1f} is below {least:.1f}")
    size = detected_size(problem, now.left - fit.left, fit.at, limits)
    if size <= 1.0:
        return replace(one, veto=f"it changes no channel by more than {size:.2g} of the detection limit")
    if any(term.at_bound for term in fit.terms):
        return replace(one, veto="its law is at a bound")
    if fit.at.at_bound:
        return replace(one, veto="one of its numbers is at a bound")
    if not _holds_with_fine_bars(problem, held, fit):
        return replace(one, veto="it finds no equilibrium with finer bars")
    return one if held is None else _held_against(base, now, one, held)


def _held_against(base: Point, now: LawFit, one: Offer, held: HeldOut) -> Offer:
    """Return an offer as the runs that were held out judge it."""
    change = held.change(base, now.point, one.fit.point)
    one = replace(one, rise=change.rise, veto="")
    return replace(one, veto=change.worse or _NOT_THERE) if one.evidence < needed(one.fit) else one


def _finer(problem: Problem, base: Point, now: LawFit, one: Offer, held: HeldOut) -> Offer:
    """Return a law that held-out runs contradict with finer knots, where these fit clearly better; (351)."""
    fit = with_finest_knots(problem, one.fit)
    if fit is None or any(term.at_bound for term in fit.terms):
        return one
    if 2.0 * (fit.log_evidence - one.fit.log_evidence) < needed(one.fit):
        return one
    if not _holds_with_fine_bars(problem, held, fit):
        return one
    gain = 2.0 * (fit.log_evidence - now.log_evidence)
    return _held_against(base, now, replace(one, fit=fit, gain=gain), held)


def _holds_with_fine_bars(problem: Problem, held: HeldOut | None, fit: LawFit) -> bool:
    point = fit.point
    try:
        for each in (problem, *(() if held is None else (held.problem,))):
            simulated(each.stack, point.rig(each.rig), point.effects, bars=FINE)
    except (FitError, SettingsError):
        return False
    return True

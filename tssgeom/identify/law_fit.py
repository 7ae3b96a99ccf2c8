"""Fit of free laws inside the forward model: smoothness by marginal likelihood, bands from the posterior.

Each law has a Gaussian prior on its second differences; the rest is the fit of `fit.py`, by the method of
Levenberg and Marquardt. Source: docs/model.md (189), (190), (293), (294).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import CreepLaw
from tssgeom.errors import FitError, SettingsError
from tssgeom.identify.fit import Point, Problem, posed_about, prior_deviation, prior_sd
from tssgeom.identify.law_smoothness import law_precision, straight_model
from tssgeom.identify.mechanisms import FINEST, Mechanism, creep_law, mechanisms
from tssgeom.least_squares import SOLVER, Solution, derivatives, solve
from tssgeom.least_squares import Problem as LeastSquares


@dataclass(frozen=True, slots=True)
class LawFitSettings:
    """Priors and steps of the fit of laws."""

    roughness: tuple[float, ...] = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
    """S.d. of derivatives that are tried, in u; chosen: from a straight line to none at all."""
    level: float = 3.0
    """S.d. of each number of a law by itself, in u; chosen: free but for what is absurd."""
    other_times: tuple[float, ...] = (5.0**-0.5, 5.0**0.5)
    """Factors of the times of creep that the band counts too [1]; derived: half of the step between these."""
    whole: int = 4
    """Passes of the last fit. Chosen: twelve, as of other fits, make a campaign with laws a fifth slower."""
    halvings: int = 5
    """Times that a start without equilibrium is halved; chosen."""


LAW_FIT = LawFitSettings()


@dataclass(frozen=True, slots=True)
class Term:
    """One law within a model."""

    mechanism: Mechanism
    u: Vector
    roughness: float
    order: int = 2
    """Of the derivatives that the prior holds."""

    @property
    def at_bound(self) -> bool:
        """Whether any number of the law is at a bound that physics does not give."""
        one = self.mechanism
        return bool(
            np.any(self.u >= one.upper - 1e-9) or np.any((one.lower < 0.0) & (self.u <= one.lower + 1e-9))
        )


@dataclass(frozen=True, slots=True)
class LawFit:
    """A model with free laws, fitted."""

    at: Point
    """Its named part."""
    terms: tuple[Term, ...]
    chi2: float
    """Of residuals and priors [1]."""
    log_evidence: float
    """Of the readings, up to a constant of the problem [1]."""
    left: Vector
    """[rows] Measured less simulated [N, m]."""
    residual: Vector
    """[rows + k] Whitened [1]."""
    jacobian: Matrix
    """[rows + k, numbers] Of the named part, then of each law."""
    covariance: Matrix
    """Of the numbers."""
    others: tuple[LawFit, ...] = ()
    """With other times of creep, which the band counts too; (352)."""

    @property
    def inflation(self) -> float:
        """Factor of the covariance where more is left than errors explain [1]."""
        return max(1.0, self.chi2 / len(self.left))

    @property
    def point(self) -> Point:
        """The model with its laws as effects."""
        return with_terms(self.at, self.terms)

    def spread(self, which: int) -> Vector:
        """Return the s.d. of the numbers of one law, in u."""
        start = self.at.size + sum(term.mechanism.size for term in self.terms[:which])
        return np.sqrt(np.diag(self.covariance))[start : start + self.terms[which].mechanism.size]


def with_terms(at: Point, terms: Sequence[Term]) -> Point:
    """Return a model with laws as effects behind its own."""
    return replace(at, effects=(*at.effects, *(term.mechanism.effect(term.u) for term in terms)))


class Score(NamedTuple):
    """What straight lines promise of a law."""

    gain: float
    """2 Δ ln Z [1]."""
    term: Term
    """Where its fit starts."""
    columns: Matrix
    """[rows + k, numbers] Derivatives of the whitened prediction by its numbers there [1]."""


def score(problem: Problem, base: LawFit, mechanism: Mechanism) -> Score | None:
    """Return what a law promises on top of a model by straight lines; None where it changes nothing."""
    start = Term(mechanism, np.zeros(mechanism.size), LAW_FIT.roughness[0])
    laws = _Laws(problem, base.at, (*base.terms, start))
    own = -derivatives(laws.posed(), laws.start, base.left, base.jacobian.shape[1])
    if not np.any(own):
        return None
    jacobian = np.column_stack([base.jacobian, own])
    straight = straight_model(jacobian, base.residual, _deviation(problem, base.at, base.terms))
    best = None
    for term in _priors(start, (start.order,)):
        evidence = straight.evidence(_precision(base.at, (*base.terms, term)))
        if best is None or evidence > best[0]:
            best = evidence, term
    assert best is not None
    return Score(2.0 * (best[0] - base.log_evidence), best[1], own)


class Added(NamedTuple):
    """One part on top of a fitted model whose derivatives a quick fit takes over."""

    before: Matrix
    """[rows + k, numbers] Those of the model, of its prediction [1]."""
    first: int
    """Position of the first number of the part."""
    columns: Matrix | None = None
    """Those of the part at the start, where they are known."""


def fitted(
    problem: Problem,
    at: Point,
    terms: Sequence[Term],
    passes: int = LAW_FIT.whole,
    added: Added | None = None,
    orders: tuple[int, ...] = (),
) -> LawFit | None:
    """Fit a model with laws from a start; None where it finds no equilibrium near it.

    The derivatives are those of the last pass but one; `passes` is how often they are taken, with what was
    `added` only those of its numbers. `orders` are those of the priors that laws may have; left out, the
    second and what a law has already.
    """
    orders = orders or tuple({2, *(term.order for term in terms)})
    for _ in range(LAW_FIT.halvings):
        laws = _Laws(problem, at, tuple(terms), orders)
        posed = laws.posed() if added is None else _sharing(laws.posed(), added)
        end = solve(posed, laws.start, passes if terms or at.free else 0)
        if end is not None:
            return laws.fit(end)
        if not terms:
            break
        terms = (*terms[:-1], replace(terms[-1], u=0.5 * terms[-1].u))  # nearer to no law
    return None


def _sharing(plain: LeastSquares[None], added: Added) -> LeastSquares[None]:
    """Return a fit that takes derivatives of the added part alone, and those not where they are known."""
    known, held = added.columns, -added.before

    def jacobian(now: Solution[None]) -> Matrix:
        nonlocal known
        end = len(now.u) - held.shape[1] + added.first
        of_part = derivatives(plain, now.u, now.left, added.first, end) if known is None else -known
        known = None
        return np.column_stack([held[:, : added.first], of_part, held[:, added.first :]])

    return replace(plain, jacobian=jacobian)


@dataclass(slots=True)
class _Laws:
    """A model with laws while it is fitted: numbers of its named part from where it is, then of each law."""

    problem: Problem
    at: Point
    terms: tuple[Term, ...]
    """With the last roughness."""
    orders: tuple[int, ...] = (2,)

    @property
    def start(self) -> Vector:
        """The numbers at the start."""
        return np.concatenate([np.zeros(self.at.size), *(term.u for term in self.terms)])

    def model_at(self, u: Vector) -> tuple[Point, tuple[Term, ...]]:
        """Return named part and laws at some numbers."""
        ends = self.at.size + np.cumsum([0, *(term.mechanism.size for term in self.terms)])
        each = zip(self.terms, ends, ends[1:], strict=False)
        return self.at.moved(u[: self.at.size]), tuple(replace(term, u=u[i:j]) for term, i, j in each)

    def left(self, u: Vector) -> tuple[Vector, None] | None:
        """Return measured less simulated; None where there is no equilibrium."""
        try:
            return self.problem.left(with_terms(*self.model_at(u))), None
        except (FitError, SettingsError):
            return None

    def smoothed(self, u: Vector, residual: Vector, jacobian: Matrix) -> Matrix:
        """Return the precision of the prior with the likeliest roughness of each law."""
        at, terms = self.model_at(u)
        self.terms = _smoothed(self, at, terms, -jacobian, residual)
        return _precision(at, self.terms)

    def posed(self) -> LeastSquares[None]:
        """Return the fit."""
        named, laws = posed_about(self.problem, self.at), [term.mechanism for term in self.terms]
        none = np.zeros(sum(one.size for one in laws))

        def longer(of_named: Vector | float, *of_laws: Vector) -> Vector:
            return np.concatenate([np.broadcast_to(of_named, self.at.size), *of_laws])

        return LeastSquares(
            *(self.left, self.smoothed),
            lower=longer(named.lower, *(one.lower * np.ones(one.size) for one in laws)),
            upper=longer(named.upper, *(one.upper * np.ones(one.size) for one in laws)),
            centre=longer(named.centre, none),
            step=longer(named.step, none + SOLVER.coarse_step),
            longest=longer(named.longest, *(np.full(one.size, _longest(one)) for one in laws)),
            whitened=self.problem.whitening.whitened,
            close=named.close,
        )

    def fit(self, end: Solution[None]) -> LawFit:
        """Return the fit with its evidence; docs/model.md (190)."""
        at, terms = self.model_at(end.u)
        normal = end.jacobian.T @ end.jacobian + end.precision
        (_, whole), (_, prior) = np.linalg.slogdet(normal), np.linalg.slogdet(end.precision)
        evidence = -0.5 * (end.chi2 + float(whole) - float(prior))
        rest = evidence, end.left, end.residual, -end.jacobian, end.covariance
        return LawFit(at, terms, end.chi2, *rest)


def _longest(law: Mechanism) -> float:
    """Return the step that one pass of a fit may take, in u."""
    return np.inf if law.is_straight else 0.5 * LAW_FIT.level


def _precision(at: Point, terms: Sequence[Term]) -> Matrix:
    """Return the precision of the prior of all numbers."""
    blocks = [np.diag(prior_sd(at) ** -2.0)]
    blocks += [law_precision(one.mechanism, one.roughness, LAW_FIT.level, one.order) for one in terms]
    size = sum(len(block) for block in blocks)
    out, start = np.zeros((size, size)), 0
    for block in blocks:
        stop = start + len(block)
        out[start:stop, start:stop] = block
        start = stop
    return out


def _deviation(problem: Problem, at: Point, terms: Sequence[Term]) -> Vector:
    """Return how far all numbers are from the centre of their priors."""
    return np.concatenate([prior_deviation(problem, at), *(term.u for term in terms)])


def _smoothed(
    laws: _Laws, at: Point, terms: tuple[Term, ...], jacobian: Matrix, residual: Vector
) -> tuple[Term, ...]:
    """Return the laws with the prior that the readings make most likely, one law after the other."""
    straight = straight_model(jacobian, residual, _deviation(laws.problem, at, terms))
    for which in range(len(terms)):
        tried = [(*terms[:which], one, *terms[which + 1 :]) for one in _priors(terms[which], laws.orders)]
        terms = max(tried, key=lambda one: straight.evidence(_precision(at, one)))
    return terms


def _priors(term: Term, orders: tuple[int, ...]) -> Iterator[Term]:
    """Yield a law with every prior that it may have."""
    for order, roughness in product(orders, LAW_FIT.roughness):
        yield replace(term, order=order, roughness=roughness)


def spread_over_priors(problem: Problem, fit: LawFit, orders: tuple[int, ...]) -> LawFit:
    """Return a fit with the covariance over all priors that its laws may have; docs/model.md (294)."""
    straight = straight_model(fit.jacobian, fit.residual, _deviation(problem, fit.at, fit.terms))
    every = product(*(tuple(_priors(term, orders)) for term in fit.terms))
    return replace(fit, covariance=straight.covariance([_precision(fit.at, terms) for terms in every]))


ORDERS = (1, 2)
"""Derivatives that a prior of a law may hold: laws that step, and laws that bend."""


def with_finest_knots(problem: Problem, fit: LawFit) -> LawFit | None:
    """Return a fit whose laws have as many knots as a rig can hold; None where it finds no equilibrium."""
    by_name = {one.name: one for one in mechanisms(problem.stack, problem.rig, FINEST)}
    terms = [with_knots(term, by_name[term.mechanism.name]) for term in fit.terms]
    return fitted(problem, fit.at, terms, orders=ORDERS)


def with_bands(problem: Problem, fit: LawFit) -> LawFit:
    """Return a fit with the covariance over all priors, and times, that its laws may have; (294), (352)."""
    others = (each for factor in LAW_FIT.other_times if (each := with_other_times(problem, fit, factor)))
    others = tuple(spread_over_priors(problem, each, ORDERS) for each in others)
    return replace(spread_over_priors(problem, fit, ORDERS), others=others)


def with_other_times(problem: Problem, fit: LawFit, factor: float) -> LawFit | None:
    """Return a fit whose elements of creep have times by a factor; None without any, or no equilibrium."""
    laws = [term.mechanism.effect(np.ones(term.mechanism.size)) for term in fit.terms]
    if not any(isinstance(law, CreepLaw) for law in laws):
        return None
    terms = tuple(
        replace(term, mechanism=creep_law(factor * np.array(law.time_s), term.mechanism.x))
        if isinstance(law, CreepLaw)
        else term
        for term, law in zip(fit.terms, laws, strict=True)
    )
    return fitted(problem, fit.at, terms, orders=ORDERS)


def with_knots(term: Term, fine: Mechanism) -> Term:
    """Return a law at other knots."""
    own = term.mechanism
    if fine.size == own.size:
        return term
    curve, more = np.split(term.u, [own.size - own.more])
    there = core.tabulated(core.table_of(own.warped, _values(own, curve)), fine.warped)
    return replace(term, mechanism=fine, u=np.concatenate([_numbers(fine, there), more]))


def _values(one: Mechanism, u: Vector) -> Vector:
    """Return a law at all its knots, in u."""
    values = np.cumsum(u) if one.rising else u
    return np.concatenate([np.zeros(int(one.pinned)), values])


def _numbers(one: Mechanism, values: Vector) -> Vector:
    """Return the numbers of a law with these values at all its knots, in u."""
    return np.diff(values) if one.rising else values[int(one.pinned) :]

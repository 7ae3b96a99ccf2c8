"""Fit of free laws inside the forward model: smoothness by marginal likelihood, bands from the posterior.

Each law has a Gaussian prior on its second differences; the rest is the fit of `fit.py`, by the method of
Levenberg and Marquardt. Source: docs/model.md (189), (190); S. N. Wood, Fast stable restricted maximum
likelihood and marginal likelihood estimation of semiparametric generalized linear models, J. R. Stat. Soc. B
73 (2011).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import FitError, SettingsError
from tssgeom.identify.fit import Point, Problem, columns, prior_deviation, prior_sd
from tssgeom.identify.mechanisms import Mechanism


@dataclass(frozen=True, slots=True)
class LawFitSettings:
    """Priors and steps of the fit of laws."""

    roughness: tuple[float, ...] = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
    """S.d. of second derivatives that are tried, in u; chosen: from a straight line to none at all."""
    level: float = 3.0
    """S.d. of each number of a law by itself, in u; chosen: free but for what is absurd."""
    step: float = 0.02
    """Step of derivatives, in u; chosen: far above rounding, far below a law's size."""
    done: float = 0.1
    """Fall of χ² that ends the fit [1]; chosen."""
    quick: int = 2
    """Passes of a first fit; chosen for speed."""
    whole: int = 4
    """Passes of the last fit; chosen."""
    halvings: int = 5
    """Times that a start without equilibrium is halved; chosen."""
    longest: float = 1.5
    """Longest step of any number of a law, in u; chosen."""


LAW_FIT = LawFitSettings()


@dataclass(frozen=True, slots=True)
class Term:
    """One law within a model."""

    mechanism: Mechanism
    u: Vector
    roughness: float

    @property
    def at_bound(self) -> bool:
        """Whether any number of the law is at a bound that physics does not give."""
        one = self.mechanism
        return bool(
            np.any(self.u >= one.upper - 1e-9) or (one.lower < 0.0 and np.any(self.u <= one.lower + 1e-9))
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


def score(problem: Problem, base: LawFit, mechanism: Mechanism) -> tuple[float, Term] | None:
    """Return how much a law promises by straight lines, 2 Δ ln Z [1], and its start; None without."""
    start = Term(mechanism, np.zeros(mechanism.size), LAW_FIT.roughness[0])
    own = _columns_of(problem, base.at, base.left, (*base.terms, start), len(base.terms))
    if not np.any(own):
        return None
    jacobian = np.column_stack([base.jacobian, own])
    straight = straight_model(jacobian, base.residual, _deviation(problem, base.at, base.terms))
    best = None
    for roughness in LAW_FIT.roughness:
        term = replace(start, roughness=roughness)
        evidence = straight.evidence(_precision(base.at, (*base.terms, term)))
        if best is None or evidence > best[0]:
            best = evidence, term
    assert best is not None
    return 2.0 * (best[0] - base.log_evidence), best[1]


def fitted(problem: Problem, at: Point, terms: Sequence[Term], passes: int = LAW_FIT.whole) -> LawFit | None:
    """Fit a model with laws from a start; None where it finds no equilibrium near it.

    The derivatives are those of the last pass but one; `passes` is how often they are taken.
    """
    start = _started(problem, at, tuple(terms))
    if start is None:
        return None
    now, left = start
    damping, residual = 1e-3, problem.whitening.whitened(left)
    jacobian = _jacobian(problem, at, now, left)
    for number in range(passes if now or at.free else 0):
        if number:
            jacobian = _jacobian(problem, at, now, left)
        now = _smoothed(problem, at, now, jacobian, residual)
        chi2 = _chi2(problem, at, now, residual)
        better = _better(problem, (at, now), (jacobian, residual, chi2), damping)
        if better is None:
            break
        at, now, left, after, damping = better
        residual = problem.whitening.whitened(left)
        if chi2 - after < LAW_FIT.done:
            break
    precision = _precision(at, now)
    normal, chi2 = jacobian.T @ jacobian + precision, _chi2(problem, at, now, residual)
    (_, whole), (_, prior) = np.linalg.slogdet(normal), np.linalg.slogdet(precision)
    evidence = -0.5 * (chi2 + float(whole) - float(prior))  # docs/model.md (190)
    covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    return LawFit(at, now, chi2, evidence, left, residual, jacobian, covariance)


def _started(problem: Problem, at: Point, terms: tuple[Term, ...]) -> tuple[tuple[Term, ...], Vector] | None:
    """Return laws from which there is an equilibrium, nearer to none where need be, and what they leave."""
    for _ in range(LAW_FIT.halvings):
        try:
            return terms, problem.left(with_terms(at, terms))
        except (FitError, SettingsError):
            if not terms:
                return None
            terms = (*terms[:-1], replace(terms[-1], u=0.5 * terms[-1].u))
    return None


def _jacobian(problem: Problem, at: Point, terms: Sequence[Term], left: Vector) -> Matrix:
    point = with_terms(at, terms)
    parts = [columns(problem, point, left)]
    parts += [_columns_of(problem, at, left, terms, which) for which in range(len(terms))]
    return np.column_stack(parts)


def _columns_of(problem: Problem, at: Point, left: Vector, terms: Sequence[Term], which: int) -> Matrix:
    """Return derivatives of the whitened prediction by the numbers of one law [rows + k, size]."""
    out = [_slope(problem, at, left, terms, which, k) for k in range(terms[which].mechanism.size)]
    return problem.whitening.whitened(np.column_stack(out))


def _slope(problem: Problem, at: Point, left: Vector, terms: Sequence[Term], which: int, k: int) -> Vector:
    term = terms[which]
    for sign in (1.0, -1.0):
        u = term.u.copy()
        u[k] += sign * LAW_FIT.step
        moved = (*terms[:which], replace(term, u=u), *terms[which + 1 :])
        try:
            return sign * (left - problem.left(with_terms(at, moved))) / LAW_FIT.step
        except (FitError, SettingsError):
            continue
    return np.zeros_like(left)


def _precision(at: Point, terms: Sequence[Term]) -> Matrix:
    """Return the precision of the prior of all numbers."""
    blocks = [np.diag(prior_sd(at) ** -2.0)]
    blocks += [term.mechanism.penalty(term.roughness, LAW_FIT.level) for term in terms]
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


def _chi2(problem: Problem, at: Point, terms: Sequence[Term], residual: Vector) -> float:
    off = _deviation(problem, at, terms)
    return float(residual @ residual + off @ _precision(at, terms) @ off)


@dataclass(frozen=True, slots=True)
class Straight:
    """A model made straight, as far as its evidence needs it."""

    information: Matrix
    """[numbers, numbers]"""
    slope: Vector
    """[numbers]"""
    square: float
    """Of all residuals from the centre of the priors [1]."""

    def evidence(self, precision: Matrix) -> float:
        """Return the log evidence under a prior of this precision; docs/model.md (190)."""
        normal = self.information + precision
        gain = float(self.slope @ np.linalg.solve(normal, self.slope))
        (_, whole), (_, prior) = np.linalg.slogdet(normal), np.linalg.slogdet(precision)
        return -0.5 * (self.square - gain + float(whole) - float(prior))


def straight_model(jacobian: Matrix, residual: Vector, deviation: Vector) -> Straight:
    """Make a model straight about numbers that are so far from the centre of their priors.

    Parameters
    ----------
    jacobian
        [rows, numbers] Of the whitened prediction [1].
    residual
        [rows] Measured less predicted, whitened [1].
    deviation
        Of the first numbers; those behind are at their centres.
    """
    pseudo = residual + jacobian[:, : len(deviation)] @ deviation
    return Straight(jacobian.T @ jacobian, jacobian.T @ pseudo, float(pseudo @ pseudo))


def _smoothed(
    problem: Problem, at: Point, terms: tuple[Term, ...], jacobian: Matrix, residual: Vector
) -> tuple[Term, ...]:
    """Return the laws with the roughness that the readings make most likely, one law after the other."""
    straight = straight_model(jacobian, residual, _deviation(problem, at, terms))
    for which in range(len(terms)):
        tried = [
            (*terms[:which], replace(terms[which], roughness=roughness), *terms[which + 1 :])
            for roughness in LAW_FIT.roughness
        ]
        terms = max(tried, key=lambda one: straight.evidence(_precision(at, one)))
    return terms


def _better(
    problem: Problem,
    model: tuple[Point, tuple[Term, ...]],
    linear: tuple[Matrix, Vector, float],
    damping: float,
) -> tuple[Point, tuple[Term, ...], Vector, float, float] | None:
    """Return the first step that makes χ² fall, with residuals, χ² and damping; None where none does."""
    (at, terms), (jacobian, residual, chi2) = model, linear
    precision = _precision(at, terms)
    normal = jacobian.T @ jacobian + precision
    slope = jacobian.T @ residual - precision @ _deviation(problem, at, terms)
    for _ in range(6):
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slope)
        moved, start = list[Term](), at.size
        for term in terms:
            by = np.clip(step[start : start + term.mechanism.size], -LAW_FIT.longest, LAW_FIT.longest)
            moved.append(replace(term, u=_allowed(term.mechanism, term.u + by)))
            start += term.mechanism.size
        trial = at.moved(np.asarray(step[: at.size], dtype=np.float64))
        try:
            left = problem.left(with_terms(trial, moved))
        except (FitError, SettingsError):
            damping *= 10.0
            continue
        after = _chi2(problem, trial, moved, problem.whitening.whitened(left))
        if after < chi2:
            return trial, tuple(moved), left, after, max(damping / 10.0, 1e-6)
        damping = max(10.0 * damping, 1e-2)
    return None


def _allowed(mechanism: Mechanism, u: Vector) -> Vector:
    return np.asarray(np.clip(u, mechanism.lower, mechanism.upper), dtype=np.float64)

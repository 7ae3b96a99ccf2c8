"""Laws that were taken, with as many knots as a rig can hold, and bands over all priors that they may have.

A search needs few knots. A band needs more: between knots it holds only what a curve through them can be.
Source: docs/model.md (293), (294).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tssgeom import core
from tssgeom.arrays import Vector
from tssgeom.identify.fit import Problem
from tssgeom.identify.law_fit import LawFit, Term, fitted, spread_over_priors
from tssgeom.identify.mechanisms import FINEST, Mechanism, mechanisms

_ORDERS = (1, 2)  # of derivatives that a prior may hold: laws that step, and laws that bend


def with_finest_knots(problem: Problem, fit: LawFit) -> LawFit | None:
    """Return a fit whose laws have as many knots as a rig can hold; None where it finds no equilibrium."""
    by_name = {one.name: one for one in mechanisms(problem.stack, problem.rig, FINEST)}
    terms = [with_knots(term, by_name[term.mechanism.name]) for term in fit.terms]
    return fitted(problem, fit.at, terms, orders=_ORDERS)


def with_bands(problem: Problem, fit: LawFit) -> LawFit:
    """Return a fit with the covariance over all priors that its laws may have; docs/model.md (294)."""
    return spread_over_priors(problem, fit, _ORDERS)


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

"""How well runs determine a free law of a machine: what its knots do, and the band over all its priors.

Source: docs/model.md (294), (312).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants_tendon_rows import TABLE
from tssgeom.identify.finding import LawCurve
from tssgeom.identify.law_fit import ORDERS
from tssgeom.identify.law_smoothness import law_curve, straight_model
from tssgeom.identify.machine_laws import FreeLaw
from tssgeom.identify.machine_parts import Number, Part
from tssgeom.identify.machine_problem import FitState, Problem
from tssgeom.identify.machine_score import with_part
from tssgeom.uncertain import Prior

_UNIT = Prior(0.0, 1.0, log=False)


def law_part(law: FreeLaw) -> Part:
    """Return a law as a part."""
    waves = (Number(f"wave {k + 1}", law.name, "1", _UNIT, 0.0) for k in range(law.size))
    return Part(law.name, law, tuple(waves))


def law_band(problem: Problem, state: FitState, law: FreeLaw) -> LawCurve:
    """Return a fitted law with its band over all priors; that of these alone without an equilibrium near."""
    at = problem.waves_of(law)
    others = np.array([j for j in range(len(state.u)) if j not in at])
    fine = law.with_knots(TABLE.most)
    numbers = fine.numbers_of(law, state.u[at])
    rest = replace(
        problem,
        parameters=tuple(problem.parameters[j] for j in others),
        laws=tuple(one for one in problem.laws if one is not law),
    )
    of_knots = by_knots(fine, rest, state.u[others], numbers)
    if of_knots is None:
        of_knots = np.zeros((sum(map(len, state.left)), len(fine.waves)))
    weight = np.concatenate(state.weight)
    slope = np.column_stack([state.slope(problem)[:, others], weight[:, None] * (of_knots @ fine.waves)])
    deviation = np.concatenate([state.u[others], numbers])
    line = straight_model(-slope, weight * np.concatenate(state.left), deviation)
    n, back = len(others), np.linalg.pinv(fine.waves)
    precisions = []
    for prior in fine.as_rough(ORDERS, 0.0):
        own = back @ prior.waves
        precision = np.eye(len(deviation))
        precision[n:, n:] = np.linalg.inv(own @ own.T)
        precisions.append(precision)
    covariance = line.covariance(precisions)
    first = [problem.parameters[j].key for j in others].index("friction.coefficient")
    prior, of_law = rest.parameters[first].prior, [first, *range(n, len(deviation))]
    scale = np.diag([prior.sd, *np.ones(fine.size)])
    own = scale @ covariance[np.ix_(of_law, of_law)] @ scale
    return law_curve(fine.mechanism, fine.waves, numbers, own, prior.value(state.u[others][first]))


def by_knots(law: FreeLaw, problem: Problem, u: Vector, numbers: Vector) -> Matrix | None:
    """Return derivatives of what is left by u at the knots that the waves of a law reach [rows, k] [SI].

    Parameters
    ----------
    law, numbers
        The law that is added to a problem, and its numbers there [waves].
    problem, u
        The problem without it, and its numbers.

    Returns
    -------
    None where the machine has no equilibrium there, or the law changes nothing.
    """
    longer, columns = with_part(problem, law_part(law)), list[Vector]()
    here = longer.model(np.concatenate([u, numbers]))
    if here is None:
        return None
    left = np.concatenate(longer.left(here))
    for k, step in enumerate(law.steps):
        moved = numbers.copy()
        moved[k] += step
        there = longer.model(np.concatenate([u, moved]))
        if there is None:
            return None
        columns.append((np.concatenate(longer.left(there)) - left) / step)
    by_waves = np.column_stack(columns)
    return np.asarray(by_waves @ np.linalg.pinv(law.waves)) if np.any(by_waves) else None

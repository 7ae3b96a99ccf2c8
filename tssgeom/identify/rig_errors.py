"""Errors of the numbers that a fit puts into a rig, with their correlations; docs/model.md (318)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import SettingsError
from tssgeom.identify.assembly import updated
from tssgeom.identify.calibration import Calibration
from tssgeom.identify.fit import Fit, Problem
from tssgeom.identify.fit_quality import unexplained
from tssgeom.identify.law_fit import LawFit, Term, with_terms
from tssgeom.identify.machine_posterior import Posterior
from tssgeom.identify.machine_problem import Problem as MachineProblem
from tssgeom.least_squares import SOLVER
from tssgeom.rig import Rig, with_values
from tssgeom.uncertain import RigErrors, assumed

_CURVES = ("factor", "stretch", "ratio", "error", "torque")  # of laws, as effects name them


def of_calibration(fitted: Calibration, rig: Rig) -> RigErrors:
    """Return the errors of what `Calibration.applied` puts into a rig, by their keys there."""
    made = fitted.applied(rig)
    keys = {"friction": "friction.coefficient", "compliance": "tendon.compliance_per_N"}
    if made.effects != rig.effects:
        keys["tension_out_offset"] = f"effects[{len(made.effects) - 1}].offset_N"
    known = {name for name in keys if fitted.estimates[name].observable}
    at = [k for k, name in enumerate(fitted.fitted_names) if name in known]
    names = [fitted.fitted_names[k] for k in at]
    values = [1.0 if name.endswith("offset") else fitted.estimates[name].value for name in names]
    is_log = [not name.endswith("offset") for name in names]
    errors = _errors([keys[name] for name in names], values, is_log, fitted.covariance[np.ix_(at, at)])
    return replace(errors, unexplained=unexplained(fitted.channels))


def of_machine(problem: MachineProblem, posterior: Posterior) -> RigErrors:
    """Return the errors of the numbers of the rig that were fitted, in the units of the rig."""
    alone = np.eye(len(posterior.u))
    at = [j for j, each in enumerate(problem.parameters) if each.kind == "rig"]
    fitted = [problem.parameters[j] for j in at]
    scale = np.array([each.prior.sd for each in fitted])
    own = np.sqrt(np.diag(posterior.covariance)[at])
    true = np.array([posterior.of(alone[j])[0] for j in at])
    unit = scale * true / own
    covariance = posterior.covariance[np.ix_(at, at)] * np.outer(unit, unit)
    values = [each.value(posterior.u[j]) for j, each in zip(at, fitted, strict=True)]
    return _errors([each.key for each in fitted], values, [each.prior.log for each in fitted], covariance)


def of_fit(problem: Problem, fit: Fit | LawFit, others: Matrix) -> RigErrors:
    """Return the errors of what a campaign puts into a rig: friction, compliance, effects and laws.

    Those of the angles of routes count too, (115), but for their common gain, which commands count. `others`
    is what these may be off beside the directions that the fit counts [rows, m] [N, m].
    """
    at, terms = (fit.at, fit.terms) if isinstance(fit, LawFit) else (fit.at, ())
    moved = fit.covariance @ (fit.jacobian.T @ problem.whitening.whitened(others))
    covariance = fit.inflation * fit.covariance + moved @ moved.T
    slope = [at.friction, at.compliance]
    keys, first = ["friction.coefficient", "tendon.compliance_per_N"], len(problem.rig.effects)
    values = [at.friction, at.compliance]
    for free in at.free:
        keys.append(f"effects[{first + free.effect}].{free.key}")
        values.append(float(getattr(at.effects[free.effect], free.key)))
        slope.append(values[-1] if free.log else free.unit)
    slopes = [np.diag(np.pad(slope, (0, len(at.zeros))))[: len(slope)]]
    for which, term in enumerate(terms, first + len(at.effects)):
        name, curve, by = _curve(term)
        keys += [f"effects[{which}].{name}[{k}]" for k in range(len(curve))]
        values += curve.tolist()
        slopes.append(by)
    whole = np.asarray(block_diag(*slopes), dtype=np.float64)
    made = updated(problem.rig, with_terms(at, terms))
    return _possible(keys, np.array(values), whole @ covariance @ whole.T, made)


def _curve(term: Term) -> tuple[str, Vector, Matrix]:
    """Return name and values of the curve of a law, and their derivatives by the numbers of the law."""
    effect = term.mechanism.effect
    name = next(name for name in effect(term.u).__struct_fields__ if name in _CURVES)

    def curve(u: Vector) -> Vector:
        return np.array(getattr(effect(u), name))

    columns = list[Vector]()
    for way in SOLVER.step * np.eye(len(term.u)):
        try:
            columns.append((curve(term.u + way) - curve(term.u)) / SOLVER.step)
        except SettingsError:  # it is at a bound
            columns.append((curve(term.u) - curve(term.u - way)) / SOLVER.step)
    return name, curve(term.u), np.column_stack(columns)


def _possible(keys: Sequence[str], values: Vector, covariance: Matrix, rig: Rig) -> RigErrors:
    """Return errors of numbers of a rig, but of those whose bounds are within a standard deviation."""
    sd = np.sqrt(np.diag(covariance))
    at = [k for k, key in enumerate(keys) if sd[k] > 0.0 and _may_err(rig, key, values[k], sd[k])]
    known = sd[at]
    correlation = covariance[np.ix_(at, at)] / np.outer(known, known)
    return RigErrors(tuple(keys[k] for k in at), tuple(known.tolist()), correlation)


def _may_err(rig: Rig, key: str, value: float, sd: float) -> bool:
    prior = assumed(key, float(value), float(sd))
    try:
        return all(with_values(rig, {key: prior.value(sign)}) for sign in (-1.0, 1.0))
    except SettingsError:
        return False


def _errors(
    keys: Sequence[str], values: Sequence[float], is_log: Sequence[bool], covariance: Matrix
) -> RigErrors:
    """Return errors of numbers whose covariance is that of their logarithms, where `is_log`."""
    own = np.sqrt(np.diag(covariance))
    sd = [
        value * math.sqrt(math.expm1(each**2)) if log else each
        for value, log, each in zip(values, is_log, own.tolist(), strict=True)
    ]
    return RigErrors(tuple(keys), tuple(sd), covariance / np.outer(own, own))

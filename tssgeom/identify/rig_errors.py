"""Errors of the numbers that a fit puts into a rig, with their correlations; docs/model.md (318)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tssgeom.arrays import Matrix
from tssgeom.identify.calibration import Calibration
from tssgeom.identify.machine_posterior import Posterior
from tssgeom.identify.machine_problem import Problem
from tssgeom.rig import Rig
from tssgeom.uncertain import RigErrors


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
    return _errors([keys[name] for name in names], values, is_log, fitted.covariance[np.ix_(at, at)])


def of_machine(problem: Problem, posterior: Posterior) -> RigErrors:
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

"""What a machine that was fitted to the begin of every run predicts of its end; docs/model.md (246).

Cycles that are held out between fitted ones do not show whether a part goes on as it was fitted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tssgeom.errors import FitError
from tssgeom.identify.fit_quality import weights_of
from tssgeom.identify.machine_evidence import FittedModel, contradicted, held_out_rises, modelled, worse
from tssgeom.identify.machine_fit import fit_round, fitted_again
from tssgeom.identify.machine_problem import fitted_rows
from tssgeom.identify.machine_run import MachineRun, turns_of
from tssgeom.identify.readings import READING
from tssgeom.tendon.machine_simulation import drive_channels


def contradiction(before: FittedModel | None, model: FittedModel) -> str:
    """Return which channel at the end of the runs parts make worse, in a clause; empty where none; (246).

    `before` is the forecast without parts.
    """
    if before is None or (after := forecast(model)) is None:
        return ""
    clause = worse(before, after, contradicted(held_out_rises(before, after)))
    return f"{clause}, where only the first two thirds of the runs are fitted" if clause else ""


def forecast(model: FittedModel) -> FittedModel | None:
    """Return a model fitted to the begin of every run; None where that has no equilibrium."""
    runs = tuple(replace(run, held_out=_at_end(run)) for run in model.problem.runs)
    problem = replace(model.problem, runs=runs, rows=fitted_rows(runs, held_out=False))
    try:
        channels = problem.model(model.state.u)
        if channels is None:
            return None
        problem, state = fitted_again(
            problem, fit_round(problem, model.state.u, *weights_of(problem.left(channels)))
        )
        return modelled(problem, state, model.parts, (), model.fixed)
    except FitError:
        return None


def _at_end(run: MachineRun) -> np.ndarray:
    """Return which samples are the end of a run, from a turn on where there are enough [n] bool."""
    motion = run.given[drive_channels(run.drive, run.tendons)[0]]
    first = round((1.0 - 1.0 / READING.cycles) * len(motion))
    edges = turns_of(motion)[1:-1]
    if len(edges) > 2:
        first = int(edges[np.argmin(np.abs(np.asarray(edges) - first))])
    return np.arange(len(motion)) > first

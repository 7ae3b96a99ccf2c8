"""Motors that go straight from reading to reading, where runs are likelier so; docs/model.md (304)."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import FitError
from tssgeom.identify.machine_evidence import FittedModel, delta_bic, own_numbers
from tssgeom.identify.machine_fit import fit_from
from tssgeom.identify.machine_parameters import parameters_of
from tssgeom.identify.machine_problem import FitState, Problem, fitted_rows
from tssgeom.identify.machine_run import MachineRun, straight_between_readings, turns_apart
from tssgeom.uncertain import Uncertain

STRAIGHT = "The motor goes straight from reading to reading: so the runs are likelier."
"""What is said of such runs."""


def straight_fit(
    problem: Problem,
    state: FitState,
    uncertain: Sequence[Uncertain],
    extended: Callable[[Problem, FitState], tuple[Problem, Vector]] | None = None,
) -> tuple[Problem, FitState] | None:
    """Return the fit with motors that go straight between readings, where it is the likelier one.

    Parameters
    ----------
    problem, state
        A fit with motors as they were read.
    uncertain
        What is not certain of its rig.
    extended
        As `fit_from` takes it.
    """
    runs = tuple(map(straight_between_readings, problem.runs))
    if not any(itertools.starmap(turns_apart, zip(problem.runs, runs, strict=True))):
        return None
    parameters = tuple(parameters_of(runs, problem.rig, uncertain))
    start = np.array(
        [0.0 if each.kind == "turn" else u for each, u in zip(parameters, state.u, strict=False)]
    )
    rows = fitted_rows(runs, held_out=False)
    try:
        straight = Problem(runs, problem.rig, parameters, rows, problem.bars)
        made = fit_from(straight, start, lambda _: None, extended)
    except FitError:
        return None
    before, after = (FittedModel(*each, (), {}, {}, {}) for each in ((problem, state), made))
    return made if delta_bic(before, after) > 0.0 else None


def likelier(run: MachineRun, problem: Problem, state: FitState) -> MachineRun:
    """Return a run that is held out, its motor straight between readings where it is likelier so; (304)."""
    straight, model = straight_between_readings(run), FittedModel(problem, state, (), {}, {}, {})
    if not turns_apart(run, straight):
        return run
    both = (
        own_numbers(model.on_known_routes(each), model.rig, fine=problem.fine) for each in (run, straight)
    )
    curved, made = (FittedModel(*own, (), {}, {}, {}) for own in both)
    return straight if delta_bic(curved, made) > 0.0 else run

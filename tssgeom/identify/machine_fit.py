"""The fit of a machine to runs: Gauss-Newton on the model, with what was assumed as data.

Source: docs/model.md (179)-(183).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import CHANCE
from tssgeom.errors import FitError
from tssgeom.identify.fit_quality import ROBUST, first_weights
from tssgeom.identify.machine_parameters import one_bend, shares_of
from tssgeom.identify.machine_problem import FIT, FitState, Problem, fitted_rows
from tssgeom.identify.machine_run import thinned
from tssgeom.least_squares import SOLVER, Solution, solve
from tssgeom.least_squares import Problem as LeastSquares

_Answer = tuple[list[Mapping[str, Vector]], list[Vector]]
_LEAST_TENSION = 1e-3  # of a tendon that pulls [N]; derived: its logarithm is finite
_STARTS = tuple(itertools.product((0.0, -1.0, 1.0), repeat=3))


def start_of(problem: Problem) -> Vector:
    """Return where the fit starts: the best of a few corners of what is assumed, after a short fit each.

    Where a sheath bends anywhere, the best corner with one bend towards its base, and its end, counts too.
    """
    few = max(FIT.least_at_start, FIT.most_at_start // len(problem.runs))
    runs = tuple(thinned(run, few) for run in problem.runs)
    rows = fitted_rows(runs, held_out=None)
    short = Problem(runs, problem.rig, problem.parameters, rows, problem.bars)
    weight = first_weights(short.measured())
    nearest = list[Vector]()
    for bends in _bend_starts(problem):
        starts = list[tuple[float, Vector]]()
        for corner in _corners(problem):
            u = corner + bends
            channels = short.model(u)
            if channels is not None:
                starts.append((_objective(short.left(channels), weight, u), u))
        starts.sort(key=lambda start: start[0])
        nearest += [u for _, u in starts[: 1 if bends.any() else FIT.starts]]
    if not nearest:
        raise FitError("the machine has no equilibrium at the numbers of the rig: check units and radii")
    inflation = np.ones(len(rows))
    states = [fit_round(short, u, weight, inflation, FIT.start_steps) for u in nearest]
    best = sorted(states, key=lambda state: state.objective)
    possible = (state.u for state in best if problem.model(state.u) is not None)
    return next(possible, best[0].u)  # few samples of a run may have an equilibrium where all have none


def _bend_starts(problem: Problem) -> Iterator[Vector]:
    """Yield bends that are even, and one bend towards either end of the sheath."""
    even = np.zeros(len(problem.parameters))
    for position in (None, 0.25, 0.75) if shares_of(problem.parameters) else (None,):
        yield one_bend(problem.parameters, even, position)


def _corners(problem: Problem) -> Iterator[Vector]:
    """Yield corners of what is assumed, each also with the pretension of a tendon that is at rest at first.

    With any higher one the first reading of a run by its tension is a release, and the derivative by the
    pretension is 0.
    """
    free = [j for j, each in enumerate(problem.parameters) if each.kind == "rig" and each.prior.sd > 0.25]
    first = [run.given["tension_in_N"][0] for run in problem.runs if "tension_in_N" in run.given]
    pretension = [j for j, each in enumerate(problem.parameters) if each.key == "tendon.pretension_N"]
    for corner in _STARTS if free else _STARTS[:1]:
        u = np.zeros(len(problem.parameters))
        u[free] = [corner[j % 3] for j in range(len(free))]
        yield u
        for j in pretension if first else ():
            at_rest = problem.parameters[j].prior.u(max(float(np.median(first)), _LEAST_TENSION))
            u = u.copy()
            u[j] = np.clip(at_rest, -CHANCE.rare, CHANCE.rare)
            yield u


def fit_from(
    problem: Problem,
    start: Vector,
    progress: Callable[[float], object],
    extended: Callable[[Problem, FitState], tuple[Problem, Vector]] | None = None,
) -> tuple[Problem, FitState]:
    """Fit, weigh each channel by what is left and by how long its errors last, and fit again."""
    weight, inflation = first_weights(problem.measured()), np.ones(len(problem.rows))
    state = fit_round(problem, start, weight, inflation)
    if extended is not None:
        problem, u = extended(problem, state)
        state = replace(state, u=u, beside=None)
    for k in range(ROBUST.rounds):
        progress((k + 1) / (ROBUST.rounds + 1))
        problem, state = fitted_again(problem, state)
    return problem, state


def fitted_again(problem: Problem, state: FitState) -> tuple[Problem, FitState]:
    """Fit once more, with more bars and with the weights that follow from what is left."""
    problem = problem.corrected(state.u, state.channels)
    weight, inflation = problem.weights(problem.left(state.channels))
    return problem, fit_round(problem, state.u, weight, inflation)


def fit_round(
    problem: Problem, start: Vector, weight: list[Vector], inflation: Vector, steps: int = SOLVER.passes
) -> FitState:
    """Fit with these weights; raises FitError where the machine has no equilibrium at the start."""
    rows, apart = np.concatenate(weight), problem.steps()

    def slope(now: Solution[_Answer]) -> Matrix:
        nonlocal apart
        made = problem.jacobian(now.u, *now.detail, problem.beside(now.u, apart)) * rows[:, None]
        apart = problem.steps(made)
        return made

    def model(u: Vector) -> tuple[Vector, _Answer] | None:
        channels = problem.model(u)
        if channels is None:
            return None
        left = problem.left(channels)
        return np.concatenate(left), (channels, left)

    given = LeastSquares(
        *(model, np.eye(len(start)), np.full(len(start), -CHANCE.rare), np.full(len(start), CHANCE.rare)),
        whitened=lambda left: (rows * left.T).T,
        close=FIT.close,
        along_ridges=True,
        jacobian=slope,
    )
    end = solve(given, start, steps)
    if end is None:
        raise FitError("the machine has no equilibrium at the start of the fit")
    return FitState(end.u, *end.detail, weight, inflation, 0.5 * end.chi2, apart)


def _objective(left: Sequence[Vector], weight: Sequence[Vector], u: Vector) -> float:
    return 0.5 * sum(float(np.sum((w * r) ** 2)) for w, r in zip(weight, left, strict=True)) + 0.5 * float(
        u @ u
    )

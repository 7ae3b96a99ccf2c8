"""What the error of a sensed route does to the channels: where along it the angle lies.

The true over the sensed angle of a route is one number of a fit. How the angle is spread along a route errs
too, as the covariance of its pieces says. Source: docs/model.md (284) to (286).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import FitError, SettingsError
from tssgeom.identify.machine_parameters import Parameter, bends_of, route_numbers
from tssgeom.identify.machine_prediction import Machines
from tssgeom.identify.machine_problem import FIT, FitState, Problem
from tssgeom.identify.machine_run import MachineRun
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs


@dataclass(frozen=True, slots=True)
class RouteErrorSettings:
    """Which errors of a route are fitted."""

    least: float = 1e-3
    """Variance of the angle up to any arc length by the least error that is tried, over that by the largest
    [1]; chosen: 3 % of its size."""


ROUTE_ERRORS = RouteErrorSettings()
_Channels = Mapping[str, Vector]


def with_route_errors(problem: Problem, state: FitState) -> tuple[Problem, Vector]:
    """Return a problem in which the errors of routes are fitted too, and its numbers; (284) to (286)."""
    machines = replace(problem, bars=FIT.fine).machines(state.u)
    numbers = route_numbers(problem.runs)
    runs, errors, parameters = list(problem.runs), dict[int, Matrix](), list[Parameter]()
    for number in dict.fromkeys(n for own in numbers for n in own):
        on = {k: [w for w, n in enumerate(own) if n == number] for k, own in enumerate(numbers)}
        on = {k: which for k, which in on.items() if which}
        first = next(iter(on))
        arcs = problem.runs[first].routes[on[first][0]]
        tried = independent_errors(arcs, without_proportional(arcs))
        made = [
            _changes(machines, runs[k], problem.of_run(state.u, k), which, tried) for k, which in on.items()
        ]
        changed = [each for each in made if each]
        if len(changed) < len(made):
            continue
        turned = _clear([problem.runs[k] for k in on], changed)
        errors[number] = tried @ turned
        for k, each in zip(on, changed, strict=True):
            runs[k] = replace(runs[k], bends={**runs[k].bends, **_named(number, each, turned)})
        parameters += bends_of(_key(number, m) for m in range(turned.shape[1]))
    made_of = (*problem.parameters, *parameters)
    longer = replace(problem, runs=tuple(runs), parameters=made_of, route_errors=errors)
    return longer, np.concatenate([state.u, np.zeros(len(parameters))])


def with_own_route_errors(
    run: MachineRun,
    rig: Rig,
    values: Mapping[tuple[str, str], float],
    known: Sequence[int] = (),
    proportional: float = 0.0,
) -> MachineRun:
    """Return a run that is not fitted with what the errors of its routes do.

    Parameters
    ----------
    run
        The run.
    rig, values
        The fitted rig, and the numbers of the run.
    known
        Positions of routes that fitted runs have.
    proportional
        Variance of all angles of the others, beside that of each [1].
    """
    machines, bends = Machines(rig, FIT.fine), dict[str, _Channels]()
    numbers = route_numbers([run])[0]
    for number in dict.fromkeys(numbers):
        which = [w for w, n in enumerate(numbers) if n == number]
        arcs = run.routes[which[0]]
        k, covariance = len(arcs.length), np.array(arcs.covariance)
        covariance[k:, k:] += proportional * np.outer(arcs.angle, arcs.angle)
        tried = independent_errors(arcs, covariance)
        changed = [] if which[0] in known else _changes(machines, run, values, which, tried)
        if changed:
            bends |= _named(number, changed, _clear([run], [changed]))
    return replace(run, bends=bends)


def without_proportional(arcs: Arcs) -> Matrix:
    """Return the covariance of lengths and angles less errors of all angles in proportion to them; (284)."""
    k, turned = len(arcs.length), arcs.total_angle
    if turned <= 0.0:
        return np.zeros((2 * k, 2 * k))
    left = np.eye(2 * k)
    left[k:, k:] -= np.outer(arcs.angle, np.ones(k)) / turned
    return np.asarray(left @ arcs.covariance @ left.T, dtype=np.float64)


def independent_errors(arcs: Arcs, covariance: Matrix) -> Matrix:
    """Return independent errors of lengths and angles [2k, m], each of one s.d., the largest first; (285).

    Their size is that by which the angle up to any arc length is off.
    """
    variance, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(variance, 0.0))
    s = np.linspace(0.0, arcs.total_length, FIT.fine + 1)[1:]
    share = np.clip((s[:, None] - arcs.s_start) / arcs.length, 0.0, 1.0)
    kappa = arcs.kappa[np.searchsorted(arcs.s_start, s) - 1]
    _, size, turned = np.linalg.svd(np.hstack([-kappa[:, None] * share, share]) @ root, full_matrices=False)
    kept = size**2 > ROUTE_ERRORS.least * size[0] ** 2
    return np.asarray(root @ turned[kept].T, dtype=np.float64)


def _changes(
    machines: Machines,
    run: MachineRun,
    values: Mapping[tuple[str, str], float],
    which: Sequence[int],
    errors: Matrix,
) -> list[_Channels]:
    """Return how the channels of a run change by each error of a route; none without an equilibrium."""
    try:
        before = machines.predicted(run, values) if errors.size else {}
        made = list[_Channels]()
        for error in errors.T:
            routes = [arcs.moved(error) if w in which else arcs for w, arcs in enumerate(run.routes)]
            after = machines.predicted(replace(run, routes=tuple(routes)), values)
            made.append({name: after[name] - value for name, value in before.items()})
    except (FitError, SettingsError, FloatingPointError):
        return []
    return made


def _clear(runs: Sequence[MachineRun], changed: Sequence[Sequence[_Channels]]) -> Matrix:
    """Return combinations of errors [tried, kept] that change χ² of the readings by more than one; (286)."""
    rows = [
        np.array([each[name] for each in made]).T / max(noise, 1e-12)
        for run, made in zip(runs, changed, strict=True)
        for name, noise in run.noise.items()
    ]
    _, size, turned = np.linalg.svd(np.concatenate(rows), full_matrices=False)
    return np.asarray(turned[size > 1.0].T, dtype=np.float64)


def _named(number: int, changed: Sequence[_Channels], turned: Matrix) -> dict[str, _Channels]:
    return {
        _key(number, m): {name: _combined(part, changed, name) for name in changed[0]}
        for m, part in enumerate(turned.T)
    }


def _combined(part: Vector, changed: Sequence[_Channels], name: str) -> Vector:
    return np.asarray(part @ np.array([each[name] for each in changed]), dtype=np.float64)


def _key(number: int, error: int) -> str:
    return f"{number} {error}"

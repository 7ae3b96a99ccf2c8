"""Evidence for a part of a machine and against it: log evidence and held-out misfit.

Source: docs/model.md (196)-(198).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE
from tssgeom.identify.fit_quality import first_weights, inflation_of, spread
from tssgeom.identify.machine_fit import fit_round, fitted_again
from tssgeom.identify.machine_parameters import bends_of, parameters_of, route_numbers
from tssgeom.identify.machine_parts import Part
from tssgeom.identify.machine_problem import FIT, FitState, Problem, fitted_rows
from tssgeom.identify.machine_run import MachineRun
from tssgeom.identify.machine_sensor_errors import without_sensor_errors
from tssgeom.least_squares import SOLVER
from tssgeom.rig import Rig, Sensor
from tssgeom.statistics import NORMAL_95, reading_noise, root_mean_square


@dataclass(frozen=True, slots=True)
class FittedModel:
    """A machine with some parts, fitted, and what it leaves."""

    problem: Problem
    state: FitState
    parts: tuple[Part, ...]
    held: Mapping[str, float]
    """Rms by channel on what is held out [SI]; empty where nothing is."""
    fitted: Mapping[str, float]
    """The same on what is fitted."""
    held_share: Mapping[str, float]
    """Readings by channel that are held out, over those that are fitted [1]."""
    fixed: tuple[str, ...] = ()
    """Channels whose zero is held at that of the rig."""

    @property
    def rig(self) -> Rig:
        """The rig at the fitted numbers."""
        return self.problem.rig_at(self.state.u)

    def on_known_routes(self, run: MachineRun) -> MachineRun:
        """Return a run that is not fitted with angles of routes and errors of sensors as they were fitted."""
        factors, moved = self.problem.route_factors(self.state.u), self.problem.moved_bends(self.state.u)
        pairs = zip(run.routes, route_numbers((*self.problem.runs, run))[-1], strict=True)
        routes = tuple(
            (arcs.moved(moved[number]) if number in moved else arcs).scaled(angle=factors.get(number, 1.0))
            for arcs, number in pairs
        )
        return without_sensor_errors(replace(run, routes=routes), self.problem, self.state.u)


def modelled(
    problem: Problem,
    state: FitState,
    parts: Sequence[Part],
    kept: Sequence[MachineRun],
    fixed: Sequence[str] = (),
) -> FittedModel:
    """Return a fitted model with what it leaves on fitted and held-out readings."""
    made = FittedModel(problem, state, tuple(parts), {}, {}, {}, tuple(fixed))
    near = _off(problem, problem.rows, problem.answers(state.channels))
    away = _off(problem, fitted_rows(problem.runs, held_out=True), problem.answers(state.channels))
    for run in kept:
        own, there = own_numbers(made.on_known_routes(run), made.rig, fixed, problem.fine)
        away += _off(own, own.rows, own.answers(there.channels))
    count, of_held = _count_of(near), _count_of(away)
    share = {name: number / count[name] for name, number in of_held.items() if name in count}
    return replace(made, held=_rms_of(away), fitted=_rms_of(near), held_share=share)


def own_numbers(
    run: MachineRun, rig: Rig, fixed: Sequence[str] = (), fine: int = FIT.fine
) -> tuple[Problem, FitState]:
    """Fit to a run its zeros and its start alone; all else is that of the rig, and zeros `fixed` too."""
    own = [each for each in parameters_of([run], rig, ()) if each.kind not in ("rig", "route")]
    own += bends_of(run.bends)
    parameters = tuple(each for each in own if each.kind != "zero" or each.key not in fixed)
    problem = Problem((run,), rig, parameters, fitted_rows([run], held_out=None), FIT.bars, fine=fine)
    weight, inflation = first_weights(problem.measured()), np.ones(len(problem.rows))
    state = fit_round(problem, np.zeros(len(parameters)), weight, inflation)
    return fitted_again(problem, state)


_Off = list[tuple[str, Vector]]


def _off(
    problem: Problem, rows: Sequence[tuple[int, str, np.ndarray]], given: Sequence[Mapping[str, Vector]]
) -> _Off:
    return [(name, problem.runs[k].measured[name][at] - given[k][name][at]) for k, name, at in rows]


def _rms_of(parts: _Off) -> dict[str, float]:
    names = dict.fromkeys(name for name, _ in parts)
    every = {name: np.concatenate([off for other, off in parts if other == name]) for name in names}
    return {name: root_mean_square(off) for name, off in every.items()}


def _count_of(parts: _Off) -> dict[str, int]:
    out = dict[str, int]()
    for name, off in parts:
        out[name] = out.get(name, 0) + len(off)
    return out


def delta_bic(before: FittedModel, after: FittedModel) -> float:
    """Return how far the Bayesian information criterion falls; docs/model.md (196).

    Each block of readings has an error of its own size, and counts as many readings as are independent in
    what the better model leaves. As many numbers as readings leave nothing, and no evidence. A wave of a law
    counts as the share of it that the readings determine; (311).
    """
    if sum(map(len, after.state.left)) <= len(after.state.u):
        return -math.inf
    gain, worth = 0.0, 0.0
    for block, (old, new) in enumerate(zip(before.state.left, after.state.left, strict=True)):
        fall, independent = block_gain(old, new, after.problem.floor(block))
        gain, worth = gain + fall, worth + independent
    shared = len(before.state.u)
    gain += float(before.state.u @ before.state.u - after.state.u[:shared] @ after.state.u[:shared])
    return gain - _determined(after, shared) * math.log(worth)


def _determined(model: FittedModel, first: int) -> float:
    """Return how many numbers readings determine from the first one on, waves of laws in part [1]."""
    of_laws = [j for j, each in enumerate(model.problem.parameters) if each.kind == "law" and j >= first]
    if not of_laws:
        return float(len(model.state.u) - first)
    slope = model.state.slope(model.problem)
    covariance = np.linalg.inv(slope.T @ slope + np.eye(len(model.state.u)))
    return len(model.state.u) - first - float(np.sum(np.diag(covariance)[of_laws]))


def block_gain(old: Vector, new: Vector, least: float) -> tuple[float, float]:
    """Return 2 (n/N) ln(s/s′) of one block and n/N, N of what the latter leaves; (196).

    `least` is what rounding leaves [SI].
    """
    sizes = [math.hypot(size_of(left), least) for left in (old, new)]
    independent = len(new) / inflation_of(new / sizes[1])
    return 2.0 * independent * math.log(sizes[0] / sizes[1]), independent


def size_of(left: Vector) -> float:
    """Return the standard deviation s of residuals, those beyond 3 s counted as 3 s; docs/model.md (289).

    Few outliers hardly count. What a model misses at every turn does, where `spread` takes it for outliers.
    """
    size, rms = spread(left), root_mean_square(left)
    for _ in left:
        limit = CHANCE.clear * size
        was, size = size, root_mean_square(np.clip(left, -limit, limit))
        if size - was <= SOLVER.rounding * rms:
            break
    return max(size, 1e-12)


def changes(before: FittedModel, after: FittedModel) -> dict[str, float]:
    """Return by channel the rms of what a part changes over what shows [1]."""
    out = dict[str, float]()
    pairs = zip(before.state.left, after.state.left, after.problem.rows, strict=True)
    for block, (old, new, (_, name, _)) in enumerate(pairs):
        share = root_mean_square(old - new) / _limit(new, after.problem.floor(block))
        out[name] = max(out.get(name, 0.0), share)
    return out


def _limit(left: Vector, least: float) -> float:
    """Return the rms change of a block that shows beside what is left of it [SI]."""
    size = math.hypot(size_of(left), least)
    return CHANCE.clear * size * math.sqrt(inflation_of(left / size) / len(left))


def touched(model: FittedModel, parts: Sequence[Part]) -> set[str]:
    """Return the channels that parts of a model change beyond what shows, all other numbers as they are.

    Others follow what is fitted with the parts, and say nothing of these; docs/model.md (310). All are, where
    the machine has no equilibrium without the parts.
    """
    return {
        name
        for block, (_, name, left, changed) in enumerate(_without(model, parts))
        if changed > _limit(left, model.problem.floor(block))
    }


def is_below_noise(model: FittedModel, part: Part) -> bool:
    """Return whether no channel would show a part if a model left its noise alone; docs/model.md (355)."""
    runs = model.problem.runs
    return all(
        changed <= CHANCE.clear * runs[k].noise[name] / math.sqrt(len(left))
        for k, name, left, changed in _without(model, [part])
    )


def _without(model: FittedModel, parts: Sequence[Part]) -> Iterator[tuple[int, str, Vector, float]]:
    """Yield run and channel of each block, what is left of it, and the rms change without parts [SI]."""
    names = {f"{part.label}: {number.name}" for part in parts for number in part.numbers}
    problem, state = model.problem, model.state
    kept = np.array([each.name not in names for each in problem.parameters])
    without = problem.model(kept * state.u)
    others = state.left if without is None else problem.left(without)
    for (k, name, _), left, other in zip(problem.rows, state.left, others, strict=True):
        yield k, name, left, math.inf if without is None else root_mean_square(other - left)


def held_out_ratio(before: FittedModel, after: FittedModel) -> float:
    """Return the held-out rms over that without a part, the root mean square over channels [1].

    NaN where nothing is held out.
    """
    ratios = [after.held[name] / max(rms, 1e-15) for name, rms in before.held.items()]
    return math.sqrt(sum(each**2 for each in ratios) / len(ratios)) if ratios else math.nan


def held_out_rises(before: FittedModel, after: FittedModel) -> dict[str, float]:
    """Return by channel how −2 ln L of what is held out rises by a part [1]; docs/model.md (197).

    Of the same share of readings as is independent in what the better model leaves of the fitted ones.
    """
    independent = dict[str, float]()
    for block, (left, (_, name, _)) in enumerate(zip(after.state.left, after.problem.rows, strict=True)):
        size = math.hypot(size_of(left), after.problem.floor(block))
        independent[name] = independent.get(name, 0.0) + len(left) / inflation_of(left / size)
    return {
        name: 2.0 * share * independent[name] * math.log(after.held[name] / max(before.held[name], 1e-15))
        for name, share in after.held_share.items()
    }


def contradicted(rises: Mapping[str, float], by: set[str] | None = None) -> str:
    """Return the channel whose held-out readings contradict a part; empty where none does; (119), (197).

    Of channels that the part touches, `by`; of all where None.
    """
    rises = {name: rise for name, rise in rises.items() if by is None or name in by}
    worst = max(rises, key=lambda name: rises[name], default="")
    return worst if worst and rises[worst] > NORMAL_95**2 else ""


def worse(before: FittedModel, after: FittedModel, channel: str) -> str:
    """Say which channel a part makes worse on what is held out; empty where it makes none."""
    if not channel:
        return ""
    ratio = after.held[channel] / max(before.held[channel], 1e-15)
    return worse_by(channel, ratio)


def worse_by(channel: str, ratio: float) -> str:
    """Say how much worse a part makes a channel on what is held out."""
    return f"with it the held-out rms of {channel} is {ratio:.3g} times that without"


def noise_of(models: Sequence[FittedModel], rig: Rig) -> dict[str, float]:
    """Return the white noise of each channel: as specified, else the least that differences show [SI]."""
    best = models[-1]
    out = dict[str, float]()
    for (k, name, at), left in zip(best.problem.rows, best.state.left, strict=True):
        measured = best.problem.runs[k].measured[name][at]
        least = min(reading_noise(measured), reading_noise(left))
        out[name] = max(out.get(name, 0.0), rig.sensors.get(name, Sensor()).reading_noise or least)
    return out

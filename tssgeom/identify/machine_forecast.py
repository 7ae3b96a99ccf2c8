"""What a machine that was fitted to the begin of every run predicts of its end; docs/model.md (246).

Cycles that are held out between fitted ones do not show whether a part goes on as it was fitted.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import FitError
from tssgeom.identify.fit_quality import inflation_of
from tssgeom.identify.machine_evidence import FittedModel, contradicted, noise_of, size_of, touched, worse_by
from tssgeom.identify.machine_fit import fit_round, fitted_again
from tssgeom.identify.machine_held_out import predicted
from tssgeom.identify.machine_problem import FitState, Problem, fitted_rows
from tssgeom.identify.machine_run import MachineRun, turns_of
from tssgeom.identify.readings import READING
from tssgeom.statistics import NORMAL_95
from tssgeom.tendon.machine_simulation import drive_channels


class Forecast(NamedTuple):
    """A model fitted to the begin of every run."""

    problem: Problem
    state: FitState
    away: Problem
    """Whose rows are the end of every run."""

    @property
    def left(self) -> list[Vector]:
        """What it leaves there, by block of rows [SI]."""
        return self.away.left(self.state.channels)


def contradiction(before: Forecast | None, model: FittedModel) -> str:
    """Return which channel at the end of the runs parts make worse, in a clause; empty where none; (246).

    `before` is the forecast without parts.
    """
    if before is None or (after := forecast(model)) is None:
        return ""
    ratios, rises = dict[str, float](), dict[str, float]()
    noise = noise_of((model,), model.rig)
    blocks = list(_blocks(after, before.left))
    for name in dict.fromkeys(each.channel for each in blocks):
        those = [each for each in blocks if each.channel == name]
        if _is_noise(those, noise[name]):
            continue
        ratios[name] = math.sqrt(sum(each.after for each in those) / sum(each.before for each in those))
        rises[name] = 2.0 * sum(each.independent for each in those) * math.log(ratios[name])
    if not (channel := contradicted(rises, touched(model, model.parts))):
        return ""
    return f"{worse_by(channel, ratios[channel])}, where only the first two thirds of the runs are fitted"


class _Block(NamedTuple):
    """A channel at the end of a run."""

    channel: str
    readings: float
    """How many, each as far as the numbers determine it [1]."""
    independent: float
    """Readings that are independent [1]."""
    before: float
    """Sum of the squares of what is left without the part, as far as the numbers determine it [SI²]."""
    after: float
    """The same with it [SI²]."""


def _blocks(after: Forecast, without: list[Vector]) -> list[_Block]:
    """Return the end of every run; a reading counts less, the less the fit predicts it; (302)."""
    near = {
        (k, name): (left, after.problem.floor(block))
        for block, ((k, name, _), left) in enumerate(zip(after.problem.rows, after.state.left, strict=True))
    }
    made = list[_Block]()
    for (k, name, _), old, new, sd in zip(
        after.away.rows, without, *predicted(after.problem, after.away, after.state), strict=True
    ):
        if (k, name) not in near:
            continue
        left, least = near[k, name]
        size = math.hypot(size_of(left), least)
        share = 1.0 / (1.0 + np.square(sd / size))
        count = float(share.sum())
        independent = count / inflation_of(left / size)
        squares = (max(float(share @ np.square(each)), 1e-30) for each in (old, new))
        made.append(_Block(name, count, independent, *squares))
    return made


def _is_noise(blocks: list[_Block], noise: float) -> bool:
    """Whether what is left with the part is no more than noise: it contradicts nothing; (302)."""
    square = sum(each.after for each in blocks) / sum(each.readings for each in blocks)
    independent = sum(each.independent for each in blocks)
    return square < noise**2 * (1.0 + NORMAL_95 * math.sqrt(2.0 / independent))


def forecast(model: FittedModel) -> Forecast | None:
    """Return a model fitted to the begin of every run; None where that has no equilibrium."""
    runs = tuple(replace(run, held_out=_at_end(run)) for run in model.problem.runs)
    problem = replace(model.problem, runs=runs, rows=fitted_rows(runs, held_out=False))
    try:
        channels = problem.model(model.state.u)
        if channels is None:
            return None
        problem, state = fitted_again(
            problem, fit_round(problem, model.state.u, *problem.weights(problem.left(channels)))
        )
    except FitError:
        return None
    return Forecast(problem, state, replace(problem, rows=fitted_rows(runs, held_out=True)))


def _at_end(run: MachineRun) -> np.ndarray:
    """Return which samples are the end of a run, from a turn on where there are enough [n] bool."""
    motion = run.given[drive_channels(run.drive, run.tendons)[0]]
    first = round((1.0 - 1.0 / READING.cycles) * len(motion))
    edges = turns_of(motion)[1:-1]
    if len(edges) > 2:
        first = int(edges[np.argmin(np.abs(np.asarray(edges) - first))])
    return np.arange(len(motion)) > first

"""Errors of the estimates of a machine by the noise of what acts on it; docs/model.md (264), (265)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import FitError
from tssgeom.identify.machine_drive_noise import INPUT_NOISE
from tssgeom.identify.machine_problem import FitState, Problem
from tssgeom.statistics import NORMAL_95


class DriveErrors(NamedTuple):
    """What the noise of what acts does to the numbers of a fit; they count deviations of what was assumed."""

    covariance: Matrix
    """[numbers, numbers] Of their errors by it."""
    other: Matrix
    """[numbers, numbers] Of their errors by all else."""


def drive_errors(problem: Problem, state: FitState, slope: Matrix, covariance: Matrix) -> DriveErrors:
    """Return what the noise of what acts does to a fit, from draws of it; docs/model.md (264), (265).

    Parameters
    ----------
    problem, state
        The fit.
    slope
        [rows, numbers] Derivatives of the weighted readings.
    covariance
        [numbers, numbers] By Gauss and Newton, as though nothing that acts were noisy.
    """
    size, freedom = len(state.u), 0
    of_drive = np.zeros((size, size))
    weight, blocks = np.concatenate(state.weight), _blocks(problem)
    levels_known = np.zeros(size)
    for k in range(len(problem.runs)):
        of_run = np.concatenate([np.zeros(0, dtype=int), *(rows for run, _, rows in blocks if run == k)])
        turns = [j for j, each in enumerate(problem.parameters) if each.kind == "turn" and each.run == k]
        errors = list[Vector]()
        for moved, levels in _draws_of(problem, state, k):
            error = -covariance @ (slope[of_run].T @ (weight[of_run] * moved))
            error[turns] -= levels[: len(turns)] / [problem.parameters[j].prior.sd for j in turns]
            errors.append(error)
        if count := len(errors):
            of_drive += np.transpose(errors) @ np.array(errors) / count
            freedom += count
            levels_known[turns] = 1.0
    if freedom:
        of_drive *= (float(stdtrit(freedom, 0.975)) / NORMAL_95) ** 2
    of_levels = (covariance * levels_known) @ covariance  # the draws have it too
    return DriveErrors(of_drive, np.asarray(covariance - of_levels, dtype=np.float64))


def _blocks(problem: Problem) -> list[tuple[int, str, np.ndarray]]:
    """Return run, channel and rows of each block of readings."""
    edges = np.cumsum([0, *(len(at) for _, _, at in problem.rows)])
    return [(k, name, np.arange(edges[b], edges[b + 1])) for b, (k, name, _) in enumerate(problem.rows)]


def _draws_of(problem: Problem, state: FitState, k: int) -> Iterator[tuple[Vector, Vector]]:
    """Yield for each draw what it leaves of the readings of a run [SI], and how far its turns lie lower."""
    run, values = problem.runs[k], problem.of_run(state.u, k)
    turns = None if run.legs is None else run.legs.turns
    plain, machines = replace(run, legs=None), problem.machines(state.u)
    count = max(INPUT_NOISE.of_each, -(-INPUT_NOISE.draws // len(problem.runs)))

    def given(channels: Mapping[str, Vector]) -> Vector:
        return np.concatenate([channels[name][at] for j, name, at in problem.rows if j == k])

    base = None
    for draw in run.inputs.draws(count, turns):
        try:
            base = given(machines.predicted(plain, values)) if base is None else base
            there = given(machines.predicted(replace(plain, given={**run.given, **draw}), values))
        except FitError:
            continue
        levels = np.zeros(0)
        if turns is not None:
            at, levels = turns + np.arange(len(turns)), np.zeros(len(turns))
            for channel in run.inputs.pulls:
                levels = run.given[channel][at] - draw[channel][at]
        yield base - there, levels

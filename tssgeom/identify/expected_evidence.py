"""What one more run is expected to show: the evidence between models that are left, and narrower intervals.

Source: docs/model.md (117), summed over runs; G. E. P. Box, W. J. Hill, Technometrics 9 (1967) 57;
A. C. Atkinson, V. V. Fedorov, Biometrika 62 (1975) 57, on T-optimality.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.identify.candidate_models import CandidateModel, Compared
from tssgeom.identify.fit import Problem, columns, unshared, whitening
from tssgeom.identify.prediction import errors_of, run_channels, stacked
from tssgeom.identify.readings import Reading
from tssgeom.identify.screening import size_over_limit
from tssgeom.identify.ties import MOST_REPORTED
from tssgeom.rig import Rig


@dataclass(frozen=True, slots=True)
class Predicted:
    """One run as each model predicts it."""

    reading: Reading
    """Its drive and route; its measured channels are zero."""
    channels: tuple[Mapping[str, Vector], ...]
    """[models] Each [n] [N, m]."""
    flat: tuple[Vector, ...]
    """[models] What is measured of them [rows] [N, m]."""
    slopes: tuple[Matrix, ...]
    """[models] Their derivatives by ln μ, ln ρ and what is free [rows, size]; none before `linear`."""
    problem: Problem
    """Of that run, its target zero."""


def predicted(reading: Reading, rig: Rig, models: Sequence[CandidateModel]) -> Predicted:
    """Return what each model predicts of a run, the noise of the sensors white.

    Raises FitError where a model has no equilibrium in it.
    """
    channels = tuple(run_channels(reading, model.at.rig(rig), model.at.effects) for model in models)
    stack = stacked([reading])
    flat = tuple(stack.flat([each]) for each in channels)
    return Predicted(reading, channels, flat, (), Problem(stack, unshared(stack.noise), rig, stack.measured))


def linear(run: Predicted, models: Sequence[CandidateModel]) -> Predicted:
    """Return a run with the derivatives of each model."""
    stack = run.problem.stack
    plain = replace(run.problem, whitening=unshared(np.ones(stack.size)))
    return replace(
        run,
        slopes=tuple(columns(plain, model.at, -flat) for model, flat in zip(models, run.flat, strict=True)),
    )


def with_errors(run: Predicted, model: CandidateModel) -> Predicted:
    """Return a run with all that sensors, drive and route may be off, (100) to (102), about one model."""
    errors = errors_of(run.problem.stack, model.at.rig(run.problem.rig), model.at.effects)
    return replace(run, problem=replace(run.problem, whitening=whitening(errors)))


@dataclass(frozen=True, slots=True)
class Information:
    """What some runs are expected to add, linear about each model."""

    runs: tuple[Predicted, ...]
    """Of one tendon."""
    normal: tuple[Matrix, ...]
    """[models] JᵀJ of each, [size, size]."""
    slope: Mapping[tuple[int, int], Vector]
    """Jᵀd of model j if model i is true, by (i, j); [size of j]."""
    square: Mapping[tuple[int, int], float]
    """|d|² [1]."""

    def plus(self, other: Information) -> Information:
        """Return the information of both."""
        return Information(
            self.runs + other.runs,
            tuple(a + b for a, b in zip(self.normal, other.normal, strict=True)),
            {pair: self.slope[pair] + other.slope[pair] for pair in self.slope},
            {pair: self.square[pair] + other.square[pair] for pair in self.square},
        )


def information_of(run: Predicted, models: Sequence[CandidateModel]) -> Information:
    """Return what one run, with its derivatives, is expected to add."""
    whitened = run.problem.whitening.whitened
    may_be_true = [each.may_be_true for each in models]
    return expected((run,), run.flat, run.slopes, [whitened] * len(models), may_be_true)


def expected(
    runs: tuple[Predicted, ...],
    flat: Sequence[Vector],
    slopes: Sequence[Matrix],
    whitened: Sequence[Callable[[Any], Any]],
    may_be_true: Sequence[bool],
) -> Information:
    """Return the information of one run; docs/model.md (117), (314).

    Parameters
    ----------
    runs
        The run, of one tendon.
    flat, slopes, whitened
        Of each model: what it predicts [rows], its derivatives [rows, size], and what whitens either.
    may_be_true
        Of each model.
    """
    normal, slope, square = list[Matrix](), dict[tuple[int, int], Vector](), dict[tuple[int, int], float]()
    for j, own_whitened in enumerate(whitened):
        own = own_whitened(slopes[j])
        normal.append(own.T @ own)
        for i in np.flatnonzero(may_be_true).tolist():
            if i != j:
                off = own_whitened(flat[i] - flat[j])
                slope[i, j], square[i, j] = own.T @ off, float(off @ off)
    return Information(runs, tuple(normal), slope, square)


def expected_delta_bic(added: Information, models: Sequence[Compared]) -> dict[tuple[int, int], float]:
    """Return by (i, j) how much worse model j is expected to fit the runs than i, if i is true; (117)."""
    out = {}
    for i, j in added.square:
        rest = added.square[i, j] - float(added.slope[i, j] @ step_of(added, models, (i, j)))
        out[i, j] = min(max(rest, 0.0), MOST_REPORTED)
    return out


def step_of(added: Information, models: Sequence[Compared], pair: tuple[int, int]) -> Vector:
    """Return how far the second model of a pair moves when it is refitted to runs of the first [size]."""
    j = pair[1]
    step = np.linalg.solve(added.normal[j] + models[j].information, added.slope[pair])
    return np.asarray(step, dtype=np.float64)


def difference(run: Predicted, pair: tuple[int, int], step: Vector) -> Vector:
    """Return a model less another one that has moved by a step, in one run [rows] [N, m]."""
    i, j = pair
    return run.flat[i] - run.flat[j] - run.slopes[j] @ step


def size_over_limits(
    added: Information, models: Sequence[Compared], pair: tuple[int, int], limits: Mapping[str, float]
) -> float:
    """Return the largest difference of a pair in any run over its detection limit [1]; (111).

    Runs of a machine have no such limit: it is infinite.
    """
    step = step_of(added, models, pair)
    sizes = (size_over_limit(run.problem.stack, difference(run, pair, step), limits) for run in added.runs)
    return max(sizes, default=math.inf)


def shrink(added: Information, model: Compared, j: int, which: int) -> float:
    """Return the expected standard error of one number over that of now [1]."""
    before = np.linalg.inv(model.information)[which, which]
    after = np.linalg.inv(model.information + added.normal[j])[which, which]
    return math.sqrt(float(after / before))

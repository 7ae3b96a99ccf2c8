"""The models that the runs of a machine leave, and what one more run is expected to show of them.

Source: docs/discovery.md, "Designed experiments"; docs/model.md (117), (314).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import TssgeomError
from tssgeom.identify.candidate_models import BASE, CANDIDATES
from tssgeom.identify.expected_evidence import Information, expected
from tssgeom.identify.law_search import LAW_SEARCH
from tssgeom.identify.machine_evidence import FittedModel
from tssgeom.identify.machine_finding import MachineWork
from tssgeom.identify.machine_parameters import Parameter, parameters_of
from tssgeom.identify.machine_parts import Part
from tssgeom.identify.machine_problem import Problem, fitted_rows
from tssgeom.identify.machine_run import MachineRun
from tssgeom.identify.machine_steps import TriedPart
from tssgeom.statistics import NORMAL_95

_SHARED = ("rig", "share", "law")
"""Kinds of numbers that a new run has in common with those before, beside errors of routes."""


@dataclass(frozen=True, slots=True)
class MachineCandidate:
    """One model of a machine that the runs leave."""

    name: str
    model: FittedModel
    shared: tuple[int, ...]
    """Which of its numbers a new run has in common."""
    information: Matrix
    """[shared, shared] Of these, from the runs and the priors, in standard deviations of the priors."""
    may_be_true: bool

    u: Vector
    """[shared] The numbers; of a part that may hide, as large as the runs allow."""

    @property
    def parameters(self) -> list[Parameter]:
        """What a new run has in common."""
        return [self.model.problem.parameters[j] for j in self.shared]


def candidates_of(work: MachineWork) -> list[MachineCandidate]:
    """Return the models that the runs leave, the best first; one where nothing is left to separate."""
    steps = work.taken
    if not steps:
        tried = work.chosen.steps[0].tried if work.chosen.steps else ()
        hidden = [one for one in tried if not (one.refusal or one.part.laws)]
        hidden.sort(key=lambda one: -one.delta_bic)
        base = _candidate(BASE, work.base, may_be_true=False)
        return [base, *_named(hidden[: LAW_SEARCH.fitted - 1], hidden=True)]
    last = steps[-1]
    best = last.chosen
    assert best is not None
    near = [one for one in last.tried if one.passes and best.evidence - one.evidence < CANDIDATES.near]
    others = [one for one in near if one.part.label != best.part.label]
    if not others:
        return [_candidate(best.part.label, work.chosen.model, may_be_true=True)]
    return _named([best, *others][: LAW_SEARCH.fitted])


def _named(tried: Sequence[TriedPart], *, hidden: bool = False) -> list[MachineCandidate]:
    """Return models by the names of their parts, and by what of these is a choice where names are alike."""
    names = [one.part.name for one in tried]
    return [
        _candidate(
            name if names.count(name) == 1 else one.part.label, one.model, hides=one.part if hidden else None
        )
        for one, name in zip(tried, names, strict=True)
    ]


def _candidate(
    name: str, model: FittedModel, *, may_be_true: bool = True, hides: Part | None = None
) -> MachineCandidate:
    """Return a fitted model; a part that hides as large as its 95 % interval goes; (314)."""
    every, u = list(enumerate(model.problem.parameters)), model.state.u
    shared = [j for j, each in every if each.run == -1 and each.kind in _SHARED]
    slope = model.state.slope(model.problem)
    covariance = np.linalg.inv(slope.T @ slope + np.eye(slope.shape[1]))
    if hides is not None:
        of_part = f"{hides.label}: {hides.switch.name}"
        switch = next(j for j, each in every if each.name == of_part)
        along = NORMAL_95 * covariance[switch] / math.sqrt(covariance[switch, switch])
        u = u + math.copysign(1.0, u[switch]) * along
    information = np.asarray(np.linalg.inv(covariance[np.ix_(shared, shared)]), dtype=np.float64)
    return MachineCandidate(name, model, tuple(shared), information, may_be_true, u[shared])


def intervals(candidate: MachineCandidate) -> list[tuple[Parameter, float, float]]:
    """Return each number, its value and half its 95 % interval, in its unit."""
    spread = NORMAL_95 * np.sqrt(np.diag(np.linalg.inv(candidate.information)))
    rows = zip(candidate.parameters, candidate.u, spread, strict=True)
    return [(each, each.value(u), 0.5 * abs(each.value(u + by) - each.value(u - by))) for each, u, by in rows]


@dataclass(frozen=True, slots=True)
class PredictedRun:
    """One run as one model predicts it, and how that follows its numbers, in standard deviations."""

    flat: Vector
    slope: Matrix
    """[rows, shared]"""
    own: Matrix
    """[rows, own] By zeros and start of the run."""

    def whitened(self, values: np.ndarray) -> np.ndarray:
        """Return rows without what zeros and start of the run may do; docs/model.md (314)."""
        if values.ndim == 1:
            return self.whitened(values[:, None])[:, 0]
        left, sizes, _ = np.linalg.svd(self.own, full_matrices=False)
        share = 1.0 - 1.0 / np.hypot(1.0, sizes)
        return np.asarray(values - left @ (share[:, None] * (left.T @ values)), dtype=np.float64)


def sigma_of(model: FittedModel, run: MachineRun) -> dict[str, float]:
    """Return what a reading of each channel is off in the fitted runs, correlation included."""
    weights = dict[str, list[float]]()
    for (_, name, _), weight in zip(model.problem.rows, model.state.weight, strict=True):
        weights.setdefault(name, []).append(float(np.median(weight)))
    return {name: 1.0 / float(np.median(weights[name])) for name in run.measured if name in weights}


def predicted_run(
    candidate: MachineCandidate, run: MachineRun, sigma: Mapping[str, float]
) -> PredictedRun | None:
    """Return a run as a model predicts it, over the error of each reading; None without an equilibrium."""
    known = replace(run, measured={name: values for name, values in run.measured.items() if name in sigma})
    own = [each for each in parameters_of([known], candidate.model.rig, ()) if each.run == 0]
    rows = fitted_rows([known], held_out=None)
    problem = candidate.model.problem
    there = Problem(
        (known,),
        problem.rig,
        (*candidate.parameters, *own),
        rows,
        problem.bars,
        laws=problem.laws,
        fine=problem.fine,
    )
    u = np.concatenate([candidate.u, np.zeros(len(own))])
    channels = there.model(u)
    if channels is None:
        return None
    left = there.left(channels)
    try:
        slope = -there.jacobian(u, channels, left, there.beside(u, there.steps()))
    except TssgeomError:
        return None
    scale = np.concatenate([np.full(len(at), sigma[name]) for _, name, at in rows])
    flat = np.concatenate([channels[0][name][at] for _, name, at in rows]) / scale
    slope = slope / scale[:, None]
    shared = len(candidate.shared)
    return PredictedRun(flat, slope[:, :shared], slope[:, shared:])


def information_of_run(
    predicted: Sequence[PredictedRun], candidates: Sequence[MachineCandidate]
) -> Information:
    """Return what one run is expected to add; docs/model.md (117), (314)."""
    flat, slopes, whitened = zip(*((one.flat, one.slope, one.whitened) for one in predicted), strict=True)
    return expected((), flat, slopes, whitened, [each.may_be_true for each in candidates])

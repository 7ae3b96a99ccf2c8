"""The models that the runs of a campaign leave, which the next run is to separate.

Source: docs/discovery.md, "Designed experiments".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

import numpy as np

from tssgeom.arrays import Matrix
from tssgeom.effects import KINDS
from tssgeom.errors import TssgeomError
from tssgeom.identify.assembly import Work
from tssgeom.identify.fit import Fit, Point, Problem, columns, freed, refined
from tssgeom.identify.law_search import LAW_SEARCH, LESS, LawSearch, as_fit
from tssgeom.identify.screening import ScoreTest, detection_limits
from tssgeom.identify.selection import Step, Tried, close_candidates, separable_from


@dataclass(frozen=True, slots=True)
class CandidateSettings:
    """Which models are held to be left."""

    near: float = 30.0
    """ΔBIC below the best within which a runner-up is separated further [1]; chosen."""
    sure: float = 2.0
    """Of the threshold: gain beyond which an effect of typical size would have been named [1]; chosen."""
    visible: float = 0.9
    """Of a signature: share beyond friction and compliance, by straight lines, above which it is not tried as
    hidden [1]; chosen for speed: the refit decides."""


CANDIDATES = CandidateSettings()


@dataclass(frozen=True, slots=True)
class CandidateModel:
    """One model that the runs leave."""

    name: str
    """Of its effects; `base` where it has none."""
    at: Point
    information: Matrix
    """[size, size] Of ln μ, ln ρ and what is free, from the runs and the priors."""
    may_be_true: bool
    """Whether a run may show it: of the base model, which the others hold, no run shows that it is true."""


class Compared(Protocol):
    """What a model of a tendon and one of a machine have, each by its own numbers."""

    @property
    def name(self) -> str:
        """Of its effects; `base` where it has none."""
        ...

    @property
    def information(self) -> Matrix:
        """[size, size] Of its numbers, from the runs and the priors."""
        ...

    @property
    def may_be_true(self) -> bool:
        """As of a `CandidateModel`."""
        ...


AnyCompared = TypeVar("AnyCompared", bound=Compared)
BASE = "base"


@dataclass(frozen=True, slots=True)
class Left(Generic[AnyCompared]):
    """What the runs leave."""

    models: tuple[AnyCompared, ...]
    """The best first; one where nothing is left to separate."""
    needed: float
    """ΔBIC that a run has to add to decide [1]."""
    limits: Mapping[str, float]
    """Detection limits by channel [N, m]; an effect has to exceed one to be separated from the base model."""


def left_by(work: Work) -> Left[CandidateModel]:
    """Return the models that the runs of a campaign leave."""
    first, problem = work.chosen.steps[0], work.chosen.problem
    limits = detection_limits(problem.stack, problem.rig)
    if work.judged.verdict == "none":
        hidden = _hidden(work)
        return Left((_plain(BASE, work.chosen.fit), *hidden), first.threshold, limits)
    if work.laws is not None:
        return Left(_laws_and_others(work.laws), separable_from(), limits)
    last = _last(work)
    if last is None:
        return Left((_plain(BASE, work.base),), first.threshold, limits)
    others = _runners_up(work, last)
    if not others:
        return Left((_of_fit(work.chosen.fit, last.tried[0].name),), first.threshold, limits)
    few = (last.tried[0], *others)[: LAW_SEARCH.fitted]
    return Left(tuple(_of_fit(one.fit, one.name) for one in few), separable_from(), limits)


def _laws_and_others(laws: LawSearch) -> tuple[CandidateModel, ...]:
    """Return the first part that was taken and those with nearly its evidence, each as it was fitted."""
    offers = [one for one in laws.rounds[0] if one.veto in ("", LESS)]
    near = [one for one in offers if offers[0].gain - one.gain < CANDIDATES.near][: LAW_SEARCH.fitted]
    return tuple(_of_fit(as_fit(one.fit), one.label) for one in near)


def _last(work: Work) -> Step | None:
    """Return the last step whose best candidate passes; where nothing is named, the first."""
    steps = [now for now in work.chosen.steps if now.tried and now.passes(now.tried[0])]
    if not steps:
        return None
    return steps[0] if work.judged.verdict == "unknown" else steps[-1]


def _runners_up(work: Work, last: Step) -> list[Tried]:
    """Return the candidates beside the best that are not separated, or not far."""
    if work.judged.verdict == "unknown":
        return [one for one in last.tried[1:] if last.passes(one)]
    if close := close_candidates(last):
        return close
    best = last.tried[0].delta_bic
    return [one for one in last.tried[1:] if last.passes(one) and best - one.delta_bic < CANDIDATES.near]


def _of_fit(fit: Fit, name: str) -> CandidateModel:
    return CandidateModel(name, fit.at, _information(fit), True)


def _plain(name: str, fit: Fit) -> CandidateModel:
    return CandidateModel(name, fit.at, _information(fit), False)


def _information(fit: Fit) -> Matrix:
    return np.asarray(np.linalg.inv(fit.covariance), dtype=np.float64)


def _hidden(work: Work) -> list[CandidateModel]:
    """Return effects that may be there below what the readings can show, the likeliest first.

    First those that improve the fit, but no larger than sensors may produce; then those of typical size that
    a refit of friction or compliance hides, by a known tie.
    """
    problem, first = work.chosen.problem, work.chosen.steps[0]
    small = [one for one in first.tried if one.delta_bic > first.needed(one) and one.size <= 1.0]
    if small:
        most = max(one.delta_bic for one in small)
        near = [one for one in small if most - one.delta_bic < CANDIDATES.near]
        near.sort(key=lambda one: -one.delta_bic)
        return [_of_fit(one.fit, one.name) for one in near[: LAW_SEARCH.fitted - 1]]
    best = dict[str, ScoreTest]()
    for test in first.screening.tests:
        name = test.variant.name
        if name not in best or test.size > best[name].size:
            best[name] = test
    tied = [
        test
        for test in best.values()
        if test.raw**2 > CANDIDATES.sure * first.threshold
        and _visible(test) < CANDIDATES.visible
        and _tied_to_rig(test.variant.name)
    ]
    base, most = work.chosen.fit, CANDIDATES.sure * first.threshold
    models = (_hidden_model(problem, base, test, most) for test in sorted(tied, key=_visible))
    return [model for model in models if model is not None][: LAW_SEARCH.fitted - 1]


def _tied_to_rig(name: str) -> bool:
    return any(partner.startswith("rig.") for tie in KINDS[name].ties for partner in tie.partners)


def _visible(test: ScoreTest) -> float:
    """Return how much of an effect is left when friction and compliance are refitted [1]."""
    return test.size / test.raw


def _hidden_model(problem: Problem, base: Fit, test: ScoreTest, most: float) -> CandidateModel | None:
    """Return the base model with an effect of typical size, friction and compliance refitted.

    None where χ² grows by more than `most` [1]: a straight line is no measure of how well a refit hides it.
    """
    typical = test.variant.effect.parameters[test.variant.amplitude].typical
    effect = test.variant.sized(math.copysign(typical, test.amplitude or 1.0))
    length = min(reading.route.arcs.total_length for reading in problem.stack.readings)
    try:
        fixed = refined(problem, replace(base.at, effects=(effect,), free=()))
        if fixed.chi2 - base.chi2 > most:
            return None
        at = replace(fixed.at, free=tuple(freed(effect, 0, length, test.variant.free)))
        left = problem.left(at)
        fit = Fit(at, fixed.chi2, fixed.residual, columns(problem, at, left), left)
    except TssgeomError:
        return None
    return _of_fit(fit, test.variant.name)

"""Selection of effects: forward, one at a time, with an exchange and a backward pass.

Source: docs/model.md (107), (110), (114).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from tssgeom.effects import AnyEffect, snake
from tssgeom.errors import FitError
from tssgeom.identify.fit import Fit, Point, Problem, explained, posed, refined
from tssgeom.identify.misfit import NO_CHANGE, HeldOut, HeldOutChange
from tssgeom.identify.prediction import Errors
from tssgeom.identify.screening import (
    ScoreTest,
    Screening,
    Variant,
    detected_size,
    detection_limits,
    refit,
    screening,
    threshold,
)
from tssgeom.least_squares import SOLVER
from tssgeom.statistics import EVIDENCE_SCALE


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """How the library is searched, and when the search ends.

    Frozen on the development seeds of `benchmarks.discovery`.
    """

    most: int = 3
    """Effects that are named at most; chosen."""
    refitted: int = 6
    """Best candidates whose refit goes on, also with the error model about the best, and that are tried
    instead of one that was chosen; chosen for speed."""
    nonlinear: float = 3.0
    """ΔBIC that a refit may gain beyond its score test [1]; chosen on development seeds."""


SEARCH = SearchSettings()


@dataclass(frozen=True, slots=True)
class Tried:
    """One effect on top of a model, refitted."""

    name: str
    test: ScoreTest
    fit: Fit
    delta_bic: float
    """Against the model without it [1]."""
    size: float
    """Largest change over its detection limit [1]."""
    held: HeldOutChange = NO_CHANGE
    """What it changes on the held-out runs."""

    @property
    def evidence(self) -> float:
        """ΔBIC, and by how much χ² of the held-out runs falls [1]."""
        return self.delta_bic - self.held.rise


@dataclass(frozen=True, slots=True)
class Step:
    """All candidates on top of one model."""

    problem: Problem
    errors: Errors
    before: Fit
    screening: Screening
    threshold: float
    """Of ΔBIC on clean campaigns [1]."""
    tried: tuple[Tried, ...]
    """The best first."""

    def passes(self, one: Tried) -> bool:
        """Whether a candidate is beyond what clean campaigns and sensors give; docs/model.md (110), (111).

        What it adds to χ² of the held-out runs counts against it; (119).
        """
        return min(one.delta_bic, one.evidence) > self.needed(one) and one.size > 1.0

    def needed(self, one: Tried) -> float:
        """Return what ΔBIC has to pass, more where the candidate leaves more than the sensors explain."""
        return self.threshold * max(1.0, one.fit.chi2 / self.problem.stack.size)


def name_of(effect: AnyEffect) -> str:
    """Return the name of an effect as users see it."""
    return snake(type(effect).__name__)


def delta_bic(before: Fit, after: Fit, rows: int) -> float:
    """Return how far the Bayesian information criterion falls."""
    return before.chi2 - after.chi2 - (len(after.at.free) - len(before.at.free)) * math.log(rows)


def step(
    problem: Problem, errors: Errors, before: Fit, tried: Sequence[Variant], seed: int, most: int = 99
) -> Step:
    """Try every variant on top of a fitted model, or the `most` promising ones."""
    has = {name_of(effect) for effect in before.at.effects}
    score = screening(problem, before, [variant for variant in tried if variant.name not in has])
    least = threshold(problem, errors, score, seed)
    limits = detection_limits(problem.stack, problem.rig)
    tests = _best_tests(score)[:most]
    if before.at.effects and _quiet(problem, before, tests, least):
        tests = []
    quick = [one for test in tests if (one := _try(problem, before, score, test, limits))]
    quick.sort(key=lambda one: -one.delta_bic)
    whole = [_continued(problem, before, one, limits) for one in quick[: SEARCH.refitted]]
    ranked = sorted([*_best_each(whole), *quick[SEARCH.refitted :]], key=lambda one: -one.delta_bic)
    return Step(problem, errors, before, score, least, tuple(_best_each(ranked)))


def _best_tests(score: Screening) -> list[ScoreTest]:
    """Return the best variant of each effect; of an end fitting, presliding and a lag that of both laws."""
    best: dict[tuple[str, str, str], ScoreTest] = {}
    for test in score.tests:
        key = (test.variant.name, test.variant.amplitude, test.variant.law)
        if key not in best or test.gain > best[key].gain:
            best[key] = test
    return sorted(best.values(), key=lambda test: -test.gain)


def _quiet(problem: Problem, before: Fit, tests: Sequence[ScoreTest], least: float) -> bool:
    """Whether a model leaves no more than the sensors explain, and no straight line promises to pass."""
    rows = problem.stack.size
    most = max((test.gain - math.log(rows) * len(test.variant.free) for test in tests), default=0.0)
    return explained(before.chi2, rows) and most < least - SEARCH.nonlinear


def _best_each(tried: Sequence[Tried]) -> list[Tried]:
    """Return the best of each name, the best first."""
    best: dict[str, Tried] = {}
    for one in sorted(tried, key=lambda each: -each.delta_bic):
        best.setdefault(one.name, one)
    return list(best.values())


def _try(
    problem: Problem, before: Fit, score: Screening, test: ScoreTest, limits: Mapping[str, float]
) -> Tried | None:
    fit = refit(problem, before, test, score.base, SOLVER.quick)
    return None if fit is None else _refitted(problem, before, test, fit, limits)


def _continued(problem: Problem, before: Fit, one: Tried, limits: Mapping[str, float]) -> Tried:
    fit = refined(problem, one.fit.at)
    return _refitted(problem, before, one.test, fit, limits)


def _refitted(problem: Problem, before: Fit, test: ScoreTest, fit: Fit, limits: Mapping[str, float]) -> Tried:
    gain = delta_bic(before, fit, problem.stack.size)
    size = detected_size(problem, before.left - fit.left, fit.at, limits)
    return Tried(test.variant.name, test, fit, gain, size)


def separable_from() -> float:
    """Return the ΔBIC from which two candidates are separated [1]."""
    return EVIDENCE_SCALE.strong


def close_candidates(now: Step) -> list[Tried]:
    """Return the runners-up that the readings do not separate from the best; docs/model.md (116)."""
    best = now.tried[0]
    return [
        one
        for one in now.tried
        if one is not best and best.evidence - one.evidence < EVIDENCE_SCALE.strong and now.passes(one)
    ]


def reposed(first: Step, held: HeldOut | None, base: Point) -> Step:
    """Refit the best few, and the model without them, with the errors about the best.

    `base` is the model without any effect.
    """
    posed_again = _posed_about(first)
    if posed_again is None:
        return replace(first, threshold=math.inf)
    problem, errors, tried = posed_again
    before = refined(problem, first.before.at)
    limits = detection_limits(problem.stack, problem.rig)
    few = [
        _refitted(problem, before, one.test, refined(problem, one.fit.at), limits)
        for one in first.tried[: SEARCH.refitted]
    ]
    if held is not None:
        few = [replace(one, held=held.change(base, before.at, one.fit.at)) for one in few]
    few.sort(key=lambda one: -one.evidence)
    rest = tried[SEARCH.refitted :]
    return replace(first, problem=problem, errors=errors, before=before, tried=(*few, *rest))


def _posed_about(first: Step) -> tuple[Problem, Errors, tuple[Tried, ...]] | None:
    """Return the problem about the best candidate that fine bars can solve, and the candidates from it on."""
    for k, one in enumerate(first.tried[: SEARCH.refitted]):
        try:
            problem, errors = posed(first.problem.stack, first.problem.rig, one.fit.at)
        except FitError:
            continue
        return problem, errors, first.tried[k:]
    return None


def _hopeless(base: Fit, problem: Problem, fit: Fit) -> bool:
    """Whether two effects have left more than half of what was to be explained, or of the noise."""
    beyond = [one.chi2 / problem.stack.size - 1.0 for one in (base, fit)]
    return len(fit.at.effects) > 1 and 2.0 * beyond[1] > max(beyond[0], 1.0)  # no third will do


@dataclass(frozen=True, slots=True)
class Selection:
    """What was chosen, and how."""

    problem: Problem
    """Posed about what was chosen."""
    errors: Errors
    base: Fit
    """Without any effect, in that problem."""
    fit: Fit
    """What was chosen."""
    steps: tuple[Step, ...]
    """Forward: all candidates on top of what was chosen so far."""


def selected(
    first: tuple[Problem, Errors, Fit], tried: Sequence[Variant], held: HeldOut | None, seed: int
) -> Selection:
    """Choose effects as long as one passes; docs/model.md (114)."""
    problem, errors, base = first
    steps, fit = list[Step](), base
    while len(fit.at.effects) < SEARCH.most and not _hopeless(base, problem, fit):
        now = step(problem, errors, fit, tried, seed + len(steps))
        if not now.tried or not now.passes(now.tried[0]):
            steps.append(now)
            break
        now = reposed(now, held, base.at)
        steps.append(now)
        best = now.tried[0]
        if not now.passes(best):
            break
        problem, errors, fit = now.problem, now.errors, best.fit
        if len(fit.at.effects) > 1:
            problem, errors, fit = exchanged(problem, errors, fit, tried, held, seed)
    return Selection(
        problem, errors, refined(problem, Point(base.at.friction, base.at.compliance)), fit, tuple(steps)
    )


def without(at: Point, which: int) -> Point:
    """Return a model without one of its effects."""
    effects = tuple(effect for k, effect in enumerate(at.effects) if k != which)
    free = tuple(
        replace(one, effect=one.effect - (one.effect > which)) for one in at.free if one.effect != which
    )
    return replace(at, effects=effects, free=free)


def exchanged(
    problem: Problem, errors: Errors, fit: Fit, tried: Sequence[Variant], held: HeldOut | None, seed: int
) -> tuple[Problem, Errors, Fit]:
    """Replace each effect in turn by the one that fits best there, held-out runs included, or by none."""
    for which in range(len(fit.at.effects) - 1):
        rest = refined(problem, without(fit.at, which))
        now = step(problem, errors, rest, tried, seed, SEARCH.refitted)
        best = now.tried[0] if now.tried else None
        if best is None or not now.passes(best):
            fit = rest
            break
        rise = 0.0 if held is None else held.rise(fit.at, best.fit.at)
        better = best.fit.chi2 + rise < fit.chi2 - 1.0
        if better and best.name != name_of(fit.at.effects[which]):
            posed_again = _posed_about(now)
            if posed_again is not None:
                problem, errors, (best, *_) = posed_again
                fit = refined(problem, best.fit.at)
            break
    return problem, errors, fit

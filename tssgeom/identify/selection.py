"""Which effects the readings ask for: forward, one at a time, with an exchange and a backward pass.

Source: docs/model.md (107), (110), (114).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from tssgeom.effects import Library, snake
from tssgeom.errors import FitError
from tssgeom.identify.base_fit import posed
from tssgeom.identify.detection_limits import guards, size_over_guard
from tssgeom.identify.false_alarms import threshold
from tssgeom.identify.held_out import GAP, HeldOut
from tssgeom.identify.noise_model import Errors
from tssgeom.identify.problem import Fit, Point, Problem, refined
from tssgeom.identify.search import Look, Screen, refit, screen
from tssgeom.identify.variants import Variant

CLOSE = 6.0
"""ΔBIC by which a runner-up has to lose to be told apart: odds of 20 to 1."""
MOST = 3
"""Effects that are named at most."""
_RIVALS = 5  # of the best, refitted with the error model about it
_QUICK, _WHOLE = 2, 8  # passes of a first refit and of a last one
_CLEAR = 4.0  # standard deviations of χ² beyond which a model leaves more than the sensors explain
_HALF = 0.5  # of χ² beyond what the sensors explain
_MARGIN = 3.0  # of ΔBIC, for what a straight line does not see
_EXCHANGED = 6  # effects that are tried in the place of one
_CONTINUED = 7  # candidates whose refit goes on


@dataclass(frozen=True, slots=True)
class Tried:
    """One effect on top of a model, refitted."""

    name: str
    look: Look
    fit: Fit
    delta_bic: float
    """Against the model without it [1]."""
    size: float
    """Largest change over guard [1]."""


@dataclass(frozen=True, slots=True)
class Step:
    """All candidates on top of one model."""

    problem: Problem
    errors: Errors
    before: Fit
    screen: Screen
    threshold: float
    """Of ΔBIC on clean campaigns [1]."""
    tried: tuple[Tried, ...]
    """The best first."""

    def passes(self, one: Tried) -> bool:
        """Whether a candidate is beyond what clean campaigns and sensors give; docs/model.md (110), (111)."""
        return one.delta_bic > self.needed(one) and one.size > 1.0

    def needed(self, one: Tried) -> float:
        """Return what ΔBIC has to pass, more where the candidate leaves more than the sensors explain."""
        return self.threshold * max(1.0, one.fit.chi2 / self.problem.stack.size)


def name_of(effect: Library) -> str:
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
    view = screen(problem, before, [variant for variant in tried if variant.name not in has])
    least = threshold(problem, errors, view, seed)
    guard = guards(problem.stack, problem.rig)
    looks = _best_looks(view)[:most]
    if before.at.effects and _quiet(problem, before, looks, least):
        looks = []
    quick = [one for look in looks if (one := _try(problem, before, view, look, guard))]
    quick.sort(key=lambda one: -one.delta_bic)
    whole = [_continued(problem, before, one, guard) for one in quick[:_CONTINUED]]
    ranked = sorted([*_best_each(whole), *quick[_CONTINUED:]], key=lambda one: -one.delta_bic)
    return Step(problem, errors, before, view, least, tuple(_best_each(ranked)))


def _best_looks(view: Screen) -> list[Look]:
    """Return the variant of each effect that promises most; of an end fitting both laws."""
    best: dict[tuple[str, str], Look] = {}
    for look in view.looks:
        key = (look.variant.name, look.variant.amplitude)
        if key not in best or look.gain > best[key].gain:
            best[key] = look
    return sorted(best.values(), key=lambda look: -look.gain)


def _quiet(problem: Problem, before: Fit, looks: Sequence[Look], least: float) -> bool:
    """Whether a model leaves no more than the sensors explain, and no straight line promises to pass."""
    rows = problem.stack.size
    most = max((look.gain - math.log(rows) * len(look.variant.free) for look in looks), default=0.0)
    return before.chi2 < rows + _CLEAR * math.sqrt(2.0 * rows) and most < least - _MARGIN


def _best_each(tried: Sequence[Tried]) -> list[Tried]:
    """Return the best of each name, the best first."""
    best: dict[str, Tried] = {}
    for one in sorted(tried, key=lambda each: -each.delta_bic):
        best.setdefault(one.name, one)
    return list(best.values())


def _try(problem: Problem, before: Fit, view: Screen, look: Look, guard: Mapping[str, float]) -> Tried | None:
    fit = refit(problem, before, look, view.base, _QUICK)
    return None if fit is None else _told(problem, before, look, fit, guard)


def _continued(problem: Problem, before: Fit, one: Tried, guard: Mapping[str, float]) -> Tried:
    fit = refined(problem, one.fit.at, passes=_WHOLE)
    return _told(problem, before, one.look, fit, guard)


def _told(problem: Problem, before: Fit, look: Look, fit: Fit, guard: Mapping[str, float]) -> Tried:
    gain = delta_bic(before, fit, problem.stack.size)
    size = size_over_guard(problem.stack, before.left - fit.left, guard)
    return Tried(look.variant.name, look, fit, gain, size)


def reposed(first: Step, held: HeldOut | None) -> Step:
    """Refit the best few, and the model without them, with the errors about the best."""
    told = _posed_about(first)
    if told is None:
        return replace(first, threshold=math.inf)
    problem, errors, tried = told
    before = refined(problem, first.before.at)
    guard = guards(problem.stack, problem.rig)
    few = [
        _told(problem, before, one.look, refined(problem, one.fit.at), guard) for one in first.tried[:_RIVALS]
    ]
    few.sort(key=lambda one: -one.delta_bic)
    few = _settled(few, held)
    rest = tried[_RIVALS:]
    return replace(first, problem=problem, errors=errors, before=before, tried=(*few, *rest))


def _posed_about(first: Step) -> tuple[Problem, Errors, tuple[Tried, ...]] | None:
    """Return the problem about the best candidate that also fine bars bear, and the candidates from it on."""
    for k, one in enumerate(first.tried[:_RIVALS]):
        try:
            problem, errors = posed(first.problem.stack, first.problem.rig, one.fit.at)
        except FitError:
            continue
        return problem, errors, first.tried[k:]
    return None


def _settled(few: list[Tried], held: HeldOut | None) -> list[Tried]:
    """Let what was held out say which of those comes first that the fitted runs do not part."""
    if held is None:
        return few
    close = [one for one in few if few[0].delta_bic - one.delta_bic < CLOSE]
    return sorted(close, key=lambda one: held.ratio(one.fit.at)) + few[len(close) :]


def _hopeless(base: Fit, problem: Problem, fit: Fit) -> bool:
    """Whether two effects have left more than half of what was to be explained: no third will."""
    beyond = [one.chi2 / problem.stack.size - 1.0 for one in (base, fit)]
    return len(fit.at.effects) > 1 and beyond[1] > max(_HALF * beyond[0], _HALF)


def _worse(before: Fit, after: Fit, held: HeldOut | None) -> bool:
    """Whether one more effect makes the gap of what was held out wider than that already is."""
    return held is not None and held.gap(after.at) > max(held.gap(before.at), GAP)


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
    while len(fit.at.effects) < MOST and not _hopeless(base, problem, fit):
        now = step(problem, errors, fit, tried, seed + len(steps))
        if not now.tried or not now.passes(now.tried[0]):
            steps.append(now)
            break
        now = reposed(now, held)
        steps.append(now)
        best = now.tried[0]
        if not now.passes(best) or (steps[1:] and _worse(fit, best.fit, held)):
            break
        problem, errors, fit = now.problem, now.errors, best.fit
        if len(fit.at.effects) > 1:
            problem, errors, fit = exchanged(problem, errors, fit, tried, seed)
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
    problem: Problem, errors: Errors, fit: Fit, tried: Sequence[Variant], seed: int
) -> tuple[Problem, Errors, Fit]:
    """Take each effect out in turn, and put in its place whatever fits best there, or nothing."""
    for which in range(len(fit.at.effects) - 1):
        rest = refined(problem, without(fit.at, which))
        now = step(problem, errors, rest, tried, seed, _EXCHANGED)
        best = now.tried[0] if now.tried else None
        if best is None or not now.passes(best):
            fit = rest
            break
        if best.fit.chi2 < fit.chi2 - 1.0 and best.name != name_of(fit.at.effects[which]):
            told = _posed_about(now)
            if told is not None:
                problem, errors, (best, *_) = told
                fit = refined(problem, best.fit.at)
            break
    return problem, errors, fit

"""Selection of the parts of a machine: forward, one at a time, and one backward pass.

Source: docs/model.md (196)-(198).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

from tssgeom.identify.machine_evidence import FittedModel, delta_bic
from tssgeom.identify.machine_forecast import Forecast, forecast
from tssgeom.identify.machine_law_search import law_step, laws_for_formulae, without_formulae
from tssgeom.identify.machine_parts import Part
from tssgeom.identify.machine_problem import FIT
from tssgeom.identify.machine_refit import MACHINE_SEARCH, refitted, without_needless
from tssgeom.identify.machine_run import MachineRun
from tssgeom.identify.machine_score import PartScore, as_noise, score_of, straight_lines
from tssgeom.identify.machine_steps import (
    PartStep,
    is_far,
    left_beyond_noise,
    refits,
    tried_part,
    with_forecasts,
)
from tssgeom.identify.selection import SEARCH
from tssgeom.statistics import EVIDENCE_SCALE, NORMAL_95


@dataclass(frozen=True, slots=True)
class PartSelection:
    """What was chosen, and how."""

    base: FittedModel
    model: FittedModel
    steps: tuple[PartStep, ...]


def selected_parts(
    base: FittedModel,
    parts: Sequence[Part],
    kept: Sequence[MachineRun],
    progress: Callable[[float], object] = lambda share: None,
) -> PartSelection:
    """Choose parts and laws as long as one passes, then take out what the others have made needless.

    Where the fit without a part, begun where that with it ends, needs it no more, it goes on there; (303).
    """
    model = base = _by_noise(base, kept)
    steps, again = list[PartStep](), 0
    before = cache(partial(forecast, base))
    while len(model.parts) < SEARCH.most:
        progress(len(model.parts) / SEARCH.most)
        made = _next_steps(base, before, model, parts, kept)
        best = made[-1].chosen
        less = None if best is None else without_needless(best.model, len(best.model.parts) - 1, kept)
        if less is not None and again < MACHINE_SEARCH.again:
            base, model, again = (base if less.parts else less), less, again + 1
            before = cache(partial(forecast, base))
            continue
        steps += made
        if best is None:
            break
        model = without_formulae(base, best.model, kept) if best.part.laws else best.model
    model = _backward(model, kept)
    for step in laws_for_formulae(base, model, kept):
        steps.append(step)
        model = model if step.chosen is None else _backward(step.chosen.model, kept)
    return PartSelection(base, model, tuple(steps))


def _next_steps(
    base: FittedModel,
    before: Callable[[], Forecast | None],
    model: FittedModel,
    parts: Sequence[Part],
    kept: Sequence[MachineRun],
) -> tuple[PartStep, ...]:
    """Return a step of parts; where none passes that and one of free laws, (311), or two of parts, (290)."""
    now = with_forecasts(before, part_step(base, model, parts, kept))
    if now.chosen:
        return (now,)
    laws = with_forecasts(before, law_step(base, model, kept))
    if laws.chosen:
        return now, laws
    first, *more = two_steps(base, before, now, parts, kept)
    return (first, *more) if more else (first, laws)


def part_step(
    base: FittedModel, model: FittedModel, parts: Sequence[Part], kept: Sequence[MachineRun]
) -> PartStep:
    """Try every part on top of a model: a score test for all, a refit for the most promising.

    None may make a channel worse than without it, or than in the `base` without any part.
    """
    tests = [*_scores(model, parts)]
    return refits(base, model, [one for one in tests if one.gain > NORMAL_95**2], kept)


def _scores(model: FittedModel, parts: Sequence[Part]) -> Iterator[PartScore]:
    """Yield what is promised by each part that a model has not."""
    has, freed = {part.label for part in model.parts}, {key for part in model.parts for key in part.of_rig}
    lines, sharp = straight_lines(model), straight_lines(as_noise(model)) if is_far(model) else None
    laws = {law.name for law in model.problem.laws}  # which follow any formula of their mechanism
    new = [part for part in parts if part.label not in has and not part.of_rig & freed]
    new = [part for part in new if part.mechanism not in laws]
    for part in new:
        if (made := score_of(part, lines, sharp)) is not None:
            yield made


def _by_noise(base: FittedModel, kept: Sequence[MachineRun]) -> FittedModel:
    """Return a base that leaves noise alone, or a likelier one fitted at the weights of noise; (308)."""
    if left_beyond_noise(base, base.fitted) >= 1.0:
        return base
    better = refitted(base.problem, base.state.u, as_noise(base), base.parts, kept, base.fixed)
    return base if better is None or delta_bic(base, better) <= 0.0 else better


def two_steps(
    base: FittedModel,
    before: Callable[[], Forecast | None],
    now: PartStep,
    parts: Sequence[Part],
    kept: Sequence[MachineRun],
) -> tuple[PartStep, ...]:
    """Return a step at which no part passes, or that and another: two parts that pass together; (290)."""
    model, pairs = now.before, dict[str, tuple[float, PartStep]]()
    if not is_far(model) or len(model.parts) > SEARCH.most - 2:
        return (now,)
    refuted = [one for one in now.tried if one.contradiction and replace(one, contradiction="").passes]
    for first in sorted(refuted, key=lambda one: -one.evidence)[: FIT.starts]:
        further = with_forecasts(before, part_step(base, first.model, parts, kept))
        if (second := further.chosen) is None:
            continue
        both = tried_part(base, model, second.part, second.model)
        if both.passes and without_needless(second.model, len(model.parts), kept) is None:
            pairs[first.part.label] = both.evidence, further
    top = max((evidence for evidence, _ in pairs.values()), default=0.0)
    close = {label for label, (evidence, _) in pairs.items() if top - evidence < EVIDENCE_SCALE.strong}
    tried = (replace(one, contradiction="") if one.part.label in close else one for one in now.tried)
    both = replace(now, tried=tuple(tried))
    return (both, pairs[both.chosen.part.label][1]) if both.chosen else (now,)


def _backward(model: FittedModel, kept: Sequence[MachineRun]) -> FittedModel:
    """Take out, one after the other, parts that the others have made needless."""
    last = 1 if model.parts and not model.parts[-1].laws else 0  # that was needed when it came
    fewer = (without_needless(model, which, kept) for which in range(len(model.parts) - last))
    less = next((each for each in fewer if each is not None), None)
    return model if less is None else _backward(less, kept)

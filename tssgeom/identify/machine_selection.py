"""Selection of the parts of a machine: forward, one at a time, and one backward pass.

Source: docs/model.md (196)-(198).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE
from tssgeom.identify.machine_evidence import (
    FittedModel,
    changes,
    contradicted,
    delta_bic,
    held_out_ratio,
    held_out_rises,
    modelled,
    noise_of,
    refused,
    touched,
    worse,
)
from tssgeom.identify.machine_fit import fitted_again
from tssgeom.identify.machine_forecast import Forecast, contradiction, forecast
from tssgeom.identify.machine_parts import Part
from tssgeom.identify.machine_problem import Problem
from tssgeom.identify.machine_refit import MACHINE_SEARCH, refitted, without_needless
from tssgeom.identify.machine_run import MachineRun
from tssgeom.identify.machine_score import PartScore, as_noise, score_of, straight_lines
from tssgeom.identify.misfit import beyond_noise
from tssgeom.identify.selection import SEARCH
from tssgeom.statistics import EVIDENCE_SCALE, NORMAL_95


@dataclass(frozen=True, slots=True)
class TriedPart:
    """One part on top of a model, refitted."""

    part: Part
    model: FittedModel
    delta_bic: float
    size: float
    """Largest change of a channel over what shows [1]."""
    rise: float
    """Of −2 ln L of what is held out [1]."""
    held_ratio: float
    """Held-out rms over that without, over channels [1]; NaN where nothing is held out."""
    refusal: str = ""
    """Why physics or a bound forbids it; empty where nothing does."""
    contradiction: str = ""
    """Which held-out channel it makes worse, in a clause; empty where none."""

    @property
    def evidence(self) -> float:
        """ΔBIC, and by how much −2 ln L of what is held out falls [1]."""
        return self.delta_bic - self.rise

    @property
    def least(self) -> float:
        """The less of ΔBIC and evidence: neither fitted nor held-out readings name a part alone [1]."""
        return min(self.delta_bic, self.evidence)

    @property
    def passes(self) -> bool:
        """Whether evidence, size, held-out readings and physics all allow it."""
        evident = self.least > EVIDENCE_SCALE.very_strong and self.size > 1.0
        return evident and not self.refusal and not self.contradiction

    @property
    def why_not(self) -> str:
        """One sentence on why it does not pass; empty where it does."""
        needed = EVIDENCE_SCALE.very_strong
        if self.delta_bic <= needed:
            return f"its ΔBIC of {self.delta_bic:.1f} is below {needed:.0f}."
        if self.evidence <= needed:
            return f"its ΔBIC, held-out readings included, of {self.evidence:.1f} is below {needed:.0f}."
        if self.size <= 1.0:
            return f"it changes no channel by more than {self.size:.2g} of the detection limit."
        return f"{why}." if (why := self.refusal or self.contradiction) else ""


@dataclass(frozen=True, slots=True)
class PartStep:
    """All parts that were tried on top of one model, the best first."""

    before: FittedModel
    tried: tuple[TriedPart, ...]

    @property
    def chosen(self) -> TriedPart | None:
        """The best that passes; of those with like evidence the one that carries over best."""
        return min(self.close, key=lambda one: one.rise, default=None)

    @property
    def close(self) -> list[TriedPart]:
        """Those that pass, with an evidence within what separates two; of nested ones the smallest."""
        passing = [one for one in self.tried if one.passes]
        top = max((one.evidence for one in passing), default=0.0)
        near = [one for one in passing if top - one.evidence < EVIDENCE_SCALE.strong]
        freed = [one.part.of_rig for one in near if one.part.of_rig]
        return [one for one in near if not any(keys < one.part.of_rig for keys in freed)]

    @property
    def tied(self) -> list[TriedPart]:
        """Those that neither evidence nor held-out readings separate from the chosen one."""
        best = self.chosen
        if best is None:
            return []
        return [one for one in self.close if one is not best and one.part.label != best.part.label]


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
    """Choose parts as long as one passes, then take out what the others have made needless.

    Where the fit without a part, begun where that with it ends, needs it no more, it goes on there; (303).
    """
    model = base = _by_noise(base, kept)
    steps, again = list[PartStep](), 0
    before = cache(partial(forecast, base))
    while len(model.parts) < SEARCH.most:
        progress(len(model.parts) / SEARCH.most)
        now = _forecast(before, part_step(base, model, parts, kept))
        made = (now,) if now.chosen else two_steps(base, before, now, parts, kept)
        best = made[-1].chosen
        less = None if best is None else without_needless(best.model, len(best.model.parts) - 1, kept)
        if less is not None and again < MACHINE_SEARCH.again:
            base, model, again = (base if less.parts else less), less, again + 1
            before = cache(partial(forecast, base))
            continue
        steps += made
        if best is None:
            break
        model = best.model
    return PartSelection(base, _backward(model, kept), tuple(steps))


def part_step(
    base: FittedModel, model: FittedModel, parts: Sequence[Part], kept: Sequence[MachineRun]
) -> PartStep:
    """Try every part on top of a model: a score test for all, a refit for the most promising.

    None may make a channel worse than without it, or than in the `base` without any part.
    """
    has, freed = {part.label for part in model.parts}, {key for part in model.parts for key in part.of_rig}
    lines, sharp = straight_lines(model), straight_lines(as_noise(model)) if _is_far(model) else None
    new = [part for part in parts if part.label not in has and not part.of_rig & freed]
    tests = [score_of(part, lines, sharp) for part in new]
    tests = [one for one in tests if one is not None and one.gain > NORMAL_95**2]
    tests.sort(key=lambda one: -one.gain)
    quick = [_refit(base, model, one, kept) for one in tests[: MACHINE_SEARCH.refitted]]
    tried = sorted((one for one in quick if one is not None), key=lambda one: -one.delta_bic)
    few = [_continued(base, model, one, kept) for one in tried[: MACHINE_SEARCH.continued]]
    few.sort(key=lambda one: -one.delta_bic)
    return PartStep(model, (*few, *tried[MACHINE_SEARCH.continued :]))


def _by_noise(base: FittedModel, kept: Sequence[MachineRun]) -> FittedModel:
    """Return a base that leaves noise alone, or a likelier one fitted at the weights of noise; (308)."""
    if _beyond_noise(base, base.fitted) >= 1.0:
        return base
    better = refitted(base.problem, base.state.u, as_noise(base), base.parts, kept, base.fixed)
    return base if better is None or delta_bic(base, better) <= 0.0 else better


def _is_far(model: FittedModel) -> bool:
    """Whether a model leaves more than three times the noise."""
    return _beyond_noise(model, model.held or model.fitted) > CHANCE.clear


def _beyond_noise(model: FittedModel, rms: Mapping[str, float]) -> float:
    """Return the misfit of a model [1]; (112)."""
    return beyond_noise(rms, noise_of((model,), model.rig))


def _forecast(before: Callable[[], Forecast | None], now: PartStep) -> PartStep:
    """Refuse what would be chosen as long as it makes the end of the runs worse; docs/model.md (246)."""
    while (best := now.chosen) is not None and (why := contradiction(before(), best.model)):
        tried = tuple(replace(one, contradiction=why) if one is best else one for one in now.tried)
        now = replace(now, tried=tried)
    return now


def two_steps(
    base: FittedModel,
    before: Callable[[], Forecast | None],
    now: PartStep,
    parts: Sequence[Part],
    kept: Sequence[MachineRun],
) -> tuple[PartStep, ...]:
    """Return a step at which no part passes, or that and another: two parts that pass together; (290)."""
    model, pairs = now.before, dict[str, tuple[float, PartStep]]()
    if not _is_far(model) or len(model.parts) > SEARCH.most - 2:
        return (now,)
    refuted = [one for one in now.tried if one.contradiction and replace(one, contradiction="").passes]
    for first in sorted(refuted, key=lambda one: -one.evidence)[: MACHINE_SEARCH.continued]:
        further = _forecast(before, part_step(base, first.model, parts, kept))
        if (second := further.chosen) is None:
            continue
        both = _tried(base, model, second.part, second.model)
        if both.passes and without_needless(second.model, len(model.parts), kept) is None:
            pairs[first.part.label] = both.evidence, further
    top = max((evidence for evidence, _ in pairs.values()), default=0.0)
    close = {label for label, (evidence, _) in pairs.items() if top - evidence < EVIDENCE_SCALE.strong}
    tried = (replace(one, contradiction="") if one.part.label in close else one for one in now.tried)
    both = replace(now, tried=tuple(tried))
    return (both, pairs[both.chosen.part.label][1]) if both.chosen else (now,)


def _backward(model: FittedModel, kept: Sequence[MachineRun]) -> FittedModel:
    """Take out, one after the other, parts that the others have made needless."""
    fewer = (without_needless(model, which, kept) for which in range(len(model.parts) - 1))
    less = next((each for each in fewer if each is not None), None)
    return model if less is None else _backward(less, kept)


def _refit(
    base: FittedModel, model: FittedModel, one: PartScore, kept: Sequence[MachineRun]
) -> TriedPart | None:
    """Refit a part from where its straight line points, or from what is typical of it."""
    typical = one.start.copy()
    switch = len(model.state.u) + one.part.switch_at
    typical[switch] = one.part.switch.prior.u(one.part.switch.start)
    half = one.start.copy()
    half[switch] *= 0.3
    starts = [
        (value, u)
        for u in ((one.start,) if one.fitted else (one.start, half, typical))
        if (value := _at(one.problem, u, one.model)) < math.inf
    ]
    if not starts:
        return None
    start = min(starts, key=lambda each: each[0])[1]
    after = refitted(one.problem, start, one.model, [*model.parts, one.part], kept)
    return None if after is None else _tried(base, model, one.part, after)


def _continued(
    base: FittedModel, model: FittedModel, one: TriedPart, kept: Sequence[MachineRun]
) -> TriedPart:
    problem, state = fitted_again(one.model.problem, one.model.state)
    after = modelled(problem, state, one.model.parts, kept, one.model.fixed)
    return _tried(base, model, one.part, after)


def _tried(base: FittedModel, model: FittedModel, part: Part, after: FittedModel) -> TriedPart:
    size = max(changes(model, after).values())
    gain, ratio, rises = delta_bic(model, after), held_out_ratio(model, after), held_out_rises(model, after)
    made = TriedPart(part, after, gain, size, sum(rises.values()), ratio)
    if made.least <= EVIDENCE_SCALE.very_strong:
        return made
    by = touched(after, [part]), touched(after, after.parts)
    pairs = zip((model, base), by, strict=True)
    against = (worse(one, after, contradicted(held_out_rises(one, after), those)) for one, those in pairs)
    return replace(made, refusal=refused(model, after), contradiction=next(filter(None, against), ""))


def _at(problem: Problem, u: Vector, model: FittedModel) -> float:
    there = problem.model(u)
    if there is None:
        return math.inf
    left = np.concatenate(model.state.weight) * np.concatenate(problem.left(there))
    return float(left @ left + u @ u)

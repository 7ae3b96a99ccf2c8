"""One step of the search for what a machine lacks: what was tried on top of a model, and which of it passes.

Source: docs/model.md (196)-(198), (246).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

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
    touched,
    worse,
)
from tssgeom.identify.machine_fit import fitted_again
from tssgeom.identify.machine_forecast import Forecast, contradiction
from tssgeom.identify.machine_parts import Part
from tssgeom.identify.machine_physics import refused
from tssgeom.identify.machine_problem import FIT, Problem
from tssgeom.identify.machine_refit import MACHINE_SEARCH, held_out_asks, refitted
from tssgeom.identify.machine_run import MachineRun
from tssgeom.identify.machine_score import PartScore
from tssgeom.identify.misfit import beyond_noise
from tssgeom.statistics import EVIDENCE_SCALE


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
        evident = (
            self.least > EVIDENCE_SCALE.very_strong
            and self.size > 1.0
            and held_out_asks(self.part, -self.rise)
        )
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
        if not held_out_asks(self.part, -self.rise):
            return "the held-out readings do not show it."
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


def refits(
    base: FittedModel, model: FittedModel, tests: Sequence[PartScore], kept: Sequence[MachineRun]
) -> PartStep:
    """Refit the most promising parts, and go on with the best of them."""
    tests = sorted(tests, key=lambda one: -one.gain)
    quick = [_refit(base, model, one, kept) for one in tests[: MACHINE_SEARCH.refitted]]
    tried = sorted((one for one in quick if one is not None), key=lambda one: -one.delta_bic)
    few = [_continued(base, model, one, kept) for one in tried[: FIT.starts]]
    few.sort(key=lambda one: -one.delta_bic)
    return PartStep(model, (*few, *tried[FIT.starts :]))


def is_far(model: FittedModel) -> bool:
    """Whether a model leaves more than three times the noise."""
    return left_beyond_noise(model, model.held or model.fitted) > CHANCE.clear


def left_beyond_noise(model: FittedModel, rms: Mapping[str, float]) -> float:
    """Return the misfit of a model [1]; (112)."""
    return beyond_noise(rms, noise_of((model,), model.rig))


def with_forecasts(before: Callable[[], Forecast | None], now: PartStep) -> PartStep:
    """Refuse what would be chosen as long as it makes the end of the runs worse; docs/model.md (246)."""
    while (best := now.chosen) is not None and (why := contradiction(before(), best.model)):
        tried = tuple(replace(one, contradiction=why) if one is best else one for one in now.tried)
        now = replace(now, tried=tried)
    return now


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
    return None if after is None else tried_part(base, model, one.part, after)


def _continued(
    base: FittedModel, model: FittedModel, one: TriedPart, kept: Sequence[MachineRun]
) -> TriedPart:
    problem, state = fitted_again(one.model.problem, one.model.state)
    after = modelled(problem, state, one.model.parts, kept, one.model.fixed)
    return tried_part(base, model, one.part, after)


def tried_part(base: FittedModel, model: FittedModel, part: Part, after: FittedModel) -> TriedPart:
    """Return what a part was worth on top of a model, from the model refitted with it."""
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

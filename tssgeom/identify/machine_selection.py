"""Selection of the parts of a machine: forward, one at a time, and one backward pass.

Source: docs/model.md (196)-(198).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import FitError
from tssgeom.identify.machine_evidence import (
    FittedModel,
    changes,
    contradicted,
    delta_bic,
    held_out_ratio,
    held_out_rises,
    modelled,
    refused,
)
from tssgeom.identify.machine_fit import fit_round, fitted_again
from tssgeom.identify.machine_parts import PARTS, Part
from tssgeom.identify.machine_problem import FIT, Problem
from tssgeom.identify.machine_run import MachineRun
from tssgeom.identify.selection import SEARCH
from tssgeom.rig import with_values
from tssgeom.statistics import EVIDENCE_SCALE, NORMAL_95


@dataclass(frozen=True, slots=True)
class MachineSearch:
    """How parts are searched for. All are chosen, for speed."""

    refitted: int = 8
    """Parts that are refitted after the score test; chosen."""
    continued: int = 3
    """Parts whose refit goes on until weights and numbers converge; chosen."""
    steps: int = 6
    """Steps of the first round of a refit; chosen."""


MACHINE_SEARCH = MachineSearch()


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
    refusal: str
    """Why physics, a bound or a channel that it makes worse forbids it; empty where nothing does."""

    @property
    def evidence(self) -> float:
        """ΔBIC, and by how much −2 ln L of what is held out falls [1]."""
        return self.delta_bic - self.rise

    @property
    def passes(self) -> bool:
        """Whether evidence, size, held-out readings and physics all allow it."""
        return self.evidence > EVIDENCE_SCALE.very_strong and self.size > 1.0 and not self.refusal

    @property
    def why_not(self) -> str:
        """One sentence on why it does not pass; empty where it does."""
        if self.evidence <= EVIDENCE_SCALE.very_strong:
            least = f"{EVIDENCE_SCALE.very_strong:.0f}"
            return f"its ΔBIC, held-out readings included, of {self.evidence:.1f} is below {least}."
        if self.size <= 1.0:
            return f"it changes no channel by more than {self.size:.2g} of the detection limit."
        return f"{self.refusal}." if self.refusal else ""


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
        """Those that pass, with an evidence within what separates two."""
        passing = [one for one in self.tried if one.passes]
        top = max((one.evidence for one in passing), default=0.0)
        return [one for one in passing if top - one.evidence < EVIDENCE_SCALE.strong]

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
    """Choose parts as long as one passes, then take out what the others have made needless."""
    model, steps = base, list[PartStep]()
    for turn in range(SEARCH.most):
        progress(turn / SEARCH.most)
        now = part_step(model, parts, kept)
        steps.append(now)
        best = now.chosen
        if best is None:
            break
        model = best.model
    return PartSelection(base, _backward(model, kept), tuple(steps))


def part_step(model: FittedModel, parts: Sequence[Part], kept: Sequence[MachineRun]) -> PartStep:
    """Try every part on top of a model: a score test for all, a refit for the most promising."""
    has = {part.label for part in model.parts}
    lines = _lines(model)
    tests = [_score(model, part, lines) for part in parts if part.label not in has]
    tests = [one for one in tests if one is not None and one.gain > NORMAL_95**2]
    tests.sort(key=lambda one: -one.gain)
    quick = [_refit(model, one, kept) for one in tests[: MACHINE_SEARCH.refitted]]
    tried = sorted((one for one in quick if one is not None), key=lambda one: -one.delta_bic)
    few = [_continued(model, one, kept) for one in tried[: MACHINE_SEARCH.continued]]
    few.sort(key=lambda one: -one.delta_bic)
    return PartStep(model, (*few, *tried[MACHINE_SEARCH.continued :]))


def _backward(model: FittedModel, kept: Sequence[MachineRun]) -> FittedModel:
    """Take out, once, the part that the others have made needless."""
    if len(model.parts) < 2:
        return model
    for which in range(len(model.parts) - 1):
        less = without_part(model, which, kept)
        if less is not None and delta_bic(less, reordered(model, which)) < EVIDENCE_SCALE.very_strong:
            return less
    return model


def without_part(model: FittedModel, which: int, kept: Sequence[MachineRun]) -> FittedModel | None:
    """Return the model refitted without one of its parts; None where that has no equilibrium."""
    problem, part = model.problem, model.parts[which]
    names = {f"{part.label}: {number.name}" for number in part.numbers}
    stays = [j for j, each in enumerate(problem.parameters) if each.name not in names]
    rig, parameters = problem.rig, [problem.parameters[j] for j in stays]
    off = {
        each.key: each.prior.centre
        for each in problem.parameters
        if each.name in names and not each.prior.log
    }
    less = replace(problem, rig=with_values(rig, off), parameters=tuple(parameters))
    parts = [each for k, each in enumerate(model.parts) if k != which]
    return _fitted(less, model.state.u[stays], model, parts, kept)


def without_zeros(
    model: FittedModel, channels: Sequence[str], kept: Sequence[MachineRun]
) -> tuple[FittedModel, FittedModel] | None:
    """Return a model refitted with zeros of channels at those of the rig, and itself in that order."""
    problem = model.problem
    of_zero = np.array([each.kind == "zero" and each.key in channels for each in problem.parameters])
    stays = np.flatnonzero(~of_zero)
    less = replace(problem, parameters=tuple(problem.parameters[j] for j in stays))
    made = _fitted(less, model.state.u[stays], model, model.parts, kept, channels)
    order = np.concatenate([stays, np.flatnonzero(of_zero)])
    same = replace(model, state=replace(model.state, u=model.state.u[order]))
    return None if made is None else (made, same)


def reordered(model: FittedModel, which: int) -> FittedModel:
    """Return the model with the numbers of one part last, as `delta_bic` compares them."""
    names = {f"{model.parts[which].label}: {number.name}" for number in model.parts[which].numbers}
    of_part = np.array([each.name in names for each in model.problem.parameters])
    order = np.concatenate([np.flatnonzero(~of_part), np.flatnonzero(of_part)])
    return replace(model, state=replace(model.state, u=model.state.u[order]))


@dataclass(frozen=True, slots=True)
class _Score:
    """What a straight line promises of a part."""

    part: Part
    problem: Problem
    start: Vector
    gain: float
    """Fall of χ² [1]."""


class _Lines(NamedTuple):
    """A model as a straight line in its numbers, weighted."""

    weight: Vector
    slope: Matrix
    normal: Matrix
    left: Vector


def _lines(model: FittedModel) -> _Lines:
    state, weight = model.state, np.concatenate(model.state.weight)
    slope = model.problem.jacobian(state.u, state.channels, state.left) * weight[:, None]
    normal = slope.T @ slope + np.eye(len(state.u))
    return _Lines(weight, slope, normal, weight * np.concatenate(state.left))


def _score(model: FittedModel, part: Part, lines: _Lines) -> _Score | None:
    """Return the best of a few scales of a part, by a straight line in its switch."""
    problem, state = model.problem, model.state
    rig, own = part.on(problem.rig)
    longer = replace(problem, rig=rig, parameters=(*problem.parameters, *own))
    scales = [k for k, number in enumerate(part.numbers) if not number.switch]
    switch = next(k for k, number in enumerate(part.numbers) if number.switch)
    step = part.switch.prior.u(part.switch.start)
    best: _Score | None = None
    for pushed in itertools.product((0.0, -1.0, 1.0), repeat=min(len(scales), 1)):
        added = np.zeros(len(own))
        for k, push in zip(scales, pushed, strict=False):
            added[k] = push * math.log(PARTS.pushed) / part.numbers[k].prior.sd
        for share in (1.0, 0.2):
            added[switch] = share * step
            there = longer.model(np.concatenate([state.u, added]))
            if there is not None:
                break
        else:
            continue
        column = (
            lines.weight * (np.concatenate(longer.left(there)) - np.concatenate(state.left)) / added[switch]
        )
        score = _line(lines, column)
        amplitude = score[0]
        number = part.switch
        low, high = (
            number.prior.u(each) if math.isfinite(each) else each for each in (number.lower, number.upper)
        )
        if not low < amplitude < high:
            amplitude = min(max(amplitude, low + 1e-3), high - 1e-3)
        gain = score[1] if score[0] * amplitude > 0.0 and low < score[0] else 0.0
        start = added.copy()
        start[switch] = min(max(amplitude, -FIT.farthest), FIT.farthest)
        made = _Score(part, longer, np.concatenate([state.u, start]), gain)
        best = made if best is None or made.gain > best.gain else best
    return best


def _line(lines: _Lines, column: Vector) -> tuple[float, float]:
    """Return the amplitude of one more column and the fall of χ², all other numbers following."""
    rest = column - lines.slope @ np.linalg.solve(lines.normal, lines.slope.T @ column)
    power = float(rest @ rest)
    if power <= 1e-12:
        return 0.0, 0.0
    pull = float(rest @ lines.left)
    return -pull / power, pull**2 / power


def _refit(model: FittedModel, one: _Score, kept: Sequence[MachineRun]) -> TriedPart | None:
    """Refit a part from where its straight line points, or from what is typical of it."""
    shared = len(model.state.u)
    typical = one.start.copy()
    switch = shared + next(k for k, number in enumerate(one.part.numbers) if number.switch)
    typical[switch] = one.part.switch.prior.u(one.part.switch.start)
    half = one.start.copy()
    half[switch] *= 0.3
    starts = [
        (value, u) for u in (one.start, half, typical) if (value := _at(one.problem, u, model)) < math.inf
    ]
    if not starts:
        return None
    start = min(starts, key=lambda each: each[0])[1]
    after = _fitted(one.problem, start, model, [*model.parts, one.part], kept)
    return None if after is None else _tried(model, one.part, after)


def _continued(model: FittedModel, one: TriedPart, kept: Sequence[MachineRun]) -> TriedPart:
    problem, state = fitted_again(one.model.problem, one.model.state)
    return _tried(model, one.part, modelled(problem, state, one.model.parts, kept, one.model.fixed))


def _tried(model: FittedModel, part: Part, after: FittedModel) -> TriedPart:
    size = max(changes(model, after).values())
    gain, ratio, rises = delta_bic(model, after), held_out_ratio(model, after), held_out_rises(model, after)
    made = TriedPart(part, after, gain, size, sum(rises.values()), ratio, "")
    if made.evidence <= EVIDENCE_SCALE.very_strong:
        return made
    return replace(made, refusal=refused(model, after) or _worse(model, after, contradicted(rises)))


def _worse(model: FittedModel, after: FittedModel, channel: str) -> str:
    """Say which channel a part makes worse on what is held out; empty where it makes none."""
    if not channel:
        return ""
    ratio = after.held[channel] / max(model.held[channel], 1e-15)
    return f"with it the held-out rms of {channel} is {ratio:.3g} times that without"


def _at(problem: Problem, u: Vector, model: FittedModel) -> float:
    there = problem.model(u)
    if there is None:
        return math.inf
    left = np.concatenate(model.state.weight) * np.concatenate(problem.left(there))
    return float(left @ left + u @ u)


def _fitted(
    problem: Problem,
    start: Vector,
    model: FittedModel,
    parts: Sequence[Part],
    kept: Sequence[MachineRun],
    fixed: Sequence[str] = (),
) -> FittedModel | None:
    """Fit from a start with the weights of a model, then with its own."""
    try:
        state = fit_round(problem, start, model.state.weight, model.state.inflation, MACHINE_SEARCH.steps)
        problem, state = fitted_again(problem, state)
        return modelled(problem, state, parts, kept, fixed)
    except FitError:
        return None

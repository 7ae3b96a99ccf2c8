"""Refits of a machine: from a start, and without a part or a zero that it has.

Source: docs/model.md (196)-(198), (291).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import FitError
from tssgeom.identify.finding import RigNumber
from tssgeom.identify.machine_evidence import (
    FittedModel,
    contradicted,
    delta_bic,
    held_out_rises,
    is_below_noise,
    modelled,
)
from tssgeom.identify.machine_fit import fit_round, fitted_again
from tssgeom.identify.machine_parameters import Parameter
from tssgeom.identify.machine_parts import Part
from tssgeom.identify.machine_problem import Problem
from tssgeom.identify.machine_run import MachineRun
from tssgeom.rig import Rig, with_values
from tssgeom.statistics import EVIDENCE_SCALE
from tssgeom.uncertain import path_of


@dataclass(frozen=True, slots=True)
class MachineSearch:
    """How parts are searched for. All are chosen, for speed."""

    refitted: int = 8
    """Parts that are refitted after the score test; chosen."""
    again: int = 2
    """Times that a step is made again from a better fit without a part; chosen."""
    steps: int = 6
    """Steps of the first round of a refit; chosen."""


MACHINE_SEARCH = MachineSearch()


def refitted(
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


def without_needless(model: FittedModel, which: int, kept: Sequence[MachineRun]) -> FittedModel | None:
    """Return a model without one of its parts; None where fitted or held-out readings ask for that; (291)."""
    less, whole = without_part(model, which, kept), reordered(model, which)
    if less is None:
        return None
    if is_below_noise(model, model.parts[which]):
        return less
    fall = -sum(held_out_rises(less, whole).values())
    asked = delta_bic(less, whole) >= EVIDENCE_SCALE.very_strong and held_out_asks(model.parts[which], fall)
    held = fall > 0.0 and contradicted(held_out_rises(whole, less))
    return None if asked or held else less


def held_out_asks(part: Part, fall: float) -> bool:
    """Whether the fall of −2 ln L of held-out readings alone asks for a part that is a law; (311).

    A law follows whatever it is fitted to.
    """
    return not part.laws or fall > EVIDENCE_SCALE.very_strong


def without_part(model: FittedModel, which: int, kept: Sequence[MachineRun]) -> FittedModel | None:
    """Return the model refitted without one of its parts; None where that has no equilibrium."""
    problem, part = model.problem, model.parts[which]
    names = {f"{part.label}: {number.name}" for number in part.numbers}
    stays = [j for j, each in enumerate(problem.parameters) if each.name not in names]
    parameters = [problem.parameters[j] for j in stays]
    laws, rig = tuple(law for law in problem.laws if law not in part.laws), problem.rig
    if isinstance(part.effect, RigNumber):
        off = {
            each.key: each.prior.centre
            for each in problem.parameters
            if each.name in names and not each.prior.log
        }
        rig = with_values(problem.rig, off)
    elif not part.laws:
        own = next(each.key for each in problem.parameters if each.name in names)
        rig, parameters = _without_effect(problem.rig, int(str(path_of(own)[1])), parameters)
    less = replace(problem, rig=rig, parameters=tuple(parameters), laws=laws)
    parts = [each for k, each in enumerate(model.parts) if k != which]
    return refitted(less, model.state.u[stays], model, parts, kept)


def _without_effect(rig: Rig, at: int, parameters: Sequence[Parameter]) -> tuple[Rig, list[Parameter]]:
    """Return a rig without one of its effects, and parameters with the keys that they have then."""
    moved = list[Parameter]()
    for each in parameters:
        table, *rest = path_of(each.key) if each.kind == "rig" else ("",)
        behind = table == "effects" and int(rest[0]) > at
        moved.append(each._replace(key=f"effects[{int(rest[0]) - 1}].{rest[1]}") if behind else each)
    return msgspec.structs.replace(rig, effects=rig.effects[:at] + rig.effects[at + 1 :]), moved


def without_zeros(
    model: FittedModel, channels: Sequence[str], kept: Sequence[MachineRun]
) -> tuple[FittedModel, FittedModel] | None:
    """Return a model refitted with zeros of channels at those of the rig, and itself in that order."""
    problem = model.problem
    of_zero = np.array([each.kind == "zero" and each.key in channels for each in problem.parameters])
    stays = np.flatnonzero(~of_zero)
    less = replace(problem, parameters=tuple(problem.parameters[j] for j in stays))
    made = refitted(less, model.state.u[stays], model, model.parts, kept, channels)
    return None if made is None else (made, _with_last(model, of_zero))


def reordered(model: FittedModel, which: int) -> FittedModel:
    """Return the model with the numbers of one part last, as `delta_bic` compares them."""
    names = {f"{model.parts[which].label}: {number.name}" for number in model.parts[which].numbers}
    return _with_last(model, np.array([each.name in names for each in model.problem.parameters]))


def _with_last(model: FittedModel, which: np.ndarray) -> FittedModel:
    order = np.concatenate([np.flatnonzero(~which), np.flatnonzero(which)])
    parameters = tuple(model.problem.parameters[j] for j in order)
    state = replace(model.state, u=model.state.u[order], steps=model.state.steps[order], beside=None)
    return replace(model, problem=replace(model.problem, parameters=parameters), state=state)

"""What each part of a machine promises by a straight line, before it is refitted."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import CHANCE
from tssgeom.errors import FitError
from tssgeom.identify.machine_evidence import FittedModel, block_gain, noise_of
from tssgeom.identify.machine_fit import fit_round
from tssgeom.identify.machine_parts import PARTS, Part
from tssgeom.identify.machine_problem import Problem
from tssgeom.least_squares import SOLVER


@dataclass(frozen=True, slots=True)
class PartScore:
    """What a straight line promises of a part, or two steps of a fit that asks it to leave noise alone."""

    part: Part
    problem: Problem
    """With the part."""
    start: Vector
    """Where its refit starts, in u."""
    gain: float
    """ΔBIC but for the number that it has more [1]; (299), (308)."""
    model: FittedModel
    """That without the part, with the weights from which the refit starts."""
    fitted: bool = False
    """Whether the start is the end of a fit."""


class Lines(NamedTuple):
    """A model as a straight line in its numbers, weighted."""

    model: FittedModel
    weight: Vector
    """[rows] [1/SI]"""
    slope: Matrix
    """[rows, numbers] [1]"""
    normal: Matrix
    """[numbers, numbers] With the prior [1]."""
    left: Vector
    """[rows] [1]"""
    blocks: list[Vector]
    """What is left of each block of rows [SI]."""
    floors: list[float]
    """What rounding leaves of each [SI]."""
    edges: np.ndarray
    """Rows between them."""


def straight_lines(model: FittedModel) -> Lines:
    """Make a fitted model straight in its numbers."""
    state, weight = model.state, np.concatenate(model.state.weight)
    slope = state.slope(model.problem)
    normal = slope.T @ slope + np.eye(len(state.u))
    floors = [model.problem.floor(block) for block in range(len(state.left))]
    edges = np.cumsum([len(each) for each in state.left])[:-1]
    return Lines(model, weight, slope, normal, weight * np.concatenate(state.left), state.left, floors, edges)


def as_noise(model: FittedModel) -> FittedModel:
    """Return a model with the weights that its readings have where it leaves their noise alone; (308)."""
    noise = noise_of((model,), model.rig)
    rows = zip(model.problem.rows, model.state.left, strict=True)
    weight = [np.full(len(left), 1.0 / noise[name]) for (_, name, _), left in rows]
    return replace(model, state=replace(model.state, weight=weight, inflation=np.ones(len(weight))))


def with_part(problem: Problem, part: Part) -> Problem:
    """Return a problem with the numbers of a part behind its own."""
    rig, own = part.on(problem.rig)
    laws = (*problem.laws, *part.laws)
    return replace(problem, rig=rig, parameters=(*problem.parameters, *own), laws=laws)


def score_of(part: Part, lines: Lines, sharp: Lines | None = None) -> PartScore | None:
    """Return the best of a few scales of a part: by a straight line in its switch, or two steps of a fit.

    Parameters
    ----------
    part
        What is tried.
    lines, sharp
        The model without it at the weights of its fit, and at those of `as_noise`; no fit without these.
    """
    problem = lines.model.problem
    longer = with_part(problem, part)
    tried = [*_tries(part, longer, lines.model)]
    if not tried:
        return None
    line = _best_line(part, longer, lines, tried)
    fitted = None if sharp is None else _fitted(_best_line(part, longer, sharp, tried), sharp)
    return line if fitted is None or fitted.gain <= line.gain else fitted


def _best_line(
    part: Part, longer: Problem, lines: Lines, tried: Sequence[tuple[Vector, Vector]]
) -> PartScore:
    """Return the best of what was tried of a part, by a straight line in its switch; (299)."""
    made = list[PartScore]()
    for added, off in tried:
        amplitude, gain = _within(part, _line(lines, lines.weight * off / added[part.switch_at]))
        start = np.concatenate([lines.model.state.u, added])
        start[len(lines.model.state.u) + part.switch_at] = amplitude
        made.append(PartScore(part, longer, start, gain, lines.model))
    return max(made, key=lambda one: one.gain)


def _tries(part: Part, longer: Problem, model: FittedModel) -> Iterator[tuple[Vector, Vector]]:
    """Yield numbers of a part at a few scales and sizes, and how they change what is left [rows] [SI]."""
    left = np.concatenate(model.state.left)
    scales = [k for k, number in enumerate(part.numbers) if not number.switch]
    step = part.switch.prior.u(part.switch.start)
    for pushed in itertools.product((0.0, -1.0, 1.0), repeat=min(len(scales), 1)):
        added = np.zeros(len(part.numbers))
        for k, push in zip(scales, pushed, strict=False):
            added[k] = push * math.log(PARTS.pushed) / part.numbers[k].prior.sd
        for share in PARTS.shares:
            tried = added.copy()
            tried[part.switch_at] = share * step
            there = longer.model(np.concatenate([model.state.u, tried]))
            if there is not None:
                yield tried, np.concatenate(longer.left(there)) - left


def _fitted(one: PartScore, sharp: Lines) -> PartScore | None:
    """Return where two steps from the start of a score end; None where the machine has no equilibrium."""
    state = one.model.state
    try:
        end = fit_round(one.problem, one.start, state.weight, state.inflation, SOLVER.quick)
    except FitError:
        return None
    blocks = zip(sharp.blocks, end.left, sharp.floors, strict=True)
    gain = sum(block_gain(old, new, least)[0] for old, new, least in blocks)
    weight, inflation = one.problem.weights(end.left)
    state = replace(state, weight=weight, inflation=inflation)
    return replace(one, start=end.u, gain=gain, model=replace(one.model, state=state), fitted=True)


def _within(part: Part, line: tuple[float, float]) -> tuple[float, float]:
    """Return amplitude and gain of a line as far as the bounds of a part allow."""
    number, (asked, promised) = part.switch, line
    low, high = (
        number.prior.u(each) if math.isfinite(each) else each for each in (number.lower, number.upper)
    )
    amplitude = asked if low < asked < high else min(max(asked, low + 1e-3), high - 1e-3)
    gain = promised if asked * amplitude > 0.0 and low < asked else 0.0
    return min(max(amplitude, -CHANCE.rare), CHANCE.rare), gain


def _line(lines: Lines, column: Vector) -> tuple[float, float]:
    """Return the amplitude of one more column and what it gains, all other numbers following; (299)."""
    rest = column - lines.slope @ np.linalg.solve(lines.normal, lines.slope.T @ column)
    power = float(rest @ rest)
    if power <= 1e-12:
        return 0.0, 0.0
    amplitude = -float(rest @ lines.left) / power
    after = np.split((lines.left + amplitude * rest) / lines.weight, lines.edges)
    pairs = zip(lines.blocks, after, lines.floors, strict=True)
    return amplitude, sum(block_gain(old, new, least)[0] for old, new, least in pairs)

"""What each part of a machine promises by a straight line, before it is refitted."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import CHANCE
from tssgeom.identify.machine_evidence import FittedModel, block_gain
from tssgeom.identify.machine_parts import PARTS, Part
from tssgeom.identify.machine_problem import Problem


@dataclass(frozen=True, slots=True)
class PartScore:
    """What a straight line promises of a part."""

    part: Part
    problem: Problem
    """With the part."""
    start: Vector
    """Where its refit starts, in u."""
    gain: float
    """ΔBIC of a straight line, but for the number that it has more [1]; (299)."""


class Lines(NamedTuple):
    """A model as a straight line in its numbers, weighted."""

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
    return Lines(weight, slope, normal, weight * np.concatenate(state.left), state.left, floors, edges)


def score_of(model: FittedModel, part: Part, lines: Lines) -> PartScore | None:
    """Return the best of a few scales of a part, by a straight line in its switch."""
    problem, state = model.problem, model.state
    rig, own = part.on(problem.rig)
    longer = replace(problem, rig=rig, parameters=(*problem.parameters, *own))
    scales = [k for k, number in enumerate(part.numbers) if not number.switch]
    switch = next(k for k, number in enumerate(part.numbers) if number.switch)
    step = part.switch.prior.u(part.switch.start)
    best: PartScore | None = None
    for pushed in itertools.product((0.0, -1.0, 1.0), repeat=min(len(scales), 1)):
        added = np.zeros(len(own))
        for k, push in zip(scales, pushed, strict=False):
            added[k] = push * math.log(PARTS.pushed) / part.numbers[k].prior.sd
        for share in PARTS.shares:
            added[switch] = share * step
            there = longer.model(np.concatenate([state.u, added]))
            if there is None:
                continue
            off = np.concatenate(longer.left(there)) - np.concatenate(state.left)
            amplitude, gain = _within(part, _line(lines, lines.weight * off / added[switch]))
            start = added.copy()
            start[switch] = amplitude
            made = PartScore(part, longer, np.concatenate([state.u, start]), gain)
            best = made if best is None or made.gain > best.gain else best
    return best


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

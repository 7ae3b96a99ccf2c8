"""The runs that nothing is fitted to, and the gap that a model leaves on them.

Source: docs/model.md (112).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import FitError
from tssgeom.identify.base_fit import posed
from tssgeom.identify.noise_model import telling, total_sigma
from tssgeom.identify.problem import Point, Problem
from tssgeom.identify.readings import Reading
from tssgeom.identify.stack import stacked
from tssgeom.rig import Rig

GAP = 0.7
"""Held-out gap below which its ratio says nothing: half of the noise again."""


@dataclass(frozen=True, slots=True)
class HeldOut:
    """The runs that nothing was fitted to."""

    problem: Problem
    told: np.ndarray
    """[rows] bool: readings that count."""
    noise: Mapping[str, float]
    """Rms of what the sensors explain, by channel [N, m]."""
    before: float
    """Gap of the base model [1]."""

    def gap(self, at: Point) -> float:
        """Return the gap that a model leaves [1]; infinite where it finds no equilibrium."""
        try:
            left = self.problem.left(at)
        except FitError:
            return math.inf
        return gap(_rms(self.problem, left, self.told), self.noise)

    def ratio(self, at: Point) -> float:
        """Return the gap over that of the base model [1]; NaN where that shows none."""
        return self.gap(at) / self.before if self.before > GAP else math.nan


def held_out(runs: tuple[Reading, ...], rig: Rig, base: Point) -> HeldOut | None:
    """Prepare the runs that are held out; None where none is."""
    kept = [run for run in runs if run.held_out]
    if not kept:
        return None
    problem, errors = posed(stacked(kept), rig, base)
    sigma = total_sigma(errors)
    told = _telling(problem, sigma)
    noise = _rms(problem, sigma, told)
    before = gap(_rms(problem, problem.left(base), told), noise)
    return HeldOut(problem, told, noise, before)


def _telling(problem: Problem, sigma: Vector) -> np.ndarray:
    """Return which readings count, by run and channel [rows] bool."""
    out = np.zeros(len(sigma), dtype=bool)
    for block in problem.stack.blocks:
        out[block.rows] = telling(sigma[block.rows])
    return out


def _rms(problem: Problem, left: Vector, told: np.ndarray) -> dict[str, float]:
    out = dict[str, list[Vector]]()
    for block in problem.stack.blocks:
        out.setdefault(block.channel, []).append(left[block.rows][told[block.rows]])
    return {name: float(np.sqrt(np.mean(np.square(np.concatenate(parts))))) for name, parts in out.items()}


def gap(rms: Mapping[str, float], noise: Mapping[str, float]) -> float:
    """Return the gap: root mean over channels of what is beyond the noise, in units of it; (112)."""
    if not rms:
        return float("nan")
    return float(np.sqrt(np.mean([max((rms[name] / noise[name]) ** 2 - 1.0, 0.0) for name in rms])))

"""Steps of a fit of a machine whose bends nobody knows to the valley that its runs leave open.

Source: docs/model.md (260), (327).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import CHANCE
from tssgeom.identify.machine_parameters import shares_of
from tssgeom.identify.machine_problem import FIT, Problem
from tssgeom.least_squares import SOLVER


@dataclass(frozen=True, slots=True)
class BendStepSettings:
    """How fits go to the valley of bends."""

    chords: int = 2
    """Steps with the same derivatives [1]; chosen for speed."""
    far: float = 100.0
    """Of χ² above the lowest: from farther away friction goes straight [1]; chosen: nearer by, (260)."""
    least: float = 0.05
    """Of itself: what a step leaves of a share at least [1]; chosen: from 1 to a thousandth in two steps."""


STEPS = BendStepSettings()


class Pull(NamedTuple):
    """What draws one number to a value, as one more reading would."""

    number: int
    to: float
    sd: float

    def square(self, u: Vector) -> float:
        """Return what it adds to χ² [1]."""
        return float((u[self.number] - self.to) / self.sd) ** 2


class Point(NamedTuple):
    """Numbers of a machine, and what the model gives for them."""

    u: Vector
    channels: list[Mapping[str, Vector]]
    left: Vector
    """Weighted readings less the model [rows]."""
    chi2: float
    """Of readings and what was assumed [1]."""


class Passed(NamedTuple):
    """A point that a fit passes, with its derivatives."""

    point: Point
    slope: Matrix
    covariance: Matrix
    """By Gauss and Newton."""


class BendSteps:
    """The model with many bars and the weights of a fit, and steps of fits to its readings."""

    def __init__(self, problem: Problem, weight: Vector, steps: Vector) -> None:
        self.problem = replace(problem, bars=FIT.fine, too_few_bars=())
        self.weight, self._apart = weight, steps
        self.sd = np.array([each.prior.sd for each in problem.parameters])
        self._own = np.eye(len(self.sd))
        self._shares = shares_of(problem.parameters)
        keys = [each.key for each in problem.parameters]
        self._friction = keys.index("friction.coefficient")

    def at(self, u: Vector) -> Point | None:
        """Return the point of these numbers; None without an equilibrium."""
        u = np.clip(u, -CHANCE.rare, CHANCE.rare)
        channels = self.problem.model(u)
        if channels is None:
            return None
        left = self.weight * np.concatenate(self.problem.left(channels))
        chi2 = float(left @ left + u @ u)
        return Point(u, channels, left, chi2) if np.isfinite(chi2) else None

    def passed(self, point: Point) -> Passed:
        """Return a point with its derivatives."""
        beside = self.problem.beside(point.u, self._apart)
        left = self.problem.left(point.channels)
        slope = self.problem.jacobian(point.u, point.channels, left, beside) * self.weight[:, None]
        self._apart = self.problem.steps(slope)
        return self.with_slope(point, slope)

    def with_slope(self, point: Point, slope: Matrix) -> Passed:
        """Return a point with these derivatives."""
        return Passed(point, slope, np.asarray(np.linalg.inv(slope.T @ slope + self._own), dtype=np.float64))

    def fit(self, start: Passed, lowest: float, passes: int, pull: Pull | None = None) -> Iterator[Passed]:
        """Yield where a fit passes behind its start; `lowest` is the χ² of the lowest point that is known."""
        here = start
        for _ in range(passes):
            there = self._step(here, here.point.chi2 - lowest > STEPS.far, pull)
            fall = _height(here.point, pull) - _height(there, pull)
            if fall > 0.0:
                here = self.passed(there)
                yield here
            if fall < 2.0 * SOLVER.converged:
                return

    def _step(self, at: Passed, far: bool, pull: Pull | None) -> Point:
        """Return a point that is lower, the same one where none is."""
        normal = at.slope.T @ at.slope + self._own
        if pull is not None:
            normal[pull.number, pull.number] += pull.sd**-2
        first = _down(at, at.point, pull)
        for share, damping, straight in _ways(far):
            damped = normal + damping * np.diag(np.diag(normal))
            ends = [self._chords(at, damped, (1.0 - share) * first, pull, each) for each in straight]
            best = min(ends, key=lambda point: _height(point, pull))
            if best is not at.point:
                return best
        return at.point

    def _chords(self, at: Passed, damped: Matrix, wanted: Vector, pull: Pull | None, straight: bool) -> Point:
        """Return where steps with the same derivatives end, the start if the first is not lower; (260)."""
        best = at.point
        for _ in range(STEPS.chords):
            step = np.asarray(np.linalg.solve(damped, _down(at, best, pull) - wanted), dtype=np.float64)
            there = self.at(self.moved(best.u, step) if straight else best.u + step)
            if there is None or _height(there, pull) >= _height(best, pull):
                break
            best = there
        return best

    def moved(self, u: Vector, step: Vector) -> Vector:
        """Return numbers behind a step in which the friction of each part, μΦ_j, goes straight; (327)."""
        out, k, own = u + step, self._friction, self._shares
        weights, rates = np.exp(self.sd[own] * u[own]), self.sd[own] * step[own]
        common = self.sd[k] * step[k] - float(weights @ rates / weights.sum())
        after = weights * np.maximum(1.0 + rates + common, STEPS.least) * np.exp(-common)
        out[own] = np.log(after) / self.sd[own]
        out[k] = u[k] + (common + np.log(after.sum() / weights.sum())) / self.sd[k]
        return out

    def rise(self, at: Passed, number: int, far: float) -> float:
        """Return by how much χ² rises where one number goes so far and the others follow."""
        along = at.covariance[:, number] / at.covariance[number, number]
        to = (at.point.u + far * along, self.moved(at.point.u, far * along))
        ends = (self._beside(at, point, number, along) for point in map(self.at, to) if point is not None)
        return min((end.chi2 for end in ends), default=np.inf) - at.point.chi2

    def _beside(self, at: Passed, point: Point, number: int, along: Vector) -> Point:
        """Return a lower point at which one number is the same."""
        for _ in range(STEPS.chords):
            step = at.covariance @ _down(at, point, None)
            there = self.at(point.u + step - along * step[number])
            if there is None or there.chi2 >= point.chi2:
                break
            point = there
        return point


def _height(point: Point, pull: Pull | None) -> float:
    return point.chi2 + (0.0 if pull is None else pull.square(point.u))


def _down(at: Passed, point: Point, pull: Pull | None) -> Vector:
    """Return half of how fast χ² falls at a point by each number, with the derivatives of another one."""
    down = -(at.slope.T @ point.left + point.u)
    if pull is not None:
        down[pull.number] -= (point.u[pull.number] - pull.to) / pull.sd**2
    return np.asarray(down, dtype=np.float64)


def _ways(far: bool) -> Iterator[tuple[float, float, tuple[bool, ...]]]:
    """Yield share of the way, damping, and whether friction goes straight."""
    if far:
        yield from ((1.0, damping, (True,)) for damping in (0.0, *SOLVER.damping[1:4]))
    yield from ((share, 0.0, (False, True)) for share in SOLVER.shares)
    yield from ((1.0, damping, (False, True)) for damping in SOLVER.damping[2:4])

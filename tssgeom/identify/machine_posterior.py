"""What runs leave open of a machine: errors by noise of what acts, and the posterior along its widest ones.

Where two numbers show nearly as a product, the posterior is a bent ridge, steeper on one side than on the
other, and few bars tilt it; the covariance of Gauss and Newton holds at its top only. Source: docs/model.md
(261), (264), (265).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, stdtrit

from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import CHANCE
from tssgeom.errors import FitError
from tssgeom.identify.machine_bends import Valley, unlike
from tssgeom.identify.machine_drive_noise import INPUT_NOISE
from tssgeom.identify.machine_problem import FIT, FitState, Problem
from tssgeom.least_squares import SOLVER
from tssgeom.statistics import NORMAL_95


class DriveErrors(NamedTuple):
    """What the noise of what acts does to the numbers of a fit; they count deviations of what was assumed."""

    covariance: Matrix
    """[numbers, numbers] Of their errors by it."""
    other: Matrix
    """[numbers, numbers] Of their errors by all else."""


def drive_errors(problem: Problem, state: FitState, slope: Matrix, covariance: Matrix) -> DriveErrors:
    """Return what the noise of what acts does to a fit, from draws of it; docs/model.md (264), (265).

    Parameters
    ----------
    problem, state
        The fit.
    slope
        [rows, numbers] Derivatives of the weighted readings.
    covariance
        [numbers, numbers] By Gauss and Newton, as though nothing that acts were noisy.
    """
    size, freedom = len(state.u), 0
    of_drive = np.zeros((size, size))
    weight, blocks = np.concatenate(state.weight), _blocks(problem)
    levels_known = np.zeros(size)
    for k in range(len(problem.runs)):
        of_run = np.concatenate([np.zeros(0, dtype=int), *(rows for run, _, rows in blocks if run == k)])
        turns = [j for j, each in enumerate(problem.parameters) if each.kind == "turn" and each.run == k]
        errors = list[Vector]()
        for moved, levels in _draws_of(problem, state, k):
            error = -covariance @ (slope[of_run].T @ (weight[of_run] * moved))
            error[turns] -= levels[: len(turns)] / [problem.parameters[j].prior.sd for j in turns]
            errors.append(error)
        if count := len(errors):
            of_drive += np.transpose(errors) @ np.array(errors) / count
            freedom += count
            levels_known[turns] = 1.0
    if freedom:
        of_drive *= (float(stdtrit(freedom, 0.975)) / NORMAL_95) ** 2
    of_levels = (covariance * levels_known) @ covariance  # the draws have it too
    return DriveErrors(of_drive, np.asarray(covariance - of_levels, dtype=np.float64))


def _blocks(problem: Problem) -> list[tuple[int, str, np.ndarray]]:
    """Return run, channel and rows of each block of readings."""
    edges = np.cumsum([0, *(len(at) for _, _, at in problem.rows)])
    return [(k, name, np.arange(edges[b], edges[b + 1])) for b, (k, name, _) in enumerate(problem.rows)]


def _draws_of(problem: Problem, state: FitState, k: int) -> Iterator[tuple[Vector, Vector]]:
    """Yield for each draw what it leaves of the readings of a run [SI], and how far its turns lie lower."""
    run, values = problem.runs[k], problem.of_run(state.u, k)
    turns = None if run.legs is None else run.legs.turns
    plain, machines = replace(run, legs=None), problem.machines(state.u)
    count = max(INPUT_NOISE.of_each, -(-INPUT_NOISE.draws // len(problem.runs)))

    def given(channels: Mapping[str, Vector]) -> Vector:
        return np.concatenate([channels[name][at] for j, name, at in problem.rows if j == k])

    base = None
    for draw in run.inputs.draws(count, turns):
        try:
            base = given(machines.predicted(plain, values)) if base is None else base
            there = given(machines.predicted(replace(plain, given={**run.given, **draw}), values))
        except FitError:
            continue
        levels = np.zeros(0)
        if turns is not None:
            at, levels = turns + np.arange(len(turns)), np.zeros(len(turns))
            for channel in run.inputs.pulls:
                levels = run.given[channel][at] - draw[channel][at]
        yield base - there, levels


@dataclass(frozen=True, slots=True)
class PosteriorSettings:
    """How a posterior is followed along a number."""

    wide: float = 0.02
    """Of a number: standard deviation from which its posterior is tested [1]; chosen: what is known better
    is met by a straight line."""
    most: int = 3
    """Numbers that are followed [1]; chosen for speed."""
    tested: float = 1.5
    """Standard deviations at which it is first tested whether χ² rises as a normal law's [1]; chosen."""
    normal: float = 0.15
    """Of this rise: difference up to which the law is normal [1]; chosen: 7 % of an interval."""
    step: float = 0.6
    """Standard deviations from one point to the next [1]; chosen: three of them in the half of a bell."""
    leap: float = 4.0
    """Rise of χ² from one point to the next from which the step is halved [1]; chosen."""


POSTERIOR = PosteriorSettings()
_POINTS = round(3.0 * CHANCE.rare / POSTERIOR.step)  # tried on each side: three times what a normal law takes
_LEAST = POSTERIOR.step / 8.0  # standard deviations of the least step: halved three times
_FOLLOWS = math.sqrt(0.5)
"""Correlation from which a number goes with one that is followed [1]: half of its variance."""


@dataclass(frozen=True, slots=True)
class Profile:
    """The posterior along one number."""

    number: int
    u: Matrix
    """[points, numbers] All numbers where that one is held and the others are likeliest."""
    chi2: Vector
    """[points] Of readings and what was assumed [1]."""

    @property
    def weight(self) -> Vector:
        """Share of each point [points] [1]."""
        at = self.u[:, self.number]
        density = np.exp(-0.5 * (self.chi2 - self.chi2.min())) * (np.gradient(at) if len(at) > 1 else 1.0)
        return density / density.sum()


@dataclass(frozen=True, slots=True)
class Posterior:
    """Of all numbers, in standard deviations of what was assumed."""

    u: Vector
    """The likeliest ones."""
    covariance: Matrix
    """By Gauss and Newton."""
    errors: DriveErrors
    """By the noise of what acts, and by all else."""
    quantile: float
    """Standard deviations of half a 95 % interval of a normal law [1]."""
    profiles: tuple[Profile, ...]
    valley: Valley | None = None
    """Of a machine whose bends nobody knows."""

    def of(self, share: Vector) -> tuple[float, float, float]:
        """Return standard deviation and 95 % interval of a sum of numbers, each times its share; (261).

        Where a long tail makes the interval wider, the standard deviation is that of a normal law: (182).
        """
        if self.valley is not None:
            return self._in_valley(share, self.valley)
        middle, across = float(share @ self.u), self.covariance @ share
        of_drive, other = (float(share @ each @ share) for each in self.errors)
        sd, own = math.sqrt(max(float(share @ across), 1e-300)), np.sqrt(np.diag(self.covariance))
        strength = [abs(float(across[each.number])) / (sd * own[each.number]) for each in self.profiles]
        if max(strength, default=0.0) < _FOLLOWS:
            sd = math.sqrt(max(other + of_drive, 1e-300))
            return sd, middle - self.quantile * sd, middle + self.quantile * sd
        best = int(np.argmax(strength))
        weight, centres = self.profiles[best].weight, self.profiles[best].u @ share
        narrower = math.sqrt(max(other, 0.0)) / sd
        centres = middle + narrower * (centres - middle)
        inside = narrower * sd * math.sqrt(max(1.0 - strength[best] ** 2, 1e-4))
        beside = math.hypot(inside, math.sqrt(of_drive))
        spread = math.hypot(beside, math.sqrt(float(weight @ (centres - weight @ centres) ** 2)))
        low, high = (_quantile(centres, beside, weight, sign * self.quantile) for sign in (-1.0, 1.0))
        low, high = min(low, middle), max(high, middle)
        return max(spread, (high - low) / (2.0 * self.quantile)), low, high

    def _in_valley(self, share: Vector, valley: Valley) -> tuple[float, float, float]:
        """Return what `of` does by the points that fits have passed; (329)."""
        middle, of_drive = float(share @ self.u), float(share @ self.errors.covariance @ share)
        beside, (low, high) = self.quantile**2 * of_drive, valley.ends(share, self.quantile)
        low = middle - math.sqrt(max(middle - low, 0.0) ** 2 + beside)
        high = middle + math.sqrt(max(high - middle, 0.0) ** 2 + beside)
        return (high - low) / (2.0 * self.quantile), low, high


def _quantile(centres: Vector, sd: float, weight: Vector, at: float) -> float:
    """Return where a mixture of normal laws has the probability of a normal one at so many deviations."""
    wanted, low, high = ndtr(at), centres.min() - 9.0 * sd, centres.max() + 9.0 * sd
    for _ in range(60):
        middle = 0.5 * (low + high)
        less = weight @ ndtr((middle - centres) / sd) < wanted
        low, high = (middle, high) if less else (low, middle)
    return float(0.5 * (low + high))


def posterior_of(
    problem: Problem,
    state: FitState,
    quantile: float,
    *,
    normal: bool = False,
    valley: Valley | None = None,
) -> tuple[Problem, FitState, Posterior]:
    """Return the posterior about a fit, and the fit at its likeliest numbers.

    It is not followed where it is taken for `normal`, or where a `valley` of bends was.
    """
    slope = state.slope(problem)
    covariance = np.asarray(np.linalg.inv(slope.T @ slope + np.eye(len(state.u))), dtype=np.float64)
    errors = drive_errors(problem, state, slope, covariance)
    fine = replace(problem, bars=FIT.fine, too_few_bars=())
    wide = () if normal or valley is not None else _wide(problem, covariance)
    made = (_Along(fine, state, slope, covariance, j).profile() for j in wide)
    profiles = tuple(each for each in made if each is not None)
    if profiles:
        best = min(profiles, key=lambda each: each.chi2.min())
        u = best.u[np.argmin(best.chi2)]
        channels = fine.model(u)
        if channels is not None:
            problem, state = (
                fine,
                replace(state, u=u, channels=channels, left=fine.left(channels), beside=None),
            )
    return problem, state, Posterior(state.u, covariance, errors, quantile, profiles, valley)


def _wide(problem: Problem, covariance: Matrix) -> list[int]:
    """Return the numbers along which the posterior is tested, the widest first, none like another."""
    deviation = np.sqrt(np.diag(covariance))
    wide = [
        (each.prior.sd * deviation[j], j)
        for j, each in enumerate(problem.parameters)
        if each.kind == "rig" and each.prior.log and each.prior.sd * deviation[j] > POSTERIOR.wide
    ]
    return unlike(covariance, [j for _, j in sorted(wide, reverse=True)], POSTERIOR.most)


class _Point(NamedTuple):
    """All numbers where one is held and the others are likeliest, what is left there, and its χ²."""

    u: Vector
    residual: Vector
    chi2: float


class _Along:
    """The posterior along one number, the others being likeliest at each of its values; (261)."""

    def __init__(self, problem: Problem, state: FitState, slope: Matrix, covariance: Matrix, j: int) -> None:
        self.problem, self.start, self.j = problem, state.u, j
        self.weight = np.concatenate(state.weight)
        self.others = np.arange(len(state.u)) != j
        self.first: Matrix = slope[:, self.others]
        self.slope: Matrix = self.first.copy()
        self.sd = math.sqrt(covariance[j, j])
        self.along = covariance[:, j] / covariance[j, j]

    def profile(self) -> Profile | None:
        """Return the posterior along the number; None where a normal law is near enough."""
        top = self._fitted(self.start)
        if top is None:
            return None
        rise, near = POSTERIOR.tested**2, list[bool]()
        for way in (-POSTERIOR.tested, POSTERIOR.tested):
            there = self._fitted(top.u + way * self.sd * self.along)
            near.append(there is not None and abs(there.chi2 - top.chi2 - rise) < POSTERIOR.normal * rise)
        if all(near):
            return None
        sides = [self._side(top, way) for way in (-1.0, 1.0)]
        points = [*reversed(sides[0]), top, *sides[1]]
        return Profile(
            self.j, np.array([each.u for each in points]), np.array([each.chi2 for each in points])
        )

    def _side(self, top: _Point, way: float) -> list[_Point]:
        """Return points on one side, nearer to each other where χ² rises fast."""
        self.slope = self.first.copy()
        points, step, lowest, last = [top], POSTERIOR.step * self.sd, top.chi2, self.along
        for _ in range(_POINTS):
            there = self._fitted(points[-1].u + last * (way * step / last[self.j]))
            rise = np.inf if there is None else there.chi2 - points[-1].chi2
            if there is None or (rise > POSTERIOR.leap and step > _LEAST * self.sd):
                step *= 0.5
                if step < _LEAST * self.sd:
                    break
                continue
            last, lowest = there.u - points[-1].u, min(lowest, there.chi2)
            points.append(there)
            if there.chi2 - lowest > CHANCE.rare**2:
                break
            step *= 1.0 if abs(rise) > 0.25 * POSTERIOR.leap else 1.5
        return points[1:]

    def _fitted(self, u: Vector) -> _Point | None:
        """Return the likeliest others with this one held.

        Each evaluation mends the derivatives. Source: C. G. Broyden, Math. Comput. 19 (1965) 577.
        """
        best, damping = self._at(u), 0.0
        if best is None:
            return None
        for _ in range(SOLVER.passes):
            normal = np.asarray(self.slope.T @ self.slope, dtype=np.float64) + np.eye(len(best.u) - 1)
            scale = np.diag(normal)
            pull = np.asarray(-(self.slope.T @ best.residual + best.u[self.others]), dtype=np.float64)
            step = np.linalg.solve(normal + damping * np.diag(scale), pull)
            promised = float(pull @ step)
            if promised < SOLVER.step**2:  # so short a step would mend derivatives by rounding
                break
            moved = best.u.copy()
            moved[self.others] += step
            there = self._at(moved)
            if there is not None:
                off = there.residual - best.residual - self.slope @ step
                mended = np.outer(off, scale * step) / float(step @ (scale * step))
                self.slope = np.asarray(self.slope + mended, dtype=np.float64)
            if there is None or there.chi2 >= best.chi2:
                if promised < SOLVER.converged:
                    break
                damping = max(10.0 * damping, 0.1)
                continue
            fall, best = best.chi2 - there.chi2, there
            if fall < SOLVER.converged:
                break
            damping *= 0.1
        return best

    def _at(self, u: Vector) -> _Point | None:
        channels = self.problem.model(u)
        if channels is None:
            return None
        residual = self.weight * np.concatenate(self.problem.left(channels))
        return _Point(u, residual, float(residual @ residual + u @ u))

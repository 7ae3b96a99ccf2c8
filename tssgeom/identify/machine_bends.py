"""What runs leave open of a machine where nobody says where its sheaths bend; docs/model.md (326) to (329).

Shares of the angle, lever arm, friction and softness lie along a long bent valley, whose direction the
covariance of Gauss and Newton has at one point only. So fits begin from other bends, and go on along the
numbers that are known least: from each point that they pass the numbers may go as far as χ² allows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.identify.machine_bend_steps import BendSteps, Passed, Pull
from tssgeom.identify.machine_fit import fitted_again
from tssgeom.identify.machine_parameters import one_bend, shares_of
from tssgeom.identify.machine_problem import FIT, FitState, Problem, fitted_rows
from tssgeom.identify.machine_run import thinned
from tssgeom.statistics import HELD, NORMAL_95


@dataclass(frozen=True, slots=True)
class BendFitSettings:
    """How the valley of bends is followed."""

    positions: tuple[float, ...] = (0.125, 0.375, 0.625, 0.875)
    """Of the sheath: where the one bend is from which a fit begins [1]; chosen: its quarters."""
    passes: int = 5
    """Of each fit [1]; chosen for speed."""
    followed: int = 2
    """Numbers along which fits go on [1]; chosen for speed."""
    alike: float = 0.9
    """Correlation from which one number is followed with another, by fits and along a posterior [1];
    chosen."""
    beyond: float = 1.5
    """Half intervals by which a number is pulled beyond its interval [1]; chosen."""
    pull: float = 0.3
    """Standard deviation of what pulls it, in half intervals [1]; chosen."""
    bent: float = 4.0
    """Rise of χ² at the end of an interval over that of a normal law, from which a valley is bent [1];
    chosen: a bent one has hundreds."""
    changed: float = 1.5
    """Change of the inflation from which a fit is made again [1]; chosen."""
    most: int = 400
    """Samples of all runs that are fitted from other bends; more are thinned instead; chosen for speed."""


BEND_FITS = BendFitSettings()
TWO_95 = round(-2.0 * math.log(1.0 - HELD), 2)
"""Rise of χ² to which an interval goes [1]: the 95 % quantile of χ² of two numbers, the number itself and the
position along the valley, in which few points lie; to as many digits as that is known."""


class Spot(NamedTuple):
    """A point in the valley."""

    u: Vector
    covariance: Matrix
    """By Gauss and Newton."""
    above: float
    """χ² above that of the lowest point [1]."""


class Valley(NamedTuple):
    """Points that fits have passed."""

    spots: tuple[Spot, ...]

    def ends(self, share: Vector, quantile: float) -> tuple[float, float]:
        """Return the least and most of a sum of numbers, each times its share; (329).

        Parameters
        ----------
        share
            Of each number.
        quantile
            Standard deviations of half a 95 % interval of a normal law [1].
        """
        rise, ends = TWO_95 * (quantile / NORMAL_95) ** 2, list[tuple[float, float]]()
        for u, covariance, above in self.spots:
            if above <= rise:
                far = math.sqrt(max(float(share @ covariance @ share), 0.0) * (rise - above))
                ends.append((float(share @ u) - far, float(share @ u) + far))
        return min(low for low, _ in ends), max(high for _, high in ends)


def followed(problem: Problem, state: FitState) -> tuple[Problem, FitState, Valley | None]:
    """Return the best of fits from several bends, and what they passed; None where bends are known.

    Parameters
    ----------
    problem, state
        A fit.
    """
    if not shares_of(problem.parameters):
        return problem, state, None
    problem, state = _with_own_weights(problem, state)
    fits = _Fits(problem, state)
    if not fits.begin(state.u):
        return problem, state, None
    if not fits.bent():
        return problem, state, fits.valley()
    if fits.real:
        fits.from_other_bends()
    lowest = fits.lowest().point
    channels = problem.model(lowest.u)
    fall = fits.passed[0].point.chi2 - lowest.chi2
    if fits.real and fall > 1.0 and channels is not None:  # more than a standard deviation of one number
        there = replace(state, u=lowest.u, channels=channels, left=problem.left(channels), beside=None)
        problem, state = _with_own_weights(*fitted_again(replace(problem, too_few_bars=()), there))
        fits = fits.with_weights(problem, state)
        fits.begin(state.u)
    fits.along_widest()
    return problem, state, fits.valley()


def unlike(covariance: Matrix, order: Iterable[int], most: int) -> list[int]:
    """Return the first numbers in an order, so many at most, none of which goes with one before it."""
    sd, taken = np.sqrt(np.diag(covariance)), list[int]()
    for j in order:
        alike = [abs(covariance[j, k]) / (sd[j] * sd[k]) for k in taken]
        if len(taken) < most and max(alike, default=0.0) < BEND_FITS.alike:
            taken.append(j)
    return taken


def _with_own_weights(problem: Problem, state: FitState) -> tuple[Problem, FitState]:
    """Return a fit whose weights are those of what it leaves."""
    for _ in range(2):
        _, inflation = problem.weights(problem.left(state.channels))
        if np.all(np.abs(np.log(inflation / state.inflation)) < math.log(BEND_FITS.changed)):
            break
        problem, state = fitted_again(problem, state)
    return problem, state


class _Fits:
    """Fits to the readings with the weights of a fit, and where they have passed."""

    def __init__(self, problem: Problem, state: FitState) -> None:
        samples = sum(len(run.held_out) for run in problem.runs)
        self.real = samples <= BEND_FITS.most
        thin = None if self.real else _thin(problem, state)
        made, weight = thin or (problem, np.concatenate(state.weight))
        self.steps, self.passed = BendSteps(made, weight, state.steps), list[Passed]()

    def with_weights(self, problem: Problem, state: FitState) -> _Fits:
        """Return the same points with the weights of another fit."""
        made = _Fits(problem, state)
        ratio = made.steps.weight / self.steps.weight
        for point, slope, _ in self.passed:
            left = point.left * ratio
            there = point._replace(left=left, chi2=float(left @ left + point.u @ point.u))
            made.passed.append(made.steps.with_slope(there, slope * ratio[:, None]))
        return made

    def lowest(self) -> Passed:
        """Return the lowest point."""
        return min(self.passed, key=lambda each: each.point.chi2)

    def begin(self, u: Vector, pull: Pull | None = None) -> bool:
        """Follow a fit from these numbers; returns whether the model has an equilibrium there."""
        point = self.steps.at(u)
        if point is not None:
            self._go_on(self.steps.passed(point), pull)
        return point is not None

    def _go_on(self, start: Passed, pull: Pull | None) -> None:
        lowest = self.lowest().point.chi2 if self.passed else start.point.chi2
        self.passed += [start, *self.steps.fit(start, lowest, BEND_FITS.passes, pull)]

    def bent(self) -> bool:
        """Whether χ² rises far more than by a normal law at the end of an interval of the rig; (326)."""
        at, most = self.lowest(), BEND_FITS.bent * NORMAL_95**2
        far = NORMAL_95 * np.sqrt(np.diag(at.covariance))
        rises = (self.steps.rise(at, j, way * far[j]) for j in self._of_rig() for way in (-1.0, 1.0))
        return any(rise > most for rise in rises)

    def _of_rig(self) -> list[int]:
        every = enumerate(self.steps.problem.parameters)
        return [j for j, each in every if each.kind == "rig"]

    def from_other_bends(self) -> None:
        """Follow fits from an even bend, and from one bend here and there."""
        u = self.lowest().point.u
        for position in (None, *BEND_FITS.positions):
            self.begin(one_bend(self.steps.problem.parameters, u, position))

    def along_widest(self) -> None:
        """Follow fits that pull the numbers that are known least beyond their intervals; (328)."""
        covariance = self.lowest().covariance
        sd = np.sqrt(np.diag(covariance)) * self.steps.sd
        order = sorted(self._of_rig(), key=lambda j: -sd[j])
        for j in unlike(covariance, order, BEND_FITS.followed):
            for way in (-1.0, 1.0):
                self._go_beyond(j, way)

    def _go_beyond(self, j: int, way: float) -> None:
        at = max(self.passed, key=lambda each: self._end(each, j, way))
        half = math.sqrt(TWO_95 * at.covariance[j, j])
        to = way * (self._end(at, j, way) + BEND_FITS.beyond * half)
        self._go_on(at, Pull(j, to, BEND_FITS.pull * half))

    def _end(self, each: Passed, j: int, way: float) -> float:
        """Return how far a number may go one way from a point."""
        left = TWO_95 - (each.point.chi2 - self.lowest().point.chi2)
        return way * each.point.u[j] + math.sqrt(each.covariance[j, j] * left) if left > 0.0 else -np.inf

    def valley(self) -> Valley:
        """Return the points that were passed."""
        low = self.lowest().point.chi2
        spots = (Spot(each.point.u, each.covariance, each.point.chi2 - low) for each in self.passed)
        return Valley(tuple(spots))


def _thin(problem: Problem, state: FitState) -> tuple[Problem, Vector] | None:
    """Return fewer samples, whose readings are what the fit gives, with weights of the same sum."""
    each = max(FIT.least_at_start, FIT.most_at_start // len(problem.runs))
    runs = tuple(thinned(run, each) for run in problem.runs)
    made = replace(problem, runs=runs, bars=FIT.fine, too_few_bars=())
    channels = made.model(state.u)
    if channels is None:
        return None
    runs = tuple(
        replace(run, measured={name: values + 0.0 * run.measured[name] for name, values in given.items()})
        for run, given in zip(runs, channels, strict=True)
    )
    total = {row[:2]: float(weight @ weight) for row, weight in zip(problem.rows, state.weight, strict=True)}
    rows = tuple(row for row in fitted_rows(runs, held_out=None) if row[:2] in total)
    weight = [np.full(len(row[2]), math.sqrt(total[row[:2]] / len(row[2]))) for row in rows]
    return replace(made, runs=runs, rows=rows), np.concatenate(weight)

"""The fit of `discover` and `calibrate`: friction, compliance, effects and zeros, through the whole run.

Shared errors are solved for, the rest is counted. Source: docs/model.md (103)-(107).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from msgspec.structs import replace as changed
from scipy.linalg import solve_triangular

from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import CHANCE
from tssgeom.effects import AnyEffect, Parameter
from tssgeom.errors import FitError
from tssgeom.identify.prediction import FINE, Errors, Stack, errors_of, simulated, stacked
from tssgeom.identify.readings import Reading
from tssgeom.least_squares import SOLVER, derivatives, solve
from tssgeom.least_squares import Problem as LeastSquares
from tssgeom.rig import Friction, Rig
from tssgeom.uncertain import UNKNOWNS


@dataclass(frozen=True, slots=True)
class FitSettings:
    """Steps and priors of the fit.

    Frozen on the development seeds of `benchmarks.discovery`.
    """

    log_sd: float = 1.0
    """Prior s.d. of ln μ, ln ρ, and of the logarithm of a scale of an effect [1]; chosen: free but for
    factors of e."""
    size_sd: float = 10.0
    """Prior s.d. of an amplitude over that of its effect [1]; chosen: free but for what is absurd."""
    unit_m: float = 0.02
    """Unit of arc length in the fit of a hidden bend [m]; chosen."""


FIT = FitSettings()


@dataclass(frozen=True, slots=True)
class Free:
    """One number of an effect that is fitted, as u: value = u · unit, or unit · e^u of a scale."""

    effect: int
    """Which of the effects."""
    key: str
    unit: float
    log: bool
    low: float
    high: float

    def value(self, u: float) -> float:
        """Return the parameter in SI."""
        value = self.unit * math.exp(min(u, 300.0)) if self.log else self.unit * u
        return min(max(value, self.low), self.high)

    def u(self, value: float) -> float:
        """Return the number that is fitted."""
        return math.log(max(value, 1e-300) / self.unit) if self.log else value / self.unit


@dataclass(frozen=True, slots=True)
class Problem:
    """Readings, what weighs them, and the nominal rig."""

    stack: Stack
    whitening: Whitening
    rig: Rig
    target: Vector
    """[rows] Measured less what too few bars make wrong [N, m]."""
    predict: Callable[[Point], Vector] | None = None
    """Gives [rows] [N, m] where a model has zeros of a run; None where it has none."""

    def left(self, at: Point) -> Vector:
        """Return measured less simulated [rows] [N, m]."""
        if self.predict is not None:
            return self.target - self.predict(at)
        return self.target - simulated(self.stack, at.rig(self.rig), at.effects)


@dataclass(frozen=True, slots=True)
class Point:
    """Friction, compliance, effects, and zeros of a run: one model."""

    friction: float
    """[1]"""
    compliance: float
    """[1/N]"""
    effects: tuple[AnyEffect, ...] = ()
    free: tuple[Free, ...] = ()
    zeros: tuple[float, ...] = ()
    """Numbers of one run that are fitted beside the rig, each in standard deviations of its prior [1]."""

    @property
    def size(self) -> int:
        """Numbers that are fitted."""
        return 2 + len(self.free) + len(self.zeros)

    @property
    def at_bound(self) -> bool:
        """Whether a number of an effect is as far as it may go."""
        for free in self.free:
            value = getattr(self.effects[free.effect], free.key)
            own = self.effects[free.effect].parameters[free.key]
            if value <= own.lower < 0.0 or value >= own.upper or (not own.switch and value <= own.lower):
                return True
        return False

    def rig(self, nominal: Rig) -> Rig:
        """Return the rig with this friction and compliance."""
        return with_base(nominal, self.friction, self.compliance)

    def moved(self, by: Vector) -> Point:
        """Return the model a step on: ln μ, ln ρ, what is free, and zeros [size]; bounds hold."""
        effects, own = list(self.effects), 2 + len(self.free)
        for free, du in zip(self.free, by[2:own], strict=True):
            effect = effects[free.effect]
            u = free.u(getattr(effect, free.key))
            effects[free.effect] = changed(effect, **{free.key: free.value(u + du)})
        scale = np.exp(by[:2])
        return replace(
            self,
            friction=float(self.friction * scale[0]),
            compliance=float(self.compliance * scale[1]),
            effects=tuple(effects),
            zeros=tuple(
                min(max(u + float(du), -CHANCE.clear), CHANCE.clear)
                for u, du in zip(self.zeros, by[own:], strict=True)
            ),
        )


@dataclass(frozen=True, slots=True)
class Fit:
    """A model refitted."""

    at: Point
    chi2: float
    """Of residuals and priors [1]."""
    residual: Vector
    """[rows + k] Whitened [1]."""
    jacobian: Matrix
    """[rows + k, 2 + free] Of the whitened prediction by ln μ, ln ρ and what is free [1]."""
    left: Vector
    """[rows] Measured less simulated [N, m]."""

    @property
    def inflation(self) -> float:
        """Factor of the covariance where more is left than errors explain [1]."""
        return max(1.0, self.chi2 / len(self.left))

    @property
    def covariance(self) -> Matrix:
        """Of ln μ, ln ρ and what is free."""
        sd = prior_sd(self.at)
        normal = self.jacobian.T @ self.jacobian + np.diag(sd**-2.0)
        return np.asarray(np.linalg.inv(normal), dtype=np.float64)


def with_base(rig: Rig, friction: float, compliance: float) -> Rig:
    """Return the rig with another coefficient of friction [1] and compliance [1/N]."""
    tendon = changed(rig.tendon, compliance_per_N=compliance)
    return changed(rig, friction=Friction(coefficient=friction), tendon=tendon)


def start_rig(rig: Rig) -> Rig:
    """Return the rig about which a fit starts: its friction and compliance are no less than rigs have."""
    least = [UNKNOWNS[key].value(-CHANCE.rare) for key in ("friction.coefficient", "tendon.compliance_per_N")]
    return with_base(rig, max(rig.friction.coefficient, least[0]), max(rig.tendon.compliance_per_N, least[1]))


def freed(effect: AnyEffect, which: int, length: float, only: tuple[str, ...] = ()) -> Iterator[Free]:
    """Return what of an effect is fitted: amplitudes, and scales that runs determine."""
    for key, parameter in effect.parameters.items():
        if parameter.fitted and (not only or key in only):
            yield _free(which, key, parameter, length)


def _free(which: int, key: str, parameter: Parameter, length: float) -> Free:
    if key == "at_m":
        return Free(which, key, FIT.unit_m, False, 0.0, length)
    if not parameter.switch:
        return Free(which, key, parameter.centre, True, parameter.lower, parameter.upper)
    return Free(which, key, parameter.prior_sd, False, parameter.lower, parameter.upper)


def prior_sd(at: Point) -> Vector:
    """Return standard deviations of the priors of ln μ, ln ρ and what is free."""
    own = [FIT.log_sd if free.log else 1e3 if free.key == "at_m" else FIT.size_sd for free in at.free]
    return np.array([FIT.log_sd, FIT.log_sd, *own, *(1.0 for _ in at.zeros)])


def prior_deviation(problem: Problem, at: Point) -> Vector:
    """Return how far ln μ, ln ρ and what is free are from the centre of their priors."""
    base = [
        math.log(at.friction / max(problem.rig.friction.coefficient, 1e-6)),
        math.log(at.compliance / problem.rig.tendon.compliance_per_N),
    ]
    own = [free.u(getattr(at.effects[free.effect], free.key)) for free in at.free]
    off = [0.0 if free.key == "at_m" else u for free, u in zip(at.free, own, strict=True)]
    return np.array([*base, *off, *at.zeros])


def columns(problem: Problem, at: Point, left: Vector, first: int = 0) -> Matrix:
    """Return derivatives of the whitened prediction by free numbers from the `first` on, one-sided."""
    return -derivatives(posed_about(problem, at), np.zeros(at.size), left, first)


def refined(problem: Problem, start: Point, base: Matrix | None = None, passes: int = SOLVER.passes) -> Fit:
    """Refit a model from a start; `base` are columns of μ and ρ to use again."""
    given = plain = posed_about(problem, start)
    if base is not None:
        held = -base
        given = replace(
            plain,
            jacobian=lambda now: np.column_stack([held, derivatives(plain, now.u, now.left, held.shape[1])]),
        )
    end = solve(given, np.zeros(start.size), passes)
    if end is None:
        raise FitError("the tendon has no equilibrium at the start of the fit")
    return Fit(end.detail, end.chi2, end.residual, -end.jacobian, end.left)


def posed_about(problem: Problem, at: Point) -> LeastSquares[Point]:
    """Return the fit of a model in numbers that count from where it is; docs/model.md (104), (105)."""

    def model(u: Vector) -> tuple[Vector, Point] | None:
        there = at.moved(u)
        try:
            return problem.left(there), there
        except FitError:
            return None

    own = 2 + len(at.free)
    step, longest = np.full(at.size, SOLVER.step), np.full(at.size, 0.5 * FIT.size_sd)
    step[2:own], longest[:2] = SOLVER.coarse_step, FIT.log_sd
    lower, upper = _bounds(at)
    return LeastSquares(
        *(model, np.diag(prior_sd(at) ** -2.0), lower, upper),
        centre=-prior_deviation(problem, at),
        step=step,
        longest=longest,
        whitened=problem.whitening.whitened,
        close=SOLVER.converged / problem.stack.size,  # standard errors grow with what is left, (115)
    )


def _bounds(at: Point) -> tuple[Vector, Vector]:
    """Return how far down and up every number may go [size]."""
    own = [(free, free.u(getattr(at.effects[free.effect], free.key))) for free in at.free]
    lower = [free.u(free.low) - u for free, u in own] + [-CHANCE.clear - u for u in at.zeros]
    upper = [free.u(free.high) - u for free, u in own] + [CHANCE.clear - u for u in at.zeros]
    return np.array([-np.inf, -np.inf, *lower]), np.array([np.inf, np.inf, *upper])


@dataclass(frozen=True, slots=True)
class Whitening:
    """Projects residuals off the shared errors, each held by its prior."""

    sigma: Vector
    """[rows]"""
    basis: Matrix
    """[rows + k, k] Orthonormal: the shared errors above their priors."""
    triangle: Matrix
    """[k, k]"""

    def whitened(self, residual: np.ndarray) -> np.ndarray:
        """Return residuals [rows] or [rows, c], [N, m], as [rows + k (, c)], squares of sum χ²; (103)."""
        scaled = (residual.T / self.sigma).T
        rows, k = self.basis.shape[0] - self.basis.shape[1], self.basis.shape[1]
        own = self.basis[:rows].T @ scaled
        out = np.concatenate([scaled, np.zeros((k, *scaled.shape[1:]))])
        return out - self.basis @ own

    def shared(self, residual: Vector) -> Vector:
        """Return the shared errors that a residual implies, in standard deviations [k]."""
        rows = self.basis.shape[0] - self.basis.shape[1]
        own = self.basis[:rows].T @ (residual / self.sigma)
        return solve_triangular(self.triangle, own)


def unshared(sigma: Vector) -> Whitening:
    """Return what divides residuals by their standard deviations [rows] [N, m], no error being shared."""
    return Whitening(sigma, np.zeros((len(sigma), 0)), np.zeros((0, 0)))


def whitening(errors: Errors) -> Whitening:
    """Prepare the projection."""
    k = errors.modes.shape[1]
    basis, triangle = np.linalg.qr(np.vstack([errors.modes, np.eye(k)]))
    return Whitening(errors.sigma, basis, triangle)


def base_fit(readings: Sequence[Reading], rig: Rig) -> tuple[Problem, Errors, Fit]:
    """Fit friction and compliance to the runs; errors and bars are those of a first fit.

    A first fit without shared errors is tried too, and the better of both counts; (247). Two first fits that
    end within a standard error of each other are one.
    """
    stack = stacked(readings)
    start = Point(max(rig.friction.coefficient, 1e-3), rig.tendon.compliance_per_N)
    first, errors = posed(stack, rig, start)
    alone = replace(first, whitening=unshared(errors.sigma))
    fits = [refined(each, start) for each in (first, alone)]
    if _is_near(*fits):
        del fits[1]
    return min((_fitted_again(each.at, stack, rig) for each in fits), key=lambda each: each[2].chi2)


def _is_near(fit: Fit, other: Fit) -> bool:
    """Whether friction and compliance of another fit are within a standard error of one."""
    pairs = ((other.at.friction, fit.at.friction), (other.at.compliance, fit.at.compliance))
    off = np.array([math.log(there / here) for there, here in pairs])
    return float(off @ np.linalg.solve(fit.covariance, off)) < 1.0


def _fitted_again(at: Point, stack: Stack, rig: Rig) -> tuple[Problem, Errors, Fit]:
    problem, errors = posed(stack, rig, at)
    return problem, errors, refined(problem, at)


def explained(chi2: float, rows: int) -> bool:
    """Whether a model leaves no more of the readings than the sensors explain."""
    return chi2 < rows + CHANCE.clear * math.sqrt(2.0 * rows)


def posed(stack: Stack, rig: Rig, at: Point) -> tuple[Problem, Errors]:
    """Return the problem of some readings, with errors and the correction of bars about a model."""
    here = at.rig(rig)
    errors = errors_of(stack, here, at.effects)
    fine = simulated(stack, here, at.effects, bars=FINE) - simulated(stack, here, at.effects)
    return Problem(stack, whitening(errors), rig, stack.measured - fine), errors  # docs/model.md (106)

"""The fit: friction, compliance and what an effect adds, refitted through the model of the whole run.

Source: docs/model.md (105)-(107).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from msgspec.structs import replace as changed

from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import Library, Parameter
from tssgeom.errors import FitError
from tssgeom.identify.stack import Stack, simulated, with_base
from tssgeom.identify.whitening import Weighing
from tssgeom.rig import Rig

_STEP = 1e-3  # of a free parameter, for derivatives
_BASE_SD = 1.0  # of ln μ and ln ρ: they are free
_SCALE_SD = 1.0  # of the logarithm of a scale
_SIZE_SD = 10.0  # times the prior's, of an amplitude: it is free but for what would be absurd
_DONE = 0.05  # of χ²: less is no gain
_PLACE = 0.02  # m: unit of places along the route


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
    weighing: Weighing
    rig: Rig
    target: Vector
    """[rows] Measured less what too few bars make wrong [N, m]."""

    def left(self, at: Point) -> Vector:
        """Return measured less simulated [rows] [N, m]."""
        return self.target - simulated(self.stack, at.rig(self.rig), at.effects)


@dataclass(frozen=True, slots=True)
class Point:
    """Friction, compliance and effects: one model."""

    friction: float
    """[1]"""
    compliance: float
    """[1/N]"""
    effects: tuple[Library, ...] = ()
    free: tuple[Free, ...] = ()

    def rig(self, nominal: Rig) -> Rig:
        """Return the rig with this friction and compliance."""
        return with_base(nominal, self.friction, self.compliance)

    def moved(self, by: Vector) -> Point:
        """Return the model a step on: ln μ, ln ρ, then what is free [2 + free]; bounds hold."""
        effects = list(self.effects)
        for free, du in zip(self.free, by[2:], strict=True):
            effect = effects[free.effect]
            u = free.u(getattr(effect, free.key))
            effects[free.effect] = changed(effect, **{free.key: free.value(u + du)})
        scale = np.exp(np.clip(by[:2], -1.0, 1.0))
        return replace(
            self,
            friction=float(self.friction * scale[0]),
            compliance=float(self.compliance * scale[1]),
            effects=tuple(effects),
        )


@dataclass(frozen=True, slots=True)
class Fit:
    """A model refitted."""

    at: Point
    chi2: float
    """Of residuals and priors [1]."""
    residual: Vector
    """[rows + k] Weighed [1]."""
    jacobian: Matrix
    """[rows + k, 2 + free] Of the weighed prediction by ln μ, ln ρ and what is free [1]."""
    left: Vector
    """[rows] Measured less simulated [N, m]."""

    @property
    def covariance(self) -> Matrix:
        """Of ln μ, ln ρ and what is free."""
        sd = prior_sd(self.at)
        normal = self.jacobian.T @ self.jacobian + np.diag(sd**-2.0)
        return np.asarray(np.linalg.inv(normal), dtype=np.float64)


def freed(effect: Library, which: int, length: float, only: tuple[str, ...] = ()) -> Iterator[Free]:
    """Return what of an effect is fitted: amplitudes, and scales that runs can tell."""
    for key, told in effect.parameters.items():
        if told.fitted and (not only or key in only):
            yield _free(which, key, told, length)


def _free(which: int, key: str, told: Parameter, length: float) -> Free:
    if key == "at_m":
        return Free(which, key, _PLACE, False, 0.0, length)
    if not told.switch:
        return Free(which, key, told.centre, True, told.lower, told.upper)
    return Free(which, key, told.prior_sd, False, told.lower, told.upper)


def prior_sd(at: Point) -> Vector:
    """Return standard deviations of the priors of ln μ, ln ρ and what is free."""
    own = [_SCALE_SD if free.log else 1e3 if free.key == "at_m" else _SIZE_SD for free in at.free]
    return np.array([_BASE_SD, _BASE_SD, *own])


def _prior(problem: Problem, at: Point) -> Vector:
    """Return deviations from the priors, in standard deviations."""
    base = [
        math.log(at.friction / max(problem.rig.friction.coefficient, 1e-6)),
        math.log(at.compliance / problem.rig.tendon.compliance_per_N),
    ]
    own = [free.u(getattr(at.effects[free.effect], free.key)) for free in at.free]
    off = [0.0 if free.key == "at_m" else u for free, u in zip(at.free, own, strict=True)]
    return np.array([*base, *off]) / prior_sd(at)


def columns(problem: Problem, at: Point, left: Vector, first: int = 0) -> Matrix:
    """Return derivatives of the weighed prediction by free numbers from the `first` on, one-sided."""
    out = [_slope(problem, at, left, k) for k in range(first, 2 + len(at.free))]
    rows = problem.weighing.basis.shape[0]
    return problem.weighing.weighed(np.column_stack(out)) if out else np.zeros((rows, 0))


def _slope(problem: Problem, at: Point, left: Vector, k: int) -> Vector:
    """Return the derivative of the prediction by one number; zero where neither side has an equilibrium."""
    for sign in (1.0, -1.0):
        by = np.zeros(2 + len(at.free))
        by[k] = sign * _step(at, k)
        try:
            return (left - problem.left(at.moved(by))) / by[k]
        except FitError:
            continue
    return np.zeros_like(left)


def _step(at: Point, k: int) -> float:
    """Return a small step that stays inside the bounds."""
    if k < 2:
        return _STEP
    free = at.free[k - 2]
    value = getattr(at.effects[free.effect], free.key)
    size = 20.0 * _STEP
    return -size if free.value(free.u(value) + size) >= free.high else size


def refined(problem: Problem, start: Point, base: Matrix | None = None, passes: int = 8) -> Fit:
    """Refit a model by Levenberg and Marquardt's method; `base` are columns of μ and ρ to use again."""
    at, left = start, problem.left(start)
    residual = problem.weighing.weighed(left)
    chi2 = _chi2(problem, at, residual)
    damping, jacobian = 1e-3, np.zeros((0, 0))
    for _ in range(passes):
        own = columns(problem, at, left, 0 if base is None else base.shape[1])
        jacobian = own if base is None else np.column_stack([base, own])
        found = _better(problem, at, (residual, jacobian, chi2), damping)
        if found is None:
            break
        gain = chi2 - found[2]
        at, left, chi2, damping = found
        residual = problem.weighing.weighed(left)
        if gain < _DONE:
            break
    return Fit(at, chi2, residual, jacobian, left)


def _chi2(problem: Problem, at: Point, residual: Vector) -> float:
    prior = _prior(problem, at)
    return float(residual @ residual + prior @ prior)


def _better(
    problem: Problem, at: Point, linear: tuple[Vector, Matrix, float], damping: float
) -> tuple[Point, Vector, float, float] | None:
    """Return the first step that makes χ² fall, with residuals, χ² and damping; None where none does."""
    residual, jacobian, chi2 = linear
    sd, prior = prior_sd(at), _prior(problem, at)
    normal = jacobian.T @ jacobian + np.diag(sd**-2.0)
    slope = jacobian.T @ residual - prior / sd
    for _ in range(6):
        damped = normal + damping * np.diag(np.diag(normal))
        step = np.clip(np.linalg.solve(damped, slope), -5.0, 5.0)
        trial = at.moved(np.asarray(step, dtype=np.float64))
        try:
            left = problem.left(trial)
        except FitError:
            damping *= 10.0
            continue
        now = _chi2(problem, trial, problem.weighing.weighed(left))
        if now < chi2:
            return trial, left, now, max(damping / 10.0, 1e-6)
        damping = max(10.0 * damping, 1e-2)
    return None


Progress = Callable[[str, float], None]

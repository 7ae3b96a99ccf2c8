"""Least squares with a Gaussian prior and bounds, of models that may have no equilibrium.

Every iterated fit is one `Problem`: the method of Levenberg and Marquardt, projected onto the bounds. Unlike
`scipy.optimize.least_squares` it computes no derivatives where it ends, it can be interrupted between two
evaluations, and the prior may follow from where the fit is. Sources: D. W. Marquardt, J. Soc. Indust. Appl.
Math. 11 (1963) 431; D. P. Bertsekas, SIAM J. Control Optim. 20 (1982) 221, for the bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from tssgeom.arrays import Matrix, Vector

Detail = TypeVar("Detail")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class SolverSettings:
    """Numbers of every fit."""

    damping: tuple[float, ...] = (1e-3, 1e-2, 0.1, 1.0, 3.0, 10.0)
    """Of the diagonal of the normal matrix: damping of the steps tried from one position [1]; chosen: below 1
    it shortens what is weakly determined, from 1 on it takes every number by 1/2, 1/4 and 1/11."""
    passes: int = 12
    """Positions at which derivatives are computed [1]; chosen: three to six are usual."""
    quick: int = 2
    """The same in a first fit, which only ranks candidates [1]; chosen for speed: a play has a corner, and
    one step goes half the way."""
    converged: float = 0.05
    """Fall of χ², or square of a step in standard errors, below which a fit has converged [1]; chosen: 0.2
    standard errors of one number."""
    step: float = 1e-3
    """Step of one-sided derivatives by a logarithm or a zero; share of a bound within which a number is at it
    [1]; derived: root of the rounding of a model, 1e-6."""
    coarse_step: float = 0.02
    """Step by a number whose size is not known, in its unit [1]; chosen: beyond the kinks of friction."""
    shares: tuple[float, ...] = (1.0, 0.4, 0.15, 0.05)
    """Of the way to the lowest point: steps tried along a ridge, before damped ones [1]; chosen."""
    flat: float = 10.0
    """Falls that end a fit: where derivatives promise less than so many, a shortened step that falls by less
    than one ends it too [1]; chosen: each contact that begins to slide bends χ² a little."""
    chords: int = 4
    """Steps with the same derivatives, along ridges [1]; chosen: derivatives take as long as twenty."""

    @property
    def rounding(self) -> float:
        """Rounding of a model, over its range [1]: `step` is its root."""
        return self.step**2


SOLVER = SolverSettings()


def _as_it_is(residual: np.ndarray) -> np.ndarray:
    return residual


@dataclass(frozen=True, slots=True)
class Problem(Generic[Detail]):
    """What a fit needs: residuals and prior, both as functions of numbers u [size]."""

    model: Callable[[Vector], tuple[Vector, Detail] | None]
    """Gives residuals [rows], measured less predicted, and what else the caller keeps; None where the model
    has no equilibrium."""
    precision: Matrix | Callable[[Vector, Vector, Matrix], Matrix]
    """Of the prior [size, size], or how it follows from u, whitened residuals and their derivatives."""
    lower: Vector
    upper: Vector
    centre: Vector | float = 0.0
    """Of the prior [size]."""
    step: Vector | float = SOLVER.step
    """Of derivatives [size]."""
    longest: Vector | float = np.inf
    """Longest step of each number [size]."""
    whitened: Callable[[np.ndarray], np.ndarray] = _as_it_is
    """Linear: makes residuals [rows (, size)] independent, with unit variance."""
    huber: float = np.inf
    """Standard deviations from which a residual counts less: the loss is linear beyond [1]."""
    close: float = 0.0
    """Of χ²: a fall that ends the fit as well [1]."""
    jacobian: Callable[[Solution[Detail]], Matrix] | None = None
    """Derivatives of the whitened residuals; finite differences where None."""
    along_ridges: bool = False
    """Whether steps are first tried that follow a bent ridge: undamped, shortened as a whole, and with others
    behind each one that go back onto the ridge. A damped step hardly moves along it."""


@dataclass(frozen=True, slots=True)
class Solution(Generic[Detail]):
    """Where a fit is, and ends."""

    u: Vector
    """Estimates [size]."""
    left: Vector
    """[rows] Residuals."""
    detail: Detail
    residual: Vector
    """Whitened residuals, those beyond `huber` by the root of their weight [1]."""
    jacobian: Matrix
    """Their derivatives at these weights, one step before the last at least."""
    precision: Matrix
    """Of the prior."""
    chi2: float
    """Of residuals and prior [1]."""
    at_bound: np.ndarray
    """[size] Which numbers are at a bound."""
    evaluations: int = 1
    """Of the model, without those of derivatives."""
    passes: int = 0
    """Positions at which derivatives were computed."""
    converged: bool = False
    shortened: int = 0
    """Of `SolverSettings.shares`, the first that is tried: the one before that by which χ² fell last."""

    @property
    def covariance(self) -> Matrix:
        """Of the estimates, by Laplace's approximation."""
        normal = self.jacobian.T @ self.jacobian + self.precision
        return np.asarray(np.linalg.inv(normal), dtype=np.float64)


def solve(problem: Problem[Detail], start: Vector, passes: int = SOLVER.passes) -> Solution[Detail] | None:
    """Return the fit from a start; None where the model has no equilibrium there.

    Parameters
    ----------
    problem
        Model, prior and bounds.
    start
        First numbers [size].
    passes
        How often derivatives are computed at most; with 0, once, and nothing moves.
    """
    return _result(search(problem, start, passes))


def search(
    problem: Problem[Detail], start: Vector, passes: int = SOLVER.passes
) -> Generator[None, None, Solution[Detail] | None]:
    """Yield before each evaluation of the model, and return what `solve` does."""
    yield
    now = _evaluated(problem, start)
    for count in range(max(passes, 1)):
        if now is None:
            break
        now = yield from _straightened(problem, now)
        after = (yield from _stepped(problem, now)) if count < passes else now
        stands = after.chi2 == now.chi2
        now = after
        if now.converged or stands:
            break
    return now


def derivatives(
    problem: Problem[Any], u: Vector, left: Vector, first: int = 0, end: int | None = None
) -> Matrix:
    """Return derivatives of the whitened residuals by the numbers from `first` to before `end`, one-sided."""
    return _result(_differences(problem, u, left, first, end))


def _result(work: Generator[None, None, Result]) -> Result:
    """Return what a generator returns in the end."""
    while True:
        try:
            next(work)
        except StopIteration as end:
            return end.value


def _differences(
    problem: Problem[Any], u: Vector, left: Vector, first: int = 0, end: int | None = None
) -> Generator[None, None, Matrix]:
    last = len(u) if end is None else end
    slope = np.zeros((len(left), last - first))
    for k in range(first, last):
        slope[:, k - first] = yield from _column(problem, u, left, k)
    return problem.whitened(slope)


def _column(problem: Problem[Any], u: Vector, left: Vector, k: int) -> Generator[None, None, Vector]:
    """Return one column, forwards where the bound allows; zero where neither side has an equilibrium."""
    step = np.broadcast_to(problem.step, u.shape)[k]
    for by in (step, -step) if u[k] + step <= problem.upper[k] else (-step, step):
        yield
        moved = u.copy()
        moved[k] += by
        there = problem.model(moved)
        if there is not None:
            return (there[0] - left) / by
    return np.zeros_like(left)


def _evaluated(problem: Problem[Detail], u: Vector) -> Solution[Detail] | None:
    """Return the residuals at some numbers; derivatives and χ² are still to come."""
    there = problem.model(u)
    if there is None:
        return None
    at_bound = (u <= problem.lower) | (u >= problem.upper)
    empty = np.zeros((0, len(u)))
    residual = problem.whitened(there[0])
    residual = residual * _root_weight(residual, problem.huber)
    return Solution(u, *there, residual, empty, empty, np.inf, at_bound)


def _root_weight(residual: Vector, huber: float) -> Vector:
    return np.sqrt(np.minimum(1.0, huber / np.maximum(np.abs(residual), 1e-300)))


def _straightened(problem: Problem[Detail], now: Solution[Detail]) -> Generator[None, None, Solution[Detail]]:
    """Return the position with derivatives, the prior that follows from them, and χ²."""
    if problem.jacobian is None:
        slope = yield from _differences(problem, now.u, now.left)
    else:
        slope = problem.jacobian(now)
    slope = slope * _root_weight(problem.whitened(now.left), problem.huber)[:, None]
    given = problem.precision
    precision = given(now.u, now.residual, slope) if callable(given) else given
    chi2 = _chi2(problem, now, precision)
    return replace(now, jacobian=slope, precision=precision, chi2=chi2, passes=now.passes + 1)


def _chi2(problem: Problem[Any], at: Solution[Any], precision: Matrix) -> float:
    off, square = at.u - problem.centre, at.residual**2
    beyond = np.maximum(square - problem.huber**2, 0.0)
    return float(square.sum() + beyond.sum() + off @ precision @ off)


def _stepped(problem: Problem[Detail], now: Solution[Detail]) -> Generator[None, None, Solution[Detail]]:
    """Return the first step by which χ² falls; the same position where none does.

    Numbers that a bound holds against the pull stay there. A fit that expects no more than `converged` tries
    one step.
    """
    pull = _pull(problem, now, now)
    free = ~(((now.u <= problem.lower) & (pull < 0.0)) | ((now.u >= problem.upper) & (pull > 0.0)))
    normal = (now.jacobian.T @ now.jacobian + now.precision)[np.ix_(free, free)]
    enough = max(SOLVER.converged, problem.close * now.chi2)
    promised = float(pull[free] @ np.linalg.solve(normal, pull[free]))
    near, flat = promised < enough, promised < SOLVER.flat * enough
    ways, first = [(1.0, damping) for damping in SOLVER.damping], 0
    if problem.along_ridges:
        first = 0 if near else now.shortened
        ways = [(share, 0.0) for share in SOLVER.shares[first:]] + ways
    for k, (share, damping) in enumerate(ways[: 0 if not free.any() else 1 if near else None], first):
        damped = normal + damping * np.diag(np.diag(normal))
        chords = SOLVER.chords if damping == 0.0 and not near else 1
        there, fall, used = yield from _tried(problem, now, damped, free, share, chords)
        now = replace(now, evaluations=now.evaluations + used)
        if there is not None and fall > 0.0:
            moved = (there.u - now.u)[free]
            square = float(moved @ normal @ moved) if share == 1.0 else np.inf
            return replace(
                now,
                **{name: getattr(there, name) for name in ("u", "left", "detail", "residual", "at_bound")},
                chi2=now.chi2 - fall,
                shortened=min(max(k - 1, 0), len(SOLVER.shares) - 1),
                converged=min(fall if share == 1.0 or flat else np.inf, square) < enough,
            )
    return replace(now, converged=near)


def _tried(
    problem: Problem[Detail],
    now: Solution[Detail],
    damped: Matrix,
    free: np.ndarray,
    share: float,
    chords: int,
) -> Generator[None, None, tuple[Solution[Detail] | None, float, int]]:
    """Return where a step ends, by how much χ² falls there, and the evaluations that it took.

    The step goes to where that share of the pull is gone, in several steps with the same derivatives where
    asked for: along a bent ridge the first one goes beside it, and those behind it back. Source:
    docs/model.md (260).
    """
    at, best, fall, used = now, None, -np.inf, 0
    wanted = (1.0 - share) * _pull(problem, now, now)
    while used < chords:
        step = np.zeros_like(wanted)
        step[free] = np.linalg.solve(damped, (_pull(problem, now, at) - wanted)[free])
        yield
        bounded = at.u + np.clip(step, -problem.longest, problem.longest)
        there = _evaluated(problem, np.clip(bounded, problem.lower, problem.upper))
        used += 1
        lower = -np.inf if there is None else now.chi2 - _chi2(problem, there, now.precision)
        if there is None or lower <= fall:
            break
        at, best, fall = there, there, lower
    return best, fall, used


def _pull(problem: Problem[Detail], now: Solution[Detail], at: Solution[Detail]) -> Vector:
    """Return half of how fast χ² falls by each number at a position, with the derivatives of another one."""
    return -(now.jacobian.T @ at.residual + now.precision @ (at.u - problem.centre))

"""What a user would fit to a run instead: laws of one drive with hysteresis, by least squares.

Each law is linear in some parameters and nonlinear in few. The nonlinear ones start from several values,
sampled with a fixed seed where there are many, and are refined by scipy's least_squares while the linear ones
are solved for. Given channels beside the drive enter linearly.

Intervals are 95 %: from the curvature of the sum of squares, with the variance widened by (1 + ρ)/(1 - ρ)
for the correlation ρ of residuals one row apart. They hold if the law holds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares, nnls

from benchmarks.run_laws import Case, Data, Kind, Law, Mask, Response
from tssgeom.arrays import Matrix, Vector
from tssgeom.statistics import NORMAL_95

_STARTS = 3  # best of the starting values, that are refined
_CORRELATION = 0.98  # at most; a higher one cannot be estimated from one run
_DIFFERENCE = 1e-3  # of a nonlinear parameter; the kinks of a play hide a smaller one
_EVALUATIONS = 40  # of the residual, of each start


class Estimate(NamedTuple):
    """A parameter in SI, and the half width of its 95 % interval (NaN: at a bound)."""

    name: str
    kind: Kind
    """What it is a quantity of; a gain is response over drive."""
    value: float
    half_width: float


@dataclass(frozen=True, slots=True)
class Prediction:
    """A response as a method predicts it, and the method's parameters."""

    values: Vector
    """[n] SI."""
    parameters: tuple[Estimate, ...] = field(default=())


def fit(law: Law, case: Case, response: Response) -> Prediction | None:
    """Fit a law to the fitted rows; None where it does not apply or has more parameters than rows."""
    if not law.needs(response):
        return None
    data, half_range = _data_of(case, response)
    target = case.columns[response.column]
    starts = [np.array(start) for start in law.starts]
    try:
        costs = [float(np.square(_Solved(law, data, target, start).residual).sum()) for start in starts]
    except _TooFewRowsError:
        return None
    best = [starts[i] for i in np.argsort(costs)[: _STARTS if law.nonlinear else 1]]
    fits = [_Solved(law, data, target, _refined(law, data, target, start)) for start in best]
    solved = min(fits, key=lambda one: float(np.square(one.residual).sum()))
    return Prediction(solved.values, _estimates(law, solved, data, half_range))


class _TooFewRowsError(ValueError):
    pass


class _Solved:
    """The linear parameters at given nonlinear ones."""

    def __init__(self, law: Law, data: Data, target: Vector, theta: Vector) -> None:
        columns = np.column_stack(law.columns(data, theta))
        fitted = columns[data.fitted]
        if len(fitted) <= fitted.shape[1] + len(theta):
            raise _TooFewRowsError
        scale = np.maximum(np.sqrt(np.mean(np.square(fitted), axis=0)), 1e-12)
        solve = partial(_one_sign, count=len(law.gains)) if law.one_sign else _free
        self.theta = theta
        self.factors: Vector = solve(fitted / scale, target[data.fitted]) / scale
        self.columns = columns
        self.values: Vector = columns @ self.factors
        self.residual: Vector = self.values[data.fitted] - target[data.fitted]


def _free(columns: Matrix, target: Vector) -> Vector:
    return np.asarray(np.linalg.lstsq(columns, target, rcond=1e-9)[0], dtype=np.float64)


def _one_sign(columns: Matrix, target: Vector, count: int) -> Vector:
    """Solve with the first factors all positive, or all negative where that fits better."""
    gains, free = columns[:, :count], columns[:, count:]
    basis = np.linalg.qr(free)[0]
    rest, left = gains - basis @ (basis.T @ gains), target - basis @ (basis.T @ target)
    tried = [(nnls(sign * rest, left), sign) for sign in (1.0, -1.0)]
    (factors, _), sign = min(tried, key=lambda one: one[0][1])
    others = _free(free, target - gains @ (sign * factors)) if free.shape[1] else np.zeros(0)
    return np.concatenate([sign * factors, others])


def _refined(law: Law, data: Data, target: Vector, start: Vector) -> Vector:
    if not law.nonlinear:
        return start
    low, high = _bounds(law)
    return least_squares(
        lambda theta: _Solved(law, data, target, theta).residual,
        np.clip(start, low + 1e-9, high - 1e-9),
        bounds=(low, high),
        x_scale=np.maximum(np.abs(start), 0.02),
        diff_step=_DIFFERENCE,
        max_nfev=_EVALUATIONS,
    ).x


def _bounds(law: Law) -> tuple[Vector, Vector]:
    return np.array([each.low for each in law.nonlinear]), np.array([each.high for each in law.nonlinear])


def _data_of(case: Case, response: Response) -> tuple[Data, float]:
    """Return the case in units of the drive's half range, and that range [SI]."""
    drive = case.columns[response.drive]
    low, high = drive[case.fitted].min(), drive[case.fitted].max()
    half_range = 0.5 * float(high - low)
    centre = 0.0 if response.zeroed else 0.5 * (low + high)
    others = [_from_its_middle(case.columns[name], case.fitted) for name in response.others]
    varying = [values for values in others if values is not None]
    given = np.column_stack(varying) if varying else np.zeros((len(drive), 0))
    time, runs = case.columns["time_s"], tuple(case.runs())
    scaled = (drive - centre) / half_range
    return Data(scaled, time, runs, given, case.fitted, response.resists, response.zeroed), half_range


def _from_its_middle(values: Vector, fitted: Mask) -> Vector | None:
    low, high = values[fitted].min(), values[fitted].max()
    return None if high == low else (2.0 * values - low - high) / (high - low)


def _estimates(law: Law, solved: _Solved, data: Data, half_range: float) -> tuple[Estimate, ...]:
    """Return the parameters that have a meaning, with intervals by the delta method."""
    low, high = _bounds(law)
    inside = (solved.theta > low + 1e-6) & (solved.theta < high - 1e-6)
    gains = solved.factors[: len(law.gains)]
    used = np.concatenate([inside, solved.factors != 0.0])
    covariance = _covariance(law, data, solved, used)
    error = NORMAL_95 * np.sqrt(np.where(used, np.diag(covariance), np.nan))
    estimates = list[Estimate]()
    for k, each in enumerate(law.nonlinear):
        scale = half_range if each.kind == "drive" else 1.0
        estimates.append(Estimate(each.name, each.kind, scale * solved.theta[k], scale * error[k]))
    count = len(law.nonlinear)
    for k, name in enumerate(law.gains):
        estimates.append(Estimate(name, "gain", gains[k] / half_range, error[count + k] / half_range))
    if law.slides:
        slope = np.zeros(len(used))
        slope[[0, count]] = gains[0], solved.theta[0]
        width = NORMAL_95 * math.sqrt(slope @ covariance @ slope)
        estimates.append(Estimate("force", "response", gains[0] * solved.theta[0], width))
    return tuple(estimates)


def _covariance(law: Law, data: Data, solved: _Solved, used: Mask) -> Matrix:
    """Return the covariance of nonlinear parameters and factors; zero for what is not `used`."""
    slopes = list[Vector]()
    for k, value in enumerate(solved.theta):
        step = _DIFFERENCE * max(abs(float(value)), 0.02)
        moved = solved.theta.copy()
        moved[k] += step if value + step < law.nonlinear[k].high else -step
        columns = np.column_stack(law.columns(data, moved))
        slopes.append((columns - solved.columns) @ solved.factors / (moved[k] - value))
    jacobian = np.column_stack([*slopes, solved.columns])[data.fitted][:, used]
    residual = solved.residual
    degrees = len(residual) - jacobian.shape[1]
    own = float(residual @ residual)
    shared = float(residual[1:] @ residual[:-1]) / own if own > 0.0 else 0.0
    correlation = min(max(shared, 0.0), _CORRELATION)
    variance = own / degrees * (1.0 + correlation) / (1.0 - correlation)
    size = np.linalg.norm(jacobian, axis=0)
    scale = np.where(size > 0.0, size, 1.0)
    unit = jacobian / scale
    inverse = np.linalg.pinv(unit.T @ unit, hermitian=True) / np.outer(scale, scale)
    covariance = np.zeros((len(used), len(used)))
    covariance[np.ix_(used, used)] = variance * inverse
    return covariance

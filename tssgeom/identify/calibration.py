"""Friction, compliance and zeros of a rig from a measured pull and release on a known shape.

The forward model is fitted, not a regression on columns: docs/model.md, section on calibration, (70)-(74).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from msgspec.structs import replace as changed
from scipy.stats import t as student

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.errors import FitError, SettingsError
from tssgeom.identify.calibrated_run import (
    NAMES,
    CalibratedRun,
    Measured,
    calibrated_run,
    start_rig,
)
from tssgeom.identify.fit import Point, Problem, Whitening, columns, prior_sd, refined, unshared
from tssgeom.identify.prediction import FINE, stacked
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.statistics import robust_sd


@dataclass(frozen=True, slots=True)
class RobustFit:
    """How calibration weighs readings. Chosen on the runs of `benchmarks.calibration`."""

    passes: int = 4
    """Rounds in which weights and estimates converge; chosen."""
    huber: float = 2.5
    """Standard deviations from which a residual counts less [1]; cited: P. J. Huber, Robust statistics (1981)
    has 1.345 for 95 % efficiency; chosen larger, as most runs have no outlier."""
    first_sigma: float = 0.01
    """Of the range of a channel: its standard deviation in the first round [1]; chosen."""
    route_step: float = 0.02
    """Of a standard deviation of the route: step of its derivatives [1]; chosen: small, above rounding."""
    unobserved: float = 0.5
    """Of the prior's standard deviation: a wider posterior means that the run shows nothing [1]; chosen."""
    least_angle: float = 0.05
    """Angle of a route on which friction shows [rad]; chosen: friction of 0.2 takes 1 % there."""


ROBUST = RobustFit()
_WANTED = (("tension_out_offset", "N"), ("elongation_offset", "m"))


@dataclass(frozen=True, slots=True)
class Estimate:
    """One calibrated number with its 95 % interval."""

    name: str
    value: float
    unit: str
    low: float
    high: float
    observable: bool
    """False: the run does not identify it, and value and interval are those assumed beforehand."""


@dataclass(frozen=True, slots=True)
class ChannelFit:
    """How one measured channel is met."""

    name: str
    unit: str
    rms: float
    """Of what is left [unit]."""
    count: int
    effective_count: float
    """Readings that are worth as much, were they independent [1]."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """What a run identifies of a rig."""

    estimates: dict[str, Estimate]
    channels: tuple[ChannelFit, ...]
    warnings: tuple[str, ...]
    time: Vector
    """[n] [s]."""
    fitted: dict[str, Vector]
    """[n] What the fitted model gives in each channel, by its name."""

    def applied(self, rig: Rig) -> Rig:
        """Return the rig with the friction and the compliance that the run identifies."""
        friction, compliance = self.estimates["friction"], self.estimates["compliance"]
        if friction.observable:
            rig = _with_friction(rig, friction.value)
        if compliance.observable:
            rig = _with_compliance(rig, compliance.value)
        return rig


def calibrate(measured: Measured, arcs: Arcs, rig: Rig, *, from_tension: float = 4.0) -> Calibration:
    """Fit friction, compliance and zeros to a run.

    Parameters
    ----------
    measured
        Drive and responses of the run.
    arcs
        The route, with the covariance of its pieces.
    rig
        Nominal rig: pretension, load and the standard deviation of the angle gain are taken from it.
    from_tension
        Proximal tension below which the elongation does not count: slack is taken up there [N].

    Raises
    ------
    SettingsError
        Where the route is straight, so that there is no friction to find.
    FitError
        Where nothing can be fitted.

    Notes
    -----
    Source: docs/model.md (70) to (74).

    Examples
    --------
    >>> import numpy as np
    >>> from tssgeom import Arcs, Measured, MovingRoute, Rig, calibrate, simulate
    >>> route, time = Arcs.exact([0.5], [np.pi]), np.linspace(0.0, 20.0, 401)
    >>> pull = 5.0 + 10.0 * (1.0 - np.abs(time - 10.0) / 10.0)
    >>> run = list(simulate(time, MovingRoute(np.array([0.0]), [route]), Rig(), tension_in=pull))
    >>> out = np.array([moment.transmission.tension_out for moment in run])
    >>> stretch = np.array([moment.transmission.elongation for moment in run])
    >>> measured = Measured(time, tension_in=pull, tension_out=out, elongation=stretch)
    >>> print(f"{calibrate(measured, route, Rig()).estimates['friction'].value:.3f}")
    0.145
    """
    if arcs.total_angle < ROBUST.least_angle:
        raise SettingsError(
            f"the route turns by {arcs.total_angle:.3g} rad: a straight sheath shows no friction; "
            f"lay it with a bend of {ROBUST.least_angle:g} rad or more"
        )
    run = calibrated_run(measured, arcs, rig, from_tension)
    fit = _fitted(run, start_rig(rig))
    return _calibration(fit, _route_covariance(fit, arcs, rig), run.warnings)


@dataclass(frozen=True, slots=True)
class _Fit:
    """Estimates, and what they rest on; the parameters are ln μ, ln ρ, then zeros in standard deviations."""

    run: CalibratedRun
    problem: Problem
    at: Point
    left: Vector
    """[rows] Measured less simulated [N, m]."""
    jacobian: Matrix
    """[rows + parameters, parameters] Of weighted residuals and priors."""
    covariance: Matrix
    inflation: Vector
    """Readings of each channel over effective ones [1]."""


def _fitted(run: CalibratedRun, rig: Rig) -> _Fit:
    """Fit, weigh each channel by what is left and by how long its errors last, and fit again."""
    stack = stacked([run.reading])
    blocks = [block.rows for block in stack.blocks]
    at = Point(rig.friction.coefficient, rig.tendon.compliance_per_N, zeros=(0.0,) * len(run.zeros))
    problem = Problem(
        stack, unshared(stack.noise), rig, stack.measured, lambda point: run.predicted(point, rig)
    )
    sigma = [max(ROBUST.first_sigma * float(np.ptp(stack.measured[rows])), 1e-9) for rows in blocks]
    inflation = np.ones(len(blocks))
    for _ in range(ROBUST.passes):
        too_few_bars = run.predicted(at, rig, FINE) - run.predicted(at, rig)
        problem = replace(problem, target=stack.measured - too_few_bars)
        problem = replace(problem, whitening=_weights(problem.left(at), blocks, sigma, inflation))
        at = refined(problem, at).at
        left = problem.left(at)
        sigma = [_spread(left[rows]) for rows in blocks]
        inflation = np.array([_inflation(left[rows] / s) for rows, s in zip(blocks, sigma, strict=True)])
    left = problem.left(at)
    problem = replace(problem, whitening=_weights(left, blocks, sigma, inflation))
    of_data = columns(problem, at, left)
    if not np.all(np.isfinite(of_data)):
        raise FitError("the calibration did not converge: check units and columns with tssgeom check")
    jacobian = np.vstack([of_data, np.diag(1.0 / prior_sd(at))])
    square = _squares(
        problem.whitening.whitened(left), [rows.stop - rows.start for rows in blocks], at.size, inflation
    )
    return _Fit(run, problem, at, left, jacobian, _sandwich(jacobian, square), inflation)


def _weights(left: Vector, blocks: Sequence[slice], sigma: Sequence[float], inflation: Vector) -> Whitening:
    """Return weights of all readings: by channel, and less for those that are far off; docs/model.md (72)."""
    scale = np.empty(len(left))
    for rows, each, worth in zip(blocks, sigma, inflation, strict=True):
        scale[rows] = each * math.sqrt(worth)
    far = np.maximum(np.abs(left / scale), 1e-12)
    return unshared(scale / np.sqrt(np.minimum(1.0, ROBUST.huber / far)))


def _squares(left_over: Vector, counts: list[int], parameters: int, inflation: Vector) -> Vector:
    """Squares of residuals over the variance that the fit assumed; 1 for what the prior adds."""
    worth = np.repeat(inflation, counts)
    free = max(1.0 - parameters / max(float(np.sum(counts / inflation)), 1.0), 0.1)
    return np.concatenate([left_over**2 * worth / free, np.ones(parameters)])


def _sandwich(jacobian: Matrix, square: Vector) -> Matrix:
    """Covariance of the estimates where some readings are noisier than others; docs/model.md (73)."""
    bread = np.asarray(np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)
    return bread @ (jacobian.T @ (square[:, None] * jacobian)) @ bread


def _spread(left: Vector) -> float:
    """Return the standard deviation of residuals with a few that are far off."""
    robust = robust_sd(left - np.median(left))
    clipped = np.clip(left, -3 * robust, 3 * robust) if robust > 0 else left
    return max(float(np.sqrt(np.mean(clipped**2))), 1e-12)


def _inflation(left: Vector) -> float:
    """Return readings over effective ones, 1 + 2 Σ autocorrelation while positive; docs/model.md (73)."""
    clipped = np.clip(left, -3.0, 3.0)
    size = len(clipped)
    padded = np.fft.rfft(clipped - clipped.mean(), 2 * size)
    power = np.fft.irfft(np.abs(padded) ** 2)[: size // 2]
    if power[0] <= 0.0:
        return 1.0
    correlation = power / power[0]
    pairs = correlation[:-1:2] + correlation[1::2][: len(correlation[:-1:2])]
    ends = np.flatnonzero(pairs <= 0.0)
    total = 2.0 * float(np.sum(pairs[: ends[0] if len(ends) else len(pairs)])) - 1.0
    return float(np.clip(total, 1.0, size / 3))


def _route_covariance(fit: _Fit, arcs: Arcs, rig: Rig) -> Matrix:
    """Covariance of the estimates that comes from that of lengths, angles and their common gain; (74)."""
    k, problem = len(arcs.length), fit.problem
    total = np.array(arcs.covariance)
    gained = rig.shape.angle_gain_sd * np.concatenate([np.zeros(k), arcs.angle])
    total += np.outer(gained, gained)
    value, way = np.linalg.eigh(total)
    of_data = fit.jacobian[: problem.stack.size]
    bread = np.linalg.inv(fit.jacobian.T @ fit.jacobian)
    out = np.zeros_like(fit.covariance)
    for variance, direction in zip(value, way.T, strict=True):
        if variance <= 1e-6 * max(value[-1], 1e-300) or variance < 1e-18:
            continue
        by = ROBUST.route_step * math.sqrt(variance) * direction
        there = problem.target - fit.run.on(_moved(arcs, by)).predicted(fit.at, problem.rig)
        change = problem.whitening.whitened(there - fit.left) / ROBUST.route_step
        shift = bread @ (of_data.T @ change)
        out += np.outer(shift, shift)
    return out


def _moved(arcs: Arcs, by: Vector) -> Arcs:
    k = len(arcs.length)
    length, angle = np.maximum(arcs.length + by[:k], 1e-9), np.maximum(arcs.angle + by[k:], 0.0)
    return replace(arcs, length=read_only(length), angle=read_only(angle))


def _calibration(fit: _Fit, of_route: Matrix, warnings: tuple[str, ...]) -> Calibration:
    problem, stack = fit.problem, fit.problem.stack
    counts = np.array([block.rows.stop - block.rows.start for block in stack.blocks])
    effective = counts / fit.inflation
    quantile = float(student.ppf(0.975, max(float(effective.sum()) - fit.at.size, 2.0)))
    half = quantile * np.sqrt(np.diag(fit.covariance + of_route))
    observable = np.sqrt(np.diag(fit.covariance)) < ROBUST.unobserved * prior_sd(fit.at)
    channels = tuple(
        ChannelFit(
            NAMES[block.channel],
            block.channel.rpartition("_")[2],
            float(np.sqrt(np.mean(fit.left[block.rows] ** 2))),
            int(count),
            float(worth),
        )
        for block, count, worth in zip(stack.blocks, counts, effective, strict=True)
    )
    estimates = {each.name: each for each in _estimates(fit, half, observable)}
    fitted = fit.run.channels(fit.at, problem.rig)
    return Calibration(
        estimates,
        channels,
        warnings,
        fit.run.reading.time,
        {NAMES[block.channel]: fitted[block.channel] for block in stack.blocks},
    )


def _estimates(fit: _Fit, half: Vector, observable: np.ndarray) -> Iterator[Estimate]:
    """Yield every number with its interval; one that no channel shows has neither."""
    base = [("friction", "1", fit.at.friction), ("compliance", "1/N", fit.at.compliance)]
    stretch = fit.run.shows_stretch
    for k, (name, unit, value) in enumerate(base if stretch else base[:1]):
        low, high = value * math.exp(-half[k]), value * math.exp(half[k])
        yield Estimate(name, value, unit, low, high, bool(observable[k]))
    for k, (zero, u) in enumerate(zip(fit.run.zeros, fit.at.zeros, strict=True), start=2):
        value, low, high = (zero.value(each) for each in (u, u - half[k], u + half[k]))
        yield Estimate(zero.name, value, zero.unit, low, high, bool(observable[k]))
    fitted = {zero.name for zero in fit.run.zeros}
    missing = [] if stretch else [("compliance", "1/N")]
    missing += [(name, unit) for name, unit in _WANTED if name not in fitted]
    for name, unit in missing:
        yield Estimate(name, math.nan, unit, math.nan, math.nan, False)


def _with_friction(rig: Rig, value: float) -> Rig:
    return changed(rig, friction=changed(rig.friction, coefficient=value))


def _with_compliance(rig: Rig, value: float) -> Rig:
    return changed(rig, tendon=changed(rig.tendon, compliance_per_N=value))

"""Friction, compliance and zeros of a rig from a measured pull and release on a known shape.

The forward model is fitted, not a regression on columns: docs/model.md, section on calibration, (70)-(74).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from msgspec.structs import replace as changed
from scipy.optimize import least_squares
from scipy.stats import t as student

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.errors import FitError, SettingsError
from tssgeom.identify.forward import Forward, forward_model
from tssgeom.identify.measured import Measured
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.statistics import robust_sd

_PASSES = 4  # in which weights and estimates settle
_BOUND = 3.0  # standard deviations of what is assumed beforehand: the fit looks no further
_HUBER = 2.5  # standard deviations from which a residual counts less
_SMALL = 0.02  # of a standard deviation: steps of the route for its derivatives
_UNTOLD = 0.5  # of the prior's standard deviation: a wider posterior says that the run tells nothing
_LEAST_ANGLE = 0.05  # of a route on which friction can be seen [rad]


@dataclass(frozen=True, slots=True)
class Estimate:
    """One calibrated number with its 95 % interval."""

    name: str
    value: float
    unit: str
    low: float
    high: float
    observable: bool
    """False: the run does not tell it, and value and interval are those assumed beforehand."""


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
    """What a run tells about a rig."""

    estimates: dict[str, Estimate]
    channels: tuple[ChannelFit, ...]
    warnings: tuple[str, ...]
    time: Vector
    """[n] [s]."""
    fitted: dict[str, Vector]
    """[n] What the fitted model gives in each channel, by its name."""

    def applied(self, rig: Rig) -> Rig:
        """Return the rig with the friction and the compliance that the run tells."""
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
    """
    if arcs.total_angle < _LEAST_ANGLE:
        raise SettingsError(
            f"the route turns by {arcs.total_angle:.3g} rad: a straight sheath shows no friction; "
            f"lay it with a bend of {_LEAST_ANGLE:g} rad or more"
        )
    model = forward_model(measured, arcs, rig, from_tension)
    fit = _fitted(model)
    return _told(model, fit, _route_covariance(model, fit, arcs, rig))


@dataclass(frozen=True, slots=True)
class _Fit:
    """Estimates in the model's own parameters."""

    at: Vector
    jacobian: Matrix
    """Of the weighted residuals."""
    root_weight: Vector
    """Square roots of the weights that keep far-off readings from counting."""
    covariance: Matrix
    sigma: Vector
    """Standard deviation of each channel."""
    inflation: Vector
    """Readings of each channel over effective ones [1]."""


def _fitted(model: Forward) -> _Fit:
    """Fit, weigh each channel by what is left and by how long its errors last, and fit again."""
    count = len(model.channels)
    at, sigma, inflation = np.array(model.prior_mean), np.array(model.first_sigma), np.ones(count)
    room = (at - _BOUND * model.prior_sd, at + _BOUND * model.prior_sd)
    for _ in range(_PASSES):
        scale = sigma * np.sqrt(inflation)

        def residuals(p: Vector, scale: Vector = scale) -> Vector:
            return _weighted(model, p, scale)

        found = least_squares(
            residuals, at, bounds=room, x_scale=model.prior_sd, loss="huber", f_scale=_HUBER, max_nfev=60
        )
        if not np.all(np.isfinite(found.x)):
            raise FitError("the calibration did not converge: check units and columns with tssgeom check")
        at = found.x
        left = model.residuals(at)
        sigma = np.array([_spread(each) for each in left])
        inflation = np.array([_inflation(each / s) for each, s in zip(left, sigma, strict=True)])
    scale = sigma * np.sqrt(inflation)
    left_over = _weighted(model, at, scale)
    root = np.sqrt(np.minimum(1.0, _HUBER / np.maximum(np.abs(left_over), 1e-12)))
    jacobian = _jacobian(model, at, scale) * root[:, None]
    square = _squares(model, left_over * root, inflation)
    return _Fit(at, jacobian, root, _sandwich(jacobian, square), sigma, inflation)


def _squares(model: Forward, left_over: Vector, inflation: Vector) -> Vector:
    """Squares of residuals over the variance that the fit assumed; 1 for what the prior adds."""
    counts = [len(each.used) for each in model.channels]
    worth = np.repeat(inflation, counts)
    free = max(1.0 - len(model.names) / max(float(np.sum(counts / inflation)), 1.0), 0.1)
    return np.concatenate([left_over[: len(worth)] ** 2 * worth / free, np.ones(len(model.names))])


def _sandwich(jacobian: Matrix, square: Vector) -> Matrix:
    """Covariance of the estimates where some readings are noisier than others; docs/model.md (73)."""
    bread = np.asarray(np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)
    return bread @ (jacobian.T @ (square[:, None] * jacobian)) @ bread


def _weighted(model: Forward, p: Vector, scale: Vector) -> Vector:
    """Residuals over their scale, then what the prior adds; docs/model.md (72)."""
    left = [each / s for each, s in zip(model.residuals(p), scale, strict=True)]
    return np.concatenate([*left, (p - model.prior_mean) / model.prior_sd])


def _jacobian(model: Forward, at: Vector, scale: Vector) -> Matrix:
    """Central differences over a hundredth of the prior's standard deviation or less."""
    columns = []
    for k, sd in enumerate(model.prior_sd):
        h = np.zeros(len(at))
        h[k] = 1e-3 * sd
        columns.append((_weighted(model, at + h, scale) - _weighted(model, at - h, scale)) / (2 * h[k]))
    return np.column_stack(columns)


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


def _route_covariance(model: Forward, fit: _Fit, arcs: Arcs, rig: Rig) -> Matrix:
    """Covariance of the estimates that comes from that of lengths, angles and their common gain; (74)."""
    k = len(arcs.length)
    total = np.array(arcs.covariance)
    gained = rig.shape.angle_gain_sd * np.concatenate([np.zeros(k), arcs.angle])
    total += np.outer(gained, gained)
    value, way = np.linalg.eigh(total)
    scale = fit.sigma * np.sqrt(fit.inflation)
    base = _weighted(model, fit.at, scale)
    bread = np.linalg.inv(fit.jacobian.T @ fit.jacobian)
    out = np.zeros_like(fit.covariance)
    for variance, direction in zip(value, way.T, strict=True):
        if variance <= 1e-6 * max(value[-1], 1e-300) or variance < 1e-18:
            continue
        by = _SMALL * math.sqrt(variance) * direction
        moved = (_weighted(model.on(_moved(arcs, by)), fit.at, scale) - base) / _SMALL
        shift = bread @ (fit.jacobian.T @ (fit.root_weight * moved))
        out += np.outer(shift, shift)
    return out


def _moved(arcs: Arcs, by: Vector) -> Arcs:
    k = len(arcs.length)
    length, angle = np.maximum(arcs.length + by[:k], 1e-9), np.maximum(arcs.angle + by[k:], 0.0)
    return replace(arcs, length=read_only(length), angle=read_only(angle))


def _told(model: Forward, fit: _Fit, of_route: Matrix) -> Calibration:
    counts = [len(each) for each in model.residuals(fit.at)]
    effective = np.array(counts) / fit.inflation
    quantile = float(student.ppf(0.975, max(float(effective.sum()) - len(fit.at), 2.0)))
    sd = np.sqrt(np.diag(fit.covariance + of_route))
    own = np.sqrt(np.diag(fit.covariance))
    estimates = {
        name: _estimate(model, k, fit.at[k], quantile * sd[k], bool(own[k] < _UNTOLD * model.prior_sd[k]))
        for k, name in enumerate(model.names)
    }
    channels = tuple(
        ChannelFit(each.name, each.unit, float(np.sqrt(np.mean(left**2))), len(left), float(worth))
        for each, left, worth in zip(model.channels, model.residuals(fit.at), effective, strict=True)
    )
    for name in model.missing:
        estimates[name] = Estimate(name, math.nan, model.unit_of(name), math.nan, math.nan, False)
    return Calibration(estimates, channels, model.warnings, model.clock.time, model.predicted(fit.at))


def _estimate(model: Forward, k: int, at: float, half: float, observable: bool) -> Estimate:
    name = model.names[k]
    value, low, high = (model.natural(k, p) for p in (at, at - half, at + half))
    return Estimate(name, value, model.unit_of(name), low, high, observable)


def _with_friction(rig: Rig, value: float) -> Rig:
    return changed(rig, friction=changed(rig.friction, coefficient=value))


def _with_compliance(rig: Rig, value: float) -> Rig:
    return changed(rig, tendon=changed(rig.tendon, compliance_per_N=value))

"""Friction, compliance and zeros of a rig from a measured pull and release on a known shape.

The forward model is fitted, not a regression on columns: docs/model.md, section on calibration, (70)-(74).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from msgspec.structs import replace as changed
from scipy.special import stdtrit

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.channel_names import unit_of
from tssgeom.core.constants import CHANCE
from tssgeom.effects import TensionOutOffset
from tssgeom.errors import FitError, SettingsError
from tssgeom.identify.calibrated_run import NAMES, CalibratedRun, calibrated_run
from tssgeom.identify.exact_drive import drive_noise, position_is_exact
from tssgeom.identify.fit import (
    Fit,
    Point,
    Problem,
    Whitening,
    columns,
    prior_sd,
    refined,
    start_rig,
    unshared,
    with_base,
)
from tssgeom.identify.fit_quality import (
    ROBUST,
    ChannelFit,
    failures,
    first_weights,
    is_identified,
    misfits,
    squares,
    weights_of,
    whiteness,
)
from tssgeom.identify.prediction import FINE, stacked
from tssgeom.least_squares import SOLVER
from tssgeom.result import Result
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.statistics import NORMAL_95, reading_noise, root_mean_square
from tssgeom.tendon.simulation import Measured

_LEAST_ANGLE = 0.05  # of a route on which friction shows [rad]; derived: friction of 0.2 takes 1 % there
_WANTED = (("tension_out_offset", "N"), ("elongation_offset", "m"))
_FITTED = 0.8  # share of the work done when the fit ends [1]; chosen
_NOT_BY_POSITION = (
    "displacement_in_m is more exact than tension_in_N, but the model that it drives does not meet the run: "
    "the tension drives"
)
_UNMEASURED = {
    "compliance": "no channel measures the stretch: give elongation_m, or displacement_in_m",
    "tension_out_offset": "tension_out_N is not measured, or has too few readings",
    "elongation_offset": "elongation_m is not measured, or has too few readings",
}


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
    why: str = ""
    """Why the run does not identify it; empty where it does."""
    at_bound: bool = False
    """Whether the fit ended at a bound of its value."""


@dataclass(frozen=True, slots=True, repr=False)
class Calibration(Result):
    """What a run identifies of a rig."""

    estimates: dict[str, Estimate]
    """Each number with its 95 % interval, by name."""
    channels: tuple[ChannelFit, ...]
    """How well each measured channel is met."""
    warnings: tuple[str, ...]
    """What to know of run and fit, a sentence each."""
    time: Vector
    """[n] [s]."""
    fitted: dict[str, Vector]
    """[n] What the fitted model gives in each channel, by its name."""
    measured: dict[str, Vector]
    """[n] The readings that count, NaN elsewhere, by the same names."""
    tension_in: Vector
    """[n] T_in of the fitted model [N]."""
    fitted_names: tuple[str, ...]
    """Names of the estimates that the fit has, in the order of `covariance`."""
    covariance: Matrix
    """[fitted, fitted] Of a normal law with their 95 % intervals: of ln μ and ln ρ [1], of zeros [N, m]."""

    @property
    def failures(self) -> tuple[str, ...]:
        """Why the estimates are not to be used, a sentence each; none where the fit passes its test."""
        friction = self.estimates["friction"]
        bounds = [each.name for each in self.estimates.values() if each.at_bound]
        known = friction.value if friction.observable else None
        return tuple(failures(known, self.channels, bounds, self.fitted))

    def applied(self, rig: Rig) -> Rig:
        """Return the rig with friction, compliance and zero of the distal cell that the run identifies."""
        friction, compliance = self.estimates["friction"], self.estimates["compliance"]
        rig = with_base(
            rig,
            friction.value if friction.observable else rig.friction.coefficient,
            compliance.value if compliance.observable else rig.tendon.compliance_per_N,
        )
        offset = self.estimates["tension_out_offset"]
        if offset.observable and not offset.low <= 0.0 <= offset.high:
            rig = _with_offset(rig, offset.value)
        return rig


def calibrate(
    measured: Measured,
    arcs: Arcs,
    rig: Rig,
    *,
    from_tension: float = 4.0,
    progress: Callable[[str, float], object] = lambda step, share: None,
) -> Calibration:
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
    progress
        Called with each step and the share of the work that is done [1].

    Raises
    ------
    SettingsError
        Where the route is straight, so that there is no friction to find.
    FitError
        Where nothing can be fitted.

    Notes
    -----
    Source: docs/model.md (70) to (74).
    """
    if arcs.total_angle < _LEAST_ANGLE:
        raise SettingsError(
            f"the route turns by {arcs.total_angle:.3g} rad: a straight sheath shows no friction; "
            f"lay it with a bend of {_LEAST_ANGLE:g} rad or more"
        )
    warning = ()
    if position_is_exact(measured):
        run = calibrated_run(measured, arcs, rig, from_tension, "displacement_in_m")
        with suppress(FitError):
            by_position = _calibrated(run, arcs, rig, progress)
            if not any(each.lacks_an_effect for each in by_position.channels):
                return by_position
        warning = (_NOT_BY_POSITION,)
    by_tension = _calibrated(calibrated_run(measured, arcs, rig, from_tension), arcs, rig, progress)
    return replace(by_tension, warnings=(*warning, *by_tension.warnings))


def _calibrated(
    run: CalibratedRun, arcs: Arcs, rig: Rig, progress: Callable[[str, float], object]
) -> Calibration:
    fit = _fitted(run, start_rig(rig), progress)
    progress("errors of the route", _FITTED)
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
    """[rows, parameters] Of weighted residuals."""
    bread: Matrix
    """Inverse of the normal matrix, of residuals and priors."""
    covariance: Matrix
    inflation: Vector
    """Readings of each channel over effective ones [1]."""
    of_drive: Vector
    """[rows] Standard deviation of what the noise of a position that drives does to a reading [N, m]."""


def _fitted(run: CalibratedRun, rig: Rig, progress: Callable[[str, float], object]) -> _Fit:
    """Fit, weigh each channel by what is left and by how long its errors last, and fit again."""
    stack = stacked([run.reading])
    blocks = [block.rows for block in stack.blocks]
    at = Point(rig.friction.coefficient, rig.tendon.compliance_per_N, zeros=(0.0,) * len(run.zeros))
    problem = Problem(
        stack, unshared(stack.noise), rig, stack.measured, lambda point: run.predicted(point, rig)
    )
    weight = first_weights([stack.measured[rows] for rows in blocks])
    problem, fit = _refitted(run, replace(problem, whitening=_whitening(weight)), at)
    for k in range(ROBUST.rounds):
        progress(f"fit, round {k + 2} of {ROBUST.rounds + 1}", _FITTED * (k + 1) / (ROBUST.rounds + 1))
        weight, _ = weights_of([fit.left[rows] for rows in blocks])
        problem, fit = _refitted(run, replace(problem, whitening=_whitening(weight)), fit.at)
    weight, inflation = weights_of([fit.left[rows] for rows in blocks])
    problem, at, left = replace(problem, whitening=_whitening(weight)), fit.at, fit.left
    of_data = columns(problem, at, left)
    if not np.all(np.isfinite(of_data)):
        raise FitError("the calibration did not converge: check units and columns with tssgeom check")
    jacobian = np.vstack([of_data, np.diag(1.0 / prior_sd(at))])
    square = squares(
        problem.whitening.whitened(left), [rows.stop - rows.start for rows in blocks], at.size, inflation
    )
    bread = np.asarray(np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)
    of_noise = bread @ (jacobian.T @ (square[:, None] * jacobian)) @ bread  # (73)
    fit = _Fit(run, problem, at, left, of_data, bread, of_noise, inflation, np.zeros(len(left)))
    if run.tension is None or run.reading.drive == "tension_in_N":
        return fit
    progress("errors of the drive", _FITTED)
    noise = drive_noise(run, problem, at, bread, of_data)
    return replace(fit, covariance=fit.covariance + noise.covariance, of_drive=noise.spread)


def _refitted(run: CalibratedRun, problem: Problem, at: Point) -> tuple[Problem, Fit]:
    """Fit with these weights, from the model's response of many bars there."""
    too_few_bars = run.predicted(at, problem.rig, FINE) - run.predicted(at, problem.rig)
    problem = replace(problem, target=problem.stack.measured - too_few_bars)
    return problem, refined(problem, at)


def _whitening(weight: Sequence[Vector]) -> Whitening:
    return unshared(1.0 / np.concatenate(weight))


def _route_covariance(fit: _Fit, arcs: Arcs, rig: Rig) -> Matrix:
    """Covariance of the estimates that comes from that of lengths, angles and their common gain; (74)."""
    k, problem = len(arcs.length), fit.problem
    total = np.array(arcs.covariance)
    gained = rig.shape.angle_gain_sd * np.concatenate([np.zeros(k), arcs.angle])
    total += np.outer(gained, gained)
    value, way = np.linalg.eigh(total)
    out = np.zeros_like(fit.covariance)
    for variance, direction in zip(value, way.T, strict=True):
        if variance <= 1e-6 * max(value[-1], 1e-300) or variance < 1e-18:
            continue
        by = SOLVER.coarse_step * math.sqrt(variance) * direction
        there = problem.target - fit.run.on(_moved(arcs, by)).predicted(fit.at, problem.rig)
        change = problem.whitening.whitened(there - fit.left) / SOLVER.coarse_step
        shift = fit.bread @ (fit.jacobian.T @ change)
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
    quantile = float(stdtrit(max(float(effective.sum()) - fit.at.size, 2.0), 0.975))
    half = quantile * np.sqrt(np.diag(fit.covariance + of_route))
    spread = np.sqrt(np.diag(fit.covariance))
    observable = [is_identified(*pair) for pair in zip(spread, prior_sd(fit.at), strict=True)]
    channels = tuple(
        ChannelFit(
            NAMES[block.channel],
            unit_of(block.channel),
            root_mean_square(fit.left[block.rows]),
            int(count),
            float(worth),
            math.hypot(reading_noise(stack.measured[block.rows]), root_mean_square(fit.of_drive[block.rows])),
            float(np.ptp(stack.measured[block.rows])),
            whiteness(fit.left[block.rows]),
        )
        for block, count, worth in zip(stack.blocks, counts, effective, strict=True)
    )
    estimates = {each.name: each for each in _estimates(fit, half, observable)}
    fitted = fit.run.channels(fit.at, problem.rig)
    unit = np.array([1.0, 1.0, *(zero.sd for zero in fit.run.zeros)]) * quantile / NORMAL_95
    return Calibration(
        estimates,
        channels,
        (*warnings, *misfits(channels)),
        fit.run.reading.time,
        {NAMES[block.channel]: fitted[block.channel] for block in stack.blocks},
        {NAMES[block.channel]: fit.run.reading.measured[block.channel] for block in stack.blocks},
        fitted["tension_in_N"],
        ("friction", "compliance", *(zero.name for zero in fit.run.zeros)),
        read_only((fit.covariance + of_route) * np.outer(unit, unit)),
    )


def _estimates(fit: _Fit, half: Vector, observable: Sequence[bool]) -> Iterator[Estimate]:
    """Yield every number with its interval; one that no channel shows has neither."""
    base = [("friction", "1", fit.at.friction), ("compliance", "1/N", fit.at.compliance)]
    stretch = fit.run.shows_stretch
    for k, (name, unit, value) in enumerate(base if stretch else base[:1]):
        low, high = value * math.exp(-half[k]), value * math.exp(half[k])
        yield Estimate(name, value, unit, low, high, observable[k], _why(observable[k], name))
    for k, (zero, u) in enumerate(zip(fit.run.zeros, fit.at.zeros, strict=True), start=2):
        value, low, high = (zero.value(each) for each in (u, u - half[k], u + half[k]))
        shows, bound = observable[k], abs(u) >= CHANCE.clear and not zero.name.startswith("turn")
        yield Estimate(zero.name, value, zero.unit, low, high, shows, _why(shows, zero.name), bound)
    fitted = {zero.name for zero in fit.run.zeros}
    missing = [] if stretch else [("compliance", "1/N")]
    missing += [(name, unit) for name, unit in _WANTED if name not in fitted]
    for name, unit in missing:
        yield Estimate(name, math.nan, unit, math.nan, math.nan, False, _UNMEASURED[name])


def _why(observable: bool, name: str) -> str:
    """Return why a number that was fitted is not identified."""
    if observable:
        return ""
    return f"the run changes what was assumed of {name} by less than half"


def _with_offset(rig: Rig, offset: float) -> Rig:
    """Return the rig whose distal cell reads too much by this beyond what the rig had [N]."""
    had = [each for each in rig.effects if isinstance(each, TensionOutOffset)]
    total = TensionOutOffset(offset_N=offset + sum(each.offset_N for each in had))
    return changed(rig, effects=(*(each for each in rig.effects if each not in had), total))

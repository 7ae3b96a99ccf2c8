"""A route that moves, tracked from frame to frame: each fit starts from the last one; docs/model.md (34).

`follow` computes what a frame needs. `model_checked` tests whether the estimator behind it is still the right
one, after the result is out and a little at a time, so that no frame waits for it.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tssgeom import core
from tssgeom.arrays import Vector
from tssgeom.errors import FitError
from tssgeom.route.arcs.chain import Chain, Data, fit_fixed_pieces, parameter_count
from tssgeom.route.arcs.moves import finer, fit_chain, simpler
from tssgeom.route.arcs.outliers import curvature_at_points, with_tangents, without_outlying_tangents
from tssgeom.route.arcs.summary import pieces_of
from tssgeom.route.geometry import (
    Method,
    chain_allowed,
    chain_data,
    chain_fit,
    checked,
    first_chain,
    measure,
    spline_fit,
    with_few_points_variance,
)
from tssgeom.route.model_choice import (
    CHOICE,
    log_evidence_difference,
    model_choice_variance,
    penalised_log_evidence_difference,
    undecided,
)
from tssgeom.route.observations import Shape
from tssgeom.route.route_fit import RouteFit
from tssgeom.route.spline.fit import Spline, fit


@dataclass(frozen=True, slots=True)
class TrackingSchedule:
    """When which model is checked while a route is tracked; docs/model.md (34). Evidence counts as 2 ln."""

    joints_interval: int = 4
    """Frames between two checks of a chain, for fewer joints and for more in turn. Chosen: by latency."""
    unlikely_interval: int = 4
    """Checks of a kind after which an unlikely joint is tried as well. Chosen: by latency."""
    unlikely_ranks: int = 4
    """Unlikely joints that take turns. Chosen: by latency."""
    first_interval: int = 16
    """Frames after which the other estimator is tried. Chosen: by latency."""
    longest_interval: int = 512
    """The same where the other was far behind again and again [frames]. Chosen."""
    takeover: float = 10.0
    """Evidence difference by which the other must lead to take over [2 ln]. Chosen: odds of 1 to 150."""
    far_behind: float = 60.0
    """Evidence difference beyond which the interval to the next trial doubles [2 ln]. Chosen."""
    moves_per_frame: int = 2
    """Moves of a candidate chain after one frame. Chosen: by latency."""
    patience: int = 4
    """Frames in which a candidate chain that is hopeless may still come up. Chosen."""


SCHEDULE = TrackingSchedule()


@dataclass(frozen=True, slots=True)
class ModelCheck:
    """A check of the model of one frame, due before the next one is fitted."""

    shape: Shape
    noise: float | None
    """Known standard deviation of each coordinate [m]."""
    candidate: Literal["spline", "chain", "joints"]
    """What is tried: a spline, a chain, or other joints of the chain that is tracked."""
    data: Data | None = None
    """The points as given to the chain; None where a spline was tracked."""


@dataclass(frozen=True, slots=True)
class TrackedFit:
    """Fit of the last frame, and what the next one needs to go on from it."""

    fit: RouteFit
    index: Vector
    """Count of each fitted point in the sensed sequence."""
    age: int = 0
    """Frames since the other estimator was tried."""
    interval: int = SCHEDULE.first_interval
    """Frames after which it is tried again."""
    checks: int = 2
    """Checks of the joints of a chain since they changed."""
    candidate: Chain | Spline | None = None
    """What may take over: a chain under trial, or the spline of the last trial."""
    model_choice_variance: float = 0.0
    """Variance of Φ from the choice between the two [rad²]."""
    check: ModelCheck | None = None
    """What `model_checked` is to test."""


def follow(shape: Shape, noise: float | None, last: TrackedFit | None, method: Method = "auto") -> TrackedFit:
    """Fit a route to a shape, starting from where a moving route was last.

    The estimator of the last frame goes on as long as it fits, and the other is tried now and then.

    Parameters
    ----------
    shape
        Validated points; their number may change from frame to frame.
    noise
        Known standard deviation of each coordinate [m]; estimated where left out.
    last
        Result of the last frame; without it the fit starts from nothing.
    method
        As in `measure`.

    Raises
    ------
    FitError
        Where the points give no finite curve.
    """
    tracked = None
    last = None if last is None else model_checked(last)
    if last is not None and last.fit.chain is not None:
        tracked = _follow_chain(shape, noise, last, last.fit.chain, method)
    elif last is not None:
        tracked = _follow_spline(shape, noise, last, method)
    if tracked is not None:
        with suppress(FitError):  # a route that leaps may be lost, and fitted again from nothing
            fit = checked(tracked.fit, shape)
            return tracked if fit is tracked.fit else replace(tracked, fit=fit)
    return TrackedFit(measure(shape, noise, method), shape.index)


def model_checked(last: TrackedFit) -> TrackedFit:
    """Make the check that is due: it selects the estimator and the joints from which the next frame starts.

    `follow` does so itself where it was not done; to have it done between two frames changes nothing else.
    """
    check = last.check
    if check is None:
        return last
    try:
        return _after_check(check, last)
    except FitError:  # a candidate that cannot be fitted is no better than what is tracked
        return replace(last, check=None)


def _after_check(check: ModelCheck, last: TrackedFit) -> TrackedFit:
    chain, last = last.fit.chain, replace(last, check=None)
    if check.data is None or chain is None:
        return _with_chain_tried(check, last)
    if check.candidate == "spline":
        return _with_spline_tried(check, check.data, chain, last)
    count, more_joints = divmod(last.checks, 2)
    rank, now = divmod(count, SCHEDULE.unlikely_interval)
    rank %= SCHEDULE.unlikely_ranks
    unlikely = slice(rank, rank if now else rank + 1)
    better = (finer if more_joints else simpler)(check.data, chain, unlikely)
    if better is None:
        return replace(last, checks=last.checks + 1)
    better = fit_chain(check.data, better, SCHEDULE.moves_per_frame - 1)
    return replace(last, fit=replace(last.fit, chain=better), checks=0)


def _follow_chain(
    shape: Shape, noise: float | None, last: TrackedFit, chain: Chain, method: Method
) -> TrackedFit | None:
    """Go on with a chain; None where it fits no longer."""
    age, known, free = last.age + 1, 0.0 if noise is None else noise * noise, shape.stations is None
    variance = last.fit.noise**2
    chain = chain._replace(stations=_stations(shape, last, chain))
    tangents = unit = weights = None
    if shape.directions is not None:
        spacing, shortest = core.chain_scale(shape.points, chain.form, chain.stations)
        data = Data(shape.points, np.ones(len(shape.points)), free, known, spacing, shortest=shortest)
        kappa = curvature_at_points(chain)
        data = with_tangents(data, shape.directions, shape.direction_noise**2, kappa, variance)
        tangents = without_outlying_tangents(data, fit_fixed_pieces(data, chain, restart=True)).tangents
    if tangents is not None:
        unit, weights = tangents.unit, tangents.weight
    count = parameter_count(chain.curved, free)
    spacing, shortest, fits, weight, *fitted = core.follow_chain(
        count, shape.points, free, known, unit, weights, *chain[:3], variance
    )
    data = Data(shape.points, weight, free, known, spacing, tangents, shortest)
    chain, pieces = Chain(fitted[0], chain.curved, *fitted[1:5]), pieces_of(*fitted[5:])
    if not fits:
        chain, pieces = fit_chain(data, chain), None
        if not _fits(data, chain, variance):
            return None
    result = chain_fit(shape, data, chain, pieces)
    result = result.with_model_choice_variance(last.model_choice_variance)
    check = None
    if method == "auto" and age >= last.interval:
        check = ModelCheck(shape, noise, "spline", data)
    elif age % SCHEDULE.joints_interval == 0 or last.checks < 2:
        check = ModelCheck(shape, noise, "joints", data)
    return TrackedFit(
        result,
        shape.index,
        age,
        last.interval,
        last.checks,
        last.candidate or last.fit.spline,
        last.model_choice_variance,
        check,
    )


def _stations(shape: Shape, last: TrackedFit, chain: Chain) -> Vector:
    """Predict the stations of the points on the last chain, before the fit."""
    if shape.stations is not None:
        return shape.stations.copy()
    if shape.index is last.index:
        return chain.stations
    if shape.index[-1] == last.index[-1] and shape.index[0] == last.index[0]:
        return np.interp(shape.index, last.index, chain.stations)
    steps = np.linalg.norm(np.diff(shape.points, axis=0), axis=1)
    share = np.concatenate(([0.0], np.cumsum(steps))) / steps.sum()
    return chain.stations[0] + share * (chain.stations[-1] - chain.stations[0])


def _fits(data: Data, chain: Chain, variance: float) -> bool:
    """Whether a chain is off the points by no more than noise, of a variance as in the last frame [m²]."""
    weights = None if data.tangents is None else data.tangents.weight
    known = (len(chain.matrix), data.weight, data.free, data.variance, data.spacing, weights)
    return bool(core.chain_fits(*known, chain.form, chain.stations, chain.cost, variance))


def _with_spline_tried(check: ModelCheck, data: Data, chain: Chain, last: TrackedFit) -> TrackedFit:
    """Let a spline take over from a chain, or drop it for the time being.

    It starts from the last one, which may be old: its first fit only brings it up to date.
    """
    before = last.candidate if isinstance(last.candidate, Spline) else None
    spline = fit(check.shape, check.noise, before)
    if before is not None and last.age == last.interval:
        return replace(last, candidate=spline)
    difference = penalised_log_evidence_difference(data, chain, spline)
    if difference > 0.0 and not undecided(difference, len(chain.bend)):
        return _not_taken_over(last, -difference, spline, 0.0)
    smooth = spline_fit(spline)
    variance = model_choice_variance(smooth, last.fit, difference)
    if difference < -SCHEDULE.takeover:
        return TrackedFit(smooth, last.index, model_choice_variance=variance)
    return _not_taken_over(last, -difference, spline, variance)


def _not_taken_over(
    last: TrackedFit, difference: float, candidate: Spline | None, variance: float
) -> TrackedFit:
    """Go on as before, the candidate's evidence being ahead by the difference [2 ln], mostly negative."""
    interval = SCHEDULE.first_interval
    if difference < -SCHEDULE.far_behind:
        interval = min(2 * last.interval, SCHEDULE.longest_interval)
    return replace(last, age=0, interval=interval, candidate=candidate, model_choice_variance=variance)


def _follow_spline(shape: Shape, noise: float | None, last: TrackedFit, method: Method) -> TrackedFit:
    """Go on with a spline, and now and then plan a trial of a chain beside it."""
    spline = fit(shape, noise, last.fit.spline)
    age = last.age + 1
    due = method == "auto" and (last.candidate is not None or age >= last.interval)
    check = ModelCheck(shape, noise, "chain") if due and chain_allowed(shape, spline) else None
    smooth = with_few_points_variance(spline_fit(spline), shape)
    result = smooth.with_model_choice_variance(last.model_choice_variance)
    return TrackedFit(
        result,
        shape.index,
        age,
        last.interval,
        last.checks,
        last.candidate,
        last.model_choice_variance,
        check,
    )


def _with_chain_tried(check: ModelCheck, last: TrackedFit) -> TrackedFit:
    """Let a chain take over from a spline, give it a few more moves, or drop it for the time being."""
    smooth, spline = last.fit, last.fit.spline
    if spline is None:
        return last
    data = chain_data(check.shape, check.noise, spline)
    if isinstance(last.candidate, Chain):
        candidate = fit_fixed_pieces(data, last.candidate._replace(stations=np.array(spline.route.station)))
    else:
        candidate = fit_fixed_pieces(data, first_chain(data, smooth))
    moved = fit_chain(data, candidate, SCHEDULE.moves_per_frame)
    difference = log_evidence_difference(data, moved, spline)
    converged = len(moved.bend) == len(candidate.bend)
    late = last.age >= last.interval + SCHEDULE.patience
    if difference < CHOICE.hopeless and (converged or late):
        return _not_taken_over(last, difference, None, 0.0)
    if not converged:
        return replace(last, candidate=moved)
    arcs = chain_fit(check.shape, data, moved)
    difference = penalised_log_evidence_difference(data, moved, spline)
    variance = model_choice_variance(smooth, arcs, difference)
    if difference > SCHEDULE.takeover:
        return TrackedFit(arcs, last.index, candidate=spline, model_choice_variance=variance)
    return _not_taken_over(last, difference, None, variance)

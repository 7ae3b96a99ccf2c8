"""A route that moves, tracked from frame to frame: each fit starts from the last one; docs/model.md (34).

`follow` computes what a frame needs. `model_check` tests whether the estimator behind it is still the right
one, after the result is out and a step at a time, so that no frame waits for it.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from tssgeom import core
from tssgeom.arrays import Vector
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_arcs import CHAIN_MOVES
from tssgeom.core.constants_route import PASSES
from tssgeom.errors import FitError
from tssgeom.route.agreement import checked
from tssgeom.route.arcs.chain import Chain, Data, fit_fixed_pieces
from tssgeom.route.arcs.moves import fit_chain
from tssgeom.route.arcs.outliers import curvature_at_points, with_tangents, without_outlying_tangents
from tssgeom.route.arcs.summary import ChainPieces, chain_fit
from tssgeom.route.error_posterior import NO_POSTERIOR, ErrorPosterior
from tssgeom.route.fibre.noise import LastNoise
from tssgeom.route.geometry import (
    Method,
    chain_allowed,
    measure,
    spline_fit,
    with_few_points_variance,
)
from tssgeom.route.model_check import SCHEDULE, CheckRun, ModelCheck, steps_of
from tssgeom.route.observations import Shape
from tssgeom.route.route_fit import NO_ERRORS, RouteFit, SharedErrors
from tssgeom.route.spline.spline import Spline
from tssgeom.route.spline.warm import warm
from tssgeom.route.time_filter import PointFilter


class NotWarmError(Exception):
    """A route has to be fitted from nothing, and the caller has no time for that."""


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
    by_models: SharedErrors = NO_ERRORS
    """Variances from the choice between the two, and from forms that no point shows."""
    trials: int = 0
    """Checks that the candidate chain has gone through."""
    run: CheckRun | None = None
    """The check that is under way."""
    frames: int = 0
    """Frames that it has taken so far."""
    due: bool = False
    """Whether the steps that follow this frame are still to be made."""
    warm_only: bool = False
    """Whether the next fit may only go on from here: one from nothing takes ten times as long."""
    marker_axis: Vector | None = None
    """First axis across the route at the first marker, where markers sit beside the route [3]."""
    filtered: PointFilter | None = None
    """The points as filtered in time, where they are."""
    sensed_over_fitted: float = 1.0
    """Noise of the sensed points over that of those that were fitted [1]."""
    noise_growth: float = 1.0
    """Noise that the next fit is expected to find over that of this one [1]."""
    first_noise: float = 0.0
    """Noise of the fit from which the warm ones began [m]."""
    first_left: float = 0.0
    """Noise that the filter left of the points of that fit [m]."""
    noise_bounded: bool = False
    """Whether fits of few points went astray, so that the noise is taken from differences in time."""
    noise_of_time: bool = False
    """Whether few points showed less noise than the filter leaves, so that it is taken from that."""
    noise_contradicted: bool = False
    """Whether the points contradict the noise that is stated of them, so that it is estimated."""
    direction_noise: float = 0.0
    """Noise of a component of sensed directions that was estimated [rad]."""
    fibre_noise: LastNoise | None = None
    """Noise of the curvatures of a fibre that was estimated."""
    errors: ErrorPosterior = NO_POSTERIOR
    """What errors that neighbouring points share mean for the fit."""

    is_stale: bool = False
    """Whether few points went over to another estimator, whose errors are those of the route as it was."""

    @property
    def has_noise_of_time(self) -> bool:
        """Whether few points were taken for a sharper route than their noise in time leaves; (272)."""
        if self.filtered is None or not self.fit.is_of_few:
            return False
        return self.noise_of_time or PASSES.warm_noise * self.fit.noise**2 < self.filtered.noise**2

    def start_for(self, now: PointFilter | None) -> TrackedFit | None:
        """Return it as the start for a frame with these filtered points, and with the noise to expect there.

        None where a fit from nothing shows more: points were exchanged, or few have so little noise left.
        """
        growth = noise_growth(self.fit.noise, self.filtered, now)
        if now is not None and now.reordered:
            return None
        quieter = now is not None and PASSES.warm_noise * now.noise**2 < self.first_left**2
        return None if quieter and self.fit.is_of_few else replace(self, noise_growth=growth)

    @classmethod
    def of(cls, fit: RouteFit, index: Vector) -> TrackedFit:
        """Begin with a fit that was made from nothing."""
        return cls(fit, index, by_models=fit.by_models)

    def beside(self, fit: RouteFit) -> RouteFit:
        """Return the fit of a later frame with these variances added."""
        return replace(self.by_models.of_stream(fit), turned=self.fit.turned)

    def with_check(self, check: ModelCheck | None) -> TrackedFit:
        """Begin a check, where there is one."""
        if check is None:
            return self
        # joints are tried at once: those of a route that slides are soon wrong
        work = math.inf if check.candidate == "joints" else CHAIN_MOVES.work_of_any
        return replace(self, run=CheckRun(steps_of(check, self), work), frames=0, due=True)

    def taken_over(
        self, fit: RouteFit, index: Vector, candidate: Spline | None, added: SharedErrors
    ) -> TrackedFit:
        """Go on with the fit of another estimator, of the points of an earlier frame."""
        return TrackedFit(
            fit,
            index,
            candidate=candidate,
            by_models=added,
            marker_axis=self.marker_axis,
            filtered=self.filtered,
            is_stale=fit.is_of_few,
        )


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
    NotWarmError
        Where a fit from nothing is needed, and the last one is to be `warm_only`.
    """
    tracked = None
    last = model_checked(last) if last is not None and last.due else last
    if last is not None and last.is_stale:
        pass  # what few points allow between them was averaged over another route
    elif last is not None and last.fit.chain is not None:
        tracked = _follow_chain(shape, noise, last, last.fit.chain, method)
    elif last is not None:
        tracked = _follow_spline(shape, noise, last, method)
    if last is not None and tracked is not None:
        with suppress(FitError):  # a route that leaps may be lost, and fitted again from nothing
            fit = checked(tracked.fit, shape, last.fit)
            return tracked if fit is tracked.fit else replace(tracked, fit=fit)
    if last is not None and last.warm_only:
        raise NotWarmError
    return TrackedFit.of(measure(shape, noise, method), shape.index)


def model_checked(last: TrackedFit) -> TrackedFit:
    """Make the steps of a check that are due after a frame; its end may select another estimator or joints.

    `follow` does so itself where it was not done; to have it done between two frames changes nothing else.
    """
    if not last.due or last.run is None:
        return last
    outcome = last.run.after(last.frames + 1)
    if outcome is None:
        return replace(last, frames=last.frames + 1, due=False)
    return replace(outcome(last), run=None, frames=0, due=False)


def noise_growth(fitted: float, before: PointFilter | None, now: PointFilter | None) -> float:
    """Return the noise that the fit of a frame may find, over that of the last one [1]; docs/model.md (255).

    Parameters
    ----------
    fitted
        Noise of the last fit [m].
    before, now
        The filter after the last frame and after this one; without a filter, `now` as before it, the points
        are as sensed.
    """
    if before is None:
        return 1.0
    left = before.sensed_noise if now is None else now.noise
    fitted = max(fitted, ROUNDING.exact * before.noise)
    variance = fitted**2 + left**2 - before.noise**2
    if fitted < before.noise:  # no part of it is the same in each frame
        variance = max(variance, (fitted * left / before.noise) ** 2)
    return math.sqrt(variance) / fitted


def _follow_chain(
    shape: Shape, noise: float | None, last: TrackedFit, chain: Chain, method: Method
) -> TrackedFit | None:
    """Go on with a chain; None where it fits no longer."""
    age, known, free = last.age + 1, 0.0 if noise is None else noise * noise, shape.stations is None
    variance = (max(last.noise_growth, 1.0) * last.fit.noise) ** 2
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
    count = chain.parameters_across + (not free)
    spacing, shortest, fits, weight, form, stations, matrix, cost, square, *of_pieces = core.follow_chain(
        count, shape.points, free, known, unit, weights, *chain[:3], variance
    )
    data = Data(shape.points, weight, free, known, spacing, tangents, shortest)
    chain = Chain(form, chain.curved, stations, matrix, cost, square)
    pieces: ChainPieces | None = ChainPieces(*cast("tuple[Any, ...]", of_pieces))
    if not fits:
        if last.warm_only:
            return None
        chain, pieces = fit_chain(data, chain), None
        if not _fits(data, chain, variance):
            return None
    result = last.beside(chain_fit(shape, data, chain, pieces))
    now = _now(result, shape, last, last.candidate or last.fit.spline)
    if now.run is not None:
        return now
    if method == "auto" and age >= last.interval:
        return now.with_check(ModelCheck(shape, noise, "spline", data))
    if age % SCHEDULE.interval == 0 or last.checks < 2:
        return now.with_check(ModelCheck(shape, noise, "joints", data))
    return now


def _now(result: RouteFit, shape: Shape, last: TrackedFit, candidate: Chain | Spline | None) -> TrackedFit:
    """Return the fit of this frame, one frame older than the last one; a check goes on."""
    return TrackedFit(
        result,
        shape.index,
        last.age + 1,
        last.interval,
        last.checks,
        candidate,
        last.by_models,
        last.trials,
        last.run,
        last.frames,
        last.run is not None,
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


def _follow_spline(shape: Shape, noise: float | None, last: TrackedFit, method: Method) -> TrackedFit | None:
    """Go on with a spline, now and then with a trial of a chain; None where it fits no longer."""
    spline = warm(shape, noise, last.fit.spline, last.noise_growth**2, last.index)
    if spline is None:
        return None
    smooth = with_few_points_variance(spline_fit(spline), shape)
    result = last.beside(smooth)
    now = _now(result, shape, last, last.candidate)
    wanted = method == "auto" and (last.candidate is not None or now.age >= last.interval)
    if now.run is None and wanted and chain_allowed(shape, spline):
        return now.with_check(ModelCheck(shape, noise, "chain"))
    return now

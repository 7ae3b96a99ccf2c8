"""A route that moves, tracked from frame to frame: each fit starts from the last one; docs/model.md (34).

`follow` computes what a frame needs. `model_check` tests whether the estimator behind it is still the right
one, after the result is out and a step at a time, so that no frame waits for it.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any, cast

import numpy as np

from tssgeom import core
from tssgeom.arrays import Vector
from tssgeom.errors import FitError
from tssgeom.route.agreement import checked
from tssgeom.route.arcs.chain import Chain, Data, fit_fixed_pieces, parameter_count
from tssgeom.route.arcs.moves import fit_chain
from tssgeom.route.arcs.outliers import curvature_at_points, with_tangents, without_outlying_tangents
from tssgeom.route.arcs.summary import ChainPieces, pieces_of
from tssgeom.route.geometry import (
    Method,
    chain_allowed,
    chain_fit,
    measure,
    spline_fit,
    with_few_points_variance,
)
from tssgeom.route.model_check import SCHEDULE, ModelCheck, TrackedFit, model_checked
from tssgeom.route.observations import Shape
from tssgeom.route.route_fit import RouteFit
from tssgeom.route.spline.spline import Spline
from tssgeom.route.spline.warm import warm


class NotWarmError(Exception):
    """A route has to be fitted from nothing, and the caller has no time for that."""


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
    count = parameter_count(chain.curved, free)
    spacing, shortest, fits, weight, form, stations, matrix, cost, square, *of_pieces = core.follow_chain(
        count, shape.points, free, known, unit, weights, *chain[:3], variance
    )
    data = Data(shape.points, weight, free, known, spacing, tangents, shortest)
    chain = Chain(form, chain.curved, stations, matrix, cost, square)
    pieces: ChainPieces | None = pieces_of(*cast("tuple[Any, ...]", of_pieces))
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

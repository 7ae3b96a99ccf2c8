"""A route that moves, followed from frame to frame: each fit starts from the last one; docs/model.md (34).

What a frame needs is found by `follow`. Whether the estimator behind it is still the right one is asked by
`reconsidered`, after the result is out and a little at a time, so that no frame waits for it.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import FitError
from tssgeom.route.arcs.chain import KINK, Chain, Data, has_kink, value_count
from tssgeom.route.arcs.fit import fit_fixed_pieces, turn_is_identifiable
from tssgeom.route.arcs.moves import finer, fit_chain, simpler
from tssgeom.route.arcs.outliers import (
    curvature_at_points,
    outlier_weights,
    with_tangents,
    without_outlying_tangents,
)
from tssgeom.route.geometry import (
    HOPELESS,
    Geometry,
    Method,
    by_chain,
    by_few,
    by_spline,
    checked,
    doubt,
    doubted,
    fit_data,
    may_be_chain,
    measure,
    started,
    told_length,
    undecided,
)
from tssgeom.route.model_choice import lead, margin
from tssgeom.route.observations import Shape
from tssgeom.route.spline.fit import Spline, fit
from tssgeom.route.stations import spacing_of_pieces

_LOOK = 4  # frames after which a chain is asked whether it needs fewer joints, or more, in turn
_SEARCH = 4  # looks of a kind after which an unlikely joint is tried as well
_TURNS = 4  # so many of them in turn
_CHALLENGE = 16  # frames after which the other estimator is tried
_LONGEST_WAIT = 512  # frames, where the other was far behind again and again
_SURE = 10.0  # -2 ln evidence that the other must be ahead to take over
_FAR = 60.0  # -2 ln evidence behind which it may wait longer for its next trial
_MOVES = 2  # of a chain in one frame
_PATIENCE = 4  # frames in which a chain that is far behind may still come up
_UNFIT = 6.0  # standard deviations of the cost above which a chain does not fit
_QUIETER = 100.0  # times less noise variance than in the last frame, where the fit begins anew
_NOISIER = 2.0  # times the noise variance of the last frame: the same where noise is not known
_ROUNDING = 1e-9  # of the spacing
_EXACT = 1e-5  # of the spacing: what no sensor tells apart


@dataclass(frozen=True, slots=True)
class Question:
    """What is to be asked of a frame before the next one is fitted."""

    shape: Shape
    noise: float | None
    """Known standard deviation of each coordinate [m]."""
    about: Literal["spline", "chain", "joints"]
    """What is tried: a spline, a chain, or other joints of the chain that is followed."""
    data: Data | None = None
    """The points as the chain sees them; None where a spline was followed."""


@dataclass(frozen=True, slots=True)
class Followed:
    """Geometry of the last frame, and what the next one needs to go on from it."""

    geometry: Geometry
    index: Vector
    """Count of each fitted point in the sensed sequence."""
    age: int = 0
    """Frames since the other estimator was tried."""
    wait: int = _CHALLENGE
    """Frames after which it is tried again."""
    looks: int = 2
    """How often a chain was asked for other joints since they changed."""
    rival: Chain | Spline | None = None
    """What may take over: a chain under trial, or the spline of the last trial."""
    doubt: float = 0.0
    """Variance of Φ from the choice between the two [rad²]."""
    question: Question | None = None
    """What `reconsidered` is to find out."""


def follow(shape: Shape, noise: float | None, last: Followed | None, method: Method = "auto") -> Followed:
    """Fit a route to a shape, starting from where a moving route was last.

    The estimator of the last frame goes on as long as it fits, and the other is tried now and then.

    Parameters
    ----------
    shape
        Validated points; their number may change from frame to frame.
    noise
        Known standard deviation of each coordinate [m]; estimated where left out.
    last
        What was found in the last frame; without it the fit starts from nothing.
    method
        As in `measure`.

    Raises
    ------
    FitError
        Where the points give no finite curve.
    """
    found = None
    last = None if last is None else reconsidered(last)
    if last is not None and last.geometry.chain is not None:
        found = _follow_chain(shape, noise, last, last.geometry.chain, method)
    elif last is not None:
        found = _follow_spline(shape, noise, last, method)
    if found is not None:
        with suppress(FitError):  # a route that leaps may be lost, and found again from nothing
            return replace(found, geometry=checked(told_length(found.geometry, shape), shape))
    return Followed(measure(shape, noise, method), shape.index)


def reconsidered(last: Followed) -> Followed:
    """Answer what is asked of the last frame: the estimator and the joints from which the next one starts.

    `follow` does so itself where nobody did; to have it done between two frames changes nothing else.
    """
    asked = last.question
    if asked is None:
        return last
    try:
        return _answered(asked, last)
    except FitError:  # what cannot be fitted is no better than what is followed
        return replace(last, question=None)


def _answered(asked: Question, last: Followed) -> Followed:
    chain, last = last.geometry.chain, replace(last, question=None)
    if asked.data is None or chain is None:
        return _with_chain_tried(asked, last)
    if asked.about == "spline":
        return _with_spline_tried(asked, asked.data, chain, last)
    round_of, look = divmod(last.looks, 2)
    turn, now = divmod(round_of, _SEARCH)
    turn %= _TURNS
    better = (finer if look else simpler)(asked.data, chain, slice(turn, turn if now else turn + 1))
    if better is None:
        return replace(last, looks=last.looks + 1)
    better = fit_chain(asked.data, better, _MOVES - 1)
    return replace(last, geometry=replace(last.geometry, chain=better), looks=0)


def _follow_chain(
    shape: Shape, noise: float | None, last: Followed, chain: Chain, method: Method
) -> Followed | None:
    """Go on with a chain; None where it fits no longer."""
    spacing = spacing_of_pieces(shape.points, float(chain.stations[-1] - chain.stations[0]))
    data = Data(
        shape.points,
        np.ones(len(shape.points)),
        shape.stations is None,
        0.0 if noise is None else noise * noise,
        spacing,
        shortest=KINK if has_kink(chain, spacing) else 1.0,
    )
    age = last.age + 1
    variance = last.geometry.outline.noise**2
    chain = chain._replace(stations=_stations(shape, last, chain))
    if shape.directions is not None:
        kappa = curvature_at_points(chain)
        data = with_tangents(data, shape.directions, shape.direction_noise**2, kappa, variance)
        data = without_outlying_tangents(data, fit_fixed_pieces(data, chain, restart=True))
    chain = fit_fixed_pieces(data, chain, restart=True)
    weight = outlier_weights(data, chain, variance)
    if weight is not None:
        data = data._replace(weight=weight)
        chain = fit_fixed_pieces(data, chain)
    if _unfit(data, chain, variance):
        chain = fit_chain(data, chain)
        if _unfit(data, chain, variance):
            return None
    geometry = by_chain(shape, data, chain)
    asked = None
    if method == "auto" and age >= last.wait:
        asked = Question(shape, noise, "spline", data)
    elif age % _LOOK == 0 or last.looks < 2:
        asked = Question(shape, noise, "joints", data)
    return Followed(
        doubted(geometry, last.doubt),
        shape.index,
        age,
        last.wait,
        last.looks,
        last.rival or last.geometry.spline,
        last.doubt,
        asked,
    )


def _stations(shape: Shape, last: Followed, chain: Chain) -> Vector:
    """Where the points are on the last chain, as near as can be told before the fit."""
    if shape.stations is not None:
        return shape.stations.copy()
    if shape.index is last.index:
        return chain.stations
    if shape.index[-1] == last.index[-1] and shape.index[0] == last.index[0]:
        return np.interp(shape.index, last.index, chain.stations)
    steps = np.linalg.norm(np.diff(shape.points, axis=0), axis=1)
    share = np.concatenate(([0.0], np.cumsum(steps))) / steps.sum()
    return chain.stations[0] + share * (chain.stations[-1] - chain.stations[0])


def _unfit(data: Data, chain: Chain, variance: float) -> bool:
    """Whether the points are off the chain by more than noise, of a variance as in the last frame [m²].

    A chain that turns out of their sight fits nothing, however near it comes to those that are not strays.
    """
    if not turn_is_identifiable(data, chain):
        return True
    freedom = max(value_count(data) - len(chain.matrix), 1)
    most = 1.0 + _UNFIT * math.sqrt(2.0 / freedom)
    if data.variance > 0.0:
        return not chain.cost < most * data.variance * freedom
    usual = max(variance, (_ROUNDING * data.spacing) ** 2) * freedom
    least = (_EXACT * data.spacing) ** 2 * freedom
    quieter = _QUIETER * max(chain.cost, least) < usual  # the last frame was none to measure by
    return quieter or not chain.cost < max(_NOISIER, 1.5 * most) * usual


def _with_spline_tried(asked: Question, data: Data, chain: Chain, last: Followed) -> Followed:
    """Let a spline take over from a chain, or drop it for the time being.

    It starts from the last one, which may be old: its first fit only brings it up to date.
    """
    before = last.rival if isinstance(last.rival, Spline) else None
    spline = fit(asked.shape, asked.noise, before)
    if before is not None and last.age == last.wait:
        return replace(last, rival=spline)
    ahead = margin(data, chain, spline)
    if ahead > 0.0 and not undecided(ahead, len(chain.bend)):
        return replace(last, age=0, wait=_next_wait(last.wait, -ahead), rival=spline, doubt=0.0)
    smooth = by_spline(spline)
    unsure = doubt(smooth, last.geometry, ahead)
    if ahead < -_SURE:
        return Followed(smooth, last.index, doubt=unsure)
    return replace(last, age=0, wait=_next_wait(last.wait, -ahead), rival=spline, doubt=unsure)


def _follow_spline(shape: Shape, noise: float | None, last: Followed, method: Method) -> Followed:
    """Go on with a spline, and now and then ask for a chain beside it."""
    spline = fit(shape, noise, last.geometry.spline)
    age = last.age + 1
    tried = method == "auto" and (last.rival is not None or age >= last.wait) and may_be_chain(shape, spline)
    asked = Question(shape, noise, "chain") if tried else None
    geometry = doubted(by_few(by_spline(spline), shape), last.doubt)
    return replace(last, geometry=geometry, index=shape.index, age=age, question=asked)


def _with_chain_tried(asked: Question, last: Followed) -> Followed:
    """Let a chain take over from a spline, give it a few more moves, or drop it for the time being."""
    smooth, spline = last.geometry, last.geometry.spline
    if spline is None:
        return last
    data = fit_data(asked.shape, asked.noise, spline)
    if isinstance(last.rival, Chain):
        rival = fit_fixed_pieces(data, last.rival._replace(stations=np.array(spline.route.station)))
    else:
        rival = fit_fixed_pieces(data, started(data, smooth))
    moved = fit_chain(data, rival, _MOVES)
    ahead = lead(data, moved, spline)
    settled = len(moved.bend) == len(rival.bend)
    if ahead < HOPELESS and (settled or last.age >= last.wait + _PATIENCE):
        return replace(last, rival=None, age=0, wait=_next_wait(last.wait, ahead), doubt=0.0)
    if not settled:
        return replace(last, rival=moved)
    arcs, ahead = by_chain(asked.shape, data, moved), margin(data, moved, spline)
    unsure = doubt(smooth, arcs, ahead)
    if ahead > _SURE:
        return Followed(arcs, last.index, rival=spline, doubt=unsure)
    return replace(last, rival=None, age=0, wait=_next_wait(last.wait, ahead), doubt=unsure)


def _next_wait(wait: int, ahead: float) -> int:
    """How long to wait before the other estimator is tried again, `ahead` being its lead."""
    return min(2 * wait, _LONGEST_WAIT) if ahead < -_FAR else _CHALLENGE

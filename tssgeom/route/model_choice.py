"""Whether the points speak for a chain of arcs or for a smooth route; docs/model.md (34)."""

from __future__ import annotations

import math

import numpy as np

from tssgeom.route.arcs.chain import Chain, Data, tangent_count
from tssgeom.route.arcs.moves import saved_by_slopes
from tssgeom.route.arcs.outliers import squared_tangent_residuals
from tssgeom.route.arcs.positions import squared_distances
from tssgeom.route.spline.fit import Spline

_MARGIN_OF_ONE = 23.0
_MARGIN_OF_JOINT = 18.0  # what a joint must save beyond its price: smooth routes look like staircases too
_MANY, _MARGIN_OF_MORE = 7, 4.0  # pieces from which on each must save even more
_VALUES_A_PARAMETER = 2.5  # fewer cannot tell a staircase from a smooth route
_FAR_ALONG = 3.0  # spacings that points lie off their known stations, where a chain lost them
_OFF_ALONG = 9.0  # times what they lie off across it


def margin(data: Data, chain: Chain, spline: Spline) -> float:
    """-2 ln evidence by which the chain beats the spline, its joints and missing slopes paid for; (34)."""
    return lead(data, chain, spline) - max(saved_by_slopes(data, chain), 0.0)


def lead(data: Data, chain: Chain, spline: Spline) -> float:
    """-2 ln evidence by which the chain beats the spline, after the extra price of its joints; (34)."""
    pieces = len(chain.bend)
    price = _MARGIN_OF_JOINT * (pieces - 1) + _MARGIN_OF_MORE * max(pieces - _MANY, 0)
    return spline.deviance - _deviance(data, chain) + _MARGIN_OF_ONE - price


def _deviance(data: Data, chain: Chain) -> float:
    """-2 ln evidence of points and directions normal to a chain; docs/model.md (34), (94)."""
    fitted = _deviance_of_points(data, chain)
    if data.tangents is None:
        return fitted
    used = data.tangents.variance > 0.0
    variance, square = data.tangents.variance[used], squared_tangent_residuals(data, chain)[used]
    return fitted + float(np.sum(2.0 * np.log(variance) + square / variance))


def _deviance_of_points(data: Data, chain: Chain) -> float:
    """-2 ln evidence of the points normal to a chain, infinite where it has too many parameters for them."""
    square = squared_distances(data.points, chain.stations, *chain[:4], True)
    cost, values = float(data.weight @ square), 2 * int(np.count_nonzero(data.weight))
    fitted = values + 2 * tangent_count(data.tangents)
    parameters = len(chain.matrix) - (0 if data.free else 1)
    if parameters * _VALUES_A_PARAMETER > fitted or _off_along(data, chain, cost):
        return math.inf
    variance = data.variance if data.variance > 0.0 else max(cost / values, 1e-280)
    return values * math.log(variance) + cost / variance + parameters * math.log(fitted)


def _off_along(data: Data, chain: Chain, across: float) -> bool:
    """Whether points are far off their stations though near the chain, as where a route turns back."""
    lost = chain.cost - across > _FAR_ALONG**2 * float(data.weight.sum()) * data.spacing**2
    return not data.free and lost and chain.cost > _OFF_ALONG * across

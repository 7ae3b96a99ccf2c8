"""Weights of points and directions in a chain: 0 for outliers, and by their noise for directions."""

from __future__ import annotations

import numpy as np

from tssgeom import core
from tssgeom.arrays import Points, Vector
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_route import OUTLIERS, PASSES
from tssgeom.route.arcs.chain import (
    Chain,
    Data,
    WeightedTangents,
    along,
    fit_fixed_pieces,
    noise_variance,
    squared_distances,
    value_count,
)
from tssgeom.route.arcs.moves import Budget, fit_chain
from tssgeom.route.directions import tangent_variances
from tssgeom.route.outliers import outlier_limit

_SAME_NOISE = 0.1  # relative change of the noise variance for which directions keep their weights


def outlier_weights(data: Data, chain: Chain, variance: float = 0.0) -> Vector | None:
    """Weight of each point by its distance across the chain, or None where no weight changes.

    Parameters
    ----------
    data, chain
        Points and the chain that was fitted to those with weight.
    variance
        Least noise variance that is assumed where `data` has none [m²].
    """
    known = (data.weight, data.free, data.variance, data.spacing)
    differ, weight = core.outlier_weights(chain.square, *known, variance)
    return weight if differ else None


def without_outliers(data: Data, chain: Chain) -> tuple[Data, Chain]:
    """Weight the points by the chain and fit it again, until no weight changes."""
    budget = Budget(data)
    for _ in range(PASSES.most):
        weight = outlier_weights(data, chain)
        if weight is None:
            break
        data = data._replace(weight=weight)
        chain = fit_chain(data, fit_fixed_pieces(data, chain), budget)
    return data, chain


def with_tangents(
    data: Data, tangents: Points | None, sensor_variance: float, kappa: Vector, variance: float
) -> Data:
    """Add sensed directions, weighted against points of the given noise variance; docs/model.md (94).

    Parameters
    ----------
    data
        The points.
    tangents, sensor_variance
        Directions, rows of NaN where none is used [n, 3], and the variance of a component [rad²].
    kappa
        Curvature at the points, as far as it is known [n] [1/m].
    variance
        Noise variance of a coordinate, where `data` has none [m²].
    """
    if tangents is None:
        return data
    least = data.variance or max(variance, (ROUNDING.relative * data.spacing) ** 2)
    slid = kappa**2 * least if data.free else np.zeros(len(tangents))
    return _weighted(data, np.nan_to_num(tangents), tangent_variances(tangents, sensor_variance, slid), least)


def _weighted(data: Data, unit: Points, tangent_variance: Vector, variance: float) -> Data:
    used = tangent_variance > 0.0
    weight = np.where(used, variance / np.where(used, tangent_variance, 1.0), 0.0)
    return data._replace(tangents=WeightedTangents(unit, weight, tangent_variance))


def curvature_at_points(chain: Chain) -> Vector:
    """Curvature of the chain at the stations of its points [n] [1/m]."""
    piece = np.searchsorted(chain.joints[1:], chain.stations, side="right")
    return np.linalg.norm(chain.bend, axis=1)[piece]


def squared_tangent_residuals(data: Data, chain: Chain) -> Vector:
    """Squared residuals of the directions across the chain, 0 where none is used [n] [rad²]."""
    if data.tangents is None:
        return np.zeros(0)
    _, fitted, _ = along(chain.stations, chain.form)
    cosine = np.einsum("ij,ij->i", data.tangents.unit, fitted)
    square = np.where(cosine > 0.0, np.maximum(1.0 - cosine * cosine, 0.0), 4.0)
    return np.where(data.tangents.variance > 0.0, square, 0.0)


def refitted_with_tangents(data: Data, chain: Chain, budget: Budget) -> tuple[Data, Chain]:
    """Fit again without outlying directions, and with weights that follow the noise of the points."""
    if data.tangents is None:
        return data, chain
    for _ in range(PASSES.most):
        changed = _weighted_by_noise(without_outlying_tangents(data, chain), chain)
        if changed is data:
            break
        data = changed
        chain = fit_chain(data, fit_fixed_pieces(data, chain), budget)
    return data, chain


def without_outlying_tangents(data: Data, chain: Chain) -> Data:
    """Leave out directions that the chain does not explain."""
    tangents, count = data.tangents, data.fitted_directions
    if tangents is None or not count:
        return data
    variance = _variance_in_weights(tangents)
    limit = outlier_limit(max(count, 2), 1.0)  # docs/model.md (29)
    if not data.variance:
        limit *= max(noise_variance(data, chain) / variance, 1.0)
    outlier = squared_tangent_residuals(data, chain) > limit * tangents.variance
    if not outlier.any() or np.count_nonzero(outlier) > max(OUTLIERS.share * count, 1.0):
        return data
    return _weighted(data, tangents.unit, np.where(outlier, 0.0, tangents.variance), variance)


def _weighted_by_noise(data: Data, chain: Chain) -> Data:
    """Weight directions by the noise variance of the points alone, where it is not known."""
    tangents, count = data.tangents, data.fitted_directions
    if tangents is None or data.variance or not count:
        return data
    square = squared_distances(data, chain, across=data.free)
    values = value_count(data)
    points = values - 2 * count
    freedom = max(points * (1.0 - len(chain.matrix) / values), 1.0)
    variance = max(float(data.weight @ square) / freedom, (ROUNDING.relative * data.spacing) ** 2)
    if abs(variance / _variance_in_weights(tangents) - 1.0) < _SAME_NOISE:
        return data
    return _weighted(data, tangents.unit, tangents.variance, variance)


def _variance_in_weights(tangents: WeightedTangents) -> float:
    """Noise variance of the points against which directions are weighted [m²]."""
    return float(np.max(tangents.weight * tangents.variance))

"""Weights of points and directions in a chain: 0 for outliers, and by their noise for directions."""

from __future__ import annotations

import numpy as np
from numba import njit

from tssgeom.arrays import Points, Vector
from tssgeom.route.arcs.chain import (
    Chain,
    Data,
    WeightedTangents,
    noise_variance,
    tangent_count,
    value_count,
)
from tssgeom.route.arcs.fit import fit_fixed_pieces
from tssgeom.route.arcs.moves import fit_chain
from tssgeom.route.arcs.positions import along, squared_distances
from tssgeom.route.directions import tangent_variances
from tssgeom.route.outliers import LIMITS, outlier_limit, residual_variance
from tssgeom.statistics import MEDIANS

_SAME_NOISE = 0.1  # relative change of the noise variance for which directions keep their weights
_ROUNDING = 1e-9  # of the mean spacing


def outlier_weights(data: Data, chain: Chain, variance: float = 0.0) -> Vector | None:
    """Weight of each point by its distance across the chain, or None where no weight changes.

    Parameters
    ----------
    data, chain
        Points and the chain that was fitted to those with weight.
    variance
        Least noise variance that is assumed where `data` knows none [m²].
    """
    square, count = chain.square, len(chain.square)
    known = data.variance or variance
    limit = outlier_limit(count, residual_variance(known, 0.0, data.spacing))
    if not _any_changes(square, data.weight, limit):
        return None
    if not data.variance:
        robust = float(np.median(square)) / (MEDIANS.square_2 if data.free else MEDIANS.square_3)
        limit = outlier_limit(count, residual_variance(known, robust, data.spacing))
    weight = np.where(square > limit, 0.0, 1.0)
    few = np.count_nonzero(weight == 0.0) <= LIMITS.share * len(weight)
    return weight if few and not np.array_equal(weight, data.weight) else None


@njit(cache=True, nogil=True)
def _any_changes(square: np.ndarray, weight: np.ndarray, limit: float) -> bool:
    """Whether any point is beyond the limit or has no weight."""
    off = False
    for i in range(len(square)):
        off |= not square[i] <= limit or weight[i] == 0.0
    return off


def without_outliers(data: Data, chain: Chain) -> tuple[Data, Chain]:
    """Weight the points by the chain and fit it again, until no weight changes."""
    for _ in range(LIMITS.chain_rounds):
        weight = outlier_weights(data, chain)
        if weight is None:
            break
        data = data._replace(weight=weight)
        chain = fit_chain(data, fit_fixed_pieces(data, chain))
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
        Noise variance of a coordinate, where `data` knows none [m²].
    """
    if tangents is None:
        return data
    least = data.variance or max(variance, (_ROUNDING * data.spacing) ** 2)
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
    _, fitted, _ = along(chain.stations, *chain[:4])
    cosine = np.einsum("ij,ij->i", data.tangents.unit, fitted)
    square = np.where(cosine > 0.0, np.maximum(1.0 - cosine * cosine, 0.0), LIMITS.backwards)
    return np.where(data.tangents.variance > 0.0, square, 0.0)


def refitted_with_tangents(data: Data, chain: Chain) -> tuple[Data, Chain]:
    """Fit again without outlying directions, and with weights that follow the noise of the points."""
    if data.tangents is None:
        return data, chain
    for _ in range(LIMITS.chain_rounds_of_tangents):
        changed = _weighted_by_noise(without_outlying_tangents(data, chain), chain)
        if changed is data:
            break
        data = changed
        chain = fit_chain(data, fit_fixed_pieces(data, chain))
    return data, chain


def without_outlying_tangents(data: Data, chain: Chain) -> Data:
    """Leave out directions that the chain does not explain."""
    tangents, count = data.tangents, tangent_count(data.tangents)
    if tangents is None or not count:
        return data
    variance = _variance_in_weights(tangents)
    limit = outlier_limit(max(count, 2), 1.0)
    if not data.variance:
        limit *= max(noise_variance(data, chain) / variance, 1.0)
    outlier = squared_tangent_residuals(data, chain) > limit * tangents.variance
    if not outlier.any() or np.count_nonzero(outlier) > max(LIMITS.share * count, 1.0):
        return data
    return _weighted(data, tangents.unit, np.where(outlier, 0.0, tangents.variance), variance)


def _weighted_by_noise(data: Data, chain: Chain) -> Data:
    """Weight directions by the noise variance of the points alone, where it is not known."""
    tangents, count = data.tangents, tangent_count(data.tangents)
    if tangents is None or data.variance or not count:
        return data
    square = squared_distances(data.points, chain.stations, *chain[:4], data.free)
    values = value_count(data)
    points = values - 2 * count
    freedom = max(points * (1.0 - len(chain.matrix) / values), 1.0)
    variance = max(float(data.weight @ square) / freedom, (_ROUNDING * data.spacing) ** 2)
    if abs(variance / _variance_in_weights(tangents) - 1.0) < _SAME_NOISE:
        return data
    return _weighted(data, tangents.unit, tangents.variance, variance)


def _variance_in_weights(tangents: WeightedTangents) -> float:
    """Noise variance of the points against which directions are weighted [m²]."""
    return float(np.max(tangents.weight * tangents.variance))

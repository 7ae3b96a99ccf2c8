"""When a sensed point or direction is an outlier: one limit for every estimator; docs/model.md (29)."""

from __future__ import annotations

import math

from tssgeom.core.constants_route import OUTLIERS


def outlier_limit(count: int, variance: float) -> float:
    """Return the square beyond which a residual of this variance, one of `count`, is an outlier; (29)."""
    return (OUTLIERS.square + OUTLIERS.square_per_log_count * math.log(count)) * variance


def residual_variance(known: float, robust: float, spacing: float) -> float:
    """Return the variance by which residuals are judged: the greatest of three; docs/model.md (29).

    Parameters
    ----------
    known
        Noise variance of a coordinate, 0 where unknown.
    robust
        The same from the median of the residuals, 0 where it does not count.
    spacing
        Mean spacing of the points, of which a small part is always allowed.
    """
    return max(robust, known, (OUTLIERS.floor * spacing) ** 2)

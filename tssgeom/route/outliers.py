"""When a sensed point or direction is an outlier: one limit for every estimator; docs/model.md (29)."""

from __future__ import annotations

import math

from tssgeom.core.constants_route import OUTLIERS


def outlier_limit(count: int, variance: float) -> float:
    """Return the square beyond which a residual of this variance, one of `count`, is an outlier; (29)."""
    return (OUTLIERS.square + 2.0 * math.log(count)) * variance

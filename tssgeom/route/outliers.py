"""When a sensed point or direction is an outlier: one limit for every estimator; docs/model.md (29)."""

from __future__ import annotations

import math

from tssgeom.core.constants import CHANCE


def outlier_limit(count: int, variance: float) -> float:
    """Return the square beyond which a residual of this variance, one of `count`, is an outlier; (29).

    Pure noise of two components takes one of `count` for one with a chance of e^-8 = 0.03 %, whatever it is.
    """
    return (CHANCE.rare**2 + 2.0 * math.log(count)) * variance

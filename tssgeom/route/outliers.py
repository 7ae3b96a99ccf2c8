"""When a sensed point or direction is an outlier: one limit for every estimator, and its reasons."""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit


class OutlierLimits(NamedTuple):
    """Limits on residuals. Squares are in variances of the noise, lengths in spacings of the points."""

    square: float = 16.0
    """Squared residual of one value of many [1]. Derived: with 2 ln n added, pure noise of two components
    takes one of n values for an outlier with a chance of e^-8 = 0.03 %, whatever n is."""
    square_per_log_count: float = 2.0
    """What each unit of ln n adds to it [1]; derived: as above."""
    floor: float = 1e-4
    """Noise that every residual is allowed [spacing]: below some five times this none is an outlier, however
    exact the other points; chosen."""
    share: float = 0.1
    """Most outliers of all values; where there are more, the fit is wrong [1]; chosen."""

    bend_share: float = 0.3
    """Residual over κh² that a jump of curvature alone gives a point of a smooth curve [1]; chosen."""
    bend_share_at_end: float = 2.0
    """The same at the first and last point, which have neighbours on one side only [1]; chosen."""
    bend_share_next_to_end: float = 1.0
    """The same one point farther in [1]; chosen."""
    sharpest: float = 1.0
    """Greatest turn from point to point in this test [rad]; chosen: a sharper one comes from an outlier."""
    neighbours: int = 3
    """Points on either side among which only the worst becomes an outlier at once [1]; chosen."""
    turn_share: float = 0.5
    """Residual of a direction over the turn from point to point that a jump of curvature alone gives [1];
    chosen."""
    least_own: float = 1e-3
    """Least share of the variance of a direction that the rest of the fit leaves to it [1]; chosen."""
    backwards: float = 4.0
    """Squared residual of a direction that points against the route [rad²]; derived: (2 sin(π/2))²."""

    run_at_end: int = 4
    """Outliers side by side at an end, beyond which they are the end [1]; chosen."""
    run_within: int = 8
    """Outliers side by side between two points that are none, beyond which they are the route [1]; chosen."""
    run_share: float = 0.1
    """The same as a share of all points, where that is more [1]; chosen."""

    spline_rounds: int = 8
    """Most fits of a spline without its outliers [1]; chosen."""
    chain_rounds: int = 4
    """The same of a chain [1]; chosen."""
    chain_rounds_of_tangents: int = 3
    """The same for the directions beside a chain [1]; chosen."""


LIMITS = OutlierLimits()


@njit(cache=True, nogil=True)
def outlier_limit(count: int, variance: float) -> float:
    """Return the square beyond which a residual of this variance, one of `count`, is an outlier."""
    return (LIMITS.square + LIMITS.square_per_log_count * math.log(count)) * variance


@njit(cache=True, nogil=True)
def residual_variance(known: float, robust: float, spacing: float) -> float:
    """Return the variance by which residuals are judged: the greatest of three.

    Parameters
    ----------
    known
        Noise variance of a coordinate, 0 where unknown.
    robust
        The same from the median of the residuals, 0 where it does not count.
    spacing
        Mean spacing of the points, of which a small part is always allowed.
    """
    return max(robust, known, (LIMITS.floor * spacing) ** 2)

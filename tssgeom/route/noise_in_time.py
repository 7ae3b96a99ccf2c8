"""The noise of points that are filtered in time: what is left of a stated one, and what a fit may find."""

from __future__ import annotations

import math

from tssgeom.core.constants import ROUNDING
from tssgeom.route.time_filter import FILTER, PointFilter


def noise_left(now: PointFilter, stated: float | None) -> float | None:
    """Return the noise of filtered points [m] where that of a sensor is stated [m]; None where it is not.

    What is stated beyond what changes in time is the same in every frame, and stays; docs/model.md (159).
    """
    if stated is None:
        return None
    constant = stated**2 - now.sensed_noise**2
    if constant < FILTER.constant_share * stated**2:
        constant = 0.0
    return math.sqrt(constant + now.noise**2)


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

"""Noise that few points show across the plane in which they lie; docs/model.md (256), (257)."""

from __future__ import annotations

import math

import numpy as np

from tssgeom.core.constants import CHANCE
from tssgeom.route.observations import NOISE_PRIOR, Shape
from tssgeom.route.resolution import LIMITS
from tssgeom.route.route import step_lengths
from tssgeom.route.route_fit import RouteFit

_STEPS = 200  # noises that are compared, 1.05 to 1.1 apart


def noise_of_plane(shape: Shape, fit: RouteFit) -> float | None:
    """Return the noise [m] of few points that lie in a plane too exactly for that of a fit, else None.

    White noise is the same in each direction. What lies in the plane is then bends, not noise. Points
    that lie in it exactly were not sensed across it, and show nothing.

    Parameters
    ----------
    shape
        Validated points, whose noise is not known.
    fit
        Fit by a noise that was estimated.
    """
    points = shape.points[fit.weight > 0.0]
    free = len(points) - 3
    shared = fit.spline is not None and fit.spline.shared_angle_error > 0.0
    if not shape.is_of_few or shape.directions is not None or shared or free < 1:
        return None
    length = float(np.sum(step_lengths(points)))
    square = float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1]) ** 2
    share = square / (free * max(fit.noise, 1e-300) ** 2)
    if square <= free * (LIMITS.noiseless * length) ** 2 or share >= 1.0:
        return None
    if free * (share - 1.0 - math.log(share)) <= CHANCE.clear**2:
        return None
    noise = np.geomspace(LIMITS.noiseless * length, fit.noise, _STEPS)
    decades = np.log10(noise / (NOISE_PRIOR.typical * length)) / NOISE_PRIOR.decades
    return float(noise[np.argmin(2.0 * free * np.log(noise) + square / noise**2 + decades**2)])

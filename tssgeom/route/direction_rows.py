"""Sensed directions beside few points, in the noise of these; docs/model.md (330)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Points, Vector
from tssgeom.core.constants import ROUNDING
from tssgeom.route.directions import tangent_variances
from tssgeom.route.route_fit import RouteFit


class DirectionRows(NamedTuple):
    """Sensed directions."""

    row: np.ndarray
    """Points that have one [k]."""
    unit: Points
    """Unit tangents [k, 3]."""
    weight: Vector
    """Noise of a coordinate, over the length of the fit, over that of a component [k] [1/rad]."""


def direction_rows(smooth: RouteFit, used: np.ndarray, noise: float) -> DirectionRows | None:
    """Return the directions that a smooth fit used, each of a noise of its components [rad].

    Parameters
    ----------
    smooth
        The fit; None is returned where it used no directions.
    used
        Which of its points count [n]; rows are those among them.
    noise
        Standard deviation of a component of a direction [rad].
    """
    unit = None if smooth.spline is None else smooth.spline.memory.tangents
    if unit is None:
        return None
    route, length = smooth.route, float(smooth.route.s[-1])
    kappa = np.interp(route.station, route.s, np.linalg.norm(route.curvature_vector, axis=1))
    least = max(route.noise, ROUNDING.relative * length)
    variance = tangent_variances(unit, noise**2, (kappa * least) ** 2)[used]
    row = np.flatnonzero(variance > 0.0)
    return DirectionRows(row, unit[used][row], least / length / np.sqrt(variance[row]))

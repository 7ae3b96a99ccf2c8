"""A fitted route: what everyone who asks for places along it needs, whichever estimator found it."""

from __future__ import annotations

from dataclasses import dataclass

from tssgeom.arrays import Points, Vector


@dataclass(frozen=True, slots=True)
class Route:
    """A route on nodes along its arc length, and how the sensed points lie about it."""

    s: Vector
    """Arc length at the nodes, from 0 [m]."""
    position: Points
    """Places of the nodes [m]."""
    tangent: Points
    """Unit tangents [1]."""
    curvature_vector: Points
    """Change of the unit tangent with arc length, normal to it [1/m]."""
    noise: float
    """Standard deviation of one coordinate of the points, known or estimated [m]."""
    weight: Vector
    """Weight of each sensed point: 1, or 0 for an outlier."""
    station: Vector
    """Arc length of the foot of each sensed point [m]."""
    residual: Points
    """Sensed point less its foot [m]."""
    warnings: tuple[str, ...] = ()

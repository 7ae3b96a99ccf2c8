"""A route and its curvature on nodes, as estimators write them out."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tssgeom.arrays import Vector
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.route import Route


@dataclass(frozen=True, slots=True)
class Outline:
    """A route and its curvature, written out."""

    route: Route
    profile: CurvatureProfile

    @property
    def noise(self) -> float:
        """Standard deviation of a coordinate of the points [m]."""
        return self.route.noise

    @property
    def weight(self) -> Vector:
        """Weight of each point; 0 where it was ignored [1]."""
        return self.route.weight

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is to be said of the fit."""
        return self.route.warnings

    def doubted(self, variance: float) -> Outline:
        """Add a variance of Φ [rad²]."""
        return replace(self, profile=self.profile.doubted(variance))

    def warned(self, text: str) -> Outline:
        """Add a warning."""
        return replace(self, route=replace(self.route, warnings=(*self.warnings, text)))

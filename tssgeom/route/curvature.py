"""Curvature and accumulated curve angle of a fitted route, with standard errors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Vector, read_only
from tssgeom.result import Result


@dataclass(frozen=True, slots=True, repr=False)
class CurvatureProfile(Result):
    """Curvature along a route, on its nodes."""

    s: Vector
    """Arc length [m]."""
    kappa: Vector
    """Curvature, freed of the bias that noise gives to a magnitude [1/m]."""
    phi: Vector
    """Accumulated curve angle [rad]."""
    kappa_se: Vector
    """Standard error of the curvature [1/m]."""
    phi_se: Vector
    """Standard error of the accumulated curve angle [rad]."""

    @property
    def length(self) -> float:
        """Length of the route [m]."""
        return float(self.s[-1])

    @property
    def total_angle(self) -> float:
        """Accumulated curve angle of the whole route, Φ [rad]."""
        return float(self.phi[-1])

    @property
    def total_angle_se(self) -> float:
        """Standard error of Φ [rad]."""
        return float(self.phi_se[-1])

    def with_angle_variance(self, variance: float) -> CurvatureProfile:
        """Add a variance of Φ [rad²], spread as the angle is, and as the length where there is none."""
        spread = self.phi if self.total_angle > 0.0 else self.s
        share = spread / max(float(spread[-1]), 1e-300)
        return replace(self, phi_se=read_only(np.sqrt(self.phi_se**2 + variance * share**2)))

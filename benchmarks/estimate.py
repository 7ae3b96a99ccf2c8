"""What every estimator is shown, and what it answers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.elongation import RIG, TENSION_IN, first_pull
from tssgeom.arrays import Points, Vector
from tssgeom.route.geometry import Method, measure
from tssgeom.route.observations import clean
from tssgeom.tendon.capstan import pretensioned, step
from tssgeom.tendon.transmission import of_corners as transmit


@dataclass(frozen=True, slots=True)
class Sighting:
    """Points as an estimator gets them."""

    points: Points
    """A row of NaN was not seen [m]."""
    stations: Vector | None
    """Arc length at each point, where the sensor tells it [m]."""
    noise: float | None
    """Standard deviation of each coordinate, where the sensor's is known [m]."""
    true_noise: float
    """The same in truth, for peers that cannot do without it [m]."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Geometry as one estimator sees it; a standard error it does not give is NaN, a count 0."""

    s: Vector
    """Arc length from the proximal end [m]."""
    phi: Vector
    """Accumulated curve angle there [rad]."""
    elongation: float
    """On the first pull to 15 N [m]."""
    angle_se: float = math.nan
    """Standard error of Φ [rad]."""
    elongation_se: float = math.nan
    """Standard error of the elongation from geometry [m]."""
    pieces: int = 0
    """Number of pieces of constant curvature."""

    @classmethod
    def of_profile(cls, s: Vector, phi: Vector) -> Estimate:
        """Answer of an estimator that gives the accumulated angle `phi` [rad] at `s` [m] and no more."""
        return cls(s, phi, first_pull(np.diff(s), np.diff(phi)))

    @property
    def total_angle(self) -> float:
        """Accumulated curve angle of the whole route, Φ [rad]."""
        return float(self.phi[-1])


def ours(method: Method, sighting: Sighting) -> Estimate:
    """Answer of this project, with its error bars."""
    found = measure(clean(sighting.points, sighting.stations), sighting.noise, method)
    pulled = step(pretensioned(RIG), TENSION_IN, RIG.friction.coefficient)
    moved = transmit(pulled, found.arcs, RIG)
    return Estimate(
        s=found.profile.s,
        phi=found.profile.phi,
        elongation=moved.elongation,
        angle_se=found.arcs.total_angle_se,
        elongation_se=moved.elongation_se,
        pieces=len(found.arcs.length),
    )


OURS: dict[str, Callable[[Sighting], Estimate]] = {
    "spline": partial(ours, "spline"),
    "arcs": partial(ours, "arcs"),
    "auto": partial(ours, "auto"),
}

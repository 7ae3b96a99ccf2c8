"""From a shape to everything the tendon asks of it: route, curvature profile and pieces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from tssgeom.shape.arcs import Arcs, constant_curvature_pieces
from tssgeom.shape.curvature import CurvatureProfile, curvature_profile
from tssgeom.shape.points import Shape
from tssgeom.shape.spline import Route, fit

Method = Literal["auto", "spline", "arcs"]


@dataclass(frozen=True, slots=True)
class Geometry:
    """What was found out about one route."""

    route: Route
    profile: CurvatureProfile
    arcs: Arcs


def measure(shape: Shape, noise: float | None = None, method: Method = "auto") -> Geometry:
    """Fit a route to a shape and cut it into pieces.

    Parameters
    ----------
    shape
        Validated points.
    noise
        Known standard deviation of each coordinate [m]; estimated where left out.
    method
        Estimator: the spline, the chain of arcs, or the one that the points speak for.

    Raises
    ------
    FitError
        Where the points give no finite curve.
    """
    route = fit(shape, noise)
    profile = curvature_profile(route)
    return Geometry(route, profile, constant_curvature_pieces(route, profile))

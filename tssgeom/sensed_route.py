"""The route of one frame, fitted and at its resolution, as a tendon needs it."""

from __future__ import annotations

from typing import NamedTuple

from tssgeom.frame import Frame, fit_frame, with_shared_errors_of
from tssgeom.rig import Rig
from tssgeom.route.observations import Shape
from tssgeom.route.resolution import SharedErrors
from tssgeom.route.route_fit import RouteFit
from tssgeom.route.time_filter import PointFilter
from tssgeom.route.tracking import TrackedFit


class SensedRoute(NamedTuple):
    """The route of a frame, as a tendon needs it."""

    shape: Shape
    tracked: TrackedFit
    fit: RouteFit
    """The fit at its resolution."""
    shared: SharedErrors
    """Errors beside its own, which other frames have too."""


def sensed_route(
    frame: Frame, rig: Rig, last: TrackedFit | None = None, points: PointFilter | None = None
) -> SensedRoute:
    """Fit the route of a frame, from that of the `last` one; no tendon is needed, and none is moved.

    Raises
    ------
    ShapeError
        Where the points cannot be a route.
    FitError
        Where they give no finite curve.
    """
    shape, tracked = fit_frame(frame, rig, last, points)
    return SensedRoute(shape, tracked, *with_shared_errors_of(frame, rig, tracked))

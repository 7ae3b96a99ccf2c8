"""One shape in, its route, tension and elongation out: the engine of the stream for a single frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tssgeom.arrays import Points, Vector, read_only
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.route.synthetic import chain, helix, positions
from tssgeom.sensed_route import SensedRoute, fit_frame, sensed_route
from tssgeom.stream import Frame, FrameResult, at_rest, pulled

if TYPE_CHECKING:
    from tssgeom.route.repeated import Repeated
    from tssgeom.tendon.commander import Commander

_A_RADIAN, _LEAST = 20, 60
"""Points of an even bend a radian, and the least number of them; chosen: a spline follows it to 1e-7 rad."""
_RISE = 0.1
"""Slope of the helix of an even bend of more than a whole turn [1]; chosen: its turns lie side by side."""


def analyse(
    points: Points | Frame,
    rig: Rig | None = None,
    *,
    tension_in: float = 15.0,
    stations: Vector | None = None,
    commander: Commander | None = None,
) -> FrameResult:
    """Fit the route of one shape and pull its tendon for the first time; as `tssgeom.analyse`, without files.

    A `commander` holds the tendon as it may be, where numbers of the rig have errors.

    Raises
    ------
    ShapeError
        Where the points cannot be a route.
    SettingsError
        Where the tension is negative or not finite.
    FitError
        Where the points give no finite curve.
    """
    if isinstance(points, Frame):
        frame = points
    else:
        frame = Frame(read_only(np.array(points, dtype=np.float64)), stations=stations)
    chosen = Rig() if rig is None else rig
    return pulled(0, frame, at_rest(chosen), chosen, tension_in, sensed_route(frame, chosen), commander)


def even_bend(arcs: Arcs) -> FrameResult:
    """Return a route of one piece that nobody sensed, on a circle, or on a helix where it turns further.

    The tendon in it is at rest; its curve angle is known without error.
    """
    length, angle = arcs.total_length, arcs.total_angle
    s = np.linspace(0.0, length, max(_LEAST, int(_A_RADIAN * angle)))
    if angle <= 2.0 * np.pi:
        points = positions(chain(np.array([length]), np.array([angle / length])), s)
    else:
        across, radius = np.sqrt(1.0 - _RISE**2), length / angle
        points = helix(across**2 * radius, 2.0 * np.pi * _RISE * across * radius, s)
    result = analyse(Frame(read_only(points), length=length, source="markers"), tension_in=0.0)
    return replace(result, fit=replace(result.fit, arcs=arcs))


def analyse_same(
    frames: Sequence[Frame], rig: Rig | None = None, *, tension_in: float = 15.0
) -> tuple[FrameResult, Repeated]:
    """Estimate one route that was sensed several times, and pull its tendon for the first time.

    Parameters
    ----------
    frames
        Two or more shapes of the route from end to end, either way round, each in coordinates of its own;
        the drive is that of the first.
    rig, tension_in
        As in `analyse`.

    Returns
    -------
    tuple[FrameResult, Repeated]
        The result for the route, and how large and how long the errors of its shapes are.

    Raises
    ------
    ShapeError
        Where the points cannot be one route.
    SettingsError
        Where the tension is negative or not finite.
    FitError
        Where they give no finite curve.

    Notes
    -----
    Source: docs/model.md (165).

    Examples
    --------
    >>> import numpy as np
    >>> from tssgeom import Frame, analyse_same
    >>> angle = np.linspace(0.0, np.pi, 60)
    >>> exact = 0.5 / np.pi * np.column_stack((np.sin(angle), 1 - np.cos(angle), 0 * angle))
    >>> rng = np.random.default_rng(1)
    >>> frames = [Frame(exact + rng.normal(0.0, 2e-4, exact.shape)) for _ in range(3)]
    >>> result, repeated = analyse_same(frames)
    >>> abs(result.profile.total_angle - np.pi) < 0.05
    True
    """
    from tssgeom.route.repeated import common_route  # here: one shape needs no scipy

    chosen = Rig() if rig is None else rig
    routes = [fit_frame(frame, chosen) for frame in frames]
    common = common_route([tracked.fit for _, tracked in routes])
    (shape, tracked), fit = routes[common.line], common.fit
    words = (
        f"{len(routes)} lines of one route: a coordinate of one errs by {1e3 * common.error:.3g} mm, alike "
        f"over {1e3 * common.error_length:.3g} mm"
    )
    shape = replace(shape, warnings=(*shape.warnings, words))
    sensed = SensedRoute(shape, tracked, fit, common.shared)
    frame = replace(frames[0], points=frames[common.line].points)
    return pulled(0, frame, at_rest(chosen), chosen, tension_in, sensed), common

"""Whether a route that was fitted to points still goes along them."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from tssgeom.arrays import Points, Vector
from tssgeom.errors import FitError
from tssgeom.route.pieces import Arcs
from tssgeom.route.route import Route
from tssgeom.route.stations import distance

_MOST_IGNORED = 1 / 3  # of the points
_LONGEST_WAY = 1.3  # from point to point over the length of a route, noise allowed for: chords are shorter
_OFF = 4.0  # noises, beside a spacing, that points are off their feet on the whole
_FOLDED = -0.5  # cosine between neighbouring tangents
_LONGEST_DETOUR = 2.0  # length of a route over the way from point to point: an arc of 3.8 rad over its chord
_MOST_BETWEEN = 4.0  # turn between neighbouring points, more than straight back, that no point tells [rad]
_LEAST_KNOWN = 20 * math.pi  # standard error of Φ beyond which the fit is no route at all [rad]


def is_folded(route: Route) -> bool:
    """Whether a route turns straight back between two nodes, which its curvature does not tell.

    It may also go straight on there and lose the points, which then are far from their feet along the route.
    """
    tangent = route.tangent
    if np.einsum("ij,ij->i", tangent[1:], tangent[:-1]).min() < _FOLDED:
        return True
    off = route.residual[route.weight > 0.0]
    spacing = route.s[-1] / len(route.weight)
    return bool(np.vdot(off, off) > len(off) * (spacing**2 + (_OFF * route.noise) ** 2))


def refuse_folded(route: Route) -> None:
    """Refuse a route that turns straight back between two nodes.

    Raises
    ------
    FitError
        Where it does.
    """
    if is_folded(route):
        raise FitError("the route turns straight back between two points: sense it more densely there")


def refuse_lost(points: Points, weight: Vector, noise: float, arcs: Arcs) -> None:
    """Refuse a fit that lost its points on the way, as where a route turns back between two of them.

    Parameters
    ----------
    points, weight
        Sensed points [m], and the weight of each; 0 where it was ignored [1].
    noise
        Standard deviation of a coordinate [m].
    arcs
        The route that was fitted.

    Raises
    ------
    FitError
        Where a number is not finite, a piece has no length, the angle is unknown, many points were ignored,
        or the way from point to point is longer than the route, or far shorter.
    """
    finite = math.isfinite(arcs.total_length + arcs.total_angle + arcs.covariance.sum())
    if not finite or arcs.length.min() <= 0.0:
        raise FitError("the points give no finite curve: check the unit and look for stray points")
    ignored, way = _followed(points, weight)
    chord = math.hypot(arcs.total_length / len(points), math.sqrt(6.0) * noise)
    lost = ignored > _MOST_IGNORED * len(points) or way > _LONGEST_WAY * len(points) * chord
    if lost or arcs.total_length > _LONGEST_DETOUR * way:
        raise FitError(
            f"no route fits the points, {ignored} of {len(points)} lie off it: sense it more densely where "
            "it turns sharply, and look for points out of order"
        )
    if arcs.total_angle_se > _LEAST_KNOWN:
        raise FitError(
            f"{len(points)} points do not tell how far the route turns: sense it more densely where it turns "
            "sharply, and look for points out of order"
        )


def winds(points: Points, weight: Vector, stations: Vector, turned: Vector) -> bool:
    """Whether a route winds out of sight between its points.

    Parameters
    ----------
    points, weight
        Sensed points [m], and the weight of each; 0 where it was ignored [1].
    stations, turned
        Arc length [m] and accumulated angle [rad] of the route at the points.
    """
    length = stations[-1] - stations[0]
    detour = length > _LONGEST_DETOUR * _followed(points, weight)[1]
    return bool(detour or np.diff(turned[weight > 0.0]).max() > _MOST_BETWEEN)


@njit(cache=True, nogil=True)
def _followed(points: np.ndarray, weight: np.ndarray) -> tuple[int, float]:
    """Return how many points were ignored, and the way from point to point of the others [m]."""
    ignored, way, last = 0, 0.0, -1
    for i in range(len(points)):
        if weight[i] <= 0.0:
            ignored += 1
            continue
        if last >= 0:
            way += distance(points[i], points[last])
        last = i
    return ignored, way

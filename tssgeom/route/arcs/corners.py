"""A first chain for a route with kinks: straight pieces between corners, which no smooth curve leads to."""

from __future__ import annotations

import math

import numpy as np

from tssgeom.arrays import Points
from tssgeom.route.arcs.fit import KINK, Chain, Data
from tssgeom.route.pieces import normals
from tssgeom.route.route import Route

_OFF = 5.0  # standard deviations of a coordinate that a point may lie off the line between two corners
_CUT = 0.5  # spacings that a corner between two points may lie off the line through both
_FEWEST = 3  # spacings of a straight piece
_ONE = 3  # points on which a corner may be found twice


def cornered(data: Data, route: Route) -> tuple[Data, Chain] | None:
    """Return straight pieces with a short arc at each corner, or None where no corners stand clear.

    Parameters
    ----------
    data
        The points.
    route
        A smooth fit to them, which knows noise and stations.

    Returns
    -------
    data, chain
        The points, all of weight 1 since a smooth curve takes corners for outliers, and the chain.

    Notes
    -----
    Corners are found by cutting the line through both ends at the point farthest off, again and again
    (Ramer, 1972; Douglas and Peucker, 1973).
    """
    points = data.points
    at = _once(np.array(_corners(points, max(_OFF * route.noise, _CUT * data.gap))))
    if len(at) < 3 or np.min(np.diff(at)) < _FEWEST:
        return None
    leg = np.diff(points[at], axis=0)
    size = np.linalg.norm(leg, axis=1)
    leg /= size[:, None]
    stations = _along(points, at, leg, size) if data.free else np.array(route.station)
    data = data._replace(weight=np.ones(len(points)), gap=float(stations[-1]) / len(points), shortest=KINK)
    axes = np.array([leg[0], *normals(leg[0])])
    frame, half = axes, 0.5 * data.gap
    joints, bend = [0.0], [np.zeros(2)]
    for k in range(1, len(leg)):
        turn, frame = _turned(frame, leg[k])
        joints += [stations[at[k]] - half, stations[at[k]] + half]
        bend += [turn / data.gap, np.zeros(2)]
    return data, Chain(
        start=np.array(points[0]),
        axes=axes,
        joints=np.array(joints),
        bend=np.array(bend),
        curved=np.ones(len(bend), dtype=np.bool_),
        stations=stations,
        matrix=np.zeros((0, 0)),
        cost=0.0,
        square=np.zeros(0),
    )


def _along(points: Points, at: np.ndarray, leg: Points, size: np.ndarray) -> np.ndarray:
    """Return the stations of points at their feet on the lines between corners."""
    piece = np.clip(np.searchsorted(at, np.arange(len(points)), side="right") - 1, 0, len(leg) - 1)
    foot = np.einsum("ij,ij->i", points - points[at[piece]], leg[piece])
    return np.append(0.0, np.cumsum(size))[piece] + np.clip(foot, 0.0, size[piece])


def _corners(points: Points, off: float) -> list[int]:
    """Return, in order, the points between which straight lines pass all others within a distance."""
    kept, waiting = {0, len(points) - 1}, [(0, len(points) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        chord = points[last] - points[first]
        off_first = points[first + 1 : last] - points[first]
        size = float(chord @ chord)
        share = np.clip(off_first @ chord / size, 0.0, 1.0) if size > 0.0 else np.zeros(len(off_first))
        square = np.sum((off_first - share[:, None] * chord) ** 2, axis=1)
        worst = int(np.argmax(square))
        if square[worst] > off * off:
            kept.add(first + 1 + worst)
            waiting += [(first, first + 1 + worst), (first + 1 + worst, last)]
    return sorted(kept)


def _once(at: np.ndarray) -> np.ndarray:
    """Return indices with neighbours that are one corner made one; both ends stay."""
    cut = np.flatnonzero(np.diff(at[1:-1]) > _ONE) + 1
    inner = [round(float(np.mean(group))) for group in np.split(at[1:-1], cut) if len(group)]
    return np.array([at[0], *inner, at[-1]])


def _turned(frame: np.ndarray, tangent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return by what turn [2] [rad] a frame comes to a new tangent without twist, and the frame then."""
    across = frame[1:] @ tangent
    sine, cosine = float(np.linalg.norm(across)), float(frame[0] @ tangent)
    share = across / sine if sine > 0.0 else np.array([1.0, 0.0])  # straight back: any way round
    ahead, way = frame[0].copy(), share @ frame[1:]
    turned = np.array(frame)
    for axis in turned:
        along, out = float(axis @ ahead), float(axis @ way)
        axis += (along * (cosine - 1.0) - out * sine) * ahead
        axis += (along * sine + out * (cosine - 1.0)) * way
    return share * math.atan2(sine, cosine), turned

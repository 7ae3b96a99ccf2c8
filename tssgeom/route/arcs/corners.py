"""A first chain for a route with kinks, which no smooth curve fits: straight pieces between corners."""

from __future__ import annotations

import math

import numpy as np

from tssgeom import core
from tssgeom.arrays import Points
from tssgeom.core.constants import CHANCE
from tssgeom.core.constants_arcs import CHAIN_FIT, CHAIN_MOVES, IDENTIFIABLE
from tssgeom.route.arcs.chain import Chain, Data, unfitted
from tssgeom.route.route import Route


def cornered(data: Data, route: Route) -> tuple[Data, Chain] | None:
    """Return straight pieces with a short arc at each corner, or None where there are no distinct corners.

    Parameters
    ----------
    data
        The points.
    route
        A smooth fit to them, with its noise and stations.

    Returns
    -------
    data, chain
        The points, all of weight 1 since a smooth curve takes corners for outliers, and the chain.

    Notes
    -----
    The line through both ends is cut at the point farthest off, again and again; the cuts are the corners
    (Ramer, 1972; Douglas and Peucker, 1973).
    """
    points = data.points
    off = max(CHANCE.never * route.noise, 0.5 * data.spacing)
    # all that a chain can have, and the points beside them, so that the work is linear in the points
    most = round(CHAIN_MOVES.most_pieces * IDENTIFIABLE.few_points)
    count, kept = core.corners(points, off, most)
    if count > most:
        return None
    at = _merged(np.flatnonzero(kept))
    few, many = len(at) < 3, 2 * len(at) - 3 > CHAIN_MOVES.most_pieces
    if few or many or np.min(np.diff(at)) < IDENTIFIABLE.few_points:
        return None
    leg = np.diff(points[at], axis=0)
    size = np.linalg.norm(leg, axis=1)
    leg /= size[:, None]
    stations = _along(points, at, leg, size) if data.free else np.array(route.station)
    data = data._replace(
        weight=np.ones(len(points)), spacing=float(stations[-1]) / len(points), shortest=CHAIN_FIT.kink
    )
    axes = np.array([leg[0], *core.normals(leg[0])])
    frame, half = axes, 0.5 * data.spacing
    joints, bend = [0.0], [np.zeros(2)]
    for k in range(1, len(leg)):
        turn, frame = _turned(frame, leg[k])
        joints += [stations[at[k]] - half, stations[at[k]] + half]
        bend += [turn / data.spacing, np.zeros(2)]
    return data, unfitted(points[0], axes, np.array(joints), np.array(bend), stations)


def _along(points: Points, at: np.ndarray, leg: Points, size: np.ndarray) -> np.ndarray:
    """Return the stations of points at their feet on the lines between corners."""
    piece = np.clip(np.searchsorted(at, np.arange(len(points)), side="right") - 1, 0, len(leg) - 1)
    foot = np.einsum("ij,ij->i", points - points[at[piece]], leg[piece])
    return np.append(0.0, np.cumsum(size))[piece] + np.clip(foot, 0.0, size[piece])


def _merged(at: np.ndarray) -> np.ndarray:
    """Return indices of corners, neighbouring ones merged; both ends stay."""
    cut = np.flatnonzero(np.diff(at[1:-1]) > IDENTIFIABLE.few_points) + 1
    inner = [round(float(np.mean(group))) for group in np.split(at[1:-1], cut) if len(group)]
    return np.array([at[0], *inner, at[-1]])


def _turned(frame: np.ndarray, tangent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return by what turn [2] [rad] a frame comes to a new tangent without twist, and the frame then."""
    across = frame[1:] @ tangent
    sine, cosine = float(np.linalg.norm(across)), float(frame[0] @ tangent)
    share = across / sine if sine > 0.0 else np.array([1.0, 0.0])  # straight back: any way round
    before, towards = frame[0].copy(), share @ frame[1:]
    turned = np.array(frame)
    for axis in turned:
        along, out = float(axis @ before), float(axis @ towards)
        axis += (along * (cosine - 1.0) - out * sine) * before
        axis += (along * sine + out * (cosine - 1.0)) * towards
    turned[0] = tangent
    for k in (1, 2):  # rounding would grow from turn to turn
        turned[k] -= turned[:k].T @ (turned[:k] @ turned[k])
        turned[k] /= np.linalg.norm(turned[k])
    return share * math.atan2(sine, cosine), turned

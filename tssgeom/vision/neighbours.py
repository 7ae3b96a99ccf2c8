"""Open matches decided by their neighbours: a sheath goes on from marker to marker; docs/model.md (137)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from tssgeom.arrays import Points
from tssgeom.vision.cameras import Camera
from tssgeom.vision.matching import Matches, clash
from tssgeom.vision.ordering import belonging, chained
from tssgeom.vision.views import Look

_REACH = 1.6  # of the spacing that images show
_UNSLANTED = 0.8  # quantile of the gaps in an image that a slanted view has not shortened much
_BOTH = 2  # neighbours that a marker has at most
_MISFIT, _ELSEWHERE = 0.35, 0.3  # spacings from where a marker should be: it is one, it is none
_CLEARLY = 2.5  # times farther off than the one that is taken
_GAP = 1.5  # spacings: a longer link has room for a marker


def reach_of(cameras: tuple[Camera, ...], looks: Sequence[Look], matches: Sequence[Matches]) -> float:
    """Return the distance within which the next marker lies [m].

    It follows from the angle between neighbours in the images, the widest of all, and the usual depth.
    """
    found = []
    for v, camera in enumerate(cameras):
        centres = [one.seen[v].centre for one in looks if len(one.seen[v]) > 1]
        gaps = [KDTree(pixels).query(pixels, 2)[0][:, 1] for pixels in centres]
        depths = [one.points[one.blobs[:, v] >= 0] @ camera.rotation[2] + camera.shift[2] for one in matches]
        if gaps and (depth := np.concatenate(depths)).size:
            found.append(
                float(np.quantile(np.concatenate(gaps), _UNSLANTED) / camera.matrix[0, 0] * np.median(depth))
            )
    return _REACH * max(found, default=0.0)


def settled(found: Matches, reach: float) -> np.ndarray:
    """Return which matches nothing speaks against, after those with fewer neighbours have given way.

    Of matches that share a blob the one that more cameras see counts, or else the one with more neighbours;
    of two with as many, neither does.

    Parameters
    ----------
    found
        Possible points.
    reach
        Distance within which a neighbour lies [m].
    """
    rivals = clash(found.blobs)
    near = (cdist(found.points, found.points) <= reach) & ~rivals & ~np.eye(len(rivals), dtype=np.bool_)
    views = (found.blobs >= 0).sum(axis=1)
    alive = np.ones(len(rivals), np.bool_)
    while True:
        support = np.minimum((near & alive[None]).sum(axis=1), _BOTH)
        rank = 10 * views + support
        beats = rivals & alive[:, None] & alive[None] & (rank[:, None] > rank[None])
        unbeaten = alive & ~beats.any(axis=0)
        beaten = alive & (beats & unbeaten[:, None]).any(axis=0)
        if not beaten.any():
            return np.flatnonzero(alive & ~(rivals & alive[None]).any(axis=1))
        alive &= ~beaten


def chain_of(found: Matches, reach: float) -> np.ndarray:
    """Return the matches that make the chain of markers, as far as they are clear, in its order.

    Open matches join it where the chain has a gap or goes on, if they lie where its neighbours say that a
    marker should be, and their rivals do not.

    Raises
    ------
    ShapeError
        Where there are too few, or their order is unclear.
    """
    certain = settled(found, reach)
    taken = certain[belonging(found.points[certain], reach)]
    rivals = clash(found.blobs)
    while True:
        order = taken[chained(found.points[taken])]
        left = np.flatnonzero(~rivals[taken].any(axis=0))
        left = np.setdiff1d(left, taken)
        joining = left[_fitting(found, order, left, rivals)]
        if not len(joining):
            return order
        taken = np.append(taken, joining[0])  # one at a time: the next has to fit the chain with it


def _fitting(found: Matches, order: np.ndarray, left: np.ndarray, rivals: np.ndarray) -> np.ndarray:
    """Mark which of the matches that are left are where a marker should be, all rivals being elsewhere."""
    places, usual = _expected(found.points[order])
    misfit = cdist(found.points[left], places).min(axis=1, initial=np.inf) / usual
    other = np.where(rivals[np.ix_(left, left)], misfit[None], np.inf).min(axis=1, initial=np.inf)
    return (misfit <= _MISFIT) & (other > np.maximum(_CLEARLY * misfit, _ELSEWHERE))


def _expected(chain: Points) -> tuple[Points, float]:
    """Return where markers are missing in a chain and where it goes on, and the usual link [m]."""
    length = np.linalg.norm(np.diff(chain, axis=0), axis=1)
    usual = float(np.median(length))
    ahead = np.vstack((_beyond(chain[::-1]), chain, _beyond(chain)))
    found = [ahead[:1], ahead[-1:]]
    for i in np.flatnonzero(length > _GAP * usual):
        missing = round(float(length[i]) / usual) - 1
        x = (np.arange(1, missing + 1) / (missing + 1))[:, None]
        before, one, two, after = ahead[i : i + 4]
        slope_in = (one - before) * length[i] / np.linalg.norm(one - before)
        slope_out = (after - two) * length[i] / np.linalg.norm(after - two)
        found.append(
            (1 + 2 * x) * (1 - x) ** 2 * one
            + x * (1 - x) ** 2 * slope_in
            + x**2 * (3 - 2 * x) * two
            + x**2 * (x - 1) * slope_out
        )
    return np.concatenate(found), usual


def _beyond(chain: Points) -> Points:
    """Go on behind the end of a chain by a parabola through its last three points [1, 3]."""
    return (3.0 * chain[-1] - 3.0 * chain[-2] + chain[-3])[None]

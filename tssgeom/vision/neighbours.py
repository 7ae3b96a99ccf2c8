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
from tssgeom.vision.views import ViewSet

_REACH = 1.6  # of the spacing that images show
_UNSLANTED = 0.8  # quantile of the spacings in an image that a slanted view has not shortened much
_BOTH = 2  # neighbours that a marker has at most
_MISFIT, _ELSEWHERE = 0.35, 0.3  # spacings from where a marker should be: it is one, it is none
_CLEARLY = 2.5  # times farther off than the one that is taken
_SPACING = 1.5  # spacings: a longer link has room for a marker


def reach_of(cameras: tuple[Camera, ...], view_sets: Sequence[ViewSet], matches: Sequence[Matches]) -> float:
    """Return the distance within which the next marker lies [m].

    It follows from the angle between neighbours in the images, the widest of all, and the usual depth.
    """
    candidates = []
    for v, camera in enumerate(cameras):
        centres = [one.sightings[v].centre for one in view_sets if len(one.sightings[v]) > 1]
        spacings = [KDTree(pixels).query(pixels, 2)[0][:, 1] for pixels in centres]
        depths = [one.points[one.blobs[:, v] >= 0] @ camera.rotation[2] + camera.shift[2] for one in matches]
        if spacings and (depth := np.concatenate(depths)).size:
            candidates.append(
                float(
                    np.quantile(np.concatenate(spacings), _UNSLANTED) / camera.matrix[0, 0] * np.median(depth)
                )
            )
    return _REACH * max(candidates, default=0.0)


def unopposed(candidates: Matches, reach: float) -> np.ndarray:
    """Return which matches are consistent, after those with fewer neighbours are removed.

    Of matches that share a blob the one that more cameras see counts, or else the one with more neighbours;
    of two with as many, neither does.

    Parameters
    ----------
    candidates
        Possible points.
    reach
        Distance within which a neighbour lies [m].
    """
    conflicting = clash(candidates.blobs)
    near = (
        (cdist(candidates.points, candidates.points) <= reach)
        & ~conflicting
        & ~np.eye(len(conflicting), dtype=np.bool_)
    )
    views = (candidates.blobs >= 0).sum(axis=1)
    alive = np.ones(len(conflicting), np.bool_)
    while True:
        support = np.minimum((near & alive[None]).sum(axis=1), _BOTH)
        rank = 10 * views + support
        beats = conflicting & alive[:, None] & alive[None] & (rank[:, None] > rank[None])
        unbeaten = alive & ~beats.any(axis=0)
        beaten = alive & (beats & unbeaten[:, None]).any(axis=0)
        if not beaten.any():
            return np.flatnonzero(alive & ~(conflicting & alive[None]).any(axis=1))
        alive &= ~beaten


def chain_of(candidates: Matches, reach: float) -> np.ndarray:
    """Return the matches that make the chain of markers, as far as they are clear, in its order.

    Open matches join it where a marker is missing or the chain goes on, if they lie near the expected
    position and conflicting matches do not.

    Raises ShapeError where there are too few, or their order is unclear.
    """
    certain = unopposed(candidates, reach)
    taken = certain[belonging(candidates.points[certain], reach)]
    conflicting = clash(candidates.blobs)
    while True:
        order = taken[chained(candidates.points[taken])]
        left = np.flatnonzero(~conflicting[taken].any(axis=0))
        left = np.setdiff1d(left, taken)
        joining = left[_fitting(candidates, order, left, conflicting)]
        if not len(joining):
            return order
        taken = np.append(taken, joining[0])  # one at a time: the next has to fit the chain with it


def _fitting(candidates: Matches, order: np.ndarray, left: np.ndarray, conflicting: np.ndarray) -> np.ndarray:
    """Mark the remaining matches near an expected position from which conflicting matches are far."""
    expected, usual = _expected(candidates.points[order])
    misfit = cdist(candidates.points[left], expected).min(axis=1, initial=np.inf) / usual
    other = np.where(conflicting[np.ix_(left, left)], misfit[None], np.inf).min(axis=1, initial=np.inf)
    return (misfit <= _MISFIT) & (other > np.maximum(_CLEARLY * misfit, _ELSEWHERE))


def _expected(chain: Points) -> tuple[Points, float]:
    """Return where markers are missing in a chain and where it goes on, and the usual link [m]."""
    length = np.linalg.norm(np.diff(chain, axis=0), axis=1)
    usual = float(np.median(length))
    extended = np.vstack((_beyond(chain[::-1]), chain, _beyond(chain)))
    candidates = [extended[:1], extended[-1:]]
    for i in np.flatnonzero(length > _SPACING * usual):
        missing = round(float(length[i]) / usual) - 1
        x = (np.arange(1, missing + 1) / (missing + 1))[:, None]
        before, one, two, after = extended[i : i + 4]
        slope_in = (one - before) * length[i] / np.linalg.norm(one - before)
        slope_out = (after - two) * length[i] / np.linalg.norm(after - two)
        candidates.append(
            (1 + 2 * x) * (1 - x) ** 2 * one
            + x * (1 - x) ** 2 * slope_in
            + x**2 * (3 - 2 * x) * two
            + x**2 * (x - 1) * slope_out
        )
    return np.concatenate(candidates), usual


def _beyond(chain: Points) -> Points:
    """Go on behind the end of a chain by a parabola through its last three points [1, 3]."""
    return (3.0 * chain[-1] - 3.0 * chain[-2] + chain[-3])[None]

"""Markers of one make have one size: a match at the wrong depth shows another; docs/model.md (137)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.vision.cameras import Camera
from tssgeom.vision.matching import Matches, sure
from tssgeom.vision.views import ViewSet

_SAME = 0.22  # of ln radius: spread of one size by lighting, blur and slanted views
_MOSTLY = 0.7  # of the sure matches that have to agree before size is used


def of_one_size(
    cameras: tuple[Camera, ...], view_sets: Sequence[ViewSet], matches: Sequence[Matches]
) -> list[Matches]:
    """Leave out matches whose blobs would be markers of another size than most.

    Parameters
    ----------
    cameras
        The cameras.
    view_sets, matches
        Sightings of each frame, and the points that they may be.

    Returns
    -------
    list of Matches
        The same where markers have sizes of their own.
    """
    radii = [
        _log_radius(cameras, one, candidates) for one, candidates in zip(view_sets, matches, strict=True)
    ]
    usual = _densest(np.concatenate(radii))
    certain = [radius[sure(candidates)[0]] for radius, candidates in zip(radii, matches, strict=True)]
    agreeing = np.abs(np.concatenate(certain) - usual) <= _SAME
    if np.count_nonzero(agreeing) < _MOSTLY * len(agreeing):
        return list(matches)
    kept = [np.flatnonzero(np.abs(radius - usual) <= _SAME) for radius in radii]
    return [candidates.take(rows) for candidates, rows in zip(matches, kept, strict=True)]


def _log_radius(cameras: tuple[Camera, ...], one: ViewSet, candidates: Matches) -> Vector:
    """Logarithm of the radius that a marker would have, the mean over the views that see it [ln m]."""
    total, views = np.zeros(len(candidates.points)), np.zeros(len(candidates.points))
    for v, camera in enumerate(cameras):
        here = candidates.blobs[:, v] >= 0
        depth = candidates.points[here] @ camera.rotation[2] + camera.shift[2]
        area = one.sightings[v].size[candidates.blobs[here, v]] / (camera.matrix[0, 0] * camera.matrix[1, 1])
        total[here] += 0.5 * np.log(area / np.pi) + np.log(depth)
        views[here] += 1.0
    return total / np.maximum(views, 1.0)


def _densest(values: Vector) -> float:
    """Return the median of the values in the window, `_SAME` wide, that holds most of them."""
    if not len(values):
        return 0.0
    ordered = np.sort(values)
    until = np.searchsorted(ordered, ordered + _SAME, side="right")
    first = int(np.argmax(until - np.arange(len(ordered))))
    return float(np.median(ordered[first : until[first]]))

"""Blobs covered in part or run into another: their area jumps, their centre is off; docs/model.md (139)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tssgeom.vision.cameras import Camera
from tssgeom.vision.views import Located, ViewSet

_WHOLE = (0.75, 1.35)  # of the usual area: smaller is covered in part, larger is two in one
_HALF = 15  # frames before and after, over which the usual area is taken
_FEWEST = 5


def uncovered(
    cameras: tuple[Camera, ...], view_sets: Sequence[ViewSet], frames: Sequence[Located]
) -> list[np.ndarray]:
    """Return the sightings of every marker without those that are covered in part or two in one.

    Parameters
    ----------
    cameras
        The cameras.
    view_sets, frames
        Sightings of every frame, and the markers located by them.

    Returns
    -------
    list of ndarray
        For each frame the sighting of each camera, -1 for none [n, v].
    """
    which = np.array([one.which for one in frames])
    size = np.full(which.shape, np.nan)
    for f, (view_set, one) in enumerate(zip(view_sets, frames, strict=True)):
        for v, camera in enumerate(cameras):
            here = which[f, :, v] >= 0
            depth = one.points[here] @ camera.rotation[2] + camera.shift[2]
            size[f, here, v] = view_set.sightings[v].size[which[f, here, v]] * depth**2
    share = size / _usual(size)
    return list(np.where((share < _WHOLE[0]) | (share > _WHOLE[1]), -1, which))


def _usual(size: np.ndarray) -> np.ndarray:
    """Median over the frames around, NaN where too few of them have a value [f, n, v]."""
    usual = np.full_like(size, np.nan)
    for f in range(len(size)):
        around = np.sort(size[max(f - _HALF, 0) : f + _HALF + 1], axis=0)  # NaN last
        known = np.isfinite(around).sum(axis=0)
        middle = [np.take_along_axis(around, k[None], axis=0)[0] for k in ((known - 1) // 2, known // 2)]
        usual[f] = np.where(known >= _FEWEST, 0.5 * (middle[0] + middle[1]), np.nan)
    return usual

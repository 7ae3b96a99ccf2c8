"""Positions of markers in space from the sightings that were assigned to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import SettingsError
from tssgeom.vision.cameras import Camera, eyes
from tssgeom.vision.single_view import by_tag, on_plane, refuse_without_plane
from tssgeom.vision.triangulation import mean_of, triangulate
from tssgeom.vision.views import Located, ViewSet, gathered


@dataclass(frozen=True, slots=True)
class Alone:
    """What determines the depth where there is one camera only."""

    plane: float | None = None
    """The markers lie on the plane z = plane of the common frame [m]."""
    side: float | None = None
    """Side of the tags [m]."""


def refuse_one_camera(cameras: tuple[Camera, ...], alone: Alone, *, tags: bool) -> None:
    """Refuse one camera where nothing determines the depth.

    Raises SettingsError where one camera has neither a plane nor tags of a known side.
    """
    first, *others = cameras
    if others:
        return
    if alone.plane is not None:
        refuse_without_plane(first, alone.plane)
    elif not (tags and alone.side):
        how = "--plane-mm where the route lies in a plane, or --tag-mm for tags of a known side"
        raise SettingsError(
            f"one camera does not determine the depth of markers: add a camera, or give {how}"
        )


def located(
    cameras: tuple[Camera, ...], view_set: ViewSet, which: np.ndarray, gate: Vector, alone: Alone
) -> Located:
    """Locate markers.

    Parameters
    ----------
    cameras
        One for each column of `which`.
    view_set
        Sightings of all cameras.
    which
        The sighting of each camera that a marker comes from, -1 for none [n, v].
    gate
        Largest square by the number of views.
    alone
        What determines the depth of one camera.
    """
    first, *others = cameras
    if others:
        return _from_views(cameras, view_set, which, gate)
    return _from_one(first, view_set, which, alone)


def _from_views(cameras: tuple[Camera, ...], view_set: ViewSet, which: np.ndarray, gate: Vector) -> Located:
    slope, weight = gathered(view_set, which)
    views, count, corners = slope.shape[:3]
    flat = slope.reshape(views, -1, 2), weight.reshape(views, -1, 2, 2)
    positioned = triangulate(eyes(cameras), *flat, gate)
    points, covariance = mean_of(
        positioned.points.reshape(count, corners, 3), positioned.covariance.reshape(count, corners, 3, 3)
    )
    good = np.asarray(np.isfinite(points).all(axis=1))
    used = positioned.used.reshape(views, count, corners).all(axis=2).T
    freedom = positioned.freedom.reshape(count, corners).sum(axis=1)
    return Located(
        points,
        covariance,
        positioned.square.reshape(count, corners).sum(axis=1),
        np.where(good, freedom, 0.0),
        np.where(used & good[:, None], which, -1),
    )


def _from_one(camera: Camera, view_set: ViewSet, which: np.ndarray, alone: Alone) -> Located:
    rows, sightings = which[:, 0], view_set.sightings[0]
    here = rows >= 0
    count = len(rows)
    points, covariance = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    chosen = rows[here]
    if alone.plane is not None:
        corners = sightings.pixels.shape[1]
        noise = sightings.noise[chosen] / np.sqrt(corners)
        points[here], covariance[here] = on_plane(camera, sightings.centre[chosen], noise, alone.plane)
    elif alone.side is not None:
        points[here], covariance[here] = by_tag(
            camera, sightings.pixels[chosen], sightings.noise[chosen], alone.side
        )
    good = np.asarray(np.isfinite(points).all(axis=1))
    covariance[~good] = np.nan
    return Located(
        points,
        covariance,
        np.where(good, 0.0, np.nan),
        np.zeros(count),
        np.where(good[:, None], which, -1),
    )

"""Positions of markers in space from the sightings that were assigned to them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.errors import SettingsError
from tssgeom.vision.cameras import Camera, eyes, sight
from tssgeom.vision.triangulation import mean_of, triangulate
from tssgeom.vision.views import Located, ViewSet, gathered

_LEAST_SLOPE = 0.1  # sine of the angle between ray and plane, below which depth is undetermined
_MOST_SHARE = 0.03  # of the depth: a larger standard error is no longer linear
_FIT = 25.0  # squared standard deviations that the corners of a tag may be off, three degrees of freedom


def on_plane(camera: Camera, pixels: Matrix, noise: Vector, height: float) -> tuple[Points, np.ndarray]:
    """Locate markers that lie on the plane z = height of the common frame.

    Parameters
    ----------
    camera
        The camera.
    pixels, noise
        Pixels of the markers [n, 2] [px], and its standard deviation [n] [px].
    height
        Where the plane lies [m].

    Returns
    -------
    tuple
        Positions [n, 3] [m], NaN where the sight runs along the plane, and covariances [n, 3, 3] [m²].
    """
    slope, slope_by_pixel = sight(camera, pixels)
    toward = np.column_stack((slope, np.ones(len(slope)))) @ camera.rotation
    reach = (height - camera.position[2]) / toward[:, 2]
    points = camera.position + reach[:, None] * toward
    by_slope = reach[:, None, None] * (
        camera.rotation[:2].T[None]
        - toward[:, :, None] * camera.rotation[:2, 2][None, None] / toward[:, 2, None, None]
    )
    by_pixel = by_slope @ slope_by_pixel * noise[:, None, None]
    flat = np.abs(toward[:, 2]) < _LEAST_SLOPE * np.linalg.norm(toward, axis=1)
    points[flat | (reach <= 0)] = np.nan
    return points, by_pixel @ by_pixel.transpose(0, 2, 1)


def refuse_without_plane(camera: Camera, height: float) -> None:
    """Refuse a plane that the camera itself lies in.

    Raises SettingsError where no pixel determines a position on the plane.
    """
    if abs(camera.position[2] - height) < 1e-3:
        raise SettingsError(
            f"camera {camera.name!r} lies in the plane z = {1e3 * height:g} mm: calibrate with "
            "--board-frame, so that z = 0 is the plane of the board"
        )


def by_tag(camera: Camera, corners: np.ndarray, noise: Vector, side: float) -> tuple[Points, np.ndarray]:
    """Locate tags of a known side by their four corners.

    Depth follows from the size of the image, so that its error is large; it is left out where the error is
    beyond 3 % of the depth, or where the corners are no square.

    Parameters
    ----------
    camera
        The camera.
    corners, noise
        Pixels [n, 4, 2] [px] and their standard deviation [n] [px].
    side
        Side of the tags [m].

    Returns
    -------
    tuple
        Middles of the tags [n, 3] [m], NaN where they are left out, and covariances [n, 3, 3] [m²].
    """
    results = [_tag(camera, four, sd, side) for four, sd in zip(corners, noise, strict=True)]
    if not results:
        return np.zeros((0, 3)), np.zeros((0, 3, 3))
    return np.array([position for position, _ in results]), np.array([spread for _, spread in results])


def _tag(camera: Camera, corners: Matrix, noise: float, side: float) -> tuple[Vector, Matrix]:
    undetermined = np.full(3, np.nan), np.full((3, 3), np.nan)
    half = 0.5 * side
    square = np.array([[-half, half, 0.0], [half, half, 0.0], [half, -half, 0.0], [-half, -half, 0.0]])
    lens = camera.matrix, camera.distortion
    try:
        good, turn, shift = cv2.solvePnP(square, corners, *lens, flags=cv2.SOLVEPNP_IPPE_SQUARE)
    except cv2.error:
        return undetermined
    if not good or not np.isfinite(shift).all() or shift[2, 0] <= 0:
        return undetermined
    turn, shift = cv2.solvePnPRefineLM(square, corners, *lens, turn, shift)
    projected, jacobian = cv2.projectPoints(square, turn, shift, *lens)
    jacobian = jacobian[:, :6]
    off = float(np.sum((projected.reshape(-1, 2) - corners) ** 2)) / noise**2
    information = jacobian.T @ jacobian / noise**2
    if off > _FIT or np.linalg.cond(information) > 1e14:
        return undetermined
    spread = np.linalg.inv(information)[3:, 3:]  # docs/model.md (140)
    if not np.sqrt(spread[2, 2]) < _MOST_SHARE * shift[2, 0]:
        return undetermined
    rotation = camera.rotation
    return rotation.T @ (shift[:, 0] - camera.shift), rotation.T @ spread @ rotation


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
        points, covariance, np.where(good, 0.0, np.nan), np.zeros(count), np.where(good[:, None], which, -1)
    )

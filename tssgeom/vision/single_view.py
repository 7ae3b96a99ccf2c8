"""Points from one camera where something else determines the depth, a plane or the side of a tag; (140)."""

from __future__ import annotations

import cv2
import numpy as np

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.errors import SettingsError
from tssgeom.vision.cameras import Camera, sight

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

"""Calibrated cameras: the projection of a point, and the ray of a pixel; docs/model.md (130)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.errors import SettingsError

DISTORTIONS = ("k1", "k2", "p1", "p2", "k3")
"""Coefficients of the lens, radial and tangential, in the order of OpenCV."""

_NEWTON_STEPS = 5
"""After OpenCV's first steps, whose number only OpenCV 5 lets choose. Derived: each doubles the digits."""
_NO_TURN = np.zeros(3)
_BEHIND = 1e-6  # depth below which a point is not in front of a camera [m]


@dataclass(frozen=True, slots=True)
class Camera:
    """One camera with its position in the common frame."""

    name: str
    width: int
    """[px]."""
    height: int
    """[px]."""
    matrix: Matrix
    """Focal lengths and principal point, [3, 3] [px]."""
    distortion: Vector
    """Coefficients of `DISTORTIONS` [5] [1]."""
    turn: Vector
    """Rotation vector from the common frame into the camera's [3] [rad]."""
    shift: Vector
    """Position of the common origin in the camera's frame [3] [m]."""

    @property
    def rotation(self) -> Matrix:
        """Rotation from the common frame into the camera's [3, 3]."""
        return np.asarray(cv2.Rodrigues(self.turn)[0], dtype=np.float64)

    @property
    def position(self) -> Vector:
        """Centre of the camera in the common frame [3] [m]."""
        return -self.rotation.T @ self.shift


@dataclass(frozen=True, slots=True)
class Eyes:
    """The poses of several cameras as arrays, for triangulation."""

    rotation: np.ndarray
    """[v, 3, 3]."""
    shift: Matrix
    """[v, 3] [m]."""


def eyes(cameras: tuple[Camera, ...]) -> Eyes:
    """Stack the poses of cameras."""
    return Eyes(np.array([one.rotation for one in cameras]), np.array([one.shift for one in cameras]))


def project(camera: Camera, points: Points) -> Matrix:
    """Return the pixels of points, NaN for a point behind the camera; docs/model.md (130).

    Parameters
    ----------
    camera
        The camera.
    points
        Positions in the common frame [n, 3] [m].

    Returns
    -------
    Matrix
        Pixels [n, 2], the centre of the first pixel at 0, 0 [px].
    """
    if not len(points):
        return np.zeros((0, 2))
    in_front = points @ camera.rotation[2] + camera.shift[2] > _BEHIND
    safe = np.where(in_front[:, None], points, camera.position + camera.rotation[2])
    pixels, _ = cv2.projectPoints(
        np.ascontiguousarray(safe[:, None]), camera.turn, camera.shift, camera.matrix, camera.distortion
    )
    return np.where(in_front[:, None], pixels[:, 0], np.nan)


def sight(camera: Camera, pixels: Matrix) -> tuple[Matrix, np.ndarray]:
    """Return the viewing directions of pixels, without the distortion of the lens.

    Parameters
    ----------
    camera
        The camera.
    pixels
        [n, 2] [px].

    Returns
    -------
    Matrix
        x/z and y/z in the camera's frame [n, 2].
    ndarray
        Their derivatives by the pixel [n, 2, 2] [1/px].
    """
    if not len(pixels):
        return np.zeros((0, 2)), np.zeros((0, 2, 2))
    given = np.ascontiguousarray(pixels[:, None], dtype=np.float64)
    first = cv2.undistortPoints(given, camera.matrix, camera.distortion)
    slope = np.asarray(first, dtype=np.float64).reshape(-1, 2)
    inverse = np.linalg.inv(pixels_by_slope(camera, slope))
    for _ in range(_NEWTON_STEPS):
        rays = np.column_stack((slope, np.ones(len(slope))))
        again, _jacobian = cv2.projectPoints(rays, _NO_TURN, _NO_TURN, camera.matrix, camera.distortion)
        slope = slope + np.einsum("nij,nj->ni", inverse, pixels - again.reshape(-1, 2))
        inverse = np.linalg.inv(pixels_by_slope(camera, slope))
    return slope, inverse


def pixels_by_slope(camera: Camera, slope: Matrix) -> np.ndarray:
    """Return the derivative of the pixel by x/z and y/z, [n, 2, 2] [px]; docs/model.md (130)."""
    k1, k2, p1, p2, k3 = camera.distortion
    x, y = slope.T
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    rate = 2.0 * (k1 + square * (2.0 * k2 + 3.0 * k3 * square))
    cross = rate * x * y + 2.0 * (p1 * x + p2 * y)
    out = np.empty((len(slope), 2, 2))
    out[:, 0, 0] = radial + rate * x * x + 2.0 * p1 * y + 6.0 * p2 * x
    out[:, 0, 1] = out[:, 1, 0] = cross
    out[:, 1, 1] = radial + rate * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    return camera.matrix[:2, :2] @ out


def refuse_other_size(camera: Camera, image: np.ndarray, source: str) -> None:
    """Refuse an image of another size than the camera was calibrated at.

    Raises SettingsError where the sizes differ.
    """
    height, width = image.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise SettingsError(
            f"{source}: the images are {width} x {height} px, camera {camera.name!r} was calibrated at "
            f"{camera.width} x {camera.height} px: calibrate at the size that is used"
        )

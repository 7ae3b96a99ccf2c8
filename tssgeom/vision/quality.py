"""Quality of a calibration: errors of its parameters and of triangulated points; docs/model.md (142)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector, read_only
from tssgeom.vision.bundle import CAMERA, LENS, Fitted, Pose, Sighted, after
from tssgeom.vision.cameras import Camera, eyes, project, sight
from tssgeom.vision.triangulation import triangulate

_FOCAL_SD, _COVERED, _ERROR, _VIEWS = 0.005, 0.4, 1.0, 8  # beyond which a warning is due
_CELLS = 5
_MOST_POINTS = 200
_TILT = 0.01  # share of its standard deviation by which a parameter is moved


@dataclass(frozen=True, slots=True)
class Calibration:
    """Cameras in one frame, and how well the boards determine them."""

    cameras: tuple[Camera, ...]
    covariance: Matrix
    """Of fx, fy, cx, cy, distortion, rotation vector and shift of all, in the frame of the first camera."""
    noise: float
    """Standard deviation of one coordinate of a corner [px]."""
    reprojection: Vector
    """Root mean square error of the corners of each camera [v] [px]."""
    views: tuple[int, ...]
    """Boards that each camera sees."""
    covered: Vector
    """Share of each image that detected corners cover [v]."""
    point_sd: float
    """Standard deviation that the calibration alone gives a coordinate of a corner; 0 for one camera [m]."""
    warnings: tuple[str, ...] = ()

    @property
    def sd(self) -> Matrix:
        """Standard deviations of the parameters of each camera [v, 15]."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0)).reshape(-1, CAMERA)


def quality_of(
    corners: Points,
    names: Sequence[str],
    sizes: Sequence[tuple[int, int]],
    sighted: Sequence[Sighted],
    fitted: Fitted,
    board_frame: int | None,
) -> Calibration:
    """Return the cameras of a fit, and its quality."""
    cameras = tuple(_camera(*given) for given in zip(names, sizes, fitted.lens, fitted.pose, strict=True))
    covered = np.array([_covered(sighted, v, size) for v, size in enumerate(sizes)])
    calibration = Calibration(
        cameras=cameras,
        covariance=read_only(fitted.covariance),
        noise=fitted.noise,
        reprojection=np.array([_rms(sighted, fitted, v) for v in range(len(names))]),
        views=tuple(sum(one.camera == v for one in sighted) for v in range(len(names))),
        covered=covered,
        point_sd=_point_sd(corners, cameras, sighted, fitted) if len(names) > 1 else 0.0,
    )
    calibration = replace(calibration, warnings=_warnings(calibration))
    if board_frame is None:
        return calibration
    world = fitted.boards[board_frame]
    moved = [after(world, Pose(one.turn, one.shift)) for one in cameras]
    turned = tuple(replace(c, turn=p.turn, shift=p.shift) for c, p in zip(cameras, moved, strict=True))
    return replace(calibration, cameras=turned)


def _camera(name: str, size: tuple[int, int], lens: Vector, pose: Pose) -> Camera:
    fx, fy, cx, cy = lens[:4]
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return Camera(name, *size, matrix, lens[4:].copy(), pose.turn.copy(), pose.shift.copy())


def _rms(sighted: Sequence[Sighted], fitted: Fitted, camera: int) -> float:
    parts = [part for one, part in zip(sighted, fitted.residual, strict=True) if one.camera == camera]
    off = np.concatenate(parts)
    return float(np.sqrt(np.mean(np.sum(off * off, axis=1))))


def _covered(sighted: Sequence[Sighted], camera: int, size: tuple[int, int]) -> float:
    pixels = np.concatenate([one.detection.pixels for one in sighted if one.camera == camera])
    cells = np.floor(pixels / np.array(size) * _CELLS)
    return len(np.unique(cells, axis=0)) / _CELLS**2


def _point_sd(
    corners: Points, cameras: tuple[Camera, ...], sighted: Sequence[Sighted], fitted: Fitted
) -> float:
    """Root mean square standard deviation of corners that are triangulated with a calibration in error."""
    frames = sorted({one.frame for one in sighted})
    positions = np.concatenate(
        [corners @ fitted.boards[k].rotation.T + fitted.boards[k].shift for k in frames]
    )
    points = positions[np.linspace(0, len(positions) - 1, min(len(positions), _MOST_POINTS)).astype(int)]
    pixels = [project(camera, points) for camera in cameras]
    sd = np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0))
    slopes = np.zeros((len(points), 3, len(sd)))
    for j in np.flatnonzero(sd):
        moved = [
            _with(one, int(j) - CAMERA * v, _TILT * sd[j]) if j // CAMERA == v else one
            for v, one in enumerate(cameras)
        ]
        slopes[:, :, j] = (_again(tuple(moved), pixels) - points) / (_TILT * sd[j])
    variance = np.einsum("nij,jk,nik->ni", slopes, fitted.covariance, slopes)
    return float(np.sqrt(np.nanmean(variance)))


def _with(camera: Camera, parameter: int, change: float) -> Camera:
    matrix = camera.matrix
    lens = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *camera.distortion])
    whole = np.concatenate((lens, camera.turn, camera.shift))
    whole[parameter] += change
    pose = Pose(whole[LENS : LENS + 3], whole[LENS + 3 :])
    return _camera(camera.name, (camera.width, camera.height), whole[:LENS], pose)


def _again(cameras: tuple[Camera, ...], pixels: Sequence[Matrix]) -> Points:
    slope = np.array([sight(camera, at)[0] for camera, at in zip(cameras, pixels, strict=True)])
    weight = np.broadcast_to(np.eye(2), (*slope.shape, 2)).copy()
    return triangulate(eyes(cameras), slope, weight, np.full(len(cameras) + 1, np.inf)).points


def _warnings(calibration: Calibration) -> tuple[str, ...]:
    said = list[str]()
    for v, camera in enumerate(calibration.cameras):
        focal = float(calibration.sd[v, 0] / camera.matrix[0, 0])
        if focal > _FOCAL_SD:
            said.append(
                f"camera {camera.name!r}: focal length known to {100 * focal:.1f} % only: tilt the board more"
            )
        if calibration.covered[v] < _COVERED:
            said.append(
                f"camera {camera.name!r}: corners cover {100 * calibration.covered[v]:.0f} % of the image: "
                "move the board into its corners too"
            )
        if calibration.reprojection[v] > _ERROR:
            said.append(
                f"camera {camera.name!r}: corners are {calibration.reprojection[v]:.2f} px off: check focus, "
                "flatness of the board and the size of its squares"
            )
        if calibration.views[v] < _VIEWS:
            said.append(f"camera {camera.name!r}: {calibration.views[v]} boards only: use {_VIEWS} or more")
    return tuple(said)

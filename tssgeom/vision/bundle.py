"""Poses, and all cameras and boards fitted at once to every detected corner; docs/model.md (141)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from scipy.optimize import least_squares

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.errors import FitError
from tssgeom.vision.boards import BoardDetection

LENS = 9
"""Parameters of a lens: focal lengths, principal point, distortion."""
CAMERA = LENS + 6
"""Parameters of a camera: lens, rotation vector, shift."""
_BOARD = 6


class Pose(NamedTuple):
    """From one frame into another: x' = R(turn) x + shift."""

    turn: Vector
    """Rotation vector [3] [rad]."""
    shift: Vector
    """[3] [m]."""

    @property
    def rotation(self) -> Matrix:
        """[3, 3]."""
        return np.asarray(cv2.Rodrigues(self.turn)[0], dtype=np.float64)


def pose_of(turn: object, shift: object) -> Pose:
    """Return a pose from what OpenCV gives."""
    return Pose(np.asarray(turn, dtype=np.float64).ravel(), np.asarray(shift, dtype=np.float64).ravel())


STILL = Pose(np.zeros(3), np.zeros(3))


def after(first: Pose, second: Pose) -> Pose:
    """Return the pose of going through `first`, then `second`."""
    turn, shift = cv2.composeRT(first.turn, first.shift, second.turn, second.shift)[:2]
    return pose_of(turn, shift)


def backwards(pose: Pose) -> Pose:
    """Return the pose that undoes another."""
    return Pose(-pose.turn, -pose.rotation.T @ pose.shift)


@dataclass(frozen=True, slots=True)
class Sighted:
    """One board in the image of one camera."""

    camera: int
    frame: int
    detection: BoardDetection


@dataclass(frozen=True, slots=True)
class Fitted:
    """Estimates from the corners."""

    lens: Matrix
    """fx, fy, cx, cy [px], k1, k2, p1, p2, k3 [1] of each camera [v, 9]."""
    pose: tuple[Pose, ...]
    """From the frame of the first camera into that of each."""
    boards: dict[int, Pose]
    """From each board into the frame of the first camera."""
    covariance: Matrix
    """Of the parameters of all cameras, `CAMERA` each, 0 for those that are fixed [15 v, 15 v]."""
    residual: tuple[Matrix, ...]
    """What each corner of each sighting is off [m, 2] [px]."""
    noise: float
    """Standard deviation of one coordinate of a corner [px]."""


def fit_all(
    corners: Points,
    sighted: Sequence[Sighted],
    lens: Matrix,
    pose: Sequence[Pose],
    boards: dict[int, Pose],
    free: np.ndarray,
) -> Fitted:
    """Fit lenses, poses and boards by least squares from a first guess.

    Parameters
    ----------
    corners
        Corners of the board [n, 3] [m].
    sighted
        Detections of the board.
    lens, pose, boards
        First guess; the first camera stays where it is.
    free
        Which parameters of the lenses are fitted [v, 9] bool.

    Raises
    ------
    FitError
        Where the corners do not determine all parameters.
    """
    frames = sorted(boards)
    positions = {frame: CAMERA * len(lens) + _BOARD * k for k, frame in enumerate(frames)}
    start = np.concatenate(
        [*(np.concatenate((one, *at)) for one, at in zip(lens, pose, strict=True))]
        + [np.concatenate(boards[frame]) for frame in frames]
    )
    fitted = np.ones(len(start), np.bool_)
    for v in range(len(lens)):
        fitted[CAMERA * v : CAMERA * v + LENS] = free[v]
    fitted[LENS:CAMERA] = False  # the first camera is the common frame

    def full(values: Vector) -> Vector:
        whole = start.copy()
        whole[fitted] = values
        return whole

    def off(values: Vector) -> Vector:
        whole = full(values)
        return np.concatenate([_off(corners, one, whole, positions)[0].ravel() for one in sighted])

    def slopes(values: Vector) -> Matrix:
        whole = full(values)
        out = np.zeros((sum(2 * len(one.detection.corners) for one in sighted), len(start)))
        row = 0
        for one in sighted:
            _, by_camera, by_board = _off(corners, one, whole, positions)
            rows = slice(row, row + len(by_camera))
            out[rows, CAMERA * one.camera : CAMERA * (one.camera + 1)] = by_camera
            out[rows, positions[one.frame] : positions[one.frame] + _BOARD] = by_board
            row = rows.stop
        return out[:, fitted]

    given = off, start[fitted], slopes
    solution = least_squares(*given, method="lm", x_scale="jac", max_nfev=200)  # pyright: ignore[reportArgumentType]
    whole, freedom = full(solution.x), len(solution.fun) - len(solution.x)
    if freedom <= 0 or not np.isfinite(whole).all():
        raise FitError("too few corners are detected to calibrate the cameras: film the board in more poses")
    noise = float(np.sqrt(2.0 * solution.cost / freedom))
    covariance = np.zeros((len(start), len(start)))
    covariance[np.ix_(fitted, fitted)] = noise**2 * _inverse(solution.jac)
    inside = CAMERA * len(lens)
    sizes = np.cumsum([2 * len(one.detection.corners) for one in sighted])[:-1]
    cameras = whole[:inside].reshape(-1, CAMERA)
    return Fitted(
        lens=cameras[:, :LENS],
        pose=tuple(Pose(one[LENS : LENS + 3], one[LENS + 3 :]) for one in cameras),
        boards={k: Pose(whole[at : at + 3], whole[at + 3 : at + 6]) for k, at in positions.items()},
        covariance=covariance[:inside, :inside],
        residual=tuple(part.reshape(-1, 2) for part in np.split(solution.fun, sizes)),
        noise=noise,
    )


def _inverse(jacobian: Matrix) -> Matrix:
    """Inverse of J'J, its columns scaled so that no digits are lost."""
    size = np.linalg.norm(jacobian, axis=0)
    if not (size > 0).all():
        raise FitError("the corners do not determine all camera parameters: film the board in more poses")
    triangle = np.linalg.qr(jacobian / size, mode="r")
    if np.linalg.cond(triangle) > 1e12:
        raise FitError("the corners do not determine all parameters of the cameras: tilt the board more")
    inverse = np.linalg.inv(triangle) / size[:, None]
    return inverse @ inverse.T


def _off(
    corners: Points, one: Sighted, whole: Vector, positions: dict[int, int]
) -> tuple[Matrix, Matrix, Matrix]:
    """Return what corners are off, and its derivatives by camera [2m, 15] and by board [2m, 6]."""
    camera = whole[CAMERA * one.camera : CAMERA * (one.camera + 1)]
    board = whole[positions[one.frame] : positions[one.frame] + _BOARD]
    composed = cv2.composeRT(board[:3], board[3:], camera[LENS : LENS + 3], camera[LENS + 3 :])
    turn, shift, turn_b, turn_bs, turn_c, turn_cs, shift_b, shift_bs, shift_c, shift_cs = composed
    matrix = np.array([[camera[0], 0.0, camera[2]], [0.0, camera[1], camera[3]], [0.0, 0.0, 1.0]])
    pixels, slopes = cv2.projectPoints(corners[one.detection.corners], turn, shift, matrix, camera[4:LENS])
    slopes = np.asarray(slopes, dtype=np.float64)
    by_turn, by_shift = slopes[:, :3], slopes[:, 3:6]
    by_camera = np.hstack(
        (
            slopes[:, 6 : 6 + LENS],
            by_turn @ turn_c + by_shift @ shift_c,
            by_turn @ turn_cs + by_shift @ shift_cs,
        )
    )
    by_board = np.hstack((by_turn @ turn_b + by_shift @ shift_b, by_turn @ turn_bs + by_shift @ shift_bs))
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2) - one.detection.pixels, by_camera, by_board

"""Cameras calibrated from a board that they see together; docs/model.md (141)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from tssgeom.address_space import CAMERAS, require_address_space
from tssgeom.arrays import Points, Vector
from tssgeom.errors import FitError, ShapeError
from tssgeom.vision.boards import Board, BoardDetection
from tssgeom.vision.bundle import LENS, STILL, Pose, Sighted, after, backwards, fit_all, pose_of
from tssgeom.vision.quality import Calibration, quality_of

_FEWEST = 4  # views of a camera
_MOST = 60  # frames that are fitted
_WILD = 4.0  # times the usual error of a view, beyond which the view is left out


def calibrated(
    board: Board,
    names: Sequence[str],
    sizes: Sequence[tuple[int, int]],
    detections: Sequence[Sequence[BoardDetection | None]],
    board_frame: int | None = None,
) -> Calibration:
    """Calibrate cameras.

    Parameters
    ----------
    board
        The board.
    names, sizes
        Name, and width and height [px], of each camera.
    detections
        For each frame the detection of the board by each camera, None where there is none.
    board_frame
        Number of a frame whose board is to be the plane z = 0 of the common frame; the frame of the first
        camera by default.

    Raises
    ------
    ShapeError
        Where a camera sees too few boards, or none together with the others.
    FitError
        Where the boards do not determine the cameras.
    SettingsError
        Where the system leaves too little address space.
    """
    chosen = _chosen(detections, board_frame)
    sighted = [
        Sighted(v, frame, one)
        for frame in chosen
        for v, one in enumerate(detections[frame])
        if one is not None
    ]
    views = [sum(one.camera == v for one in sighted) for v in range(len(names))]
    for name, count in zip(names, views, strict=True):
        if count < _FEWEST:
            raise ShapeError(
                f"camera {name!r} sees the board in {count} images: film it in at least {_FEWEST} poses, "
                "and check --board and the size of its squares"
            )
    require_address_space(CAMERAS, "a calibration of cameras")
    corners = board.corners
    starts = [
        _alone(corners, [one for one in sighted if one.camera == v], sizes[v]) for v in range(len(names))
    ]
    lens, free = np.array([one[0] for one in starts]), np.array([one[1] for one in starts])
    in_camera = {key: pose for _, _, poses in starts for key, pose in poses.items()}
    sighted = [one for one in sighted if (one.camera, one.frame) in in_camera]
    pose, boards = _located(names, in_camera)
    fitted = fit_all(corners, sighted, lens, pose, boards, free)
    if board_frame is not None and board_frame not in fitted.boards:
        raise ShapeError(f"no board is detected in frame {board_frame}: name another --board-frame")
    return quality_of(corners, names, sizes, sighted, fitted, board_frame)


def _chosen(detections: Sequence[Sequence[BoardDetection | None]], board_frame: int | None) -> list[int]:
    """Choose frames with boards, evenly where there are many."""
    frames = [k for k, row in enumerate(detections) if any(one is not None for one in row)]
    shared = [k for k in frames if sum(one is not None for one in detections[k]) > 1] or frames
    pool = shared if len(shared) >= _MOST else frames
    picked = {pool[int(k)] for k in np.linspace(0, len(pool) - 1, min(len(pool), _MOST)).round()}
    return sorted(picked | {frame for frame in frames if frame == board_frame})


def _alone(
    corners: Points, sighted: Sequence[Sighted], size: tuple[int, int]
) -> tuple[Vector, np.ndarray, dict[tuple[int, int], Pose]]:
    """Calibrate one camera: lens [9], which parameters count [9], and the pose of each board before it.

    Views that are far worse than the others are left out. Whether the lens needs a third radial coefficient
    follows from its errors (Schwarz's criterion).
    """
    fitted_lens = _fitted_lens(corners, sighted, size, cv2.CALIB_FIX_K3)
    kept = [
        one
        for one, rms in zip(sighted, fitted_lens.rms, strict=True)
        if rms <= _WILD * np.median(fitted_lens.rms)
    ]
    if len(kept) < len(sighted):
        sighted, fitted_lens = kept, _fitted_lens(corners, kept, size, cv2.CALIB_FIX_K3)
    richer = _fitted_lens(corners, sighted, size, 0)
    values = sum(2 * len(one.detection.corners) for one in sighted)
    needed = values * np.log(richer.square / fitted_lens.square) + np.log(values) < 0
    free = np.ones(LENS, np.bool_)
    free[-1] = needed
    taken = richer if needed else fitted_lens
    return taken.lens, free, {(s.camera, s.frame): pose for s, pose in zip(sighted, taken.poses, strict=True)}


class _Lens(NamedTuple):
    lens: Vector
    poses: list[Pose]
    rms: Vector
    """Error of each view [px]."""
    square: float
    """Mean square error of all [px²]."""


def _fitted_lens(corners: Points, sighted: Sequence[Sighted], size: tuple[int, int], flags: int) -> _Lens:
    positions = [corners[one.detection.corners].astype(np.float32) for one in sighted]
    pixels = [one.detection.pixels.astype(np.float32) for one in sighted]
    fitted_lens = cv2.calibrateCameraExtended(positions, pixels, size, None, None, flags=flags)  # pyright: ignore[reportCallIssue, reportArgumentType]
    rms, matrix, distortion, turns, shifts, _, _, each = fitted_lens
    lens = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *np.ravel(distortion)[:5]])
    if not (np.isfinite(rms) and np.isfinite(lens).all()):
        raise FitError("the boards give no finite camera: check --board and the size of its squares")
    poses = [pose_of(turn, shift) for turn, shift in zip(turns, shifts, strict=True)]
    return _Lens(lens, poses, np.ravel(each), max(rms, 1e-9) ** 2)


def _located(
    names: Sequence[str], in_camera: dict[tuple[int, int], Pose]
) -> tuple[list[Pose], dict[int, Pose]]:
    """Locate cameras and boards in the frame of the first camera, one after the other by shared boards."""
    pose, boards = {0: STILL}, dict[int, Pose]()
    while True:
        for (v, frame), detections in in_camera.items():
            if v in pose and frame not in boards:
                boards[frame] = after(detections, backwards(pose[v]))
        left = [v for v in range(len(names)) if v not in pose]
        if not left:
            return [pose[v] for v in range(len(names))], boards
        shared = {v: [f for (u, f) in in_camera if u == v and f in boards] for v in left}
        following = max(left, key=lambda v: len(shared[v]))
        if not shared[following]:
            raise ShapeError(
                f"camera {names[following]!r} sees no board together with others: film it with all in step"
            )
        ways = [after(backwards(boards[f]), in_camera[following, f]) for f in shared[following]]
        pose[following] = _middle(ways)


def _middle(ways: Sequence[Pose]) -> Pose:
    """Return the pose that is nearest to all others."""
    turns, shifts = np.array([one.rotation.ravel() for one in ways]), np.array([one.shift for one in ways])
    apart = np.abs(turns[:, None] - turns[None]).sum(axis=(1, 2)) / len(ways)
    size = np.linalg.norm(shifts, axis=1).mean() + 1e-9
    apart += np.abs(shifts[:, None] - shifts[None]).sum(axis=(1, 2)) / size / len(ways)
    return ways[int(np.argmin(apart))]

"""Calibration boards, checkerboards and ChArUco, and their corners in an image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from tssgeom.arrays import Matrix, Points
from tssgeom.errors import SettingsError
from tssgeom.vision.tags import dictionary, grey

_FEWEST_CORNERS = 6
_WINDOW, _MOST_WINDOW = 0.4, 11  # of the smallest distance between corners, and in pixels
_PATIENCE = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-3)


@dataclass(frozen=True, slots=True)
class Board:
    """A flat board of squares; its z = 0 holds the corners."""

    columns: int
    """Inner corners from left to right."""
    rows: int
    """Inner corners from top to bottom."""
    square: float
    """Side of a square [m]."""
    family: str | None = None
    """Family of the tags on a ChArUco board; None for a checkerboard."""
    tag: float = 0.0
    """Side of these tags [m]."""

    @property
    def corners(self) -> Points:
        """Positions of the inner corners, row by row [n, 3] [m]."""
        x, y = np.meshgrid(np.arange(float(self.columns)), np.arange(float(self.rows)))
        flat = np.column_stack((x.ravel(), y.ravel(), np.zeros(x.size)))
        return self.square * flat


@dataclass(frozen=True, slots=True)
class BoardDetection:
    """A board in one image."""

    corners: np.ndarray
    """Indices of the detected inner corners [m]."""
    pixels: Matrix
    """Their positions in the image [m, 2] [px]."""


def board_finder(board: Board, cameras: int) -> Callable[[np.ndarray], BoardDetection | None]:
    """Return what finds a board in an image.

    Parameters
    ----------
    board
        The board.
    cameras
        How many cameras observe it: several need a board that differs from itself upside down.

    Raises
    ------
    SettingsError
        Where the board cannot be used.
    """
    if min(board.columns, board.rows) < 3 or not board.square > 0:
        raise SettingsError(
            f"a board of {board.columns} x {board.rows} inner corners, squares of {1e3 * board.square:g} mm: "
            "give at least 3 x 3 corners and squares > 0 mm"
        )
    if board.family is not None:
        return _charuco_finder(board, board.family)
    if cameras > 1 and (board.columns + board.rows) % 2 == 0:
        raise SettingsError(
            f"a checkerboard of {board.columns} x {board.rows} inner corners is the same upside down: for "
            "several cameras use one of an even by an odd number, or a ChArUco board"
        )
    return lambda image: _checkerboard(board, grey(image))


def _checkerboard(board: Board, image: np.ndarray) -> BoardDetection | None:
    size = board.columns, board.rows
    detected, corners = cv2.findChessboardCornersSB(image, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not detected:
        return None
    corners = _sharpened(image, np.asarray(corners, dtype=np.float32), board)
    grid = corners.astype(np.float64).reshape(board.rows, board.columns, 2)
    return BoardDetection(np.arange(grid.shape[0] * grid.shape[1]), _upright(grid, image).reshape(-1, 2))


def _sharpened(image: np.ndarray, corners: np.ndarray, board: Board) -> np.ndarray:
    """Locate corners to a fraction of a pixel, in windows that hold one corner each."""
    grid = corners.reshape(board.rows, board.columns, 2)
    spacings = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
    window = int(np.clip(_WINDOW * min(spacings), 2, _MOST_WINDOW))
    return cv2.cornerSubPix(image, corners, (window, window), (-1, -1), _PATIENCE)


def _upright(grid: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Order corners as the board has them: not mirrored, and the square at the first corner dark."""
    along, down = grid[0, 1] - grid[0, 0], grid[1, 0] - grid[0, 0]
    if along[0] * down[1] - along[1] * down[0] < 0:
        grid = grid[:, ::-1]
    middle = 0.25 * (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:])
    column, row = np.rint(middle).astype(int).transpose(2, 0, 1)
    shade = image[np.clip(row, 0, image.shape[0] - 1), np.clip(column, 0, image.shape[1] - 1)].astype(float)
    even = (np.indices(shade.shape).sum(axis=0) % 2) == 0
    return grid[::-1, ::-1] if shade[even].mean() > shade[~even].mean() else grid


def _charuco_finder(board: Board, family: str) -> Callable[[np.ndarray], BoardDetection | None]:
    if not 0 < board.tag < board.square:
        raise SettingsError(
            f"tags of {1e3 * board.tag:g} mm in squares of {1e3 * board.square:g} mm: "
            "give tags smaller than squares"
        )
    size = board.columns + 1, board.rows + 1
    detector = cv2.aruco.CharucoDetector(
        cv2.aruco.CharucoBoard(size, float(board.square), float(board.tag), dictionary(family))
    )

    def find(image: np.ndarray) -> BoardDetection | None:
        corners, ids, _, _ = detector.detectBoard(grey(image))
        if ids is None or len(ids) < _FEWEST_CORNERS:
            return None
        return BoardDetection(np.ravel(ids), np.asarray(corners, dtype=np.float64).reshape(-1, 2))

    return find

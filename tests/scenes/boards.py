"""Checkerboards in many poses before cameras."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from tests.scenes.lenses import Lens

_FINE = 2


@dataclass(frozen=True)
class Board:
    """Inner corners along and across, side of a square [m], and brightness 0..1 at positions u, v [m]."""

    columns: int
    rows: int
    square: float
    shade: Callable[[np.ndarray, np.ndarray], np.ndarray]


def checkerboard(columns: int = 9, rows: int = 6, square: float = 0.03) -> Board:
    """A checkerboard with a white border; the first inner corner is at 0, 0."""

    def shade(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        i, j = np.floor(u / square).astype(int), np.floor(v / square).astype(int)
        inside = (i >= -1) & (i < columns) & (j >= -1) & (j < rows)
        return np.where(inside & ((i + j) % 2 == 0), 0.0, 1.0)

    return Board(columns, rows, square, shade)


def pose_of(board: Board, turn: Sequence[float], position: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Pose of a board whose middle is at a position, turned from lying flat towards -y."""
    upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    axes = Rotation.from_rotvec(turn).as_matrix() @ upright
    middle = 0.5 * board.square * np.array([board.columns - 1, board.rows - 1, 0.0])
    # the columns of `axes` are the board's x, y and z in the world: y runs down, z away from the cameras
    return axes, np.array(position) - axes @ middle


def board_poses(board: Board, count: int, seed: int = 1) -> list[tuple[np.ndarray, np.ndarray]]:
    """Poses that turn a board by up to 35 degrees and move it through the view."""
    random = np.random.default_rng(seed)
    result = []
    for k in range(count):
        way = 2 * np.pi * k / count
        turn = 0.6 * np.array([np.cos(3 * way), 0.3 * np.sin(5 * way), np.sin(2 * way)])
        position = np.array([0.06 * np.cos(way), 0.06 * np.sin(2 * way), 0.05 * np.sin(way)])
        result.append(pose_of(board, turn + 0.1 * random.standard_normal(3), position))
    return result


def board_images(
    lens: Lens, board: Board, poses: Sequence[tuple[np.ndarray, np.ndarray]], camera: int, noise: float = 2.0
) -> list[np.ndarray]:
    """Images of a board in each pose, grey, 8 bits."""
    rays = _rays(camera, lens.width, lens.height, lens)
    result = []
    for number, (axes, origin) in enumerate(poses):
        random = np.random.default_rng((77, camera, number))
        position = lens.position
        to_board = axes.T @ (position - origin)
        across = rays @ (lens.rotation @ axes)
        reach = -to_board[2] / across[:, 2]
        u, v = to_board[0] + reach * across[:, 0], to_board[1] + reach * across[:, 1]
        edge = 1.6 * board.square
        paper = (u > -2 * edge) & (u < board.square * (board.columns - 1) + 2 * edge)
        paper &= (v > -2 * edge) & (v < board.square * (board.rows - 1) + 2 * edge) & (reach > 0)
        light = np.where(paper, 25.0 + 200.0 * board.shade(u, v), 70.0)
        image = light.reshape(lens.height, _FINE, lens.width, _FINE).mean(axis=(1, 3))
        image = gaussian_filter(image, 0.7) + noise * random.standard_normal((lens.height, lens.width))
        result.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    return result


_KEPT: dict[int, tuple[Lens, np.ndarray]] = {}


def _rays(camera: int, width: int, height: int, lens: Lens) -> np.ndarray:
    """Rays of all parts of all pixels in the camera's frame, kept for the next image."""
    if camera in _KEPT and _KEPT[camera][0] is lens:
        return _KEPT[camera][1]
    step = (np.arange(_FINE) + 0.5) / _FINE - 0.5
    x, y = (np.arange(width)[:, None] + step).ravel(), (np.arange(height)[:, None] + step).ravel()
    slope = lens.slopes(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    rays = np.column_stack((slope, np.ones(len(slope))))
    _KEPT[camera] = (lens, rays)
    return rays

"""Routes of known angle in front of the cameras, and tags along them."""

from __future__ import annotations

import numpy as np


def arch(count: int, sway: float = 0.0, angle: float = 3.0, length: float = 0.33) -> tuple[np.ndarray, float]:
    """Markers on an arc in a tilted plane that sways, and its accumulated curve angle [rad]."""
    turned = angle + sway
    along = np.linspace(-0.5, 0.5, count)
    radius = length / turned
    flat = np.column_stack((radius * np.sin(turned * along), radius * (np.cos(turned * along) - 0.7)))
    tilt = 0.5 + 0.3 * sway
    return np.column_stack((flat[:, 0], np.sin(tilt) * flat[:, 1], np.cos(tilt) * flat[:, 1])), turned


def loop(
    count: int, radius: float = 0.085, rise: float = 0.12, turns: float = 1.15
) -> tuple[np.ndarray, float]:
    """Markers on a helix about the upright axis, and its accumulated curve angle [rad]."""
    angle = np.linspace(-np.pi * turns, np.pi * turns, count)
    c = rise / (2 * np.pi)
    positions = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), c * angle))
    return positions, float(2 * np.pi * turns * radius / np.hypot(radius, c))


def tag_poses(positions: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """Axes [n, 3, 3] of tags at positions that face a point: right, up, out."""
    result = []
    for position in positions:
        out = toward - position
        out = out / np.linalg.norm(out)
        right = np.cross(np.array([0.0, 0.0, 1.0]), out)
        right /= np.linalg.norm(right)
        result.append([right, np.cross(out, right), out])
    return np.array(result)

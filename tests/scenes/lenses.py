"""Cameras with lenses that distort, and rays through any pixel of the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Lens:
    """A camera: focal length and centre [px], distortion k1 k2 p1 p2 k3, pose world to camera [m]."""

    focal: tuple[float, float]
    centre: tuple[float, float]
    distortion: tuple[float, float, float, float, float]
    rotation: np.ndarray
    shift: np.ndarray
    width: int = 640
    height: int = 480

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels [n, 2] of positions [n, 3]."""
        inside = points @ self.rotation.T + self.shift
        return self.pixels(inside[:, :2] / inside[:, 2:])

    def pixels(self, slope: np.ndarray) -> np.ndarray:
        """Pixels of directions x/z, y/z."""
        return _bent(slope, self.distortion) * self.focal + self.centre

    def slopes(self, pixels: np.ndarray) -> np.ndarray:
        """Directions of pixels, by iterating the lens until it gives the pixel."""
        wanted = (pixels - self.centre) / self.focal
        slope = wanted.copy()
        for _ in range(60):
            step = wanted - _bent(slope, self.distortion)
            slope += step
            if np.abs(step).max() < 1e-9:
                break
        return slope

    @property
    def position(self) -> np.ndarray:
        return -self.rotation.T @ self.shift


def _bent(slope: np.ndarray, distortion: tuple[float, ...]) -> np.ndarray:
    k1, k2, p1, p2, k3 = distortion
    x, y = slope[..., 0], slope[..., 1]
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    return np.stack(
        (
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ),
        axis=-1,
    )


def towards(position: np.ndarray, target: np.ndarray, roll: float = 0.0, **lens: object) -> Lens:
    """Camera at a position that faces a target, the image's down along -z where it can be."""
    forward = target - position
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, np.array([0.0, 0.0, 1.0]))
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    turned = np.cos(roll) * right + np.sin(roll) * down, -np.sin(roll) * right + np.cos(roll) * down
    rotation = np.array([*turned, forward])
    settings = {
        "focal": (650.0, 646.0),
        "centre": (316.0, 244.0),
        "distortion": (-0.21, 0.06, 4e-4, -6e-4, 0.0),
        **lens,
    }
    return Lens(rotation=rotation, shift=-rotation @ position, **settings)  # type: ignore[arg-type]


def ring(
    count: int,
    distance: float = 0.55,
    spread: float = 0.9,
    height: float = 0.35,
    target: np.ndarray | None = None,
) -> list[Lens]:
    """Cameras side by side on an arc around a target, looking down on it, each a little different."""
    focus_point = np.zeros(3) if target is None else target
    angles = np.linspace(-0.5, 0.5, count) * spread if count > 1 else np.array([0.2])
    result = []
    for k, angle in enumerate(angles):
        way = np.array([np.sin(angle), -np.cos(angle), height + 0.12 * (k % 2)])
        lens = {
            "focal": (650.0 + 9 * k, 646.0 + 7 * k),
            "distortion": (-0.21 + 0.03 * k, 0.06, 4e-4, -6e-4, 0.0),
        }
        result.append(
            towards(focus_point + distance * way / np.linalg.norm(way), focus_point, 0.03 * k, **lens)
        )
    return result
